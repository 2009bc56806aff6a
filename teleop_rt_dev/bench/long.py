"""An hour-long recording: time and memory of report, replay, diagnosis, and of the live page.

The hour is the default trial's 20 s over and over, with stamps and ticks that go on: the same
bytes, so the same work for who reads them.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from teleop_rt_dev.bench.measure import Row, row, take_all_cores
from teleop_rt_dev.paths import SILICONE

MINUTES = (1.0, 60.0)  # of the two recordings: memory must not grow with the longer one
REPLAY_S = 10.0  # played before the peak of memory is read: the page's usual window
_STAMP = re.compile(rb'("stamp_ns":|"sample_stamp_ns":|"tick":)(\d+)')
_BLOCK = 1 << 18  # bytes of a chunk of the long recording


def run(_rounds: int) -> list[Row]:
    """Measure a short and a long recording, once each: minutes of work have little scatter."""
    take_all_cores()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed program has its bytecode, too
    found = []
    with tempfile.TemporaryDirectory() as name:
        base = Path(name) / "base"
        trial = ["run", str(SILICONE), "--clock", "simulated", "--json", "--out", str(base)]
        subprocess.run([*OURS, *trial], check=True, capture_output=True)
        for minutes in MINUTES:
            folder = Path(name) / "long"
            stretch(base, folder, minutes)
            label = f"{minutes:.0f} min"
            spent, busy, peak = measured(["report", str(folder)])
            found.append(row(f"report of {label}", "s", [spent], "<= 10"))
            found.append(row(f"report of {label}, processor time", "s", [busy]))
            found.append(row(f"report of {label}, peak memory", "MB", [peak], "<= 1024"))
            for title, words in OFFLINE.items():
                _, busy, peak = measured([*words, str(folder)])
                most_s, most_MB = AIMS.get(title, (None, None))
                found.append(row(f"{title} of {label}, processor time", "s", [busy], most_s))
                found.append(row(f"{title} of {label}, peak memory", "MB", [peak], most_MB))
            began, held = replayed(folder)
            found.append(row(f"live page of {label}, until it is served", "s", [began], "<= 10"))
            found.append(row(f"live page of {label}, peak memory", "MB", [held], "<= 300"))
            shutil.rmtree(folder)
    return found


OURS = [sys.executable, "-m", "teleop_rt"]
EIGHTEEN = (
    "--models", "kelvin-voigt,mass-spring-damper,hunt-crossley", "--solvers", "rls,sprls,ni-sprls",
)  # fmt: skip
OFFLINE = {
    "replay": ("replay",),
    "replay with 18 estimators": ("replay", *EIGHTEEN),
    "diagnosis": ("diagnose",),
}


AIMS = {"replay with 18 estimators": ("<= 4.5", "<= 302"), "diagnosis": ("<= 4.5", "<= 326")}
"""Half of an hour's figures once: processor time, peak memory."""


def stretch(base: Path, folder: Path, minutes: float) -> None:
    """Write a run folder that lasts so long, from one that lasts 20 s."""
    shutil.copytree(base, folder)
    summary = json.loads((base / "summary.json").read_text())
    repeats = max(1, round(60.0 * minutes / summary["duration_s"]))
    for name in ("ticks", "duration_s"):
        summary[name] *= repeats
    (folder / "summary.json").write_text(json.dumps(summary))
    with (base / "recording.mcap").open("rb") as stream:
        reader = make_reader(stream)
        metadata = {m.name: dict(m.metadata) for m in reader.iter_metadata()}
        rows = [
            (schema, channel, message.log_time, _STAMP.split(message.data))
            for schema, channel, message in reader.iter_messages(log_time_order=False)
        ]
    with (folder / "recording.mcap").open("wb") as stream:
        writer = Writer(
            stream,
            chunk_size=_BLOCK,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,  # as our own recorder does
        )
        writer.start(library="teleop-rt")
        for name, content in metadata.items():
            writer.add_metadata(name, content)
        channels = {}
        for schema, channel, *_ in rows:
            if channel.topic not in channels:
                assert schema is not None
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "json", schema_id)
        kept = [(channels[channel.topic], stamp, text) for _, channel, stamp, text in rows]
        for repeat in range(repeats):
            later_ns = repeat * (20_050 * 10**6)
            later = dict.fromkeys((b'"stamp_ns":', b'"sample_stamp_ns":'), later_ns)
            later[b'"tick":'] = repeat * 20_050
            for channel_id, stamp, text in kept:
                shifted = stamp + later[b'"stamp_ns":']
                writer.add_message(channel_id, shifted, _shifted(text, later), shifted)
        writer.finish()


def _shifted(pieces: list[bytes], later: dict[bytes, int]) -> bytes:
    """Return a row's text, split at the shifted values, with every number that much later."""
    moved = list(pieces)
    for place in range(1, len(pieces), 3):
        moved[place + 1] = b"%d" % (int(pieces[place + 1]) + later[pieces[place]])
    return b"".join(moved)


def measured(words: list[str]) -> tuple[float, float, float]:
    """Return time, processor time [s] and peak memory [MB] of a command of ours."""
    began = time.perf_counter()
    process = subprocess.Popen([*OURS, *words], stdout=subprocess.DEVNULL)
    _, code, usage = os.wait4(process.pid, 0)
    if code:
        raise RuntimeError(f"{words} ended with {code}")
    busy = usage.ru_utime + usage.ru_stime
    return time.perf_counter() - began, busy, usage.ru_maxrss / 1024.0


def replayed(folder: Path) -> tuple[float, float]:
    """Return the time until the page is served [s], and the peak memory after a while [MB]."""
    began = time.perf_counter()
    words = [*OURS, "live", str(folder), "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        try:
            if not (server.stdout and server.stdout.readline()):
                raise RuntimeError("the live page did not begin")
            spent = time.perf_counter() - began
            time.sleep(REPLAY_S)
            status = Path(f"/proc/{server.pid}/status").read_text()
            peak = re.search(r"VmHWM:\s+(\d+) kB", status)
        finally:
            server.terminate()
    return spent, int(peak[1]) / 1024.0 if peak else float("nan")
