"""The master's recorded row: each value in the column of its name."""

from types import SimpleNamespace

import numpy as np

from teleop_rt.master.rows import record
from teleop_rt.realtime.row import NamedRow
from teleop_rt.signals import MASTER

ELSEWHERE = ("work_us", "wake_latency_us")
"""Columns that are not of the master's cycle."""


def master_of(row, of):
    """Return the parts of a master that a row reads, with each value of `of` in its place."""
    return SimpleNamespace(
        row=row.values,
        tick=of["tick"],
        position=of["position"],
        velocity=of["velocity"],
        target=of["target"],
        force=of["rendered_force"],
        silence_ns=1e6 * of["silence_ms"],
        energy_scale=2.0,
        slave=SimpleNamespace(force=of["reflected_force"], inadequate=True),
        registration=SimpleNamespace(offset=of["offset"]),
        adoption=SimpleNamespace(
            newest=SimpleNamespace(surface=of["surface"]),
            weight=of["blend"],
            energy_J=0.5 * of["adoption_energy"],
        ),
        intake=SimpleNamespace(
            acknowledged=of["contact_id"],
            model=SimpleNamespace(model_sequence=of["model_sequence"]),
        ),
        engagement=SimpleNamespace(
            state=of["state"],
            engagements=of["engagements"],
            freezes=of["freezes"],
            declutches=of["declutches"],
        ),
        endpoint=SimpleNamespace(
            statistics=SimpleNamespace(
                received=of["packets_received"],
                lost=of["packets_lost"],
                refused=of["packets_rejected"],
            ),
            trouble_code=lambda _: of["trouble"],
        ),
        screening=SimpleNamespace(refusals=of["refused_models"]),
        observer=SimpleNamespace(energy_J=of["port_energy"]),
        rendered_bound=SimpleNamespace(
            true_stiffness=of["true_stiffness"],
            rendered_stiffness=of["rendered_stiffness"],
            true_damping=of["true_damping"],
            rendered_damping=of["rendered_damping"],
        ),
        fault=SimpleNamespace(code=of["handle_fault"]),
    )


def test_every_value_is_in_the_column_of_its_name():
    row = NamedRow(MASTER)
    names = [signal.name for signal in MASTER if signal.name not in ELSEWHERE]
    of = {name: 10.0 + at for at, name in enumerate(names)}
    record(master_of(row, of), of["stamp_ns"])
    stored = row.stored[0]
    wrong = {name for name in names if stored[name] != of[name]}
    assert wrong == {"inadequate"}, "this one is a flag"
    assert stored["inadequate"] == 1.0
    assert np.isnan([stored[name] for name in ELSEWHERE]).all()
