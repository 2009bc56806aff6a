"""The studies, which are lent what only the command line knows: the drivers."""

from __future__ import annotations

from typer.main import get_command

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.study.chapter4_wiring import Wiring
from teleop_rt.study.commands import app

study = get_command(app)
study.context_settings["obj"] = Wiring(load_trial_file, open_bench)
