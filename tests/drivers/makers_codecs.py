"""One codec of each maker's drive, as the tests of their bytes use them."""

from __future__ import annotations

from hypothesis import strategies as st

from teleop_rt_drivers.actuators.mit import (
    DAMIAO_RANGES,
    TYPED_RANGES,
    DamiaoCodec,
    Gains,
    MotorLimits,
    TypedCodec,
)
from teleop_rt_drivers.actuators.moteus import MoteusCodec
from teleop_rt_drivers.actuators.odrive import OdriveCodec
from teleop_rt_drivers.actuators.vesc import VescCodec, VescMotor

NODE = 5
FLOATS = st.floats(-1e4, 1e4, width=32)


def odrive():
    return OdriveCodec(NODE, 0.05, 50.0, 40.0)


DM = DAMIAO_RANGES["DM4310"]


def damiao():
    return DamiaoCodec(0x01, 0x11, DM, Gains(80.0, 1.0))


RS = TYPED_RANGES["robstride02"]


def robstride():
    return TypedCodec(0x7F, 0xFD, RS, Gains(80.0, 1.0), MotorLimits(17.0, 50))


def moteus():
    return MoteusCodec(1, 2.0, 50.0, 0.05)


VESC = 23


def vesc():
    return VescCodec(VESC, VescMotor(7, 4.0, 0.06, 60.0, 85.0))
