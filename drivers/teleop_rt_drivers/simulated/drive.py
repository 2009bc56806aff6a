"""A CiA 402 drive in cyclic synchronous position or torque mode, moving the plant."""

from __future__ import annotations

import struct
from enum import Enum
from typing import TYPE_CHECKING

from teleop_rt_drivers.simulated.answer import INT32, PLACES, TORQUES, goal_of, thousandths
from teleop_rt_drivers.simulated.device import Nmt, Node
from teleop_rt_drivers.simulated.dictionary import EVENT_DRIVEN
from teleop_rt_drivers.simulated.motion import OFF
from teleop_rt_drivers.simulated.senses import clamped, signed

if TYPE_CHECKING:
    from teleop_rt_drivers.canopen.node_config import NodeConfig
    from teleop_rt_drivers.simulated.device import Send
    from teleop_rt_drivers.simulated.plant import Plant

CYCLIC_SYNCHRONOUS_POSITION, CYCLIC_SYNCHRONOUS_TORQUE = 8, 10  # modes (6060h, CiA 402)
OPERATE = 0x0F
"""The controlword that keeps an enabled drive enabled."""
LIMITS = (0x607D, 0x607F, 0x60C2)  # position, speed, interpolation period (CiA 402)
TARGET = 0x607A, 0  # target position (CiA 402)
HOME_SWITCH = 1 << 2
"""Bit of the digital inputs (60FDh)."""
VOLTAGE_ENABLED, REMOTE, FOLLOWS = 1 << 4, 1 << 9, 1 << 12


FORCE_PER_MV = 0.025
"""Force of one millivolt of the load cell's amplifier [rig unit]: 250 N at 10 V."""
STEP_MV, STEPS = 10_000 / 2048, 2048
"""A converter of 12 bits over -10 to 10 V; a voltage beyond reads as its end."""


def analog_input(force: float) -> int:
    """Return the voltage that the drive measures at its input [mV], of a sensor's force."""
    step = round(force / FORCE_PER_MV / STEP_MV)
    return round(STEP_MV * max(-STEPS, min(STEPS - 1, step)))


class Power(Enum):
    """States of the power drive system, with the statusword's bits 0 to 3, 5 and 6."""

    SWITCH_ON_DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    FAULT = 0x08


