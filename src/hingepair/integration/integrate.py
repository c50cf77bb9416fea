"""E12: from omega1(t) and psi'(t) to attitudes, and to everything about body 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from typing import Any, Final, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, quoted
from hingepair.integration.signals import Signal, read_position, read_signal
from hingepair.integration.solve import METHODS, Course, Solution, solve
from hingepair.integration.trajectory import PlanarTrajectory, Trajectory, rotations, world_vectors
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import check_choice, finite_number, one_constant, read_only
from hingepair.numeric.instants import instants_of
from hingepair.pair.constants import Constants, check_pair
from hingepair.pair.evaluate import STATES, compute
from hingepair.pair.forward_kinematics import Outputs
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.plans.plan import (
    ACCELERATION,
    PLANAR,
    SPATIAL,
    Kind,
    Plan,
    check_outputs,
    default_outputs,
    make_plan,
)
from hingepair.rotations.matrices import check_rotation

FRAMES: Final = ("world", "body")

Given: TypeAlias = ArrayLike | Callable[[Array], Any]
Rates: TypeAlias = Mapping[str, Signal]

_RATES: Final = {
    **{"omega1": "omega1", "alpha1": "alpha1", "phi1d": "omega1", "phi1dd": "alpha1"},
    **{"psid": "psid", "psidd": "psidd"},
}
"""Of what a plan may need, that which is a rate, and the argument it comes from."""

_WANTED: Final = {"v1": "(R1, v1) or (R1, v1, a1)", "a1": "(R1, v1, a1)"}


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
    presumes a smooth motion: at a kink or across a gap they swing. Only differences of instants enter; seconds since
    1970 as floats are rounded to 2.4e-7 s, so give the datetime64 or integer nanoseconds of the clock instead. With
    `magnus6` this is what strapdown navigation knows as multi-sample coning correction (Bortz, Miller, Savage).

    `magnus6` (order 6), `magnus4`, `cf4`, `rk4_quaternion` (order 4) and `midpoint` (order 2) make each step from
    omega1 alone; `euler_angles` integrates phi' = J^-1 omega (E4) of the sequence XYZ (E10) by Runge-Kutta steps of
    order 4; `dop853` is SciPy's.

    Args:
        pair: a HingePair, or a PlanarPair (E11): then omega1 and alpha1 are numbers, points have two coordinates.
        t: instants [s], increasing; shape (N,). One step for each interval, more where `tol` asks for them.
            datetime64 and integer nanoseconds since 1970 are counted from the first one, exactly.
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
            A jump or a kink is seen, and costs some sixty steps; none where it is at one of the instants.
        alpha1: angular acceleration of body 1 [rad/s^2], where accelerations are wanted.
        psidd: psi'' [rad/s^2], likewise.
        outputs: as for `forward_kinematics`; all of body 2 that the inputs allow unless given; () for none.
        backend: as for `forward_kinematics`.

    Returns:
        A `Trajectory` (`PlanarTrajectory`): `.t` (N,) s, `.S1` (N, 3, 3), `.quat_wxyz` (N, 4), `.psi` (N,) rad, each
        attribute of its `.state` (`.R2` (N, 3) m, ...), `.error_estimate` and `.psi_error_estimate` rad.

    Raises:
        ArgumentError: an argument cannot be used, a rate is not finite (names the first index), or tol is not
            reached. What is not finite in R1 stays in its instant.
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
    t = instants_of("t", t)
    how = execution_of(backend, 1)
    course = Course(t, method, tol, how, frame == "body")
    hinge = finite_number("psi_0", psi_0)
    flat = isinstance(pair, PlanarPair)
    start: Array | float
    if flat:
        if S1_0 is not None:
            raise ArgumentError("S1_0", "nothing beside a PlanarPair, which takes phi_0", quoted(S1_0))
        check_choice("frame", frame, ("world",))
        start = finite_number("phi_0", 0.0 if phi_0 is None else phi_0)
    else:
        check_pair(pair)
        if phi_0 is not None:
            raise ArgumentError("phi_0", "nothing beside a HingePair, which takes S1_0", quoted(phi_0))
        start = one_constant("S1_0", np.eye(3) if S1_0 is None else S1_0, 3, 3)
        check_rotation("S1_0", start)
    values = {"omega1": omega1, "alpha1": alpha1, "psid": psid, "psidd": psidd}
    rates = {
        name: read_signal(name, value, t, () if flat or name in {"psid", "psidd"} else (3,), how)
        for name, value in values.items()
        if value is not None or name in {"omega1", "psid"}
    }
    size = 2 if flat else 3
    point = read_position(np.zeros(size) if R1 is None else R1, t, size)
    found = solve(course, rates["omega1"], rates["psid"], start, hinge)
    found.check(course)
    state = _state(pair, course, found, rates, point, outputs)
    turned, place = read_only(found.turned), read_only(np.broadcast_to(point["R1"], (len(t), size)))
    own = {"phi": turned} if flat else {"quat_wxyz": turned, "R1": place, "pair": pair}
    return (PlanarTrajectory if flat else Trajectory)(
        t=read_only(t), psi=read_only(found.psi), state=state, method=method, steps=found.steps,
        _error=found.error, _psi_error=found.psi_error, **own,
    )  # fmt: skip


def _state(
    pair: Any, course: Course, found: Solution, rates: Rates, point: Mapping[str, NDArray[Any]], outputs: Outputs
) -> Any:
    """The state of the pair at the instants."""
    kind = PLANAR if isinstance(pair, PlanarPair) else SPATIAL
    plan = _plan(pair.constants, outputs, rates.keys() | point.keys(), kind)
    if not plan.outputs:
        return STATES[kind]({}, course.t.shape)
    S1 = None if kind is PLANAR else rotations(found.turned)
    known: dict[str, Any] = {**point, "psi": found.psi, **({"phi1": found.turned} if S1 is None else {"S1": S1})}
    for name in plan.inputs & _RATES.keys():
        values = rates[_RATES[name]].instants(course.t)
        known[name] = world_vectors(S1, values) if course.body and S1 is not None and values.ndim == 2 else values
    known = {name: known[name] for name in known.keys() & plan.inputs}
    return compute(pair.constants, plan, known, {"t": course.t.shape}, execution=course.how)


def _plan(pair: Constants, outputs: Outputs, given: Set[str], kind: Kind) -> Plan:
    """The plan for the outputs: all of body 2 that can be had, unless they name something else.

    Raises:
        ArgumentError: an unknown output, or one that needs what is not given; names that.
    """
    known = (
        {"S1", "phi1", "psi"} | pair.values.keys() | given | {name for name, own in _RATES.items() if own in given}
    )

    def plan(names: tuple[str, ...]) -> Plan:
        return make_plan(names, None, "home" in pair.values, kind=kind)

    if outputs is None:
        return plan(tuple(name for name in default_outputs(ACCELERATION, kind) if plan((name,)).inputs <= known))
    names = check_outputs(outputs, kind.levels) if not isinstance(outputs, tuple) or outputs else ()
    for name in names:
        for missing in sorted(plan((name,)).inputs - known):
            expected = f"{_WANTED.get(missing, 'a value')}, since output {name} needs it"
            got = f"no {missing}" if missing in _WANTED else None
            raise ArgumentError(_RATES.get(missing, "R1"), expected, got)
    return plan(names)
