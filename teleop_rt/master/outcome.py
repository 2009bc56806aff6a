"""The master's report of a trial: energies, limits that acted, and refused models."""

from __future__ import annotations

from typing import Any

from teleop_rt.master.master import Master

_NO_MASS = {"rendered": 0.0, "reason": "the operator's device measures no acceleration"}


def outcome(master: Master) -> dict[str, Any]:
    """Return the master's own account, JSON-ready; forces and energies are the hand's [SI]."""
    bound, observer, adoption = master.rendered_bound, master.observer, master.adoption
    model, engagement = master.intake.model, master.engagement
    return {
        "state": engagement.state.name,
        "engagement": {
            "engagements": engagement.engagements,
            "freezes": engagement.freezes,
            "declutches": engagement.declutches,
        },
        "passivity": {
            "stiffness": {"true": bound.true_stiffness, "rendered": bound.rendered_stiffness},
            "damping": {"true": bound.true_damping, "rendered": bound.rendered_damping},
            "stiffness_max": master.limiter.stiffness_max,
            "required_damping": bound.required_damping,
            "reduced": bound.reduced,
            "energy_min_J": observer.lowest_J,
            "epsilon_J": observer.epsilon_J,
            "missing_J": observer.missing_J,
            "injected_J": observer.injected_J,
            "surface_J": observer.surface_J,
        },
        "adoption": {
            "largest_force_step": adoption.largest_step * master.force_scale,
            "energy_J": adoption.energy_J * master.energy_scale,
            "tank_J": adoption.tank.level_J * master.energy_scale,
        },
        "handle": _handle(master),
        "mass": None if model is None else {"estimated": model.m} | _NO_MASS,
        "refused_models": dict(master.screening.refused),
        "clamped_damping": master.screening.clamped,
        "refused_walls": master.intake.refused,
        "withdrawn_walls": master.intake.withdrawn,
    }


def _handle(master: Master) -> dict[str, Any]:
    """Return the interventions of leash, watch and safety chain of the operator's device."""
    fault, leash = master.fault, master.leash
    return {
        "fault": {
            "code": fault.code,
            "name": fault.name,
            "cause": fault.cause,
            "next_step": fault.next_step,
        },
        "unsafe": master.unsafe,
        "boundings": master.shaking.boundings,
        "softenings": master.shaking.softenings,
        "longest_lead": leash.longest,
        "leash_slipped": leash.slipped,
        "largest_leash_force": master.force_scale * leash.largest,
        "withheld_at_ends": master.ends.withheld,
    }
