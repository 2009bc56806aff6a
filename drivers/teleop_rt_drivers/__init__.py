"""Drivers of teleop-rt: what stands between the core's axis and real or simulated devices."""
