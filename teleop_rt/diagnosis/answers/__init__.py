"""Answers: sizes, errors on unseen data, detectable sizes, and notes."""
