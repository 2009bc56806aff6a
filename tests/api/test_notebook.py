"""The example notebook runs, and its stored outputs are the ones that it gives."""

import re
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[2]

from teleop_rt_dev.docs.notebook import NOTEBOOK, run  # noqa: E402 - beside the scripts

NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def outputs(notebook):
    """Return each output as text by its kind; pictures by their kind alone."""
    for cell in notebook.cells:
        for one in cell.get("outputs", []):
            if one.output_type == "stream":
                yield "text", one.text
            for kind, content in sorted(one.get("data", {}).items()):
                yield kind, "" if kind.startswith("image/") else content


def test_the_notebook_runs_and_its_stored_outputs_are_those_of_the_run():
    stored = nbformat.read(NOTEBOOK, as_version=4)
    again = run(NOTEBOOK)
    assert all(cell.execution_count for cell in stored.cells if cell.cell_type == "code")
    pairs = list(zip(outputs(stored), outputs(again), strict=True))
    assert {kind for (kind, _), _ in pairs} == {"text", "text/plain", "text/html", "image/png"}
    for (kind, result), (kind_again, again_text) in pairs:
        assert kind == kind_again
        assert NUMBER.sub("#", result) == NUMBER.sub("#", again_text)
        numbers = [float(number) for number in NUMBER.findall(result)]
        # Other processors sum in another order; deviations have two digits.
        assert [float(n) for n in NUMBER.findall(again_text)] == pytest.approx(numbers, rel=0.1)
