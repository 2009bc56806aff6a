"""The slave as a daemon that keeps running in a lab: its place, commands and service."""
