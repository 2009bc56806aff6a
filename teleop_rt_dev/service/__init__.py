"""Daemons in folders of their own, and those who keep them busy."""
