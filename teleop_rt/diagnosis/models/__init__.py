"""Base models with effects: what they predict in free run, and their fit."""
