"""Where the checkout and its shipped files are."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "config"
RIGS = CONFIG / "rigs"
TRIALS = CONFIG / "trials"
SILICONE = TRIALS / "silicone_cube.yaml"
