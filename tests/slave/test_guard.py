import math

import pytest

from teleop_rt.slave.guard import ContactGuard


def guard() -> ContactGuard:
    return ContactGuard(force_cap=90.0, retreat_speed=0.1, axis_range=0.12, period_s=1e-3)


def update(guarding, target, **changes):
    known = {
        "command": 0.01,
        "position": changes.get("command", 0.01),
        "force": 0.0,
        "contact_id": 0,
        "acknowledged": 0,
        "surface": math.nan,
        "depth_cap": math.inf,
    }
    return guarding.update(target=target, **(known | changes))


def test_in_free_air_the_master_is_followed():
    assert update(guard(), 0.02) == 0.02


def test_first_contact_stops_following_within_the_tick_until_it_is_acknowledged():
    guarding = guard()
    met = {"contact_id": 1, "surface": 0.0137}
    assert update(guarding, 0.02, command=0.0138, **met) == 0.0138
    assert update(guarding, 0.05, command=0.0138, **met) == 0.0138
    assert update(guarding, 0.005, command=0.0138, **met) == 0.005
    assert update(guarding, 0.015, command=0.0138, acknowledged=1, **met) == 0.015
    assert guarding.waiting_for == 0


def test_a_contact_at_the_known_surface_is_followed_and_one_elsewhere_is_not():
    guarding = guard()
    update(guarding, 0.014, contact_id=1, acknowledged=1, surface=0.0137)
    assert update(guarding, 0.02, contact_id=2, acknowledged=1, surface=0.01372) == 0.02
    nearer = {"contact_id": 3, "acknowledged": 2, "surface": 0.005}
    assert update(guarding, 0.02, command=0.0051, **nearer) == 0.0051


def test_the_target_never_goes_deeper_than_the_force_cap_by_the_model():
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.0137, "depth_cap": 0.025}
    assert update(guard(), 0.05, **known) == 0.0137 + 0.025


def test_above_the_cap_by_measurement_the_tool_is_drawn_back_by_the_secant_at_once():
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.0137}
    pressed = known | {"command": 0.04, "position": 0.0337}
    assert update(guard(), 0.05, force=120.0, **pressed) == pytest.approx(0.0137 + 0.02 * 81 / 120)


def test_above_the_cap_the_tool_is_drawn_back_from_where_it_is_not_from_where_it_was_sent():
    unknown = {"contact_id": 1, "acknowledged": 1, "command": 0.04, "position": 0.0337}
    assert update(guard(), 0.05, force=91.0, **unknown) == 0.0337 - 1e-4
    behind = unknown | {"position": 0.045}
    assert update(guard(), 0.05, force=91.0, **behind) == 0.04 - 1e-4
    assert update(guard(), 0.05, force=89.0, **unknown) == 0.05


def test_the_secant_tells_how_deep_the_cap_allows_and_a_softer_one_counts_slowly():
    guarding = guard()
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.01}
    assert update(guarding, 0.5, force=20.0, position=0.02, **known) == 0.5, "too little to tell"
    stiff = 0.01 + 0.9 * 90 / (60 / 0.005)
    assert update(guarding, 0.5, force=60.0, position=0.015, **known) == pytest.approx(stiff)
    softer = update(guarding, 0.5, force=30.0, position=0.015, **known)
    assert stiff < softer < stiff + 0.02 * (stiff - 0.01)
    for _ in range(1000):
        last = update(guarding, 0.5, force=30.0, position=0.015, **known)
    assert last == pytest.approx(0.01 + 0.9 * 90 / (30 / 0.005))


def test_a_silent_master_lets_the_tool_retreat_to_the_surface_and_no_further():
    guarding = guard()
    assert guarding.retreat(command=0.02, surface=0.0137) == 0.02 - 1e-4
    assert guarding.retreat(command=0.01375, surface=0.0137) == 0.0137
    assert guarding.retreat(command=0.01, surface=0.0137) == 0.01
    assert guarding.retreat(command=0.02, surface=math.nan) == 0.02


def test_an_unknown_material_is_pressed_no_deeper_from_a_share_of_the_cap_on():
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.0137, "command": 0.015}
    probing = known | {"probing": True}
    assert update(guard(), 0.02, force=0.2 * 90, **probing) == 0.02
    assert update(guard(), 0.02, force=0.26 * 90, **probing) == 0.015
    assert update(guard(), 0.01, force=0.26 * 90, **probing) == 0.01
    assert update(guard(), 0.018, force=0.26 * 90, **known) == 0.018
