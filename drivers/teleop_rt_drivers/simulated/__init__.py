"""A simulated rig: a plant with its own physics behind devices that speak real bytes."""
