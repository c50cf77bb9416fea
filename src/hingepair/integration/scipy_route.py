"""E12 by SciPy's solvers of differential equations, which choose their own steps."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from hingepair.errors import ArgumentError, MissingDependencyError
from hingepair.integration.increments import quaternion_product
from hingepair.integration.signals import Signal, Values

TOLERANCE: Final = 1e-12
MOST_LOOKS: Final = 1_000_000
"""At omega1, one at a time, that a solver may take: some twenty seconds."""

_SHARPEST = 3e-14  # SciPy takes no smaller relative tolerance


def quaternions(
    omega: Signal, t: Values, start: Values, *, body: bool, tol: float = TOLERANCE, solver: str = "DOP853"
) -> Values:
    """The attitudes at the instants from q' = omega q / 2 (body axes: q omega / 2); unit quaternions, shape (N, 4).

    Raises:
        MissingDependencyError: SciPy is not installed.
        ArgumentError: the solver gave up, or would take minutes.
    """
    try:
        from scipy.integrate import solve_ivp
    except ImportError as error:
        raise MissingDependencyError("method", "scipy (pip install scipy), or another method", str(error)) from None

    looks = 0

    def rate(time: float, q: Any) -> Any:
        nonlocal looks
        looks += 1
        if looks > MOST_LOOKS:
            got = f"{looks - 1:,} looks at omega1 until {time:.3g} s of {since[-1]:.3g} s"
            raise ArgumentError("method", f"'magnus6' for a motion so long or fast that {solver} takes minutes", got)
        w = (0.0, *(0.5 * omega.nodes(t[:1], np.array([time]), (1.0,))[0, 0]).tolist())
        p = tuple(q.tolist())
        return quaternion_product(p, w) if body else quaternion_product(w, p)

    if len(t) < 2:
        return start[None].copy()
    since = t - t[0]
    tolerance = max(tol, _SHARPEST)
    done = solve_ivp(rate, (0.0, since[-1]), start, method=solver, t_eval=since, rtol=tolerance, atol=tolerance)
    if not done.success:
        raise ArgumentError("method", f"a motion that {solver} can follow", done.message)
    q = done.y.T
    unit: Values = q / np.sqrt((q**2).sum(axis=1, keepdims=True))
    return unit
