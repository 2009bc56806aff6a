"""A drafted law as a Python file that `--effects` takes: units, bounds, and a comment to read."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from teleop_rt.diagnosis.draft.choice import Law
from teleop_rt.diagnosis.draft.terms import BEYOND, MEMORIES, Term
from teleop_rt.recordings.excerpt import most_active
from teleop_rt.recordings.recording import Recording

NAME = "draft_effect"
FILE = "draft_effect.py"
_FARTHER = 3.0  # how far a weight may go from the draft, of itself and of the largest term
_FACTOR = 5.0  # how far a time or a travel may go from the draft
_WHERE = {
    True: ('"environment"', '"material"', '"render"'),
    False: ('"rig"', '"tool"', '"subtract_force"'),
}
_PAGE = '''"""A law of the force that a recording asks for.

Drafted from {recording}: no declared effect explains the model's residual there. Give the effect
a name, describe it in `sentence`, and correct wrong values; see docs/howto/effect.md.

The residual of the base depends on: {shares}.
The law is the sum of {count}: {words}.
Beyond {beyond:g} times the range seen it stays as it is there.
"""

{imports}from teleop_rt.contact.effect import Amplitude, Effect, Shape
from teleop_rt.kernels.jit import kernel

DRAFTED_FROM = "{data}"  # the data of {recording}: only others can confirm the law
{constants}


@kernel
def drafted(state, x, v, a, t, dt, eta):
    """Return the law per unit of its amplitude."""
{body}


DRAFT = Effect(
    name="{name}",
    family="{family}",
    belongs_to={belongs_to},  # the operator feels the environment's, the rig's is taken off
    stage={stage},
    amplitude=Amplitude("draft_force", "{{f}}"),
    shapes=({shapes}),
    step=drafted,
    sentence="A drafted law of {{draft_force}}.",
    compensation={compensation},
    state_size={states},
    derivative_order={order},
    only_in_contact={gated},
)
{known}
'''


def identity(recording: Recording) -> str:
    """Return a name for the data of a recording, by which a draft knows them again."""
    part, _ = most_active(recording)
    digest = sha256(part.position.tobytes())
    digest.update(part.force.tobytes())
    return digest.hexdigest()[:16]


def drafted_from(effects: Path, recording: Recording) -> bool:
    """Return whether a file of effects holds a law that was drafted from this recording."""
    return f'"{identity(recording)}"' in effects.read_text(encoding="utf-8")


def text_of(
    law: Law, recording: str, units: tuple[str, str], own: Path | None = None, data: str = ""
) -> str:
    """Return the file's text; `own` is a file of the user's effects, which the draft keeps.

    `data` is the `identity` of the recording.
    """
    visible = {group: share for group, share in law.shares.items() if share >= 0.01}
    ranked = sorted(visible.items(), key=lambda item: -item[1])
    body, shapes, states = _body(law), _shapes(law), len(_memories(law.terms))
    used = [name for name in ("copysign", "exp", "tanh") if f"{name}(" in body]
    belongs_to, stage, compensation = _WHERE[law.only_in_contact]
    names = _variables(law)
    return _PAGE.format(
        recording=recording,
        shares=", ".join(f"{group} {100.0 * share:.0f} %" for group, share in ranked) or "nothing",
        count="one term" if len(law.terms) == 1 else f"{len(law.terms)} terms",
        words="; ".join(_counted(law)),
        data=data,
        beyond=BEYOND,
        imports=f"from math import {', '.join(used)}\n\n" if used else "",
        constants="\n".join(_constants(law, names, units)),
        body=body,
        name=NAME,
        family=law.terms[0].family,
        belongs_to=belongs_to,
        stage=stage,
        shapes=shapes,
        compensation=compensation,
        states=states,
        order=2 if "w" in names else 1 if {"u", "g", "ds"} & names else 0,
        gated=law.only_in_contact,
        known=_known(own),
    )


def _counted(law: Law) -> list[str]:
    """Return the words of the terms; terms in the same words are counted behind them."""
    found = Counter(term.words for term in law.terms)
    return [words if n == 1 else f"{words} ({n} terms)" for words, n in found.items()]


def _known(own: Path | None) -> str:
    if own is None:
        return "EFFECTS = (DRAFT,)"
    return (
        "\n# Your other effects, so that one file has all.\n"
        "from pathlib import Path  # noqa: E402\n\n"
        "from teleop_rt.contact.effects.user import load_file  # noqa: E402\n\n"
        f"EFFECTS = (*load_file(Path({str(own.resolve())!r})), DRAFT)"
    )


def _variables(law: Law) -> set[str]:
    """Return the quantities that the law's expressions and memories name."""
    texts = [term.expression for term in law.terms]
    texts += [MEMORIES[key].update for key, _ in _memories(law.terms)]
    return set(re.findall(r"\b(?:s|r|u|w|g|ds)\b", " ".join(texts)))


