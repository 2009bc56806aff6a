"""One trial from start to finish: its processes or its lock-step, its folder, its summary."""
