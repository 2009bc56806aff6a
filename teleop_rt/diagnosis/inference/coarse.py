"""A problem at a lower sampling rate: a search screens it first, in a fraction of the time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from teleop_rt.contact.effect import Effect, Matrix, Vector
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.whiten import Whitener, band_bins

LEAST_HZ, JUMPS_HZ = 250.0, 500.0  # at half of either, some laws start too far from the optimum
LEAST_SAMPLES, JUMPS_SAMPLES = 6_000, 12_000  # of a long recording: it is a slow machine's
_ROUNDING = 1e-6  # of a sample; a stated rate of 250 Hz may be 249.9999


@dataclass(frozen=True, kw_only=True)
class Coarse(Problem):
    """A decimated problem, within the band that its samples resolve.

    `finely` whitens the finer problem's samples to the same bins, `wanted` is the whitened force,
    and `rows` are those of effects alone on their grids, kept for the next search.
    """

    finely: Whitener
    wanted: Vector
    rows: dict[Effect, Matrix] = field(default_factory=dict)

    @property
    def target(self) -> Vector:
        """The whitened force."""
        return self.wanted

    def rows_of(self, effect: Effect, places: Sequence[Vector], shift: float = 0.0) -> Matrix:
        """Return the whitened columns of an effect alone at the places of its grid."""
        if shift:
            return super().rows_of(effect, places, shift)
        if effect not in self.rows:
            self.rows[effect] = super().rows_of(effect, places)
        return self.rows[effect]

    def around(self, problem: Problem, fit: Fit) -> tuple[Coarse, Fit]:
        """Return the coarse problem and fit with the same residual as the fit has at full rate.

        Slow samples show a jump at a contact late, and alias its spectrum. These errors exceed the
        effects searched, so the coarse force is the fit's prediction plus the full-rate residual.
        """
        whole = self.finely.mask.size
        left = self.finely(problem.residual(fit)[:whole])
        near = replace(self, wanted=self.whitener(fit.force_on(self.motion)) + left)
        return near, near.solve(fit.model, fit.zeta, fit.theta)


def coarsened(
    problem: Problem, least_hz: float = LEAST_HZ, most_samples: int = LEAST_SAMPLES
) -> Coarse:
    """Return the problem at a rate [Hz] or somewhat more, as it is where its rate is lower.

    With more samples than `most_samples` the rate is lower still.
    """
    motion = problem.motion
    by_rate = int(1.0 / (least_hz * motion.dt) + _ROUNDING)
    every = max(1, by_rate, -(-motion.x.size // most_samples))
    whole = motion.x.size - motion.x.size % every  # so that the bins are the same frequencies
    slow = motion.every(every)
    bins = min(problem.whitener.bins, band_bins(slow.t.size, slow.dt))
    fine = _within(problem.whitener, problem.whitener.mask[:whole], bins)
    # A sum over fewer samples is as many times smaller, and its power by the square of that.
    slowly = _within(fine, fine.mask[::every], bins, 1.0 / every**2)
    slowly = replace(slowly, bridged=fine.bridged // every)
    return Coarse(
        motion=slow,
        force=problem.force[:whole:every],
        whitener=slowly,
        surface=problem.surface,
        resolution=problem.resolution,
        finely=fine,
        wanted=fine(problem.force[:whole]),
    )


def at_lower_rates(problem: Problem) -> tuple[Coarse, Coarse]:
    """Return the problem at a rate that resolves the jumps of a contact, and at the lowest rate.

    Both are made once, because they keep the rows of all effects on their grids.
    """

    def make() -> tuple[Coarse, Coarse]:
        return coarsened(problem, JUMPS_HZ, JUMPS_SAMPLES), coarsened(problem)

    return problem.made("lower rates", make)


def _within(whitener: Whitener, mask: Vector, bins: int, power: float = 1.0) -> Whitener:
    """Return the whitener of rows with another mask, of the lowest bins alone."""
    density, known = (power * row[:bins] for row in (whitener.density, whitener.known))
    return replace(whitener, mask=mask, density=density, known=known)
