"""Find what a model lacks in recorded data, name it, and show the error before and after."""
