"""A drive that is asked where it is as a cycle begins, and commanded as it ends."""

from __future__ import annotations

import json
import struct

import pytest
from framed_bench import load

from teleop_rt.axis import AxisFault
from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt_dev.faults.handle import MS, SERIAL, HandleBench
from teleop_rt_dev.paths import TRIALS
from teleop_rt_drivers.actuators.asking import AskingPort
from teleop_rt_drivers.actuators.codec import DriveState, Frame, Report, Taken
from teleop_rt_drivers.actuators.mit import DAMIAO_RANGES, DamiaoCodec, Gains
from teleop_rt_drivers.device_check import check_device
from teleop_rt_drivers.framed.counters import FramedCounters

ASKED = ("damiao", "robstride", "moteus")
WITHIN = "operator.rig.axis.answer_within_ms"
SOON = f"{WITHIN}=0.35"
STEP_M = 4e-6
"""16 bits over 25 rad at 10 mm; moteus and an asked RobStride send floats."""
US = 1000
ANSWER_NS, WAY_NS = 300 * US, 200 * US
QUESTION = Frame(0x7FF, bytes((2, 0, 0xCC, 0, 0, 0, 0, 0)))


def handle_of(kind: str) -> str:
    return f"operator.rig=../rigs/simulated_{kind}_handle.yaml"


@pytest.mark.parametrize("kind", ASKED)
def test_a_sample_is_where_the_handle_is_in_the_cycle_that_answers_it(kind):
    handle = HandleBench(SERIAL, [handle_of(kind), SOON])
    handle.update(0.0, 300)
    for _ in range(5):
        position, _ = handle.update(0.0)
        assert abs(handle.plant.velocity) > 0.03, "a period would be 30 um"
        assert position == pytest.approx(handle.plant.position, abs=STEP_M)


@pytest.mark.parametrize("kind", ASKED)
def test_the_answer_to_a_command_alone_is_a_cycle_old(kind):
    handle = HandleBench(SERIAL, [handle_of(kind)])
    handle.update(0.0, 300)
    before = handle.plant.position
    position, _ = handle.update(0.0)
    assert position == pytest.approx(before, abs=STEP_M)


@pytest.mark.parametrize(("kind", "K"), [("damiao", 9700), ("robstride", 9500), ("moteus", 9500)])
def test_a_wall_may_be_stiffer_by_more_than_half_than_on_answers_to_commands(kind, K):
    def stiffest(*changes):
        trial = load_trial_file(TRIALS / "handle.yaml", [handle_of(kind), *changes])
        said = [found.what for found in check_device(trial, trial.operator)]
        (most,) = [float(what.split("K_max is ")[1].split()[0]) for what in said if "K_max" in what]
        return most

    asked, late = stiffest(SOON), stiffest()
    assert asked >= K
    assert asked > 1.5 * late


@pytest.fixture
def errors(call):
    def found(kind, *changes):
        words = [w for change in (handle_of(kind), *changes) for w in ("--set", change)]
        _, out, _ = call("check", str(TRIALS / "handle.yaml"), "--json", *words)
        findings = json.loads(out)["findings"]
        return [f["what"] for f in findings if f["severity"] == "error"]

    return found


@pytest.mark.parametrize(("kind", "bits"), [("damiao", 270), ("robstride", 320), ("moteus", 194)])
def test_a_wait_shorter_than_question_and_answer_is_refused(errors, kind, bits):
    """135 bits a frame of 8 bytes, 160 with a long id; moteus: 8 out and 24 back at 5 Mbit/s."""
    what = f"{(bits - 1) * 1e-3:g} ms is less than the 0.{bits} ms that question and answer are"
    assert errors(kind, f"{WITHIN}={(bits - 1) * 1e-3}") == [f"{what} on the bus"]
    assert not errors(kind, f"{WITHIN}={(bits + 1) * 1e-3}")


TWO_KHZ = ("master.rate_hz=2000", "operator.rig.rate_hz=2000")


@pytest.mark.parametrize(("kind", "share"), [("damiao", 108), ("robstride", 128), ("moteus", 94)])
def test_2_khz_is_refused_where_question_and_command_do_not_fit_on_the_bus(errors, kind, share):
    said = errors(kind, *TWO_KHZ, SOON)
    assert [what for what in said if f"{share} % of 1000000 bit/s" in what] == said != []
    assert not errors(kind, *TWO_KHZ)


@pytest.mark.parametrize(("rig", "share"), [("handle", 93), ("odrive_handle", 108)])
def test_2_khz_is_refused_on_a_bus_that_does_not_carry_it(call, rig, share):
    changes = (f"operator.rig=../rigs/simulated_{rig}.yaml", *TWO_KHZ)
    words = [word for change in changes for word in ("--set", change)]
    code, out, _ = call("check", str(TRIALS / "handle.yaml"), *words)
    assert code == 2
    assert f"{share} % of 1000000 bit/s is used at 2000 Hz" in out


def test_a_drive_that_sends_by_itself_is_not_asked():
    with pytest.raises(ConfigError, match="odrive sends its position by itself"):
        load_trial_file(SERIAL, [handle_of("odrive"), f"{WITHIN}=0.3"])


@pytest.mark.parametrize("kind", ASKED)
def test_at_1_khz_the_bus_carries_question_and_command(errors, kind):
    assert not errors(kind, SOON)


