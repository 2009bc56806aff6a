"""Pages and terminal output for people."""
