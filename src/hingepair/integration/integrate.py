"""E12: from omega1(t) and psi'(t) to attitudes, and to everything about body 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, quoted
from hingepair.evaluation.backend import choose
from hingepair.integration.attitude_steps import RULES
from hingepair.integration.position import read_position
from hingepair.integration.routes import (
    METHODS,
    Course,
    check_reached,
    check_tolerance,
    hinge_angles,
    plain_steps,
    plane_angle,
    space_attitudes,
)
from hingepair.integration.signals import Signal, Values, read_signal
from hingepair.integration.trajectory import PlanarTrajectory, Trajectory
from hingepair.integration.trajectory_state import planar_state, spatial_state
from hingepair.numeric.arrays import check_choice, finite_number, one_constant, read_only, real_array
from hingepair.numeric.finite_differences import check_instants
from hingepair.pair.constants import check_pair
from hingepair.pair.evaluate import Outputs
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.rotations.matrices import check_rotation

FRAMES: Final = ("world", "body")

Given: TypeAlias = ArrayLike | Callable[[Values], Any]


@overload
def integrate(
    pair: HingePair,
    t: ArrayLike,
    omega1: Given,
    psid: Given,
    *,
    R1: Any = ...,
    S1_0: ArrayLike | None = ...,
    psi_0: float = ...,
    method: str = ...,
    frame: str = ...,
    tol: float | None = ...,
    alpha1: Given | None = ...,
    psidd: Given | None = ...,
    outputs: Outputs = ...,
    backend: str = ...,
) -> Trajectory: ...
@overload
def integrate(
    pair: PlanarPair,
    t: ArrayLike,
    omega1: Given,
    psid: Given,
    *,
    R1: Any = ...,
    phi_0: float = ...,
    psi_0: float = ...,
    method: str = ...,
    tol: float | None = ...,
    alpha1: Given | None = ...,
    psidd: Given | None = ...,
    outputs: Outputs = ...,
    backend: str = ...,
) -> PlanarTrajectory: ...
def integrate(
    pair: Any,
    t: ArrayLike,
    omega1: Given,
    psid: Given,
    *,
    R1: Any = None,
    S1_0: ArrayLike | None = None,
    phi_0: float | None = None,
    psi_0: float = 0.0,
    method: str = "magnus6",
    frame: str = "world",
    tol: float | None = None,
    alpha1: Given | None = None,
    psidd: Given | None = None,
    outputs: Outputs = None,
    backend: str = "auto",
) -> Any:
    """The motion of a pair from the angular velocity of body 1 and the hinge rate (E12).

    omega1, psid, alpha1 and psidd are each a callable of an array of times (n,) that returns (n, 3) or (n,), or one
    constant (3,) or (); samples at t; or a constant. Samples are interpolated by polynomials of degree 5, which
    presumes a smooth motion: at a kink or across a gap they swing. Stamps since 1970 cost no digits. With `magnus6`
    this is what strapdown navigation knows as multi-sample coning correction (Bortz, Miller, Savage).

    `magnus6` (order 6), `magnus4`, `cf4`, `rk4_quaternion` (order 4) and `midpoint` (order 2) make each step from
    omega1 alone; `euler_angles` integrates phi' = J^-1 omega (E4) of the sequence XYZ (E10) by Runge-Kutta steps of
    order 4; `dop853` is SciPy's.

    Args:
        pair: a HingePair, or a PlanarPair (E11): then omega1 and alpha1 are numbers, points have two coordinates.
        t: instants [s], increasing; shape (N,). One step for each interval, more where `tol` asks for them.
        omega1: angular velocity of body 1 [rad/s].
        psid: hinge rate psi' [rad/s].
        R1: reference point of body 1, world axes [m]: constant, a callable of t, or an array (N, 3); or a tuple
            (R1, v1) or (R1, v1, a1) of such arrays, or a callable that returns one. The origin unless given. Of
            points that move without v1 or a1, v2 or a2 is None.
        S1_0: attitude of body 1 at t[0]; shape (3, 3); the identity unless given.
        phi_0: angle of body 1 at t[0] [rad], of a PlanarPair; 0 unless given.
        psi_0: hinge angle at t[0] [rad].
        method: one of those above.
        frame: axes of omega1 and alpha1, "world" or "body".
        tol: largest error of the attitude and of psi at any instant [rad]. A callable is looked at in 509 steps or
            more, spread over the whole time: what is narrower than that may be missed, by `error_estimate` as well.
            A jump is seen, and costs many steps; none where it is at one of the instants.
        alpha1: angular acceleration of body 1 [rad/s^2], where accelerations are wanted.
        psidd: psi'' [rad/s^2], likewise.
        outputs: as for `forward_kinematics`; all of body 2 that the inputs allow unless given; () for none.
        backend: as for `forward_kinematics`.

    Returns:
        A `Trajectory` (`PlanarTrajectory`): `.t` (N,) s, `.S1` (N, 3, 3), `.quat_wxyz` (N, 4), `.psi` (N,) rad, each
        attribute of its `.state` (`.R2` (N, 3) m, ...), `.error_estimate` and `.psi_error_estimate` rad.

    Raises:
        ArgumentError: an argument cannot be used, is not finite (names the first index), or tol is not reached.
        GimbalLockError: `euler_angles` came too near to lock, or its steps are too long.
        MissingDependencyError: `dop853` without SciPy.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
    >>> t = np.linspace(0, np.pi / 2, 11)
    >>> motion = hp.integrate(pair, t, omega1=(0, 0, 1), psid=np.cos)
    >>> motion.S1[-1].round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    >>> round(float(motion.psi[-1]), 9)
    1.0
    """
    check_choice("method", method, METHODS)
    check_choice("frame", frame, FRAMES)
    check_tolerance(tol)
    course = Course(check_instants("t", real_array("t", t), 0), method, tol, choose(backend, 1), frame == "body")
    given: dict[str, Any] = {"omega1": omega1, "psid": psid, "alpha1": alpha1, "psidd": psidd}
    hinge = finite_number("psi_0", psi_0)
    if isinstance(pair, PlanarPair):
        if S1_0 is not None:
            raise ArgumentError("S1_0", "nothing beside a PlanarPair, which takes phi_0", quoted(S1_0))
        check_choice("frame", frame, ("world",))
        check_choice("method", method, tuple(RULES))
        angle = finite_number("phi_0", 0.0 if phi_0 is None else phi_0)
        return _in_plane(pair, course, given, R1, (angle, hinge), outputs, backend)
    check_pair(pair)
    if phi_0 is not None:
        raise ArgumentError("phi_0", "nothing beside a HingePair, which takes S1_0", quoted(phi_0))
    start = one_constant("S1_0", np.eye(3) if S1_0 is None else S1_0, 3, 3)
    check_rotation("S1_0", start)
    return _in_space(pair, course, given, R1, (start, hinge), outputs, backend)


def _in_space(
    pair: HingePair,
    course: Course,
    given: Mapping[str, Any],
    R1: Any,
    start: tuple[Values, float],
    outputs: Outputs,
    backend: str,
) -> Trajectory:
    t = course.t
    rates = _rates(given, t, (3,))
    omega, psid = _needed(rates, "omega1"), _needed(rates, "psid")
    point = read_position(np.zeros(3) if R1 is None else R1, t, 3)
    found = space_attitudes(course, omega, psid, start[0])
    hinge = hinge_angles(course, psid, start[1], found.steps)
    check_reached(course.tol, {"omega1": found.error, "psid": hinge.error})
    return Trajectory(
        t=read_only(t),
        quat_wxyz=read_only(found.values),
        psi=read_only(hinge.values),
        state=spatial_state(
            pair, t, found.values, hinge.values, rates, point, outputs, body=course.body, backend=backend
        ),
        method=course.method,
        steps=0 if course.method == "dop853" else int(found.steps.counts.sum()),
        _error=found.error,
        _psi_error=hinge.error,
    )


def _in_plane(
    pair: PlanarPair,
    course: Course,
    given: Mapping[str, Any],
    R1: Any,
    start: tuple[float, float],
    outputs: Outputs,
    backend: str,
) -> PlanarTrajectory:
    """Two sums: phi_1 of omega, psi of psi'; phi_2 = phi_1 + psi (E11)."""
    t = course.t
    rates = _rates(given, t, ())
    omega, psid = _needed(rates, "omega1"), _needed(rates, "psid")
    point = read_position(np.zeros(2) if R1 is None else R1, t, 2)
    rule = RULES[course.method]
    steps = plain_steps(course, (omega, psid), rule)
    found, hinge = (
        plane_angle(course, name, rate, begin, steps, rule)
        for name, rate, begin in zip(("omega1", "psid"), (omega, psid), start, strict=True)
    )
    check_reached(course.tol, {"omega1": found.error, "psid": hinge.error})
    return PlanarTrajectory(
        t=read_only(t),
        phi=read_only(found.values),
        psi=read_only(hinge.values),
        state=planar_state(pair, t, (found.values, hinge.values), rates, point, outputs, backend=backend),
        method=course.method,
        steps=int(steps.counts.sum()),
        _error=found.error,
        _psi_error=hinge.error,
    )


def _rates(given: Mapping[str, Any], t: Values, tail: tuple[int, ...]) -> dict[str, Signal | None]:
    tails = {"omega1": tail, "psid": (), "alpha1": tail, "psidd": ()}
    return {
        name: None if value is None else read_signal(name, value, t, tails[name]) for name, value in given.items()
    }


def _needed(rates: Mapping[str, Signal | None], name: str) -> Signal:
    signal = rates[name]
    if signal is None:
        raise ArgumentError(name, "a callable, a constant, or samples at t", None)
    return signal
