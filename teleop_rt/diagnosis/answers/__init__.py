"""What is said: sizes, errors on unseen data, what could have been seen, and notes."""
