"""Sparse regression by pysindy and SysIdentPy on records in an NPZ file; prints JSON lines.

Runs in the peers' own environment, for which see bench_diagnosis.py, and imports nothing of ours.
Each gets a dictionary with one column per additive effect, from the same smoothed motion.
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
_LARGEST_MODEL = 8


def sindy(theta: Any, force: Any, optimizer: Any) -> Any:
    """Return coefficients by an optimizer of pysindy."""
    optimizer.fit(theta, force[:, None])
    return np.asarray(optimizer.coef_).ravel()


def _price(theta: Any) -> float:
    """Return what a term costs: pysindy multiplies it by the condition number.

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


PEERS = {
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
            theta, force, split = records[f"theta{i}"], records[f"force{i}"], int(records["split"])
            scale = np.sqrt(np.mean(theta[:split] ** 2, axis=0))
            scale[scale == 0.0] = 1.0
            level = np.std(force[:split])
            begun = time.process_time()
            try:
                coefficients = regress(theta[:split] / scale, force[:split] / level)
            except Exception as error:  # noqa: BLE001 - whatever a peer raises is its answer
                print(json.dumps({"peer": name, "record": i, "error": repr(error)}))
                continue
            seconds = time.process_time() - begun
            left = force[split:] - level * (theta[split:] / scale @ coefficients)
            print(json.dumps({
                "peer": name, "record": i, "coefficients": coefficients.tolist(),
                "rms": float(np.sqrt(np.mean(left**2))), "seconds": seconds,
            }))  # fmt: skip


if __name__ == "__main__":
    main()
