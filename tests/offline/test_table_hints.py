"""Tables in other units or with marks of thousands: a hint, or a refusal with the place."""

import numpy as np
import pytest

from teleop_rt.offline.weak_force import weak_force
from teleop_rt.recordings.recording import from_arrays

TIME_S = np.arange(0.0, 4.0, 0.002)


def table(force):
    return from_arrays("table", TIME_S, 0.01 * np.sin(TIME_S), force)


@pytest.mark.parametrize(("largest", "doubted"), [(0.04, True), (0.2, False), (40.0, False)])
def test_a_force_too_weak_for_newtons_is_doubted_where_no_unit_is_stated(largest, doubted):
    found = weak_force(table(0.5 * largest * np.sin(TIME_S)))
    assert (found is not None) is doubted
    assert not doubted or "say so with --units force=kN" in found


def test_a_stated_unit_is_not_doubted(call, tmp_path):
    rows = np.transpose((TIME_S, 10.0 * np.sin(9.0 * TIME_S), 1e-2 * np.sin(9.0 * TIME_S)))
    for name, header, doubted in (("a", "t,x_m,f", True), ("b", "t_s,x_mm,f_N", False)):
        scale = 1e-3 if doubted else 1.0
        path = tmp_path / f"{name}.csv"
        np.savetxt(path, rows * (1.0, scale, 1.0), delimiter=",", header=header, comments="")
        code, out, _ = call("diagnose", path, "--base", "spring,viscous,bias")
        assert code == 0
        assert ("is the unit right?" in out) is doubted


def test_marks_of_thousands_are_refused_with_their_place(call, tmp_path):
    lines = [f"{i},0;45.{i:03d},5;{'1.' if i > 400 else ''}200,25" for i in range(500)]
    path = tmp_path / "grouped.csv"
    head = "Zeit [ms];Weg [µm];Kraft [mN]"
    path.write_text("\n".join([head, *lines]))
    code, out, err = call("diagnose", path)
    assert (code, out) == (2, "")
    assert "line 2: '45.000,5' has its thousands grouped" in err
    path.write_text("\n".join([head, *lines]).replace(".", ""))
    assert "grouped" not in call("diagnose", path)[2].replace("grouped.csv", "")
