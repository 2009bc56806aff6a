"""Synthetic recordings, and rivals and peers of the diagnosis."""
