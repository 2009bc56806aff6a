"""Both ends of a link on real sockets, and between them a wire on which everything is heard."""

from __future__ import annotations

from teleop_rt.link.channel import Endpoint
from teleop_rt.link.keys import shared_key
from teleop_rt.link.transport import UdpTransport
from teleop_rt_dev.link.wire_attacker import WireAttacker

KEYS = shared_key(bytes(range(1, 33)))


class HeardWire:
    """A slave and a master with one key, on a clock that the test sets."""

    def __init__(self) -> None:
        self.now_ns = 10**12
        at_slave = UdpTransport()
        self.slave_port = at_slave.port
        self.slave = Endpoint("slave", at_slave, KEYS, lambda: self.now_ns, rate_hz=1000)
        self.wire = WireAttacker(at_slave.port, seed=7)
        at_master = UdpTransport(peer=("127.0.0.1", self.wire.port))
        self.master = Endpoint("master", at_master, KEYS, lambda: self.now_ns, rate_hz=1000)

    def close(self) -> None:
        for one in (self.slave, self.master, self.wire):
            one.close()
