"""Every recorded signal, once: name, unit, sign and meaning.

A ring row is a vector of float64, one column per signal of its table; the recorder makes one
MCAP channel per table. Units are written with {x} and {f} for the rig's units of position and
force; `ns` and counts stay exact in float64 for more than a hundred days.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Signal:
    """One recorded signal."""

    name: str
    unit: str
    meaning: str

    @property
    def integer(self) -> bool:
        """True for stamps, counts, codes and flags, which are recorded without a fraction."""
        return self.unit in {"ns", "count"}


SLAVE = (
    Signal("tick", "count", "number of the slave's cycle, skipped ticks counted"),
    Signal("stamp_ns", "ns", "slave clock at the start of the cycle"),
    Signal("sample_stamp_ns", "ns", "when the sample was latched"),
    Signal("position_age_ms", "ms", "age of the position's own stamp at the start of the cycle"),
    Signal("force_age_ms", "ms", "age of the force's own stamp at the start of the cycle"),
    Signal("valid", "count", "1 where position and force are checked, and new or not too old"),
    Signal("position", "{x}", "axis position, > 0 towards the environment"),
    Signal("force", "{f}", "measured force, > 0 when the tool presses on the environment"),
    Signal("inadequate", "count", "1 while the selected model leaves structure in the force"),
    Signal("rig_force", "{f}", "part of the force that the rig's own effects make; 0 if unknown"),
    Signal(
        "filtered_force", "{f}", "measured force as the estimators see it: aligned and filtered"
    ),
    Signal("velocity", "{x}/s", "velocity from the differentiator, > 0 towards the environment"),
    Signal("in_contact", "count", "1 while contact is detected"),
    Signal("contact_id", "count", "number of contacts found so far"),
    Signal("surface", "{x}", "surface found, axis coordinate; null while unknown"),
    Signal("surface_deviation", "{x}", "standard deviation of the surface; null while unknown"),
    Signal("selected", "count", "row of the selected estimator; null while none"),
    Signal(
        "predicted_force", "{f}", "force predicted by the selected model; null outside of contact"
    ),
    Signal("target", "{x}", "position the master asks for, axis coordinate"),
    Signal("command", "{x}", "position commanded after every limit"),
    Signal("state", "count", "safety state"),
    Signal("fault", "count", "fault code, 0 for none"),
    Signal("missing", "count", "cycles in a row without a valid sample"),
    Signal("model_sequence", "count", "sequence of the last model sent"),
    Signal("silence_ms", "ms", "time since the last packet accepted from the master"),
    Signal("packets_received", "count", "packets accepted from the master so far"),
    Signal("packets_lost", "count", "packets of the master that never came, so far"),
    Signal("packets_rejected", "count", "packets refused so far, those overtaken left out"),
    Signal("trouble", "count", "what keeps the link from standing, 0 for nothing"),
    Signal("followings", "count", "how often it began to follow the master"),
    Signal("holds", "count", "how often it stopped following, and held"),
    Signal("held_by", "count", "what it last held for: 1 no motion, 2 a late loop, 3 a device"),
    Signal("work_us", "us", "time spent in the cycle; null on the simulated clock"),
    Signal("wake_latency_us", "us", "wake-up after the deadline; null on the simulated clock"),
)

MASTER = (
    Signal("tick", "count", "number of the master's cycle, skipped ticks counted"),
    Signal("stamp_ns", "ns", "master clock at the start of the cycle"),
    Signal("position", "{x}", "operator's position x_m, > 0 towards the environment"),
    Signal("velocity", "{x}/s", "operator's velocity"),
    Signal("offset", "{x}", "offset o = x_m - x_s kept since first contact"),
    Signal("target", "{x}", "position sent to the slave, x_m - o"),
    Signal("rendered_force", "{f}", "force rendered to the operator, > 0 pushes back"),
    Signal("surface", "{x}", "surface rendered, slave coordinate; null while unknown"),
    Signal("blend", "1", "weight w of the newest model"),
    Signal("reflected_force", "{f}", "newest slave force received; null before the first"),
    Signal("contact_id", "count", "contact acknowledged by the master"),
    Signal("model_sequence", "count", "sequence of the newest model accepted"),
    Signal("state", "count", "link state of the master"),
    Signal("silence_ms", "ms", "time since the last packet accepted from the slave"),
    Signal("packets_received", "count", "packets accepted from the slave so far"),
    Signal("packets_lost", "count", "packets of the slave that never came, so far"),
    Signal("packets_rejected", "count", "packets refused so far, those overtaken left out"),
    Signal("refused_models", "count", "models and states that were not fit to be rendered"),
    Signal("engagements", "count", "how often the slave was engaged"),
    Signal("freezes", "count", "how often silence froze the target"),
    Signal("declutches", "count", "how often the force faded: silence, or no one following"),
    Signal("adoption_energy", "J", "energy spent on adopting walls so far, at the hand"),
    Signal("port_energy", "J", "energy that the hand gave in this contact, observed"),
    Signal("true_stiffness", "{f}/{x}", "largest stiffness of the newest wall"),
    Signal("rendered_stiffness", "{f}/{x}", "as far as the device renders it passively"),
    Signal("true_damping", "{f} s/{x}", "largest damping of the newest wall"),
    Signal("rendered_damping", "{f} s/{x}", "as far as the device renders it passively"),
    Signal("handle_fault", "count", "why the operator's device was let go, 0 for nothing"),
    Signal("inadequate", "count", "1 while the slave says that its model is inadequate"),
    Signal("trouble", "count", "what keeps the link from standing, 0 for nothing"),
    Signal("work_us", "us", "time spent in the cycle; null on the simulated clock"),
    Signal("wake_latency_us", "us", "wake-up after the deadline; null on the simulated clock"),
)

TRUTH = (
    Signal("stamp_ns", "ns", "time of the plant"),
    Signal("position", "{x}", "true position of the tool"),
    Signal("velocity", "{x}/s", "true velocity of the tool"),
    Signal("force", "{f}", "true contact force"),
    Signal("reference", "{x}", "position commanded at the drive"),
    Signal("drive_mode", "count", "0 without voltage, 1 following, 2 stopping by itself"),
)

HANDLE_TRUTH = (
    Signal("stamp_ns", "ns", "time of the plant"),
    Signal("position", "{x}", "true position of the operator's device"),
    Signal("velocity", "{x}/s", "true velocity of the device"),
    Signal("hand_force", "{f}", "true force of the hand on the device"),
    Signal("motor_force", "{f}", "true force of the motor, > 0 pushes the operator back"),
    Signal("hand_energy", "J", "true energy that the hand has given to the device so far"),
)

SLAVE_TOPIC, MASTER_TOPIC, TRUTH_TOPIC = "/slave", "/master", "/truth/plant"
HANDLE_TRUTH_TOPIC = "/truth/handle"
"""The topics of these tables."""


def columns(table: tuple[Signal, ...]) -> dict[str, int]:
    """Return the column of each signal of a table by name."""
    return {signal.name: index for index, signal in enumerate(table)}
