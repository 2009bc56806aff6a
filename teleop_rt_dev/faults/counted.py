"""The rows of the fault table that are counted: packets, configs, cuts, a soak."""

from __future__ import annotations

import random
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.config.section import Units
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt.errors import RecordingError
from teleop_rt.realtime.export import recover
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.signals import SLAVE, columns
from teleop_rt_dev.faults.soak import after_faults, soak
from teleop_rt_dev.faults.table import result
from teleop_rt_dev.link.attacks import attack
from teleop_rt_dev.link.pair import Pair
from teleop_rt_dev.paths import CONFIG

UNITS = Units(position="m", force="N")
STAMP = columns(SLAVE)["stamp_ns"]
PACKETS = "packets replayed, flipped, foreign"
SOAK_FAULTS = 100


def packets(count: int, seed: int) -> dict[str, Any]:
    """Send the slave replayed, bit-flipped and foreign packets; none may be accepted."""
    found = attack(Pair(seed=seed), count, seed)
    problem = f"{found.accepted} accepted" if found.accepted or found.moved else ""
    return result(PACKETS, count, problem, f"{found.accepted} accepted")


def mutated_configs(count: int, seed: int) -> dict[str, Any]:
    """Change shipped configs at random places: valid, or refused with file, place and reason."""
    chosen = random.Random(seed)
    trials = sorted((CONFIG / "trials").glob("*.yaml"))
    valid, unclear = 0, []
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name) / "config"
        for kind in ("rigs", "trials"):
            (copy / kind).mkdir(parents=True)
            for file in (CONFIG / kind).glob("*.yaml"):
                (copy / kind / file.name).write_bytes(file.read_bytes())
        for _ in range(count):
            trial = copy / "trials" / chosen.choice(trials).name
            victim = chosen.choice((trial, *(copy / "rigs").glob("*.yaml")))
            shipped = victim.read_text(encoding="utf-8")
            victim.write_text(mutated(shipped, chosen), encoding="utf-8")
            try:
                load_trial_file(trial, [])
                valid += 1
            except ConfigError as error:
                if not all(problem.message for problem in error.problems):
                    unclear.append(str(error))
            except Exception as error:  # noqa: BLE001 - this must not happen
                unclear.append(f"{type(error).__name__}: {error}")
            finally:
                victim.write_text(shipped, encoding="utf-8")
    refused = count - valid - len(unclear)
    state = f"{refused} refused, {valid} valid"
    return result("mutated YAML", count, "; ".join(unclear[:3]), state)


def mutated(text: str, chosen: random.Random) -> str:
    for _ in range(chosen.randint(1, 4)):
        at = chosen.randrange(len(text))
        put = "".join(chosen.choice(" \n:{}[]-#&*!|>'\"%@`0e.~a\t\u00e9") for _ in range(3))
        text = text[:at] + put[: chosen.randint(0, 3)] + text[at + chosen.randint(0, 12) :]
    return text


def cut_everywhere() -> dict[str, Any]:
    """Cut a recording at every byte: the rows that `recover` saves never shrink, nor are wrong."""
    with tempfile.TemporaryDirectory() as name:
        whole, cut, saved = (Path(name) / f"{one}.mcap" for one in ("whole", "cut", "saved"))
        writer = RecordingWriter(whole, UNITS)
        writer.add_topic("/slave", (SLAVE[STAMP],))
        table = np.arange(60.0)[:, np.newaxis]
        for start in range(0, 60, 20):
            writer.write_rows("/slave", table[start : start + 20])
            writer.flush()
        writer.close()
        data, counts = whole.read_bytes(), [0]
        for length in range(len(data) + 1):
            cut.write_bytes(data[:length])
            saved.unlink(missing_ok=True)
            try:
                counts.append(recover(cut, saved))
            except RecordingError:  # nothing is left
                counts.append(0)
    fair = counts == sorted(counts) and set(counts) == {0, 20, 40, 60}
    problem = "" if fair else f"saved {sorted(set(counts))}"
    return result("recording cut at every byte", len(data) + 1, problem, "readable")


def soaked(faults: int, seed: int) -> dict[str, Any]:
    """Harm a daemon at random; memory and descriptors stay the same."""
    found = soak(after_faults(faults), seed)
    state = f"{found['grown_KiB']} KiB, {found['new_descriptors']} descriptors more"
    problem = "" if found["holds"] else f"{state}; {found['problems']}"
    return result("soak", sum(found["faults"].values()), problem, state)


def counted(seeds: int, packet_count: int, configs: int) -> Iterator[Any]:
    """Give name and work of each row."""
    yield PACKETS, lambda: packets(packet_count, seeds)
    yield "mutated YAML", lambda: mutated_configs(configs, seeds)
    yield "recording cut at every byte", cut_everywhere
    yield "soak", lambda: soaked(SOAK_FAULTS, seeds)
