"""The table of faults, the worlds in which they are played, and real processes."""
