"""The public Python interface; its names are those of `teleop_rt` itself."""
