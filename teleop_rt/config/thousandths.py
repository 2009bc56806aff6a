"""A value in mm or mrad where the unit of the key is m or rad."""

from __future__ import annotations

FACTOR = 10.0
"""By so much a value must be too large before it is taken for one in thousandths [1]."""


def meant_in_thousandths(values: tuple[float, ...], most: float, unit: str) -> str:
    """Return the question whether values above `most` are in thousandths of the unit, or "".

    It is asked where they are far too large as they are, and fit if they are in thousandths.
    """
    large = [value for value in values if abs(value) > FACTOR * most]
    if most <= 0.0 or not large or any(abs(value) > 1e3 * most for value in large):
        return ""
    meant = " and ".join(f"{value:g} m{unit} are {1e-3 * value:g} {unit}" for value in large)
    return f" (in m{unit}? {meant})"
