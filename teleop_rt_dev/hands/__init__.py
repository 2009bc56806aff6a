"""Hands drawn at random, an ideal hand, and the best wall that a handle could show."""
