"""E12 by SciPy's solvers of differential equations, which choose their own steps."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from hingepair.errors import ArgumentError, MissingDependencyError
from hingepair.integration.increments import quaternion_product
from hingepair.integration.signals import Signal, Values

TOLERANCE: Final = 1e-12
_SHARPEST = 3e-14  # SciPy takes no smaller relative tolerance


def quaternions(
    omega: Signal, t: Values, start: Values, *, body: bool, tol: float = TOLERANCE, solver: str = "DOP853"
) -> Values:
    """The attitudes at the instants from q' = omega q / 2 (body axes: q omega / 2); unit quaternions, shape (N, 4).

    Raises:
        MissingDependencyError: SciPy is not installed.
        ArgumentError: the solver gave up.
    """
    try:
        from scipy.integrate import solve_ivp
    except ImportError as error:
        raise MissingDependencyError(
            "method", "scipy (pip install '.[bench]' in the project's folder)", str(error)
        ) from None

    def rate(time: float, q: Any) -> Any:
        w = (0.0, *(0.5 * omega.at(np.array([time]))[0]).tolist())
        p = tuple(q.tolist())
        return quaternion_product(p, w) if body else quaternion_product(w, p)

    if len(t) < 2:
        return start[None].copy()
    tolerance = max(tol, _SHARPEST)
    done = solve_ivp(rate, (t[0], t[-1]), start, method=solver, t_eval=t, rtol=tolerance, atol=tolerance)
    if not done.success:
        raise ArgumentError("method", f"a motion that {solver} can follow", done.message)
    q = done.y.T
    unit: Values = q / np.sqrt((q**2).sum(axis=1, keepdims=True))
    return unit
