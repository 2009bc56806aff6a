"""Calibration: properties of a rig, measured by experiments and written into its file."""
