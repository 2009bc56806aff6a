"""Real-time controller for 1-DOF model-mediated teleoperation."""

__version__ = "0.1.0"
