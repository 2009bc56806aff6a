"""The shipped trials, loaded as the command line loads them."""

from pathlib import Path

from teleop_rt.config_loader import load_trial
from teleop_rt_dev.paths import SILICONE, TRIALS
from teleop_rt_drivers import registry

MEASURED_SPRING = TRIALS / "measured_spring.yaml"


def load(path: Path, *overrides: str):
    return load_trial(path, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, list(overrides))


def silicone(*overrides: str):
    return load(SILICONE, *overrides)
