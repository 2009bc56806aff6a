"""The silicone cube's rig, as a pipeline sees it."""

from teleop_rt.estimation.pipeline import PipelineSettings

SETTINGS = PipelineSettings(
    period_s=1e-3,
    position_resolution=5e-6,
    force_noise=0.05,
    onset_force=0.5,
    release_force=0.3,
    force_lag_s=1e-3,
)
