"""E12 by the equations' own route: phi' = J(phi)^-1 omega for the Euler angles of body 1, by Runge-Kutta steps.

The sequence is E10's, XYZ. The rates grow without bound towards gimbal lock, and no step is short enough there.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import GimbalLockError
from hingepair.evaluation import kernel_cache
from hingepair.evaluation.backend import How
from hingepair.integration.attitude_steps import Rule, Steps
from hingepair.integration.euler_steps import runge_kutta
from hingepair.integration.increments import Quaternion, quaternion_product
from hingepair.integration.signals import Signal, Values

RULE: Final = Rule(5, 4, (0.0, 0.5, 1.0))


def euler_angles(omega: Signal, steps: Steps, how: How, start: NDArray[Any], *, body: bool) -> Values:
    """The Euler angles of body 1 at the instants, continuous in time, shape (N, 3).

    Raises:
        GimbalLockError: an angle would turn by more than 1 rad in a step, near lock or since steps are too long;
            names the time.
    """
    found = np.empty((len(steps.t), 3))
    found[0] = start
    run: Any = runge_kutta
    if how.compiles(int(steps.counts.sum()), kernel_cache.turns_loaded):
        run = kernel_cache.turn_kernels().euler
    for first, last in steps.slabs():
        begin, (h, _), ends = steps.within(first, last)
        rows = np.empty((len(h), 3))
        at = run(np.ascontiguousarray(omega.nodes(begin, h, RULE.nodes)), h, found[first], body, rows)
        if at >= 0:
            near = rows[at - 1, 1] if at else found[first, 1]
            raise GimbalLockError(
                "method",
                "'magnus6' (or another that knows no lock) for a motion near gimbal lock, phi_y = +-1.5708; or "
                "shorter steps",
                f"'euler_angles' with phi_y = {near:.6g} at t = {begin[at]:.6g} and more than 1 rad in {h[at]:.3g} s",
            )
        found[first + 1 : last + 1] = rows if ends is None else rows[ends]
    return found


def quaternions_of_euler(phi: Values) -> Values:
    """The rotations of Euler angles (E10), unit quaternions (w, x, y, z) that are continuous where the angles are."""
    s, c = np.sin(0.5 * phi), np.cos(0.5 * phi)
    x, y, z = (_about(i, s[:, i], c[:, i]) for i in range(3))
    return np.stack(quaternion_product(quaternion_product(x, y), z), axis=-1)


def _about(axis: int, sine: Values, cosine: Values) -> Quaternion:
    x, y, z = (sine if i == axis else 0 * sine for i in range(3))
    return cosine, x, y, z
