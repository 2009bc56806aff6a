"""Who moves the master: the report's profile, or a recorded motion."""

from __future__ import annotations

import math
from typing import Protocol

from teleop_rt.config.operator import ProfileOperator

LIFTED_S = 0.2
"""Time in the air between two presses of a profile."""


class Operator(Protocol):
    """A hand on the master's device."""

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        """Return position and velocity at `t_s` since engagement, having felt `felt_force`."""

    def reset(self) -> None:
        """Go back to the start."""


class Profile:
    """The report's motion: approach, feel the wall, press it in a sinusoid, lift off, again.

    The device is ideal: position and velocity are those of the formula, neither quantised nor
    filtered. From where the wall is felt the mean penetration is reached along a parabola that
    starts at the approach speed, p = v τ - (v τ)² / 4 mean, while the sinusoid's amplitude
    grows as 3u² - 2u³: position and velocity are continuous and penetration stays positive.
    Lift-off starts at the trough of the sinusoid, at rest.
    """

    def __init__(self, config: ProfileOperator) -> None:
        self._config = config
        self._omega = 2 * math.pi * config.frequency_hz
        self._blend_s = 2 * config.mean / config.approach_speed
        trough = math.ceil(max(self._blend_s, config.lift_off_every_s) * config.frequency_hz + 0.25)
        self._pressing_s = (trough - 0.25) / config.frequency_hz
        self._lift_distance = config.mean - config.amplitude + config.lift_off_height
        fastest = max(config.approach_speed, self._omega * config.amplitude)
        self._lift_s = 1.5 * self._lift_distance / fastest
        self.reset()

    def reset(self) -> None:
        """Go back to the start of the approach."""
        self._pressing = False
        self._phase_start_s = 0.0
        self._phase_origin = self._config.start

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        """Return position and velocity at `t_s`; only the felt force shows where the wall is."""
        position, velocity = self._motion(t_s)
        if not self._pressing and felt_force > self._config.felt_force:
            self._pressing, self._phase_start_s, self._phase_origin = True, t_s, position
            position, velocity = self._motion(t_s)
        elif self._pressing and t_s >= self._cycle_end_s:
            self._phase_origin -= self._config.lift_off_height
            self._pressing, self._phase_start_s = False, self._cycle_end_s
            position, velocity = self._motion(t_s)
        return position, velocity

    @property
    def _cycle_end_s(self) -> float:
        return self._phase_start_s + self._pressing_s + self._lift_s + LIFTED_S

    def _motion(self, t_s: float) -> tuple[float, float]:
        since_s = t_s - self._phase_start_s
        if not self._pressing:
            speed = self._config.approach_speed
            return self._phase_origin + speed * since_s, speed
        x, v = self._press(since_s) if since_s < self._pressing_s else self._lift(since_s)
        return self._phase_origin + x, v

    def _press(self, since_s: float) -> tuple[float, float]:
        """Return penetration and velocity while pressing."""
        config = self._config
        sine = config.amplitude * math.sin(self._omega * since_s)
        cosine = config.amplitude * self._omega * math.cos(self._omega * since_s)
        if since_s >= self._blend_s:
            return config.mean + sine, cosine
        u = since_s / self._blend_s
        gain, gain_rate = u * u * (3 - 2 * u), 6 * u * (1 - u) / self._blend_s
        mean = config.mean * u * (2 - u)
        mean_rate = config.approach_speed * (1 - u)
        return mean + gain * sine, mean_rate + gain * cosine + gain_rate * sine

    def _lift(self, since_s: float) -> tuple[float, float]:
        """Return penetration and velocity from the trough to rest above the surface."""
        config = self._config
        u = min(1.0, (since_s - self._pressing_s) / self._lift_s)
        trough = config.mean - config.amplitude
        travelled = self._lift_distance * u * u * (3 - 2 * u)
        return trough - travelled, -self._lift_distance * 6 * u * (1 - u) / self._lift_s
