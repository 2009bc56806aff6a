"""The rows of the fault table that are counted: packets, configs, cuts, kills, a soak."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from campaign_soak import soak
from link_pair import Pair
from test_attacks import flipped, foreign

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.link.messages import Motion
from teleop_rt.link.security import Session
from teleop_rt.realtime.export import recover
from teleop_rt.realtime.recording import ONLINE, RecordingWriter, read_topics
from teleop_rt.realtime.rotation import SIZES
from teleop_rt.realtime.session import describe, publish
from teleop_rt.section import Units
from teleop_rt.signals import SLAVE, columns
from teleop_rt.yaml_file import ConfigError

CONFIG = Path(__file__).resolve().parent.parent / "config"
UNITS = Units(position="m", force="N")
STAMP = columns(SLAVE)["stamp_ns"]
AT_ONCE = 100


def row(fault: str, count: int, problem: str, state: str, **more: Any) -> dict[str, Any]:
    """Make a row of the campaign out of how often something was tried."""
    return {
        "fault": fault, "phase": "-", "clock": "simulated", "seeds": count, "detected_ms": None,
        "bound_ms": None, "state": state, "named": "-", "peak_force_N": None,
        "problem": problem, "holds": not problem,
    } | more  # fmt: skip


def packets(count: int, seed: int) -> dict[str, Any]:
    """Send the slave replayed, bit-flipped and foreign packets; none may be accepted."""
    pair = Pair(seed=seed)
    pair.run(1500)
    genuine = pair.master_tap.sent[:-1]
    rng = np.random.default_rng(seed)
    strange = Session.derive(b"f" * 32, rng.bytes(32), rng.bytes(32), "master")
    pair.master.send(Motion(1.0, 0.0, 0, engaged=True))
    unseen = pair.master_tap.sent[-1]
    while pair.slave_tap.inner.receive() is not None:
        pass
    before, motion = pair.slave.statistics.received, pair.slave.motion
    for attack in range(count):
        packet = genuine[int(rng.integers(len(genuine)))]
        if attack % 3 == 1:
            packet = unseen if attack % 2 else packet
            packet = flipped(packet, int(rng.integers(8 * len(packet))))
        elif attack % 3 == 2:
            packet = foreign(rng, unseen, strange)
        pair.slave_tap.injected.append(packet)
        if attack % AT_ONCE == AT_ONCE - 1:
            pair.slave.poll()
    while pair.slave_tap.injected:
        pair.slave.poll()
    accepted = pair.slave.statistics.received - before
    moved = pair.slave.motion is not motion
    problem = f"{accepted} accepted" if accepted or moved else ""
    return row("packets replayed, flipped, foreign", count, problem, f"{accepted} accepted")


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
            except Exception as error:  # noqa: BLE001 - this is what must not happen
                unclear.append(f"{type(error).__name__}: {error}")
            finally:
                victim.write_text(shipped, encoding="utf-8")
    refused = count - valid - len(unclear)
    state = f"{refused} refused, {valid} valid"
    return row("mutated YAML", count, "; ".join(unclear[:3]), state)


def mutated(text: str, chosen: random.Random) -> str:
    for _ in range(chosen.randint(1, 4)):
        at = chosen.randrange(len(text))
        put = "".join(chosen.choice(" \n:{}[]-#&*!|>'\"%@`0e.~a\t\u00e9") for _ in range(3))
        text = text[:at] + put[: chosen.randint(0, 3)] + text[at + chosen.randint(0, 12) :]
    return text


def cut_everywhere() -> dict[str, Any]:
    """Cut a recording at every byte: what `recover` saves never shrinks, and is never wrong."""
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
            counts.append(recover(cut, saved))
    fair = counts == sorted(counts) and set(counts) == {0, 20, 40, 60}
    problem = "" if fair else f"saved {sorted(set(counts))}"
    return row("recording cut at every byte", len(data) + 1, problem, "readable")


RECORDER = "from teleop_rt.trial.recorder_main import main; import sys; main(sys.argv[1:])"


def killed_recorders(kills: int) -> dict[str, Any]:
    """Kill a recorder that follows a loop of 1 kHz; how much of the loop's time is not on disk?"""
    taken = []
    online = {"position_unit": "m", "force_unit": "N"}
    sizes = {"part_bytes": "1000000000", "part_s": "1e9", "kept_bytes": "1", "kept_parts": "0"}
    for _ in range(kills):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            describe(folder, {ONLINE: online, SIZES: sizes})
            ring = publish(folder, "/slave", SLAVE)
            process = subprocess.Popen(
                [sys.executable, "-c", RECORDER, str(folder), str(folder)], stdout=subprocess.PIPE
            )
            assert process.stdout is not None
            process.stdout.readline()
            values, pushed = np.zeros(len(SLAVE)), 0
            end = time.monotonic() + 0.5 + 0.1 * random.random()
            while (now := time.monotonic()) < end:
                pushed += 1
                values[STAMP] = time.monotonic_ns()
                ring.push(values)
                time.sleep(max(0.0, now + 1e-3 - time.monotonic()))
            process.send_signal(signal.SIGKILL)
            process.wait()
            process.stdout.close()
            left = read_topics(folder / "recording.mcap", ["/slave"])["/slave"]["stamp_ns"]
            taken.append((values[STAMP] - left[-1]) * 1e-6)
            ring.close()
    worst = max(taken)
    problem = "" if worst <= 150 else f"{worst:.0f} ms lost"
    return row(
        "recorder killed: lost of the file", kills, problem, "readable",
        detected_ms=worst, bound_ms=150, clock="real", phase="contact",
    )  # fmt: skip


def soaked(minutes: float, seed: int) -> dict[str, Any]:
    """Harm a daemon at random; memory and descriptors stay what they are."""
    found = soak(minutes, seed)
    state = f"{found['grown_KiB']} KiB, {found['new_descriptors']} descriptors more"
    problem = "" if found["holds"] else f"{state}; {found['problems']}"
    return row("soak", sum(found["faults"].values()), problem, state)


def counted(seeds: int, packet_count: int, configs: int, kills: int) -> Iterator[Any]:
    """Give name and work of each row."""
    yield "packets replayed, flipped, foreign", lambda: packets(packet_count, seeds)
    yield "mutated YAML", lambda: mutated_configs(configs, seeds)
    yield "recording cut at every byte", cut_everywhere
    yield "recorder killed: lost of the file", lambda: killed_recorders(kills)
    yield "soak", lambda: soaked(1.0, seeds)
