"""Draft of a law for a residual that no declared effect explains."""
