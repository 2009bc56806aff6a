"""Noise of the sensor and through the encoder, and structure beyond noise."""
