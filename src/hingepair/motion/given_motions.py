"""Motions that users prescribe as callables of time, of the base and of joints, and the check of their rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_arrays
from hingepair.mechanism.bodies.hinge_load import call_with_arrays, check_callable
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.plans.pairs import SPACE

JointCallable: TypeAlias = Callable[[Array], Any]
"""Coordinate of a joint and its first two derivatives at instants (n,) [s]; (n,) each."""


class GivenMotion:
    """Motion that a callable of time prescribes.

    Args:
        label: its name in messages.
        motion: the callable.
        rates: names of rates by the quantities of which they are the derivatives.
        read: returns what the callable has returned at n instants as n rows by name, or refuses it.

    Raises:
        ArgumentError: it is no callable of t.
    """

    def __init__(
        self,
        label: str,
        motion: Callable[[Array], Any],
        rates: Mapping[str, str],
        read: Callable[[str, Any, Array], dict[str, Array]],
    ) -> None:
        check_callable(label, motion, "t")
        self._label, self._motion, self._rates, self._read = label, motion, rates, read

    def at(self, t: Array) -> dict[str, Array]:
        """Return the motion at n instants, arrays of n rows by name.

        Raises:
            ArgumentError: the callable returns something else.
        """
        return self._read(self._label, call_with_arrays(self._label, self._motion, t), t)

    def check(self, t: Array) -> None:
        """Raise an ArgumentError unless rates are derivatives and velocities do not jump, from t[0] to t[-1]."""
        _check_rates(self._label, self.at, t, self._rates)


def given_base(label: str, motion: Callable[[Array], BodyMotion]) -> GivenMotion:
    """Return the motion of a base: R1, S1, v1, omega1, a1 and alpha1."""
    return GivenMotion(label, motion, {"v1": "R1", "omega1": "S1", "a1": "v1", "alpha1": "omega1"}, _read_base)


def given_joint(label: str, motion: JointCallable) -> GivenMotion:
    """Return the motion of a joint: psi, psid and psidd, in this order."""
    return GivenMotion(label, motion, {"psid": "psi", "psidd": "psid"}, _read_joint)


def _read_base(label: str, returned: Any, t: Array) -> dict[str, Array]:
    arrays = motion_arrays(f"{label}1", returned, "R", "S", "v", "omega", "a", "alpha")
    try:
        return {name: np.broadcast_to(x, (len(t), *SPACE.shapes[name])) for name, x in arrays.items()}
    except ValueError:
        expected = f"a callable that returns the motion of the base at {len(t)} instants"
        raise ArgumentError(label, expected, {name: array.shape for name, array in arrays.items()}) from None


def _read_joint(label: str, returned: Any, t: Array) -> dict[str, Array]:
    try:
        values = (np.broadcast_to(np.asarray(value, np.float64), t.shape) for value in returned)
        return dict(zip(("psi", "psid", "psidd"), values, strict=True))
    except (TypeError, ValueError):
        raise ArgumentError(
            label, f"a callable that returns (psi, psi', psi'') at {len(t)} instants", returned
        ) from None


def check_rest(label: str, base: str, start: BodyMotion) -> None:
    """Refuse a start of the base with a speed that `base`, "free", "pinned" or "fixed", does not allow."""
    for name in {"free": (), "pinned": ("v",), "fixed": ("v", "omega")}[base]:
        speed = getattr(start, name)
        if speed is not None and np.any(speed):
            raise ArgumentError(f"{label}.{name}", f"None or zeros for base={base!r}", speed)


def _check_rates(
    name: str, motion: Callable[[Array], dict[str, Array]], t: Array, derived: Mapping[str, str]
) -> None:
    """Refuse a rate of a given motion that differs by more than a tenth, over the whole motion, from the central
    difference of the quantity that `derived` names for it. S1 is an attitude; names may end with the number of a
    body.
    """
    span = float(t[-1] - t[0])
    if not span:
        return
    middles = t[0] + span * (np.arange(16) + 0.5) / 16
    given = motion(middles)
    excess = dict.fromkeys(derived, np.nan)
    # A rate counts as right if one step fits it: long ones are coarse. Short ones that drown in rounding say nothing.
    for step in span * np.array([1e-3, 1e-5, 1e-7]):
        before, after = motion(middles - step), motion(middles + step)
        for rate, quantity in derived.items():
            size, change = float(np.abs(after[quantity]).max()), after[quantity] - before[quantity]
            if quantity == "S1":
                turn = after[quantity] @ np.swapaxes(before[quantity], -1, -2)
                change = np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1) / 2
            slopes, rates = change / (2 * step), given[rate]
            rounding = np.spacing(size) + np.spacing(abs(t[0]) + span) * float(np.abs(rates).max())
            allowed = 0.1 * max(float(np.abs(slopes).sum()), float(np.abs(rates).sum()))
            if 64 * slopes.size * rounding < step * allowed:
                excess[rate] = np.fmin(excess[rate], float(np.abs(slopes - rates).sum()) - allowed)
    for rate, quantity in derived.items():
        if excess[rate] > 0:
            letters = rate.removesuffix("1"), quantity.removesuffix("1")
            expected = f"a callable whose {letters[0]} is the derivative of its {letters[1]}"
            raise ArgumentError(name, expected, f"another {letters[0]}")
    for rate, quantity in derived.items():
        if quantity in derived:
            _check_jumps(name, motion, t, quantity, rate)


def _check_jumps(name: str, motion: Callable[[Array], dict[str, Array]], t: Array, velocity: str, rate: str) -> None:
    """Refuse a velocity that jumps: the simulation knows its rate, but no impulse."""

    def excess(times: Array) -> tuple[Array, Array]:
        """Return by how much v changes beyond its rate in each interval, most at a jump, and |v| at each instant."""
        found = motion(times)
        v, a = (found[key].reshape(len(times), -1) for key in (velocity, rate))
        steps = np.diff(times)[:, None]
        rounding = 4 * np.spacing(np.abs(times).max()) * np.abs(a).max(initial=0.0)
        more = np.abs(np.diff(v, axis=0) - steps * (a[1:] + a[:-1]) / 2) - rounding
        return more.max(axis=1), np.abs(v).max(axis=1)

    margin = 1e-9 * (t[-1] - t[0])  # a jump at the first or the last instant changes nothing
    times = np.linspace(t[0] + margin, t[-1] - margin, 1025)
    more, sizes = excess(times)
    k = int(np.argmax(more))
    start, end = times[k : k + 2]
    for _ in range(40):  # bisection: what a finite rate adds vanishes with the interval
        more, _ = excess(np.array([start, (start + end) / 2, end]))
        start, end = (start, (start + end) / 2) if more[0] >= more[1] else ((start + end) / 2, end)
    if more.max() > 1e-6 * sizes.max():
        letter = velocity.removesuffix("1")
        raise ArgumentError(
            name, f"a motion whose {letter} does not jump", f"a jump of {letter} at t = {start:.6g} s"
        )
