"""Find the effect that a model lacks in recorded data, and show the error before and after."""
