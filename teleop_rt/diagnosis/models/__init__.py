"""Base models with effects: their prediction in free run, and their fit."""
