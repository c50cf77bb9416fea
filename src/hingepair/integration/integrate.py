"""E12: from omega1(t) and psi'(t) to attitudes, and to everything about body 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from typing import Any, Final, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, quoted
from hingepair.integration.signals import Signal, read_position, read_signal
from hingepair.integration.solve import METHOD_NAMES, Solution, SolveOptions, solve
from hingepair.integration.trajectory import PlanarTrajectory, Trajectory, quaternions_to_matrices, rotate_to_world
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import check_choice, finite_number, one_constant, read_only
from hingepair.numeric.dask_arrays import holds_dask
from hingepair.numeric.instants import instants_of
from hingepair.pair.constants import Constants, check_pair
from hingepair.pair.evaluate import STATES, compute_state
from hingepair.pair.forward_kinematics import Outputs
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.plans.plan import (
    ACCELERATION,
    PLANAR_MOTION,
    SPATIAL_MOTION,
    Kind,
    Plan,
    check_outputs,
    default_outputs,
    make_plan,
)
from hingepair.rotations.matrices import check_rotation

RATE_FRAME_NAMES: Final = ("world", "body")
"""Axes in which omega1 and alpha1 may be given."""

RateArgument: TypeAlias = ArrayLike | Callable[[Array], Any]
"""Type of a rate argument: constant, samples, or a callable of an array of times."""
SignalsByName: TypeAlias = Mapping[str, Signal]
"""Signals of the rates, by the names of the arguments."""

_RATE_ARGUMENT_BY_INPUT: Final = {
    **{"omega1": "omega1", "alpha1": "alpha1", "phi1d": "omega1", "phi1dd": "alpha1"},
    **{"psid": "psid", "psidd": "psidd"},
}
"""Names of the arguments that give rates, by input of a plan."""

_R1_FORM_BY_INPUT: Final = {"v1": "(R1, v1) or (R1, v1, a1)", "a1": "(R1, v1, a1)"}
"""Form that the argument R1 must have so that it gives an input of a plan, by input."""


@overload
def integrate(
    pair: HingePair,
    t: ArrayLike,
    omega1: RateArgument,
    psid: RateArgument,
    *,
    R1: Any = ...,
    S1_0: ArrayLike | None = ...,
    psi_0: float = ...,
    method: str = ...,
    frame: str = ...,
    tol: float | None = ...,
    alpha1: RateArgument | None = ...,
    psidd: RateArgument | None = ...,
    outputs: Outputs = ...,
    backend: str = ...,
) -> Trajectory: ...
@overload
def integrate(
    pair: PlanarPair,
    t: ArrayLike,
    omega1: RateArgument,
    psid: RateArgument,
    *,
    R1: Any = ...,
    phi_0: float = ...,
    psi_0: float = ...,
    method: str = ...,
    tol: float | None = ...,
    alpha1: RateArgument | None = ...,
    psidd: RateArgument | None = ...,
    outputs: Outputs = ...,
    backend: str = ...,
) -> PlanarTrajectory: ...
def integrate(
    pair: Any,
    t: ArrayLike,
    omega1: RateArgument,
    psid: RateArgument,
    *,
    R1: Any = None,
    S1_0: ArrayLike | None = None,
    phi_0: float | None = None,
    psi_0: float = 0.0,
    method: str = "magnus6",
    frame: str = "world",
    tol: float | None = None,
    alpha1: RateArgument | None = None,
    psidd: RateArgument | None = None,
    outputs: Outputs = None,
    backend: str = "auto",
) -> Any:
    """Integrate the motion of a pair from the angular velocity of body 1 and the hinge rate (E12).

    omega1, psid, alpha1 and psidd are each a callable of an array of times (n,) that returns (n, 3) or (n,), or one
    constant (3,) or (); samples at t; or a constant. Samples are interpolated by polynomials of degree 5, which
    presumes a smooth motion: at a kink or across a gap they swing. Only differences of instants enter; seconds since
    1970 as floats are rounded to 2.4e-7 s, so give the datetime64 or integer nanoseconds of the clock instead. With
    `magnus6` this is what strapdown navigation knows as multi-sample coning correction (Bortz, Miller, Savage).

    `magnus6` (order 6), `magnus4`, `cf4`, `rk4_quaternion` (order 4) and `midpoint` (order 2) make each step from
    omega1 alone; `euler_angles` integrates phi' = J^-1 omega (E4) of the sequence XYZ (E10) by Runge-Kutta steps of
    order 4; `dop853` is SciPy's.

    A call integrates one motion. Many motions, such as Dask arrays (motions, N, 3) whose chunks divide the motions
    and not the time, take a task each: `dask.delayed(hp.integrate)(pair, t, omega1[i], psid[i])` is one lazy
    trajectory, and `dask.compute(*trajectories)` integrates them on threads, processes or a cluster.

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
        phi_0: angle of body 1 at t[0] [rad], for a PlanarPair only; 0 unless given.
        psi_0: hinge angle at t[0] [rad].
        method: one of the methods above.
        frame: axes of omega1 and alpha1, "world" or "body".
        tol: largest error of the attitude and of psi at any instant [rad]. A callable is evaluated in at least 509
            steps, spread over the whole time: a feature narrower than one of them may be missed, by
            `error_estimate` as well. A jump or a kink is found, and costs some sixty steps; at an instant, none.
        alpha1: angular acceleration of body 1 [rad/s^2], where accelerations are wanted.
        psidd: psi'' [rad/s^2], where accelerations are wanted.
        outputs: as for `forward_kinematics`; unless given, all of body 2 that the inputs allow; () for none.
        backend: as for `forward_kinematics`.

    Returns:
        A `Trajectory` (`PlanarTrajectory`): `.t` (N,) s, `.S1` (N, 3, 3), `.quat_wxyz` (N, 4), `.psi` (N,) rad, each
        attribute of its `.state` (`.R2` (N, 3) m, ...), `.error_estimate` and `.psi_error_estimate` rad.

    Raises:
        ArgumentError: an argument cannot be used, a rate is not finite (names the first index), or tol is not
            reached. A value of R1 that is not finite affects its own instant only.
        GimbalLockError: `euler_angles` came too near to gimbal lock, or its steps are too long.
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
    check_choice("method", method, METHOD_NAMES)
    check_choice("frame", frame, RATE_FRAME_NAMES)
    for name, value in (
        ("t", t),
        ("omega1", omega1),
        ("psid", psid),
        ("R1", R1),
        ("alpha1", alpha1),
        ("psidd", psidd),
    ):
        if holds_dask(value):
            expected = (
                "an array in memory, since integrate takes one whole motion "
                "(dask.delayed(hp.integrate)(pair, t, omega1, psid) integrates it in one task)"
            )
            raise ArgumentError(name, expected, f"a Dask {type(value).__name__}")
    t = instants_of("t", t)
    execution = execution_of(backend, 1)
    options = SolveOptions(t, method, tol, execution, frame == "body")
    hinge = finite_number("psi_0", psi_0)
    is_planar = isinstance(pair, PlanarPair)
    start: Array | float
    if is_planar:
        if S1_0 is not None:
            raise ArgumentError("S1_0", "None for a PlanarPair, which takes phi_0", quoted(S1_0))
        check_choice("frame", frame, ("world",))
        start = finite_number("phi_0", 0.0 if phi_0 is None else phi_0)
    else:
        check_pair(pair)
        if phi_0 is not None:
            raise ArgumentError("phi_0", "None for a HingePair, which takes S1_0", quoted(phi_0))
        start = one_constant("S1_0", np.eye(3) if S1_0 is None else S1_0, 3, 3)
        check_rotation("S1_0", start)
    values = {"omega1": omega1, "alpha1": alpha1, "psid": psid, "psidd": psidd}
    rates = {
        name: read_signal(name, value, t, () if is_planar or name in {"psid", "psidd"} else (3,), execution)
        for name, value in values.items()
        if value is not None or name in {"omega1", "psid"}
    }
    size = 2 if is_planar else 3
    point = read_position(np.zeros(size) if R1 is None else R1, t, size)
    solution = solve(options, rates["omega1"], rates["psid"], start, hinge)
    solution.check_tolerance(options)
    state = _compute_state(pair, options, solution, rates, point, outputs)
    orientations, positions = (
        read_only(solution.orientations),
        read_only(np.broadcast_to(point["R1"], (len(t), size))),
    )
    fields = {"phi": orientations} if is_planar else {"quat_wxyz": orientations, "R1": positions, "pair": pair}
    return (PlanarTrajectory if is_planar else Trajectory)(
        t=read_only(t), psi=read_only(solution.psi), state=state, method=method, steps=solution.steps,
        _error=solution.error, _psi_error=solution.psi_error, **fields,
    )  # fmt: skip