# Questions and answers byte by byte.


def codec_of(kind):
    rig = load(f"{kind}_handle")
    return rig.axis.drive.codec(rig)


def test_questions_are_those_of_the_makers_documents():
    assert codec_of("damiao").question() == QUESTION
    read = bytes((0x19, 0x70, 0, 0, 0, 0, 0, 0))
    assert codec_of("robstride").question() == Frame(
        17 << 24 | 0xFD << 8 | 0x7F, read, extended=True
    )
    asked = codec_of("moteus").question()
    assert (asked.can_id, asked.data[:5], set(asked.data[5:])) == (
        0x8001, bytes((0x1C, 4, 0, 0x11, 0x0F)), {0x50},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("status", "index", "value", "taken"),
    [
        (0, 0x7019, 1.5, Taken.PLACED),
        (1, 0x7019, 1.5, Taken.NOTED),
        (0, 0x7016, 1.5, Taken.NOTED),
        (0, 0x7019, float("nan"), Taken.REFUSED),
    ],
)
def test_a_robstride_answers_with_a_position_or_that_it_cannot(status, index, value, taken):
    report = Report(position=9.0, state=DriveState.FOLLOWING)
    can_id = 17 << 24 | status << 16 | 0x7F << 8 | 0xFD
    frame = Frame(can_id, struct.pack("<HHf", index, 0, value), extended=True)
    assert codec_of("robstride").take(frame, report) is taken
    assert report.position == (1.5 if taken is Taken.PLACED else 9.0)
    assert report.state is DriveState.FOLLOWING


# Which frame an answer belongs to, where they are late or lost.


class Line:
    """A wire and its clock: each frame is answered after `WAY_NS` with the newest position code."""

    fault = AxisFault.NONE
    arrived_ns = 0
    watched = ()

    def __init__(self) -> None:
        self.now = 1_000 * MS
        self.sent: list[Frame] = []
        self.due: list[tuple[int, Frame]] = []
        self.late_ns, self.lost = WAY_NS, False

    def clock(self) -> int:
        self.now += 5 * US
        return self.now

    def open(self, heard) -> None:
        self.heard = heard

    def order(self, frames, now_ns) -> bool:
        for frame in frames:
            code = (self.now // MS) & 0xFFFF
            body = bytes((0x12, code >> 8, code & 255, 0x80, 0x08, 0, 30, 30))
            if not self.lost:
                self.due.append((now_ns + self.late_ns, Frame(0x12, body)))
            self.sent.append(frame)
        return True

    def drain(self, now_ns) -> None:
        while self.due and self.due[0][0] <= now_ns:
            arrived, frame = self.due.pop(0)
            self.arrived_ns = arrived
            self.heard(frame, arrived)

    def settle(self) -> None:
        self.now += MS
        self.drain(self.now)

    def raise_fault(self, fault) -> None:
        raise AssertionError(fault)


class Asked:
    """A port that asks on such a line, and the samples of each cycle."""

    def __init__(self) -> None:
        self.line = Line()
        codec = DamiaoCodec(2, 0x12, DAMIAO_RANGES["DM4310"], Gains(1.0, 0.1))
        self.port = AskingPort(
            codec, self.line, FramedCounters(), self.line.clock, 250 * MS, None, ANSWER_NS
        )
        self.port.sources["drive"].listen(lambda values, at: self.samples.append((values[0], at)))
        self.samples: list[tuple[float, int]] = []
        self.port.open()
        self.cycle()

    def cycle(self) -> list[tuple[float, int]]:
        """Run a cycle that begins at a whole millisecond; return its answers."""
        self.samples.clear()
        self.line.now = (self.line.now // MS + 1) * MS
        self.began = self.line.now
        self.port.drain(self.line.now)
        self.took = self.line.now - self.began
        self.port.send("drive", (1.0, 0.0))
        return list(self.samples)

    @property
    def place(self) -> float:
        return -12.5 + 25.0 * (self.began // MS & 0xFFFF) / 65535


def test_a_cycle_has_one_sample_and_it_answers_its_question():
    asked = Asked()
    for _ in range(3):
        ((position, at),) = asked.cycle()
        assert position == pytest.approx(asked.place)
        assert asked.began < at < asked.began + WAY_NS
        assert WAY_NS <= asked.took < ANSWER_NS
        assert asked.line.sent[-2] == QUESTION


@pytest.mark.parametrize("late_us", [350, 700, 950])
def test_answers_after_their_time_are_no_samples_whatever_they_are_taken_for(late_us):
    asked = Asked()
    asked.line.late_ns = late_us * US
    assert [asked.cycle() for _ in range(8)] == [[]] * 8
    asked.line.late_ns = WAY_NS
    asked.cycle()
    for _ in range(3):
        ((position, _),) = asked.cycle()
        assert position == pytest.approx(asked.place)


def test_no_answer_is_waited_for_no_longer_than_its_time_and_the_next_cycles_have_samples_again():
    asked = Asked()
    asked.line.lost = True
    assert asked.cycle() == []
    assert asked.took < ANSWER_NS + 20 * US
    asked.line.lost = False
    assert asked.cycle() == [], "answers that are owed may still come"
    assert asked.line.sent[-2] != QUESTION
    for _ in range(3):
        ((position, _),) = asked.cycle()
        assert position == pytest.approx(asked.place)