def _constants(law: Law, names: set[str], units: tuple[str, str]) -> list[str]:
    """Return the scales that the law is written in, with units."""
    x, scaling = units[0], law.scaling
    lines = [f"BEYOND = {BEYOND!r}  # of the range seen"]
    if not scaling.touches:
        lines.append(f"MIDDLE = {scaling.middle!r}  # {x}, of the positions seen")
    lines.append(f"RANGE = {scaling.travel!r}  # {x}, at which s is 1")
    if "u" in names:
        lines.append(f"SPEED = {scaling.speed!r}  # {x}/s, at which u is 1")
    if "w" in names:
        lines.append(f"ACCELERATION = {scaling.acceleration!r}  # {x}/s^2, at which w is 1")
    if "g" in names:
        lines.append(
            f"STIFFNESS = {scaling.k / scaling.force!r}  # 1/{x}, of the base, over its peak"
        )
        lines.append(
            f"DAMPING = {scaling.b / scaling.force!r}  # s/{x}, of the base, over its peak"
        )
    return lines


def _body(law: Law) -> str:
    """Return the statements of the kernel."""
    names, scaling = _variables(law), law.scaling
    away = "x" if scaling.touches else "(x - MIDDLE)"
    inside = " if x > 0.0 else 0.0" if scaling.touches else ""
    lowest = "0.0" if scaling.touches else "-BEYOND"
    lines = [f"s = min(max({away} / RANGE, {lowest}), BEYOND)"] if "s" in names else []
    if "r" in names:
        lines.append(f"r = min(abs({away}) / RANGE, BEYOND)")
    for name, text in (("u", "v / SPEED"), ("w", "a / ACCELERATION")):
        if name in names:
            lines.append(f"{name} = min(max({text}, -BEYOND), BEYOND)")
    if "g" in names:
        lines.append(f"g = STIFFNESS * {away} + DAMPING * v{inside}")
    if "ds" in names:
        lines.append(f"ds = v * dt / RANGE{inside}")
    for i, (key, value) in enumerate(_memories(law.terms)):
        parameter = _places(law)[key, value]
        statement = MEMORIES[key].update.format(f"eta[{parameter}]")
        statement = statement.replace("sign(ds)", "(copysign(1.0, ds) if ds != 0.0 else 0.0)")
        own = f"{key}{i}"
        statement = re.sub(rf"\b{key}\b", own, statement)
        lines += [f"{own} = state[{i}]", statement, f"state[{i}] = {own}"]
    for i, term in enumerate(law.terms):
        text = _expression(law, term)
        lines.append(f"value = {text}" if i == 0 else f"value += eta[{i - 1}] * ({text})")
    return "\n".join(f"    {line}" for line in [*lines, "return value"])


def _expression(law: Law, term: Term) -> str:
    if not term.memory:
        return term.expression
    number = _memories(law.terms).index((term.memory, term.value))
    return re.sub(rf"\b{term.memory}\b", f"{term.memory}{number}", term.expression)


def _memories(terms: Sequence[Term]) -> list[tuple[str, float]]:
    """Return the memories of the terms, each once, with the value of its parameter."""
    return list(dict.fromkeys((term.memory, term.value) for term in terms if term.memory))


def _places(law: Law) -> dict[tuple[str, float], int]:
    """Return at which shape parameter each memory's own stands; they come after the weights."""
    found, place = {}, len(law.terms) - 1
    for key, value in _memories(law.terms):
        found[key, value] = place
        place += bool(MEMORIES[key].parameter)
    return found


def _shapes(law: Law) -> str:
    """Return the shape parameters: the weights of all terms but the first, then the memories'."""
    first = law.coefficients[0]
    lines = []
    for number, coefficient in enumerate(law.coefficients[1:], start=2):
        start = coefficient / first
        reach = _FARTHER * (abs(start) + 1.0)
        bounds = f"{start - reach:.4g}, {start + reach:.4g}, {start:.8g}"
        lines.append(f'Shape("weight_{number}", "1", {bounds}, points=1)')
    for number, (key, value) in enumerate(_memories(law.terms), start=1):
        memory = MEMORIES[key]
        if memory.parameter:
            bounds = f"{value / _FACTOR:.4g}, {value * _FACTOR:.4g}, {value:.8g}"
            lines.append(
                f'Shape("{memory.parameter}_{number}", "{memory.unit}", {bounds},'
                " logarithmic=True, points=1)"
            )
    return "".join(f"\n        {line}," for line in lines) + ("\n    " if lines else "")