def _compute_state(
    pair: Any,
    options: SolveOptions,
    solution: Solution,
    rates: SignalsByName,
    R1_motion: Mapping[str, NDArray[Any]],
    outputs: Outputs,
) -> Any:
    """Return the state of a pair at the instants, from the solution, the rates and the motion of R1."""
    kind = PLANAR_MOTION if isinstance(pair, PlanarPair) else SPATIAL_MOTION
    plan = _make_integration_plan(pair.constants, outputs, rates.keys() | R1_motion.keys(), kind)
    if not plan.outputs:
        return STATES[kind]({}, options.t.shape)
    S1 = None if kind is PLANAR_MOTION else quaternions_to_matrices(solution.orientations)
    inputs: dict[str, Any] = {
        **R1_motion,
        "psi": solution.psi,
        **({"phi1": solution.orientations} if S1 is None else {"S1": S1}),
    }
    for name in plan.inputs & _RATE_ARGUMENT_BY_INPUT.keys():
        values = rates[_RATE_ARGUMENT_BY_INPUT[name]].values_at(options.t)
        inputs[name] = (
            rotate_to_world(S1, values)
            if options.omega_in_body_axes and S1 is not None and values.ndim == 2
            else values
        )
    inputs = {name: inputs[name] for name in inputs.keys() & plan.inputs}
    return compute_state(pair.constants, plan, inputs, {"t": options.t.shape}, execution=options.execution)


def _make_integration_plan(pair: Constants, outputs: Outputs, argument_names: Set[str], kind: Kind) -> Plan:
    """Return the plan that computes the outputs; None means all outputs of body 2 that the arguments allow.

    Raises:
        ArgumentError: an unknown output, or one that needs an argument that is missing; names it.
    """
    available = (
        {"S1", "phi1", "psi"}
        | pair.values.keys()
        | argument_names
        | {name for name, argument in _RATE_ARGUMENT_BY_INPUT.items() if argument in argument_names}
    )

    def plan(names: tuple[str, ...]) -> Plan:
        return make_plan(names, None, "home" in pair.values, kind=kind)

    if outputs is None:
        return plan(tuple(name for name in default_outputs(ACCELERATION, kind) if plan((name,)).inputs <= available))
    names = check_outputs(outputs, kind.levels) if not isinstance(outputs, tuple) or outputs else ()
    for name in names:
        for missing in sorted(plan((name,)).inputs - available):
            expected = f"{_R1_FORM_BY_INPUT.get(missing, 'a value')}, since output {name} needs it"
            got = f"no {missing}" if missing in _R1_FORM_BY_INPUT else None
            raise ArgumentError(_RATE_ARGUMENT_BY_INPUT.get(missing, "R1"), expected, got)
    return plan(names)
