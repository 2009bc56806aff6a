"""The CiA 402 drive state machine, seen from the controller."""

from __future__ import annotations

from enum import IntEnum

MODE_CYCLIC_SYNCHRONOUS_POSITION = 8  # 6060h of CiA 402
MODE_CYCLIC_SYNCHRONOUS_TORQUE = 10  # 6060h of CiA 402
MODE_NAMES = {
    MODE_CYCLIC_SYNCHRONOUS_POSITION: "cyclic synchronous position",
    MODE_CYCLIC_SYNCHRONOUS_TORQUE: "cyclic synchronous torque",
}
CONTROLWORD, STATUSWORD = "0x6040", "0x6041"
MODE, MODE_DISPLAY, SUPPORTED_MODES = "0x6060", "0x6061", "0x6502"
TARGET_POSITION, ACTUAL_POSITION = "0x607A", "0x6064"
ERROR_CODE = "0x603F"
TARGET_TORQUE, MAX_TORQUE, RATED_TORQUE = "0x6071", "0x6072", "0x6076"
ACTUAL_TORQUE = "0x6077"
PER_RATED = 1000
"""Torques are in thousandths of the rated one."""

# Commands of the controlword.
DISABLE_VOLTAGE = 0x0000
QUICK_STOP = 0x0002
SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
ENABLE_OPERATION = 0x000F
FAULT_RESET = 0x0080


class Cia402State(IntEnum):
    """States of the drive, by their bits of the statusword."""

    NOT_READY = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION = 0x0F
    FAULT = 0x08


_BY_LOW_BITS = {state.value: state for state in Cia402State}
# Bits of the statusword that a state is read from; some states leave bit 5 open.
_WITHOUT_QUICK_STOP_BIT = 0x4F
_WITH_QUICK_STOP_BIT = 0x6F

NEXT_TOWARDS_ENABLED = {
    Cia402State.SWITCH_ON_DISABLED: SHUTDOWN,
    Cia402State.READY_TO_SWITCH_ON: SWITCH_ON,
    Cia402State.SWITCHED_ON: ENABLE_OPERATION,
    Cia402State.OPERATION_ENABLED: ENABLE_OPERATION,
}
"""Controlword that leads one state on; from the others there is no way but a human's."""


def drive_state(statusword: int) -> Cia402State:
    """Return the state in a statusword (CiA 402-2, table of bits 0 to 3, 5 and 6)."""
    by_four_bits = statusword & _WITHOUT_QUICK_STOP_BIT
    if by_four_bits in (0x00, 0x40, 0x08, 0x0F):
        return _BY_LOW_BITS[by_four_bits]
    return _BY_LOW_BITS.get(statusword & _WITH_QUICK_STOP_BIT, Cia402State.NOT_READY)
