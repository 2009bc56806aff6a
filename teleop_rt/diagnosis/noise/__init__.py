"""What noise there is, of the sensor and through the encoder, and what is more than noise."""
