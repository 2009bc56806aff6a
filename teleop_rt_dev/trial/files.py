"""The shipped trials, loaded as the command line loads them."""

from pathlib import Path

from teleop_rt.config.loader import load_trial
from teleop_rt.config.trial import PlantConfig, TrialConfig
from teleop_rt_dev.paths import SILICONE, TRIALS
from teleop_rt_drivers import registry

MEASURED_SPRING = TRIALS / "measured_spring.yaml"


def load(path: Path, *overrides: str) -> TrialConfig:
    return load_trial(path, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, list(overrides))


def plant_of(trial: TrialConfig) -> PlantConfig:
    """Return the simulated plant of a trial that has one."""
    assert trial.plant is not None
    return trial.plant


def silicone(*overrides: str) -> TrialConfig:
    return load(SILICONE, *overrides)
