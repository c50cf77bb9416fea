"""What acts on motions from step to step: efforts or a controller, and wrenches."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.numeric.arrays import Float64Array, Frozen, own_copy, real_array, set_frozen
from hingepair.plans.rollouts import Control


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Feedback(Frozen):
    """Controller of a rollout: tau = tau_ff + K (q_ref - q) + D (qd_ref - qd).

    Args:
        K: gains of the positions [N m/rad, N/m]: a number or shape (dof,), on the diagonal; or matrices, shape
            (dof, dof) or (..., steps, dof, dof). `Feedback.diagonal` takes a diagonal for each motion.
        D: gains of the rates [N m s/rad, N s/m], in the same forms.
        q_ref: wanted coordinates: a number or shape (dof,), held; or shape (..., steps, dof), held over each step.
        qd_ref: wanted rates, in the same forms.
        tau_ff: efforts that are added [N m, N], in the same forms.

    Raises:
        ArgumentError: a value cannot be used.
    """

    K: NDArray[Any]
    D: NDArray[Any]
    q_ref: NDArray[Any]
    qd_ref: NDArray[Any]
    tau_ff: NDArray[Any]

    def __init__(
        self, K: ArrayLike, D: ArrayLike, q_ref: ArrayLike, qd_ref: ArrayLike = 0.0, tau_ff: ArrayLike = 0.0
    ) -> None:
        given = {"K": K, "D": D, "q_ref": q_ref, "qd_ref": qd_ref, "tau_ff": tau_ff}
        arrays = {name: np.asarray(real_array(f"tau.{name}", value), np.float64) for name, value in given.items()}
        set_frozen(self, **{name: own_copy(array) for name, array in arrays.items()})

    @classmethod
    def diagonal(
        cls, K: ArrayLike, D: ArrayLike, q_ref: ArrayLike, qd_ref: ArrayLike = 0.0, tau_ff: ArrayLike = 0.0
    ) -> Feedback:
        """Return a Feedback whose gains are diagonals, which may differ from motion to motion.

        Args:
            K: gains of the positions on the diagonal: a number, or shape (..., dof), such as (2000, dof) for 2000
                motions.
            D: gains of the rates, in the same form.
            q_ref: as for `Feedback`.
            qd_ref: as for `Feedback`.
            tau_ff: as for `Feedback`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> gains = np.linspace(1, 9, 5)[:, None] * np.ones(robot.dof)  # five motions
        >>> control = hp.Feedback.diagonal(gains, 2.0, q_ref=0.3)
        >>> robot.rollout(np.zeros((5, 6)), np.zeros(6), control, 1e-3, steps=10).q.shape
        (5, 11, 6)
        """
        gains: list[ArrayLike] = []
        for name, value in (("K", K), ("D", D)):
            array = np.asarray(real_array(f"tau.{name}", value), np.float64)
            # Held over all steps, on an axis of one step.
            gains.append(array if array.ndim < 2 else array[..., None, None, :] * np.eye(array.shape[-1]))
        return cls(gains[0], gains[1], q_ref, qd_ref, tau_ff)


class Track(NamedTuple):
    """Values of an argument of a rollout at its steps, or one value for all."""

    label: str  # name in messages
    values: Float64Array  # (..., instants, *one sample); one instant holds for all
    tail: tuple[int, ...]  # shape of one sample
    has_steps: bool  # whether it was given with an axis of steps

    @property
    def instants(self) -> int:
        """How many instants it has; 1 holds for all."""
        count: int = self.values.shape[self.values.ndim - len(self.tail) - 1]
        return count

    @property
    def lead(self) -> tuple[int, ...]:
        """Leading shape: of the motions."""
        return self.values.shape[: self.values.ndim - len(self.tail) - 1]

    def flat(self, shape: tuple[int, ...]) -> Float64Array:
        """Return the values for motions of this shape as an array (motions or 1, instants, *one sample)."""
        own = self.values.shape[len(self.lead) :]
        if math.prod(self.lead) == 1:
            return self.values.reshape(1, *own)
        return np.broadcast_to(self.values, (*shape, *own)).reshape(-1, *own)


def track(label: str, value: Any, *tail: int) -> Track:
    """Return an argument as a Track. A number or one sample holds for all steps; further axes end with the steps.

    Raises:
        ArgumentError: the value cannot be used.
    """
    array = np.asarray(real_array(label, value), np.float64)
    if array.ndim == 0:
        array = np.broadcast_to(array, tail)
    if array.ndim < len(tail) or array.shape[array.ndim - len(tail) :] != tail:
        expected = f"shape {tail} or (..., steps, {', '.join(map(str, tail))})"
        raise ShapeError(label, expected, f"shape {array.shape}")
    has_steps = array.ndim > len(tail)
    return Track(label, array if has_steps else array[None], tail, has_steps)


def control_tracks(tau: Any, dof: int, limit: Any) -> tuple[Control, dict[str, Track]]:
    """Return the Control that tau (arrays, or a Feedback) asks for, and the tracks of its inputs; `limit` holds the
    largest efforts, or is None.

    Raises:
        ArgumentError: a value cannot be used.
    """
    limited = {} if limit is None else {"limit": track("effort_limits", limit, dof)}
    if limited and not (limited["limit"].values >= 0).all():
        raise ArgumentError("effort_limits", "numbers from 0", quoted(limit))
    if not isinstance(tau, Feedback):
        return Control("none", bool(limited)), {"tau": track("tau", tau, dof), **limited}
    tracks = {name: track(f"tau.{name}", getattr(tau, name), dof) for name in ("q_ref", "qd_ref", "tau_ff")}
    full = tau.K.ndim > 1 or tau.D.ndim > 1
    for name in ("K", "D"):
        gain: Any = getattr(tau, name)
        if full and gain.ndim < 2:
            gain = np.diag(track(f"tau.{name}", gain, dof).values[0])
        if full and gain.shape[-2:] != (dof, dof):
            expected = f"shape ({dof},), ({dof}, {dof}) or (..., steps, {dof}, {dof}); hp.Feedback.diagonal takes a"
            raise ShapeError(f"tau.{name}", f"{expected} diagonal for each motion", f"shape {gain.shape}")
        tracks[name] = track(f"tau.{name}", gain, *((dof, dof) if full else (dof,)))
    return Control("full" if full else "diagonal", bool(limited)), {**tracks, **limited}


def count_steps(tracks: Mapping[str, Track], steps: int | None) -> int:
    """Return the number of steps, on which all tracks agree.

    Raises:
        ArgumentError: they do not agree, or nothing says how many steps there are.
    """
    if steps is not None and (isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 0):
        raise ArgumentError("steps", "a whole number from 0", quoted(steps))
    count = None if steps is None else int(steps)
    for one in tracks.values():
        if one.instants in (1, count):
            continue
        if count is not None:
            raise ShapeError(one.label, f"values for {count} instants, or for one", f"{one.instants}")
        count = one.instants
    if count is None and any(one.has_steps for one in tracks.values()):
        count = 1
    if count is None:
        raise ArgumentError("steps", "a number of steps, since no argument has an axis of steps", None)
    return count
