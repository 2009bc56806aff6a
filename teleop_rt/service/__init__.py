"""What makes the slave a daemon that a lab leaves running: its place, commands and service."""