class ServoDrive(Node):
    """The drive: its power state follows the controlword at each SYNC, its target the plant."""

    def __init__(self, node: NodeConfig, send: Send, plant: Plant) -> None:
        self._plant = plant
        self._resolution = plant.config.drive.position_resolution
        self._power = Power.SWITCH_ON_DISABLED
        self._error = 0
        self._fault_reset_bit = False
        self.refuses = False
        self._settled = False
        self._limits: tuple[int, int, float, float] | None = None
        super().__init__(
            "drive",
            node.node_id,
            node.eds,
            send,
            {
                (0x6041, 0): self._statusword,
                (0x603F, 0): lambda: self._error,
                (0x6061, 0): lambda: self.value(0x6060),
                (0x6064, 0): lambda: clamped(plant.drive_counts, INT32),
                (0x6077, 0): self._torque,
                (0x60FD, 0): lambda: HOME_SWITCH if plant.switch_closed else 0,
                (0x6401, 1): lambda: analog_input(plant.measured_force()),
            },
        )
        self._rated = self.value(0x6076) * 1e-3
        drive = plant.config.drive
        self.measured[0x6064, 0] = PLACES, drive.zero, drive.position_resolution
        self.measured[0x6077, 0] = TORQUES, 0.0, self._rated
        self.measured[0x60FD, 0] = self.measured[0x6401, 1] = None

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""
        return self._power is Power.ENABLED

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""
        return self._plant.mode != OFF

    def boot(self, *, whole: bool = True) -> None:
        """Restart; a whole restart takes the motor's voltage away."""
        self._limits = None
        super().boot(whole=whole)
        if whole:
            self._error = 0
            self._enter_power(Power.SWITCH_ON_DISABLED)

    def written(self, index: int) -> None:
        """Obey a controlword that came by SDO at once."""
        self._limits, self._settled = None, False
        super().written(index)
        if index == 0x6040:
            self._obey(self.value(0x6040))

    def commanded(self) -> None:
        """Obey the controlword and follow the target, as of this SYNC."""
        control = self.value(0x6040)
        if control != OPERATE or self._power is not Power.ENABLED or self._fault_reset_bit:
            before = self._power, self._fault_reset_bit
            self._obey(control)
            self._settled = before == (self._power, self._fault_reset_bit)
        if self._power is not Power.ENABLED:
            return
        mode = self.value(0x6060)
        if mode == CYCLIC_SYNCHRONOUS_POSITION:
            self._follow(self.value(0x607A))
        elif mode == CYCLIC_SYNCHRONOUS_TORQUE:
            self._push(self.value(0x6071))

    def standing(self) -> dict[str, float] | None:
        """Return how it stands, by the fields of `answer.CycleFields`.

        None where the next command is more than another target, or comes otherwise.
        """
        if len(self.rpdos) != 1 or self.refuses or len(self.received) > 1:
            return None
        enabled = self._power is Power.ENABLED
        if enabled and self.value(0x6060) != CYCLIC_SYNCHRONOUS_POSITION:
            return None
        if not (self._is_kept if enabled else self._settled):
            return None
        ((can_id, pdo),) = self.rpdos.items()
        if pdo.every in EVENT_DRIVEN or pdo.keys.count(TARGET) != 1:
            return None
        place = pdo.keys.index(TARGET)
        target_at = 8 * struct.calcsize("<" + pdo.formats[:place])
        same_mask = (1 << 8 * pdo.struct.size) - 1 & ~(0xFFFFFFFF << target_at)
        stored = pdo.struct.pack(*(self.value(*key) for key in pdo.keys))
        same = int.from_bytes(stored, "little") & same_mask
        last = int.from_bytes(self.received[0][1] if self.received else stored, "little")
        if last & same_mask != same:
            return None
        lowest, highest, period_s, reach = self._limits or self._read_limits()
        drive = self._plant.config.drive
        return {
            "command_id": can_id, "command_bytes": pdo.struct.size, "target_at": target_at,
            "same_mask": signed(same_mask, 64), "same": signed(same, 64),
            "last": signed(last, 64), "pending": len(self.received), "follows": int(enabled),
            "lowest": lowest, "highest": highest, "reach": reach, "period_s": period_s,
            "zero": drive.zero, "step": drive.position_resolution,
        }  # fmt: skip

    @property
    def _is_kept(self) -> bool:
        """Return whether the controlword keeps it enabled, and its limits are not commanded."""
        if self._limits is None:
            self._read_limits()
        kept = self.value(0x6040) == OPERATE and not self._fault_reset_bit
        return kept and self._limits is not None

    def resume(self, obeyed: bytes | None, waiting: bytes | None) -> None:
        """Take over the last command that was obeyed in its place, and one that waits for SYNC."""
        if self.state is not Nmt.OPERATIONAL:
            return
        for pdo in self.rpdos.values():  # one, as it stood
            if obeyed is not None:
                found = pdo.struct.unpack(obeyed[: pdo.struct.size])
                self._stored.update(zip(pdo.keys, found, strict=True))
            if waiting is not None:
                self.received.append((pdo, waiting[: pdo.struct.size]))

    def run_timers(self, now_ns: int) -> None:
        """Also end a quick stop when the tool has come to rest (605Ah)."""
        super().run_timers(now_ns)
        if self._power is not Power.QUICK_STOP:
            return
        self.quiet_until_ns = now_ns
        if self.value(0x605A) in (1, 2) and self._plant.at_rest:
            self._enter_power(Power.SWITCH_ON_DISABLED)

    def lost_consumer(self) -> None:
        """Stop as 6007h says when the daemon is silent, then as 1029h says."""
        self.abort_connection(0x8130)
        super().lost_consumer()

    def left_operational(self) -> None:
        """Stop as 6007h says: without process data nobody commands (CiA 402-2, 6007h)."""
        self.abort_connection(0x8130)

    def abort_connection(self, code: int) -> None:
        """React as 6007h says: nothing, fault, disable voltage or quick stop."""
        option = self.value(0x6007)
        if self._power is not Power.ENABLED or option == 0:
            return
        if option == 1:
            self.fail(code)
        elif option == 2:
            self._enter_power(Power.SWITCH_ON_DISABLED)
        else:
            self._quick_stop()

    def fail(self, code: int) -> None:
        """Go into fault with an error code and an emergency message; the motor loses voltage."""
        self._error = code
        self._enter_power(Power.FAULT)
        self.emergency(code)

    def overheat(self) -> None:
        """Fail for being too hot (603Fh, 'excess device temperature')."""
        self.fail(0x4210)

    def _obey(self, control: int) -> None:
        """Take the transition that a controlword commands (CiA 402-2, table 'command coding')."""
        reset = bool(control & 0x80)
        rising, self._fault_reset_bit = reset and not self._fault_reset_bit, reset
        power = self._power
        if power is Power.FAULT:
            if rising:
                self._error = 0
                self._enter_power(Power.SWITCH_ON_DISABLED)
        elif not control & 0x02:
            self._enter_power(Power.SWITCH_ON_DISABLED)
        elif not control & 0x04:
            if power is Power.ENABLED:
                self._quick_stop()
            elif power is not Power.QUICK_STOP:
                self._enter_power(Power.SWITCH_ON_DISABLED)
        elif power is not Power.QUICK_STOP:
            self._step_towards(control & 0x0F)

    def _step_towards(self, command: int) -> None:
        """Take one step up, or go down, between ready and enabled."""
        power = self._power
        if command == 0x06:
            self._enter_power(Power.READY)
        elif command == 0x07 and power in (Power.READY, Power.ENABLED):
            self._enter_power(Power.SWITCHED_ON)
        elif command == 0x0F and power is Power.SWITCHED_ON and not self.refuses:
            self._enter_power(Power.ENABLED)
            self._plant.hold()
            if self.value(0x6060) == CYCLIC_SYNCHRONOUS_TORQUE:
                self._plant.push(0.0)

    def _enter_power(self, power: Power) -> None:
        if power not in (Power.ENABLED, Power.QUICK_STOP):
            self._plant.power_off()
        self._power = power
        self._settled, self.changed, self.quiet_until_ns = False, True, 0

    def _quick_stop(self) -> None:
        """Slow down on the ramp of 6085h, under power."""
        self._plant.slow_down(self.value(0x6085) * self._resolution)
        self._enter_power(Power.QUICK_STOP)

    def _follow(self, counts: int) -> None:
        """Run to the target within the interpolation period, inside 607Dh and 607Fh."""
        lowest, highest, period_s, reach = self._limits or self._read_limits()
        drive = self._plant.config.drive
        bounds = lowest, highest, reach, drive.zero, drive.position_resolution
        self._plant.follow(goal_of(counts, self._plant.reference, *bounds), period_s)

    def _read_limits(self) -> tuple[int, int, float, float]:
        """Return the lowest and highest counts, the period [s] and the farthest way within it.

        They are kept until something is written by SDO, unless commands carry them.
        """
        period_s = self.value(0x60C2, 1) * 10.0 ** self.value(0x60C2, 2)
        reach = self.value(0x607F) * self._resolution * period_s
        found = self.value(0x607D, 1), self.value(0x607D, 2), period_s, reach
        if not any(key[0] in LIMITS for pdo in self.rpdos.values() for key in pdo.keys):
            self._limits = found
        return found

    def _push(self, thousandths: int) -> None:
        """Push with a force in thousandths of the rated one, inside 6072h."""
        most = self.value(0x6072)
        self._plant.push(max(-most, min(most, thousandths)) * 1e-3 * self._rated)

    def _statusword(self) -> int:
        status = self._power.value | REMOTE
        if self._plant.mode != OFF:
            status |= VOLTAGE_ENABLED
        return status | FOLLOWS if self.enabled else status

    def _torque(self) -> int:
        """Return the motor's force in thousandths of the rated one (6076h)."""
        return thousandths(self._plant.servo_force, self._rated)
