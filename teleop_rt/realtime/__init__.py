"""The real-time side: clock, loop, ring and recorder."""
