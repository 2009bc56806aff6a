"""Benches of speed, each a module whose `run` takes the rounds and returns rows."""
