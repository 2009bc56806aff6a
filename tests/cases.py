"""Values of a parameter that take a test the same way; each run of the suite plays one of them."""

from __future__ import annotations

import pytest

OPTION = "--every-case"


def cases(played: object, *further: object) -> list[object]:
    """Return the values of a parameter: `played` in every run, the others only with `OPTION`.

    Several parameters of a value are a tuple, as for pytest.
    """
    return [played, *(_further(one) for one in further)]


def _further(value: object) -> object:
    values = value if isinstance(value, tuple) else (value,)
    return pytest.param(*values, marks=pytest.mark.further_case)
