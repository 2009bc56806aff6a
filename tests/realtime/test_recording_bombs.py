"""Small files that unpack to much are refused before they do, by a process with little memory."""

import json
import os
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.realtime.mcap_unpack import unpack_chunk
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.recordings.memory import VARIABLE, most_bytes
from teleop_rt.signals import SLAVE, SLAVE_TOPIC

MB = 1 << 20
MAY_TAKE_MB, BEYOND_MB, UNPACKED = 32, 96, 140 * MB
READER = f"""
import json, resource, sys
from pathlib import Path
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.table_files import read_table
from teleop_rt.realtime.reading import read_topics
import scipy.io.matlab
pages = int(Path("/proc/self/statm").read_text().split()[0])
most = pages * resource.getpagesize() + {BEYOND_MB * MB}
resource.setrlimit(resource.RLIMIT_AS, (most, most))
for name in sys.argv[1:]:
    path = Path(name)
    try:
        read_topics(path, ["/slave"]) if path.suffix == ".mcap" else read_table(path)
        print(json.dumps(""))
    except RecordingError as error:
        print(json.dumps(str(error)))
"""


def refusals(paths: list[Path]) -> tuple[list[str], str]:
    """Read files in a process with little memory left; return why each is refused, and stderr."""
    done = subprocess.run(
        [sys.executable, "-c", READER, *paths],
        env=os.environ | {VARIABLE: str(MAY_TAKE_MB)},
        capture_output=True,
        text=True,
        check=True,
    )
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == len(paths)
    return found, done.stderr


def npy(kind: str, count: int, version: int = 1, filler: int = 0) -> bytes:
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({count},), }}".encode()
    header += b" " * filler + b"\n"
    return (
        b"\x93NUMPY"
        + bytes((version, 0))
        + struct.pack("<H" if version == 1 else "<I", len(header))
        + header
    )


def test_an_archive_is_refused_by_what_it_declares(tmp_path):
    parts = {
        "zeros": (npy("<f8", UNPACKED // 8), UNPACKED),
        "bytes that become numbers": (npy("|i1", 30 * MB), 30 * MB),
        "a header": (npy("<f8", 10, version=2, filler=UNPACKED), 80),
        "a claim": (npy("<f8", 10**12), 80),
        "more than it claims": (npy("<f8", 10), UNPACKED),
    }
    paths = [tmp_path / f"{name}.npz" for name in parts]
    for path, (head, zeros) in zip(paths, parts.values(), strict=True):
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("x_m.npy", head + bytes(zeros))
        assert path.stat().st_size < MB
    for problem in refusals(paths)[0]:
        assert f"set {VARIABLE}=" in problem


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def test_a_mat_file_is_refused_by_what_its_elements_unpack_to(tmp_path):
    """Both where its matrix states as much, and where only its numbers are as many."""
    paths = [tmp_path / "stated.mat", tmp_path / "unstated.mat"]
    for path, stated in zip(paths, (UNPACKED // 8, 10), strict=True):
        matrix = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", 1, stated))
        matrix += element(1, b"x_m") + element(9, bytes(UNPACKED))
        packed = zlib.compress(element(14, matrix))
        header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
        path.write_bytes(header + struct.pack("<II", 15, len(packed)) + packed)
    for problem in refusals(paths)[0]:
        assert f"set {VARIABLE}=" in problem


def test_a_text_is_refused_by_its_length_and_by_its_fields(tmp_path):
    """Holes take no place on the disk; a field of two bytes becomes a number of eight."""
    paths = [tmp_path / f"{kind}.csv" for kind in ("hole", "fields", "commas")]
    for path, separator in zip(paths, ",,;", strict=True):
        row = f"1{separator}2{separator}\n"
        path.write_text(f"t_s{separator}x_m{separator}\n" + row * (2 * MB))
    with paths[0].open("r+b") as stream:
        stream.truncate(100_000 * MB)
    for problem in refusals(paths)[0]:
        assert f"set {VARIABLE}=" in problem


def test_a_text_with_missing_fields_takes_a_few_times_its_length(tmp_path):
    """Each field used to be an object of its own: 47 times the file, here 150 MB."""
    rows = MB // 3
    paths = [tmp_path / f"{kind}.csv" for kind in ("missing", "commas")]
    paths[0].write_text("t_s,x_m\n" + "1.25,2.5\n" * rows + ",1\n")
    paths[1].write_text("t_s;x_m\n" + "1,25;2,5\n" * rows + ";1\n")
    assert refusals(paths)[0] == ["", ""]


def chunk(compression: bytes, packed: bytes, stated: int) -> bytes:
    content = struct.pack("<QQQI", 0, 2**62, stated, 0)
    content += struct.pack("<I", len(compression)) + compression
    content += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", Opcode.CHUNK, len(content)) + content


def test_a_chunk_unpacks_to_no_more_than_it_states_and_that_is_bounded(tmp_path):
    zeros = bytes(UNPACKED)
    packed = {b"zstd": zstandard.compress(zeros), b"lz4": lz4.frame.compress(zeros)}
    paths = []
    for kind, content in packed.items():
        for stated in (1000, UNPACKED, 2**60):
            paths.append(tmp_path / f"{kind.decode()}-{stated}.mcap")
            paths[-1].write_bytes(MCAP0_MAGIC + chunk(kind, content, stated) + MCAP0_MAGIC)
            assert paths[-1].stat().st_size < MB
    problems, said = refusals(paths)
    assert problems == [""] * len(paths)
    for path in paths:
        assert f"{path}: damaged before byte" in said


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_chunks_of_any_packing_are_read(tmp_path, compression):
    data = bytes(range(256)) * 4
    pack = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}[compression]
    record = chunk(compression.encode(), pack(data), len(data))
    assert unpack_chunk(record[9:], zstandard.ZstdDecompressor()) == data


def test_rows_that_do_not_fit_are_refused_and_thinned_ones_are_read(tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, Units(position="m", force="N"))
    writer.add_topic(SLAVE_TOPIC, SLAVE)
    writer.write_rows(SLAVE_TOPIC, np.zeros((4 * MB // (8 * len(SLAVE)), len(SLAVE))))
    writer.close()
    monkeypatch.setenv(VARIABLE, "2")
    with pytest.raises(RecordingError, match=rf"columns take [23] MB.*set {VARIABLE}=[34]"):
        read_topics(path, [SLAVE_TOPIC])
    assert read_topics(path, [SLAVE_TOPIC], most={SLAVE_TOPIC: 1000})[SLAVE_TOPIC]["tick"].size
    monkeypatch.setenv(VARIABLE, "4")
    assert read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]["tick"].size > 1000


def test_a_limit_that_is_no_number_is_refused(monkeypatch):
    for stated in ("", "-1", "1e3", "much"):
        monkeypatch.setenv(VARIABLE, stated)
        with pytest.raises(RecordingError, match="a number of megabytes"):
            most_bytes()
    monkeypatch.delenv(VARIABLE)
    assert most_bytes() > 0
