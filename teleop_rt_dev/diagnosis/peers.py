"""Sparse regression by pysindy and SysIdentPy on records in an NPZ file; prints JSON lines.

Runs in the peers' own environment, for which see peers_venv.py, and imports nothing of ours. Each
gets the same columns of the same smoothed motion, and is scored on each fold by the others.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from typing import Any

import numpy as np

NOISE = 0.01
THRESHOLD = 0.01
ALWAYS_SEEN = -1  # fold of samples that are hidden from no fit
_LARGEST_MODEL = 8


def sindy(theta: Any, force: Any, optimizer: Any) -> Any:
    """Return coefficients by an optimizer of pysindy."""
    optimizer.fit(theta, force[:, None])
    return np.asarray(optimizer.coef_).ravel()


def _price(theta: Any) -> float:
    """Return the price of a term: pysindy multiplies it by the condition number.

    Then it is the mean square of the records' noise, over that of the force.
    """
    return NOISE**2 / float(np.linalg.cond(theta))


def stlsq(theta: Any, force: Any) -> Any:
    import pysindy  # noqa: PLC0415 - a peer, perhaps not installed

    return sindy(theta, force, pysindy.STLSQ(threshold=THRESHOLD, alpha=1e-6))


def frols(theta: Any, force: Any) -> Any:
    import pysindy  # noqa: PLC0415 - as above

    return sindy(theta, force, pysindy.FROLS(kappa=_price(theta), max_iter=_LARGEST_MODEL))


def ssr(theta: Any, force: Any) -> Any:
    import pysindy  # noqa: PLC0415 - as above

    return sindy(theta, force, pysindy.SSR(kappa=_price(theta), max_iter=theta.shape[1]))


def sysidentpy_frols(theta: Any, force: Any) -> Any:
    from sysidentpy.basis_function import Polynomial  # noqa: PLC0415 - as above
    from sysidentpy.model_structure_selection import FROLS  # noqa: PLC0415 - as above
    from sysidentpy.parameter_estimation import LeastSquares  # noqa: PLC0415 - as above

    model = FROLS(
        order_selection=True, estimator=LeastSquares(), n_info_values=_LARGEST_MODEL,
        info_criteria="bic", xlag=[[1]] * theta.shape[1], model_type="NFIR",
        basis_function=Polynomial(degree=1),
    )  # fmt: skip
    # Its regressors lag by at least one sample: the force is moved to meet them.
    model.fit(X=theta[:-1], y=np.concatenate([force[:1], force[:-2]])[:, None])
    found = np.zeros(theta.shape[1])
    for code, value in zip(model.final_model[:, 0], model.theta.ravel(), strict=True):
        if code >= 2000:
            found[int(code) // 1000 - 2] = value
    return found


def errors_in_variables(theta: Any, force: Any) -> Any:
    """Return coefficients by SINDy with errors in variables, chosen by their evidence.

    Columns of a noisy motion are noisy themselves, which biases least squares towards 0; the share
    of their noise in the normal equations is subtracted (Fuller 1987). Terms are left out one by
    one while the Bayesian information criterion falls. This is no full orthogonal distance
    regression with Laplace evidence (ODR-BINDy), for which there is no package.
    """
    samples = force.size
    rough = np.diff(theta, 3, axis=0)  # white noise has 20 times its variance in third differences
    noise = np.cov(rough, rowvar=False) / 20.0
    square = theta.T @ theta - samples * np.minimum(1.0, 0.5 / _largest_share(theta, noise)) * noise
    right, energy = theta.T @ force, float(force @ force)

    def solved(kept: list[int]) -> tuple[float, Any]:
        c = np.linalg.lstsq(square[np.ix_(kept, kept)], right[kept], rcond=1e-10)[0]
        left = max(energy - float(c @ right[kept]), NOISE**2 * energy)
        return samples * np.log(left / samples) + len(kept) * np.log(samples), c

    kept = list(range(theta.shape[1]))
    best, coefficients = solved(kept)
    while len(kept) > 1:
        tries = [(*solved([k for k in kept if k != out]), out) for out in kept]
        score, less, out = min(tries, key=lambda one: one[0])
        if score >= best:
            break
        best, coefficients = score, less
        kept.remove(out)
    found = np.zeros(theta.shape[1])
    found[kept] = coefficients
    return found


def _largest_share(theta: Any, noise: Any) -> float:
    """Return the largest share of a column's power that its noise has."""
    return float(np.max(np.diag(noise) / np.maximum(np.mean(theta**2, axis=0), 1e-300)))


PEERS = {
    "errors-in-variables SINDy": errors_in_variables,
    "pysindy STLSQ": stlsq,
    "pysindy FROLS": frols,
    "pysindy SSR": ssr,
    "SysIdentPy FROLS": sysidentpy_frols,
}


def main() -> None:
    warnings.simplefilter("ignore")
    with np.load(sys.argv[1], allow_pickle=False) as archive:
        records = dict(archive)
    for name, regress in PEERS.items():
        for i in range(int(records["count"])):
            theta, force, fold = (records[f"{key}{i}"] for key in ("theta", "force", "fold"))
            for number in sorted(set(fold.tolist()) - {ALWAYS_SEEN}):
                answer = scored(regress, theta, force, fold == number)
                print(json.dumps({"peer": name, "record": i, "fold": number, **answer}))


def scored(regress: Any, theta: Any, force: Any, hidden: Any) -> dict[str, Any]:
    """Return coefficients over the force's deviation, and the residual on hidden samples."""
    seen = ~hidden
    scale = np.sqrt(np.mean(theta[seen] ** 2, axis=0))
    scale[scale == 0.0] = 1.0
    level = np.std(force[seen])
    begun = time.process_time()
    try:
        coefficients = regress(theta[seen] / scale, force[seen] / level)
    except Exception as error:  # noqa: BLE001 - whatever a peer raises is its answer
        return {"error": repr(error)}
    left = force[hidden] - level * (theta[hidden] / scale @ coefficients)
    return {
        "coefficients": coefficients.tolist(), "rms": float(np.sqrt(np.mean(left**2))),
        "seconds": time.process_time() - begun,
    }  # fmt: skip


if __name__ == "__main__":
    main()
