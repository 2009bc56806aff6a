"""Shipped trials as the command line loads them, and loops closed over them."""
