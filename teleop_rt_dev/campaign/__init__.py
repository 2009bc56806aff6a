"""Campaigns, each a module with `main`."""
