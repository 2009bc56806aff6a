"""The figures of a cell of the delay study: stability, felt force, impedance, lag, energy."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import coherence, csd, welch

from teleop_rt.contact.law import linear_force, touches
from teleop_rt.master.hand import Hand
from teleop_rt.metrics import lag_s
from teleop_rt.study.delay_hand import ReplayedIntention
from teleop_rt.study.delay_plant import MATERIALS, PERIOD_S, SURFACE_M, Array, Material
from teleop_rt.study.delay_world import FORCE_MAX_N, LAW, SETTLING_S, Traces, hand_config

VELOCITY_MAX_M_PER_S = 1.0
"""A hand that becomes faster does not control the tool: the cell is unstable."""
CALM_S = 5.0
"""End of the trial, in which the intention rests."""
RMS_FACTOR = GROWTH_FACTOR = 2.0
"""A calm hand moves at most so much more than against the true local wall, or than before."""
COHERENT = 0.8
"""Coherence of motion and force above which a frequency counts in the felt impedance."""
_SEGMENT = 2048  # samples: lines of 0.5 Hz, the slowest tone of the motion


def measure(traces: Traces) -> dict[str, Any]:
    """Return the cell and its figures, JSON-ready; null where a figure is not defined."""
    figures: dict[str, Any] = asdict(traces.cell)
    figures |= {
        "felt": traces.still_tick is not None,
        "fault": None if traces.fault == "none" else traces.fault,
        "energy_min_J": traces.energy_min_J,
        "epsilon_J": traces.epsilon_J,
        "adoption_energy_J": traces.adoption_energy_J,
        "slave_force_max_N": traces.slave_force_max,
        "rendered_stiffness_N_per_m": traces.clamped_stiffness,
        "packets": {"master": traces.master_packets, "slave": traces.slave_packets},
        "models_sent": traces.models_sent,
        "ticks": len(traces.intention),
    }
    nothing = dict.fromkeys(("nrmse", "nrmse_transient", "lag_ms", "lag_to_true_ms", "impedance"))
    if traces.still_tick is None or traces.onset_tick is None:
        reason = "no contact was felt" if not traces.fault else f"slave stopped: {traces.fault}"
        return figures | nothing | {"stable": False, "unstable_because": [reason]}
    true = true_force(traces)
    reasons = _instabilities(traces)
    return (
        figures
        | _felt_force(traces, true)
        | {"impedance": _impedance(traces), "stable": not reasons, "unstable_because": reasons}
    )


def true_force(traces: Traces) -> Array:
    """Return the environment's true force at the hand's own motion, x_m - o and v_m, (n,)."""
    before, after = MATERIALS[traces.cell.environment]
    x = traces.signals["position"] - traces.signals["offset"] - SURFACE_M
    v = traces.signals["velocity"]
    stepped = np.arange(x.size) >= (x.size if traces.step_tick is None else traces.step_tick)
    clamped = traces.clamped_stiffness
    if clamped is not None:
        after = Material(clamped, after.b)
    return np.where(stepped, after.force(x, v), before.force(x, v))


def _felt_force(traces: Traces, true: Array) -> dict[str, Any]:
    """Return the error of the felt force, settled and before, and its lag.

    The lag is against the law that is rendered, the newest wall at the hand's own motion; without
    a model against the true force. Against the true force, delay and damping are one: a model whose
    damping errs by db looks late by -db/k, 2 ms of 40 N s/m on 20 kN/m, though nothing waits.
    """
    felt = traces.signals["rendered_force"]
    onset, round_trip_s = traces.onset_tick or 0, traces.cell.round_trip_ms * 1e-3
    settling = round((round_trip_s + SETTLING_S) / PERIOD_S)
    ticks = np.arange(true.size)
    transient = (ticks >= onset) & (ticks < onset + settling)
    settled = ticks >= onset + settling
    if traces.step_tick is not None:
        stepping = (ticks >= traces.step_tick) & (ticks < traces.step_tick + settling)
        transient |= stepping
        settled &= ~stepping
    span = float(np.ptp(true[onset:]))
    still = traces.still_tick or 0
    first = onset + settling if traces.step_tick is None else traces.step_tick + settling
    law = traces.signals[LAW]
    moving, longest_s = slice(first, still), round_trip_s + 0.3
    to_true = lag_s(true[moving], felt[moving], PERIOD_S, longest_s)
    lag = lag_s(law[moving], felt[moving], PERIOD_S, longest_s) if _modelled(traces) else to_true
    return {
        "nrmse": _rms(felt[settled] - true[settled]) / span if span > 0 else None,
        "nrmse_transient": _rms(felt[transient] - true[transient]) / span if span > 0 else None,
        "lag_ms": None if lag is None else lag * 1e3,
        "lag_to_true_ms": None if to_true is None else to_true * 1e3,
    }


def _modelled(traces: Traces) -> bool:
    return traces.cell.mode == "model-mediated"


def _instabilities(traces: Traces) -> list[str]:
    """Return why the cell is not stable; none where it is."""
    reasons = []
    position, force = traces.signals["position"], traces.signals["rendered_force"]
    if traces.fault != "none":
        reasons.append(f"slave stopped: {traces.fault}")
    if float(np.abs(force).max()) >= FORCE_MAX_N:
        reasons.append("force limit")
    if float(np.abs(traces.signals["velocity"]).max()) > VELOCITY_MAX_M_PER_S:
        reasons.append("velocity limit")
    calm = slice(-round(CALM_S / PERIOD_S), None)
    local = against_true_wall(traces)[calm]
    still = position[calm]
    if _spread(still) > RMS_FACTOR * _spread(local):
        reasons.append("hand does not come to rest")
    half = still.size // 2
    earlier = max(_spread(still[:half]), _spread(local[half:]))
    if _spread(still[half:]) > GROWTH_FACTOR * earlier:
        reasons.append("growing envelope")
    if traces.energy_min_J < -traces.epsilon_J:
        reasons.append("gives energy")
    return reasons


def against_true_wall(traces: Traces) -> Array:
    """Return the position of the same hand with the same intention on the true, local wall, (n,).

    Tremor and grips are those of the run; the wall is where the run's offset put it at the end.
    A mode that reflects a share of the force is compared with that share of the wall: to be soft
    is not to be unstable, and shows in the error of the felt force.
    """
    share = 1.0 if traces.cell.mode == "model-mediated" else traces.cell.gain
    before, after = MATERIALS[traces.cell.environment]
    surface = SURFACE_M + float(traces.signals["offset"][-1])
    hand = Hand(
        hand_config(),
        PERIOD_S,
        np.random.default_rng([traces.cell.seed, 3]),
        ReplayedIntention(traces.intention),
    )
    lead = traces.signals["position"].size - len(traces.intention)
    step = len(traces.intention) if traces.step_tick is None else traces.step_tick - lead
    positions, force = np.empty(len(traces.intention)), 0.0
    for tick in range(positions.size):
        x, v = hand.update(tick * PERIOD_S, force)
        positions[tick] = x
        wall, depth = (after if tick >= step else before), x - surface
        force = share * max(0.0, linear_force(depth, v, wall.k, wall.b)) if touches(depth) else 0.0
    return positions


def _impedance(traces: Traces) -> dict[str, list[float]] | None:
    """Return impedance f/v [N s/m] felt and true where the motion excites it.

    H1 estimates (Welch) of dynamic stiffness f/x over jω, from the settled motion in contact to
    its end, at frequencies where force follows position coherently; the true one is b + k/(jω).
    """
    first = (traces.step_tick or traces.onset_tick or 0) + round(
        (traces.cell.round_trip_ms * 1e-3 + SETTLING_S) / PERIOD_S
    )
    x = traces.signals["position"][first:]
    f = traces.signals["rendered_force"][first:]
    if x.size < _SEGMENT:
        return None
    hertz, cross = csd(x, f, fs=1 / PERIOD_S, nperseg=_SEGMENT)
    power = welch(x, fs=1 / PERIOD_S, nperseg=_SEGMENT)[1]
    coherent = coherence(x, f, fs=1 / PERIOD_S, nperseg=_SEGMENT)[1]
    use: NDArray[np.bool_] = (hertz > 0) & (hertz <= 20) & (power > 0) & (coherent >= COHERENT)
    omega = 2 * np.pi * hertz[use]
    felt = cross[use] / power[use] / (1j * omega)
    material = MATERIALS[traces.cell.environment][1]
    true = material.b + material.k / (1j * omega)
    return {
        "frequency_hz": hertz[use].tolist(),
        "felt": np.abs(felt).tolist(),
        "felt_phase_rad": np.angle(felt).tolist(),
        "true": np.abs(true).tolist(),
        "true_phase_rad": np.angle(true).tolist(),
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _spread(values: Array) -> float:
    return float(np.std(values))
