"""A kernel reads recorded rows as the library does, and leaves unknown types to it."""

from __future__ import annotations

import json
import math
import random
import struct

import numpy as np
import pytest

from teleop_rt.realtime import columns as columns_module
from teleop_rt.realtime.columns import TopicColumns
from teleop_rt.realtime.row_kernel import RowReader
from teleop_rt.view.run_folder import ROWS_OF_LONGER

NAMES = ("tick", "stamp_ns", "first", "second", "état", "last")
ROOM = 1 << 30


def any_number(rng: random.Random) -> str:
    """A number as JSON may write it: short, long, rounded hard, huge, tiny, or none."""
    word = struct.unpack("<d", rng.randbytes(8))[0]
    choices = (
        lambda: str(rng.randint(-3, 3)),
        lambda: str(rng.randint(-(2**63), 2**63 - 1)),
        lambda: str(rng.randint(10**18, 10**25)),
        lambda: repr(rng.uniform(-1.0, 1.0)),
        lambda: repr(rng.uniform(-1e-9, 1e-9)),
        lambda: f"{rng.uniform(-100, 100):.{rng.randrange(1, 25)}f}",
        lambda: f"{2**53 + 1}.{'0' * rng.randrange(1, 20)}{rng.randrange(2)}",
        lambda: repr(word) if math.isfinite(word) else "1E-7",
        lambda: rng.choice(["-0", "-0.0", "0e5", "null", "1e+22", "1E22", "5e-324", "2.5E0"]),
    )
    return rng.choice(choices)()


def text_of(values: list[str]) -> bytes:
    pairs = zip(NAMES, values, strict=True)
    return ("{" + ",".join(f"{json.dumps(name)}:{value}" for name, value in pairs) + "}").encode()


def laid_out(rows: list[bytes]) -> tuple[bytes, np.ndarray]:
    """Rows one after the other, with something in between, and their places."""
    data, places = b"", []
    for number, row in enumerate(rows):
        data += b"\0\1"
        places.append((len(data), len(data) + len(row), number))
        data += row
    return data, np.array(places)


def columns_of(rows: list[bytes], wanted: list[str] | None, *, kernel: bool) -> dict[str, bytes]:
    """The columns of rows in blocks of 7, as bytes: -0 and 0 are two numbers."""
    found = TopicColumns(wanted, None, columns_module._ROWS_FOR_KERNEL + 1 if kernel else 0, ROOM)
    for begin in range(0, len(rows), 7):
        found.take(*laid_out(rows[begin : begin + 7]))
    assert (found._reader is not None) == kernel  # which way was taken shows nowhere else
    return {name: values.tobytes() for name, values in found.whole().items()}


@pytest.mark.parametrize("wanted", [None, ["stamp_ns", "second"], ["last"], ["tick"]])
def test_a_kernel_reads_the_same_numbers_to_the_last_bit(wanted):
    rng = random.Random(str(wanted))  # noqa: S311 - reproducible
    rows = [text_of([any_number(rng) for _ in NAMES]) for _ in range(1000)]
    assert columns_of(rows, wanted, kernel=True) == columns_of(rows, wanted, kernel=False)


@pytest.mark.parametrize("topic", ["/slave", "/master"])
def test_the_ticks_of_an_hour_are_read_by_the_kernel_for_a_report(topic):
    found = TopicColumns(None, ROWS_OF_LONGER[topic], 3_600_000, ROOM)
    found.take(*laid_out([text_of(["1"] * len(NAMES))] * 3))
    assert found._reader is not None  # which way is taken shows nowhere else


@pytest.mark.parametrize("kernel", [True, False])
def test_whoever_keeps_a_column_keeps_no_other_in_memory(kernel):
    rows = [text_of([str(number)] * len(NAMES)) for number in range(50)]
    found = TopicColumns(None, None, columns_module._ROWS_FOR_KERNEL + 1 if kernel else 0, 0)
    found.take(*laid_out(rows))
    for column in found.whole().values():
        assert column.base.size == column.size == 50


def test_a_topic_without_a_wanted_signal_has_no_columns():
    found = TopicColumns(["other"], None, 0, ROOM)
    found.take(*laid_out([text_of(["1"] * len(NAMES))] * 3))
    assert found.whole() == {}


def test_the_kernel_itself_reads_nearly_all():
    rng = random.Random(3)  # noqa: S311 - reproducible
    rows = [text_of([any_number(rng) for _ in NAMES]) for _ in range(200)]
    read, room = RowReader(NAMES, ["first", "last"]), np.zeros((2, 200))
    data, places = laid_out(rows)
    assert read.read(data, places, room) == 200


@pytest.mark.parametrize(
    "value", ["true", '"a,b"', "[1]", "{}", "01", "1.", ".5", "1e", "+1", "--1", "1e999", "NaN", ""]
)
@pytest.mark.parametrize("place", [2, 5])
def test_what_is_no_number_is_left(value, place):
    values = ["1"] * len(NAMES)
    values[place] = value
    rows = [text_of(["2"] * len(NAMES)), text_of(values), text_of(["3"] * len(NAMES))]
    data, places = laid_out(rows)
    assert RowReader(NAMES, NAMES).read(data, places, np.zeros((len(NAMES), 3))) == 1


@pytest.mark.parametrize(
    "row", [b'{"tick":1}', b'{"tick":1,"stamp_ns":2', b'{"stamp_ns":1,"tick":2}', b"", b"{",
            b'{"tick": 1,"stamp_ns":2}', b'{"tick":1,"stamp_ns":2,"more":3}',
            b'{"tick":1,"stamp_ns":2}}'],
)  # fmt: skip
def test_a_row_of_another_shape_is_left(row):
    reader = RowReader(("tick", "stamp_ns"), ("tick", "stamp_ns"))
    assert reader.read(*laid_out([row]), np.zeros((2, 1))) == 0


def test_rows_that_are_left_keep_their_place():
    rows = [text_of([str(number)] * len(NAMES)) for number in range(30)]
    rows[11] = rows[11].replace(b'"first":11', b'"first": 11')
    assert columns_of(rows, None, kernel=True) == columns_of(rows, None, kernel=False)
