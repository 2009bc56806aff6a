"""From samples to a motion: derivatives, surface, and samples to be left out."""
