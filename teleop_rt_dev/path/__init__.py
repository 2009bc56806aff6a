"""The path from the command `run` to a tick, as a picture made from the code."""
