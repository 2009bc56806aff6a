"""Drivers of teleop-rt, between the core's axis and real or simulated devices."""
