"""A pair of link endpoints, and attackers of it."""
