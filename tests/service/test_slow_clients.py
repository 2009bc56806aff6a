"""The flood of slow clients, beside which a stop is timed, is a flood."""

import subprocess
import sys

from teleop_rt.service.local_socket import bind
from teleop_rt_dev.service import floods


def test_a_slow_client_stays_while_it_sends_and_waits_for_no_answer(tmp_path):
    place = tmp_path / "socket"
    command = [sys.executable, floods.__file__, "slow", place]
    with (
        bind(place) as listening,
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as flood,
    ):
        try:
            assert flood.stdout.readline() == "under way\n"
            for _ in range(floods.SLOW_CLIENTS // 2):  # one came with each round
                client, _ = listening.accept()
                with client:
                    assert client.recv(10).startswith(b"{")
                    client.sendall(b"x")  # fails where the client has gone
        finally:
            flood.kill()
