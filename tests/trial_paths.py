"""Where the shipped trials are."""

from pathlib import Path

TRIALS = Path(__file__).parents[1] / "config" / "trials"
SILICONE = TRIALS / "silicone_cube.yaml"
