"""What a rig is, found by experiments at it, and written into its file."""
