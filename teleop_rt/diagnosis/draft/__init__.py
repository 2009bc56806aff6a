"""A law of the user's own, drafted from what no declared effect explains."""
