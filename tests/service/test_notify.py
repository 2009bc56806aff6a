import os
import socket

import pytest
from daemon_world import DaemonWorld

from teleop_rt.service.notify import Notifier
from teleop_rt.slave.faults import State

PERIOD_NS = 1_000_000


@pytest.fixture
def manager(tmp_path):
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listening.bind(str(tmp_path / "notify"))
    listening.settimeout(0.0)
    yield listening
    listening.close()


def heard(manager) -> list[bytes]:
    messages = []
    while True:
        try:
            messages.append(manager.recv(200))
        except BlockingIOError:
            return messages


@pytest.fixture
def notifier(manager):
    one = Notifier(PERIOD_NS, environment(manager))
    yield one
    one.close()


def environment(manager, **more) -> dict[str, str]:
    return {"NOTIFY_SOCKET": manager.getsockname(), "WATCHDOG_USEC": "2000000", **more}


def test_the_watchdog_is_fed_four_times_per_timeout_by_the_ticks_alone(notifier, manager):
    for _ in range(499):
        notifier.tick()
    assert heard(manager) == []
    notifier.tick()
    assert heard(manager) == [b"WATCHDOG=1"]
    for _ in range(2000):
        notifier.tick()
    assert heard(manager) == [b"WATCHDOG=1"] * 4


def test_a_loop_that_stands_still_on_purpose_has_the_time_of_a_start(notifier, manager):
    notifier.going()
    assert heard(manager) == [b"WATCHDOG_USEC=2000000", b"READY=1"]
    notifier.standing(reloading=True)
    longer, reloading = heard(manager)
    assert longer == b"WATCHDOG_USEC=300000000"
    assert reloading.startswith(b"RELOADING=1\nMONOTONIC_USEC=")


def test_devices_that_are_configured_again_in_a_reset_are_waited_for(manager, tmp_path):
    world = DaemonWorld(tmp_path, environment(manager))
    world.until(State.DISARMED)
    world.ask("arm")
    world.until(State.ARMED)
    world.rig.inject("emergency", "drive")
    world.until(State.FAULT)
    heard(manager)
    assert world.ask("reset")["ok"]
    result = [message for message in heard(manager) if message != b"WATCHDOG=1"]
    assert result == [b"WATCHDOG_USEC=300000000", b"WATCHDOG_USEC=2000000", b"READY=1"]
    world.daemon.notifier.close()


def test_a_loop_that_hangs_is_not_fed_for(manager, tmp_path):
    world = DaemonWorld(tmp_path, environment(manager))
    world.ticks(1000)
    assert heard(manager) == [b"WATCHDOG=1"] * 2
    for _ in range(1500):
        world.step_others()
        world.server.answer(b'{"command": "status"}')
    assert heard(manager) == []
    world.daemon.notifier.close()


@pytest.mark.parametrize("change", [{"WATCHDOG_PID": str(os.getpid() + 1)}, {"WATCHDOG_USEC": "0"}])
def test_a_watchdog_that_is_not_ours_or_not_asked_for_is_not_fed(manager, change):
    notifier = Notifier(PERIOD_NS, {**environment(manager), **change})
    for _ in range(5000):
        notifier.tick()
    notifier.going()
    notifier.close()
    assert heard(manager) == [b"READY=1"]


def test_a_manager_that_is_gone_or_does_not_listen_holds_nothing_up(tmp_path, notifier):
    for _ in range(100_000):
        notifier.send(b"WATCHDOG=1")
    gone = Notifier(PERIOD_NS, {"NOTIFY_SOCKET": str(tmp_path / "nobody"), "WATCHDOG_USEC": "9"})
    gone.tick()
    gone.close()
    nobody = Notifier(PERIOD_NS, {})
    nobody.tick()
    nobody.send(b"READY=1")
