"""From samples to a motion: derivatives, surface, and what must be left out."""
