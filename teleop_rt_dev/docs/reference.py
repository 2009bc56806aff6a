"""The pages of the reference, made from the code: schema, commands, signals, faults, effects."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from teleop_rt import signals
from teleop_rt.cli import app
from teleop_rt.cli.schema import SchemaName
from teleop_rt.cli.schemas import schema_named
from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.contact.effect import handling_in_words
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.estimation.rows import rows_for
from teleop_rt.slave.estimate_log import estimate_table
from teleop_rt.slave.faults import FAULTS, State
from teleop_rt.trial.folder import plain_json
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_dev.docs import keys as docs_keys
from teleop_rt_dev.docs import rigs as docs_rigs
from teleop_rt_dev.docs import schema as docs_schema
from teleop_rt_dev.docs.table import table
from teleop_rt_dev.paths import SILICONE
from teleop_rt_drivers.simulated.reference import environment_force

_UNITS = "`{x}` is the rig's unit of position (m or rad), `{f}` that of force (N or Nm)."
_ANSWER = """# Answer of diagnose

Generated from the JSON Schema that `teleop-rt schema answer` prints, of each line that
`teleop-rt diagnose --json` prints: an Answer, or a Problem where a recording cannot be used.

"""
_COMMANDS = """# Command line

Generated from the program. Exit codes: 0 done, 1 a fault during the work, 2 bad arguments, config
or input, before anything moves.
"""
_SIGNALS = f"""# Recorded signals

Generated from `teleop_rt/signals.py`. `recording.mcap` holds one JSON channel per table;
not-a-number is null. {_UNITS}
"""


def pages() -> dict[str, str]:
    """Return the text of each generated page by its name."""
    return {
        **docs_keys.pages(),
        "commands": commands_page(),
        "signals": signals_page(),
        "summary": summary_page(),
        "answer": _ANSWER + keys_of("answer"),
        "faults": faults_page(),
        "effects": effects_page(),
        "rigs": docs_rigs.TEXT + table(docs_rigs.HEADER, list(docs_rigs.rows())),
    }


def commands_page() -> str:
    """Return every command with its arguments and options."""
    parts = [_COMMANDS]
    for name, command in app.load_all().items():
        if not command.hidden:
            parts += list(_commands(command, f"teleop-rt {name}"))
    return "\n".join(parts)


def _commands(command: Any, path: str) -> Iterator[str]:
    children = getattr(command, "commands", None)
    if children:
        for name, child in children.items():
            if not child.hidden:
                yield from _commands(child, f"{path} {name}")
        return
    rows = []
    for parameter in command.params:
        if getattr(parameter, "hidden", False) or parameter.name == "help":
            continue
        option = parameter.param_type_name == "option"
        name = ", ".join(parameter.opts) if option else parameter.name.upper()
        default = "" if parameter.default in (None, (), False) else f"`{parameter.default}`"
        needed = "required" if parameter.required else default
        rows.append((f"`{name}`", needed, getattr(parameter, "help", "") or ""))
    yield f"## `{path}`\n\n{command.help or ''}\n"
    if rows:
        yield table(("argument", "default", "meaning"), rows)


def signals_page() -> str:
    """Return every recorded signal with unit and sign."""
    parts = [_SIGNALS]
    sides = (
        ("/slave", signals.SLAVE),
        ("/master", signals.MASTER),
        ("/truth/plant", signals.TRUTH),
    )
    (row,) = rows_for(["kelvin-voigt"], ["direct"], ["rls"])
    estimates = ("/estimates/MODEL/REGRESSION/SOLVER", estimate_table(row))
    for topic, signal_table in (*sides, estimates):
        if topic.startswith("/estimates"):
            parts.append(f"## `{topic}`\n\nOne per estimator; here those of `kelvin-voigt`.\n")
        else:
            parts.append(f"## `{topic}`\n")
        rows = [(f"`{s.name}`", f"`{s.unit}`", s.meaning) for s in signal_table]
        parts.append(table(("signal", "unit", "meaning"), rows))
    parts.append("States: " + ", ".join(f"{state.value} {state.name}" for state in State) + ".\n")
    return "\n".join(parts)


def summary_page() -> str:
    """Return the keys of summary.json, from the summary of a run that ends at once."""
    rows = [(f"`{key}`", f"`{value}`") for key, value in _flat(_summary_of_a_short_run())]
    return (
        "# summary.json\n\nGenerated from a run of two seconds on simulated time. Lists show their"
        " first entry. A number that is not known is null, with a `reason` beside it. SI, or the"
        " rig's units where it is a rotary one. `teleop-rt schema summary` prints its schema.\n\n"
        + keys_of("summary")
        + "\n## Example\n\n"
        + table(("key", "for example"), rows)
    )


def keys_of(name: str) -> str:
    """Return the keys of JSON that is printed, from its schema: type and meaning of each."""
    parts = []
    for one in docs_schema.sections(schema_named(SchemaName(name))):
        kept = [(key, kind, meaning) for key, kind, _, _, meaning in one.rows]
        parts += [f"### {one.heading}\n\n{one.meaning}\n", table(("key", "type", "meaning"), kept)]
    return "\n".join(parts)


def _summary_of_a_short_run() -> dict[str, Any]:
    trial_file = SILICONE
    trial = load_trial_file(trial_file, ["duration_s=2.0"])
    with TemporaryDirectory() as name:
        folder = Path(name)
        outcome = run_lockstep(trial, trial_file, open_bench, folder, lambda _seconds: None)
        found: dict[str, Any] = plain_json(summarise(folder, trial, outcome, environment_force))
        return found


def _flat(content: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(content, dict) and content:
        for key, value in content.items():
            yield from _flat(value, f"{path}.{key}" if path else key)
    elif isinstance(content, list) and content:
        yield from _flat(content[0], f"{path}[0]")
    else:
        yield path, f"{content:.6g}" if isinstance(content, float) else content


def faults_page() -> str:
    """Return every fault with its code, cause and next step."""
    rows = [
        (str(fault.code), f"`{fault.name}`", fault.cause, fault.next_step)
        for fault in FAULTS.values()
    ]
    return (
        "# Fault codes\n\nGenerated from `teleop_rt/slave/faults.py`. The first fault is kept until"
        " a reset, and a reset never restarts motion. This is not a certified safety"
        " function. Wire the emergency stop to the drive's STO.\n\n"
        + table(("code", "name", "cause", "next step"), rows)
    )


def effects_page() -> str:
    """Return every declared effect with where it belongs and its parameters."""
    rows = []
    for effect in LIBRARY:
        amplitude = () if effect.amplitude.unity else (effect.amplitude,)
        names = ", ".join(f"{p.name} [`{p.unit}`]" for p in (*amplitude, *effect.shapes))
        belongs = f"{effect.belongs_to}, {effect.stage}"
        handling = handling_in_words(effect.compensation)
        rows.append((f"`{effect.name}`", belongs, names, handling, effect.sentence))
    return (
        "# Effects\n\nGenerated from the declarations that simulation, regression, on-line"
        f" estimation, compensation and rendering share. {_UNITS}\n\n"
        + table(("name", "belongs to", "parameters", "on-line", "in words"), rows)
    )
