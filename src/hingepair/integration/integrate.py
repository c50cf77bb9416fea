"""E12: from omega1(t) and psi'(t) to attitudes, and to everything about body 2."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from typing import Any, Final, NamedTuple, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import execution_of, execution_of_steps
from hingepair.errors import ArgumentError, quoted
from hingepair.integration.methods import STEP_RULE_BY_NAME
from hingepair.integration.signals import (
    ConstantSignal,
    SampledSignal,
    check_finite_values,
    object_array,
    read_position,
    read_signals,
    stack_signals,
    values_at,
)
from hingepair.integration.solve import METHOD_NAMES, Solution, SolveOptions, integrate_together, solve
from hingepair.integration.trajectory import (
    STATE_OUTPUT_NAME_PREFIX,
    LazyValue,
    LazyValues,
    PlanarTrajectory,
    Trajectory,
    quaternions_to_matrices,
    rotate_to_world,
    trajectory_from_arrays,
)
from hingepair.numeric.arrays import (
    FLOAT64_DTYPE,
    broadcast_shape,
    check_choice,
    finite_number,
    one_constant,
    read_only,
    vectors,
)
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.dask_arrays import apply_to_chunks, holds_dask, unwrap_lazy_xarray
from hingepair.numeric.instants import instants_of, warn_of_measurements
from hingepair.numeric.suspicions import suspicions
from hingepair.pair.constants import Constants, check_pair, check_single_pair
from hingepair.pair.evaluate import STATE_CLASS_BY_MOTION_KIND, compute_state
from hingepair.pair.forward_kinematics import Outputs
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.plans.plan import (
    ACCELERATION,
    PLANAR_MOTION_KIND,
    SPATIAL_MOTION_KIND,
    MotionKind,
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
SignalsByName: TypeAlias = Mapping[str, NDArray[np.object_]]
"""Signals of the rates, by the names of the arguments; each an array with a signal for each motion."""

_RATE_ARGUMENT_NAME_BY_PLAN_INPUT_NAME: Final = {
    **{"omega1": "omega1", "alpha1": "alpha1", "phi1d": "omega1", "phi1dd": "alpha1"},
    **{"psid": "psid", "psidd": "psidd"},
}
"""Names of the arguments that give rates, by input of a plan."""

_EXPECTED_R1_FORM_BY_PLAN_INPUT_NAME: Final = {"v1": "(R1, v1) or (R1, v1, a1)", "a1": "(R1, v1, a1)"}
"""Form that the argument R1 must have so that it gives an input of a plan, by input."""


_MAX_TOTAL_STEPS_OF_MOTION_GROUP: Final = 65_536
"""Steps that are integrated together at most, of all motions of a group."""

_R1_PART_NAME_IN_MESSAGES_BY_PLAN_INPUT_NAME: Final = {"R1": "R1", "v1": "R1[1]", "a1": "R1[2]"}
"""Name in messages of each part of the argument R1."""


@overload
def integrate(
    pair: HingePair,
    t: ArrayLike,
    omega1: RateArgument,
    psid: RateArgument,
    *,
    R1: Any = ...,
    S1_0: ArrayLike | None = ...,
    psi_0: ArrayLike = ...,
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
    phi_0: ArrayLike = ...,
    psi_0: ArrayLike = ...,
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
    phi_0: ArrayLike | None = None,
    psi_0: ArrayLike = 0.0,
    method: str = "magnus6",
    frame: str = "world",
    tol: float | None = None,
    alpha1: RateArgument | None = None,
    psidd: RateArgument | None = None,
    outputs: Outputs = None,
    backend: str = "auto",
) -> Any:
    """Integrate the motion of a pair over the instants t from the angular velocity `omega1` of body 1 and the hinge
    rate `psid` (E12). Each rate is a constant, an array of samples at t, or a callable of t. Return a `Trajectory`,
    for a PlanarPair a `PlanarTrajectory`. `frame` names the axes of omega1, "world" or "body". The motion starts from
    S1_0 (for a PlanarPair phi_0) and psi_0. Raise an ArgumentError if the error cannot be kept below `tol`.

    Each of the rates omega1, psid, alpha1 and psidd is one of:

    - a constant: shape (3,) for omega1 and alpha1, a number for psid and psidd;
    - samples at the instants t: shape (N, 3) or (N,);
    - a callable that takes an array of times (n,) and returns an array (n, 3) or (n,), or a constant.

    Samples are interpolated by polynomials of degree 5, which presumes a smooth motion: at a kink or across a gap the
    polynomials overshoot.

    The zero of t matters only to callables. A callable receives times in seconds. If t is in seconds, these times
    count from the same zero as t. If t is datetime64 or integer nanoseconds since 1970, these times count from the
    first instant. Seconds since 1970 as floats are rounded to 2.4e-7 s, so give the datetime64 or integer nanoseconds
    of the clock instead.

    The methods are:

    - `magnus6` (order 6), `magnus4` (order 4) and `midpoint` (order 2) compute the rotation vector of each step by a
      Magnus series, from omega1 at 3, 2 or 1 Gauss nodes in the step. With samples, `magnus6` corresponds to the
      multi-sample coning correction of strapdown navigation (Bortz, Miller, Savage).
    - `cf4` (order 4, commutator-free) computes the rotation of each step as the product of two rotations, from omega1
      at 2 Gauss nodes.
    - `rk4_quaternion` (order 4) is the classical Runge-Kutta method for the quaternion, which is normalised after
      each step.
    - `euler_angles` integrates the rates of the XYZ Euler angles of body 1, which follow from omega1 (E4, E10), by
      Runge-Kutta steps of order 4. It fails near gimbal lock. It is for a HingePair only.
    - `dop853` is SciPy's Runge-Kutta method DOP853 of order 8, with steps of its own. It is for a HingePair only.

    Arrays with leading axes describe many motions over the same instants: omega1, alpha1 and R1 (..., N, 3), psid and
    psidd (..., N), S1_0 (..., 3, 3), phi_0 and psi_0 (...,). Leading axes broadcast against each other. A rate or R1
    whose axis N has length 1 is constant in time in each motion. A callable, or an array without leading axes,
    applies to all motions. Each motion is integrated as if by a separate call: with the same steps, the same error
    estimate, and bitwise the same result.

    Dask arrays, and xarray objects that hold them, give a trajectory of lazy Dask arrays, with one task for each
    chunk of motions. Chunks along the time axis are joined, since a motion is integrated as a whole.
    `trajectory.compute()` returns the trajectory in memory.

    Args:
        pair: a HingePair, or a PlanarPair (E11). For a PlanarPair, omega1 and alpha1 have the same forms as psid and
            psidd, and R1, v1 and a1 have two components instead of three.
        t: instants, increasing; shape (N,): seconds (floats), datetime64, or nanoseconds since 1970 (integers).
            datetime64 and integer nanoseconds are converted exactly to seconds since the first one.
        omega1: angular velocity of body 1 [rad/s].
        psid: hinge rate psi' [rad/s].
        R1: position of the reference point of body 1, world axes [m]: a constant (3,), an array (N, 3), or a callable
            of times (n,) that returns an array (n, 3) or a constant; the origin by default. To give the velocity
            [m/s] and the acceleration [m/s^2] of the reference point too, give a tuple (R1, v1) or (R1, v1, a1) of
            arrays, or a callable that returns such a tuple. If R1 is not constant and v1 (or a1) is not given, v2 (or
            a2) of the result is None.
        S1_0: attitude of body 1 at t[0], body to world, for a HingePair only; shape (..., 3, 3); the identity by
            default.
        phi_0: angle of body 1 at t[0] [rad], for a PlanarPair only; shape (...,); 0 by default.
        psi_0: hinge angle at t[0] [rad]; shape (...,); 0 by default.
        method: name of one of the methods above; "magnus6" by default.
        frame: axes of omega1 and alpha1: "world" (the default) or "body" (for a HingePair only).
        tol: largest allowed error of the attitude and of psi at any instant [rad]. By default, each interval of t is
            one step, and the error has no limit; but `dop853` chooses its own steps, with a tolerance of 1e-12 rad.
            If tol is given, the steps are divided until the error is small enough. If a rate is a callable, at least
            about 500 steps are then used from t[0] to t[-1]. A jump or a kink of a callable costs about sixty further
            steps, or none if it is at one of the instants t. A pulse of a callable that is shorter than a step may be
            missed; `error_estimate` may then be too small.
        alpha1: angular acceleration of body 1 [rad/s^2]. Without alpha1, a2 and alpha2 of the result are None.
        psidd: hinge acceleration psi'' [rad/s^2]. Without psidd, a2 and alpha2 of the result are None.
        outputs: tuple of the names of the outputs to compute, such as ("R2", "v2"), as for `forward_kinematics`; ()
            for none. By default, all outputs of body 2 that can be computed from the inputs.
        backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

    Returns:
        A `Trajectory`, for a PlanarPair a `PlanarTrajectory`. A Trajectory has the instants `.t` (N,) [s], the
        attitude of body 1 as `.S1` (..., N, 3, 3) and `.quat_wxyz` (..., N, 4), the hinge angle `.psi` (..., N)
        [rad], the outputs, such as `.R2` (..., N, 3) [m], and estimates of the largest error at any instant,
        `.error_estimate` for the attitude of body 1 and `.psi_error_estimate` for psi, (...,) [rad]. In place of
        `.S1` and `.quat_wxyz`, a PlanarTrajectory has the angle of body 1 as `.phi` (..., N) [rad]. If there are many
        motions, `trajectory[i]` is the trajectory of motion i.

    Raises:
        ArgumentError: an argument cannot be used, a rate is not finite (the error gives the first index), or tol is
            not reached. If there are many motions, the error names the motion. A value of R1 that is not finite is no
            error: only the results at its instant are not finite.
        GimbalLockError: with `euler_angles`, an angle changes by more than 1 rad in a step, because the motion comes
            near gimbal lock or the steps are too long.
        MissingDependencyError: the method is `dop853` and SciPy is not installed.

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
    >>> many = hp.integrate(pair, t, omega1=(0, 0, 1), psid=[[0.5], [1.0], [2.0]])  # three constant hinge rates
    >>> many.psi.shape, many[2].psi.shape
    ((3, 11), (11,))
    """
    motion = {"omega1": omega1, "psid": psid, "R1": R1, "S1_0": S1_0, "phi_0": phi_0, "psi_0": psi_0}
    motion |= {"alpha1": alpha1, "psidd": psidd}
    choices: dict[str, Any] = {"method": method, "frame": frame, "tol": tol, "outputs": outputs, "backend": backend}
    if holds_dask(t):
        raise ArgumentError("t", "instants in memory, which all motions share", f"a Dask {type(t).__name__}")
    t = instants_of("t", t)
    if holds_dask(motion):
        return _integrate_lazily(pair, t, motion, choices)
    request = _read_request(pair, t, **motion, **choices)
    trajectory = _make_trajectory(request, _solve_motions(request))
    if any(isinstance(signal, SampledSignal) for name in ("omega1", "psid") for signal in request.signals[name].flat):
        warn_of_measurements(_instant_doubts(trajectory))
    return trajectory


def _instant_doubts(trajectory: Any) -> list[str]:
    """Return a sentence if the instants of sampled rates are probably not in seconds, judged by how far body 1 and
    the hinge of the first motion turn in a step.
    """
    count = len(trajectory.t)
    turned = np.zeros(count - 1)
    for psi in trajectory.psi.reshape(-1, count)[:1]:
        turned += np.abs(np.diff(psi))
    if isinstance(trajectory, Trajectory):
        for quats in trajectory.quat_wxyz.reshape(-1, count, 4)[:1]:
            turned += 2 * np.arccos(np.minimum(np.abs((quats[1:] * quats[:-1]).sum(axis=1)), 1.0))
    angle = np.concatenate(([0.0], np.cumsum(turned)))
    return suspicions("sampled motion", "t", np.stack((trajectory.t, angle), axis=-1))


class _Request(NamedTuple):
    """Checked arguments of `integrate`: the pair, the solver's options, arrays of signals of the rates by name,
    arrays of R1, v1 and a1, orientation and hinge angle at the start, the leading shape of the motions, and the plan
    of the outputs.
    """

    pair: Any
    options: SolveOptions
    signals: SignalsByName
    points: Mapping[str, NDArray[Any]]  # R1, v1, a1, as far as they are known; (k,), (..., 1, k) or (..., N, k)
    start: Array  # attitudes S1_0 (..., 3, 3), in the plane angles phi_0 (...,) [rad]
    psi_0: Array  # hinge angles at t[0] [rad]; shape (...,)
    motions: tuple[int, ...]  # leading shape of the motions; () for one motion
    plan: Plan  # of the outputs


def _read_request(
    pair: Any,
    t: Array,
    *,
    omega1: Any,
    psid: Any,
    R1: Any,
    S1_0: Any,
    phi_0: Any,
    psi_0: Any,
    alpha1: Any,
    psidd: Any,
    method: str,
    frame: str,
    tol: float | None,
    outputs: Outputs,
    backend: str,
) -> _Request:
    """Check the arguments of `integrate`, and return them as a `_Request`, in which rates are signals and other
    values are arrays. Raise an ArgumentError that names an argument of the wrong kind or shape. Samples may still
    hold NaN.
    """
    check_choice("method", method, METHOD_NAMES)
    check_choice("frame", frame, RATE_FRAME_NAMES)
    execution = execution_of_steps(backend, len(t))
    if tol is not None and not finite_number("tol", tol) > 0:
        raise ArgumentError("tol", "a positive number", tol)
    options = SolveOptions(t, method, tol, execution, frame == "body")
    psi_0 = _read_start_values("psi_0", psi_0)
    is_planar = isinstance(pair, PlanarPair)
    if is_planar:
        if S1_0 is not None:
            raise ArgumentError("S1_0", "None for a PlanarPair, which takes phi_0", quoted(S1_0))
        check_choice("frame", frame, ("world",))
        check_choice("method", method, tuple(STEP_RULE_BY_NAME))
        start = _read_start_values("phi_0", 0.0 if phi_0 is None else phi_0)
    else:
        check_pair(pair)
        if phi_0 is not None:
            raise ArgumentError("phi_0", "None for a HingePair, which takes S1_0", quoted(phi_0))
        start = _read_start_values("S1_0", np.eye(3) if S1_0 is None else S1_0, 3, 3)
    values = {"omega1": omega1, "alpha1": alpha1, "psid": psid, "psidd": psidd}
    signals = {
        name: read_signals(name, value, t, () if is_planar or name in {"psid", "psidd"} else (3,), execution)
        for name, value in values.items()
        if value is not None or name in {"omega1", "psid"}
    }
    size = 2 if is_planar else 3
    points = read_position(np.zeros(size) if R1 is None else R1, t, size)
    shapes = {name: array.shape for name, array in signals.items()}
    shapes |= {
        name: points[key].shape[:-2]
        for key, name in _R1_PART_NAME_IN_MESSAGES_BY_PLAN_INPUT_NAME.items()
        if key in points
    }
    shapes |= {"phi_0": start.shape} if is_planar else {"S1_0": start.shape[:-2]}
    motions = broadcast_shape({**shapes, "psi_0": psi_0.shape})
    kind = PLANAR_MOTION_KIND if is_planar else SPATIAL_MOTION_KIND
    plan = _make_integration_plan(pair.constants, outputs, signals.keys() | points.keys(), kind)
    return _Request(pair, options, signals, points, start, psi_0, motions, plan)


def _read_start_values(name: str, value: Any, *trailing_shape: int) -> Array:
    """Return a value at t[0] as a float64 array. The shape is `trailing_shape`, the further positional arguments, for
    one motion, and (..., *trailing_shape) for many. Raise an ArgumentError that names the argument `name` for another
    shape.
    """
    if np.ndim(value) == 0 and not trailing_shape:
        return np.array(finite_number(name, value))
    return vectors(name, value, *trailing_shape).astype(np.float64)


def _name_of_motion(name: str, index: Sequence[int]) -> str:
    """Return the argument name `name` followed by the index of a motion as text for messages, or `name` alone if the
    index is empty.

    >>> [_name_of_motion("psi_0", index) for index in [(), (3,), (2, 5)]]
    ['psi_0', 'psi_0 of motion 3', 'psi_0 of motion (2, 5)']
    """
    return f"{name} of motion {index[0] if len(index) == 1 else tuple(index)}" if len(index) else name


class _Motion(NamedTuple):
    """One motion of a request: its index, a mapping of the signals of its rates by name, and its attitude (in the
    plane its angle) and hinge angle at the start.
    """

    motion_index: tuple[int, ...]
    signals: Mapping[str, Any]
    start: Any  # attitude (3, 3), in the plane an angle [rad]
    psi_0: float  # rad


def _list_motions(request: _Request) -> list[_Motion]:
    """Return a list of the motions of a request, as `_Motion` records in C order of their indices."""
    shape, is_planar = request.motions, isinstance(request.pair, PlanarPair)
    signals: dict[str, Any] = dict(request.signals)
    starts, psi_0 = request.start, request.psi_0
    if shape:
        signals = {name: np.broadcast_to(array, shape) for name, array in signals.items()}
        starts = np.broadcast_to(starts, shape + (() if is_planar else (3, 3)))
        psi_0 = np.broadcast_to(psi_0, shape)
    return [
        _Motion(
            index,
            {name: array[index] for name, array in signals.items()},
            float(starts[index]) if is_planar else starts[index],
            float(psi_0[index]),
        )
        for index in np.ndindex(shape)
    ]


@contextlib.contextmanager
def _errors_named_by_motion(motion: _Motion, first_motion_index: tuple[int, ...] | None) -> Iterator[None]:
    """Return a context manager that adds the index of `motion` to the name in an ArgumentError of its block. The
    error of a single motion is raised unchanged. `first_motion_index`, a tuple or None for zeros, is added to the
    index.
    """
    try:
        yield
    except ArgumentError as error:
        if not motion.motion_index:
            raise
        index = motion.motion_index
        if first_motion_index is not None:
            index = tuple(np.add(first_motion_index, index).tolist())
        raise type(error)(_name_of_motion(error.name, index), error.expected, error.got) from None


def _check_motions(
    request: _Request, motions: Iterable[_Motion], first_motion_index: tuple[int, ...] | None = None
) -> None:
    """Raise an ArgumentError if a number of one of the motions is not finite, or an attitude at the start is not a
    rotation. The error names the first such motion. `first_motion_index`, a tuple or None for zeros, is added to the
    index of the motion.
    """
    for motion in motions:
        with _errors_named_by_motion(motion, first_motion_index):
            _check_motion(request, motion)


def _solve_motions(request: _Request, first_motion_index: tuple[int, ...] | None = None) -> list[Solution]:
    """Check and solve each motion of a request (E12); return a list of `Solution`s in C order of the motions'
    indices. Raise an ArgumentError or a GimbalLockError that names the first motion that cannot be solved.
    `first_motion_index`, a tuple or None for zeros, is added to the index of the motion.
    """
    motions, solutions = _list_motions(request), []
    _check_motions(request, motions, first_motion_index)
    for motion, integrated in zip(motions, _integrate_together(request.options, motions), strict=True):
        with _errors_named_by_motion(motion, first_motion_index):
            solutions.append(_solve_motion(request.options, motion, integrated))
    return solutions


def _integrate_together(options: SolveOptions, motions: Sequence[_Motion]) -> list[tuple[Array, Array] | None]:
    """Integrate motions in groups; return a list with a pair for each motion, the arrays of its orientations and of
    its hinge angles. The list has None for a motion that is alone in its group. It has None for all motions if the
    options require separate steps for each of them (a tolerance, Euler angles or SciPy's solver).
    """
    group_size = max(1, _MAX_TOTAL_STEPS_OF_MOTION_GROUP // len(options.t))
    results: list[tuple[Array, Array] | None] = []
    for first in range(0, len(motions), group_size):
        group = motions[first : first + group_size]
        integrated = None
        if len(group) > 1:
            omega, psid = (stack_signals([motion.signals[name] for motion in group]) for name in ("omega1", "psid"))
            start = np.array([motion.start for motion in group])
            psi_0 = np.array([motion.psi_0 for motion in group])
            integrated = integrate_together(options, omega, psid, start, psi_0)
        results += [None] * len(group) if integrated is None else list(zip(*integrated, strict=True))
    return results


def _check_motion(request: _Request, motion: _Motion) -> None:
    """Raise an ArgumentError if a number of a motion is not finite, or the attitude at the start is not a rotation.
    The error names the argument, not the motion. `request` says whether the motion is planar.
    """
    for name, signal in motion.signals.items():
        check_finite_values(name, signal)
    finite_number("psi_0", motion.psi_0)
    if isinstance(request.pair, PlanarPair):
        finite_number("phi_0", motion.start)
    else:
        check_rotation("S1_0", one_constant("S1_0", motion.start, 3, 3))


def _solve_motion(options: SolveOptions, motion: _Motion, integrated: tuple[Array, Array] | None) -> Solution:
    """Return the `Solution` of one motion (E12). `integrated` is the pair of arrays of its orientations and hinge
    angles if these are computed already, otherwise None. Raise an ArgumentError if the tolerance of the options is
    not reached, or an error of `solve`.
    """
    signals = motion.signals
    solution = solve(options, signals["omega1"], signals["psid"], motion.start, motion.psi_0, integrated)
    solution.check_tolerance(options)
    return solution


def _make_trajectory(request: _Request, solutions: Sequence[Solution]) -> Any:
    """Return the `Trajectory` or `PlanarTrajectory` of all motions of a request from their solutions. Compute its
    state, the requested outputs at all instants.
    """
    t, motions = request.options.t, request.motions
    is_planar = isinstance(request.pair, PlanarPair)
    orientations = _stack_results(
        [one.orientations for one in solutions], motions, (len(t),) if is_planar else (len(t), 4)
    )
    psi = _stack_results([one.psi for one in solutions], motions, (len(t),))
    state = _compute_state(request, orientations, psi)
    R1 = np.broadcast_to(request.points["R1"], (*motions, len(t), 2 if is_planar else 3))
    steps = [one.steps for one in solutions]
    values: dict[str, Any] = {
        "steps": _stack_results(steps, motions, (), np.dtype(np.int64)) if motions else steps[0]
    }
    values |= {"phi": orientations} if is_planar else {"quat_wxyz": orientations, "R1": read_only(R1)}
    values |= {} if is_planar else {"pair": request.pair}
    return (PlanarTrajectory if is_planar else Trajectory)(
        t=read_only(t), psi=psi, state=state, method=request.options.method,
        _error=_lazy_errors([one.error for one in solutions], motions),
        _psi_error=_lazy_errors([one.psi_error for one in solutions], motions), **values,
    )  # fmt: skip


def _stack_results(
    results: Sequence[Any],
    motions: tuple[int, ...],
    trailing_shape: tuple[int, ...],
    dtype: np.dtype[Any] = FLOAT64_DTYPE,
) -> NDArray[Any]:
    """Return the results of many motions, a sequence of arrays of shape `trailing_shape`, as one read-only array
    (*motions, *trailing_shape), where `motions` is the leading shape. If `motions` is (), the sequence holds one
    result, which is not copied.
    """
    if not motions:
        return read_only(np.asarray(results[0]))
    array = np.empty((len(results), *trailing_shape), dtype)
    for index, row in enumerate(results):
        array[index] = row
    return read_only(array.reshape(motions + trailing_shape))


def _lazy_errors(errors: Sequence[LazyValue], motions: tuple[int, ...]) -> LazyValue | LazyValues:
    """Return a sequence of lazy error estimates, one for each motion, as one LazyValues object of shape `motions`,
    or, if `motions` is (), the LazyValue of the single motion.
    """
    return LazyValues(object_array(motions, errors)) if motions else errors[0]


def _compute_state(request: _Request, orientations: Array, psi: Array) -> Any:
    """Compute the requested outputs at all instants of all motions; return them as a `PairState` or `PlanarState`.
    `orientations` are the quaternions of body 1, in the plane its angles, and `psi` the hinge angles.
    """
    options, plan = request.options, request.plan
    shape = psi.shape
    if not plan.outputs:
        return STATE_CLASS_BY_MOTION_KIND[plan.kind]({}, shape)
    S1: Any = None if plan.kind is PLANAR_MOTION_KIND else quaternions_to_matrices(orientations)
    inputs: dict[str, Any] = {
        **request.points,
        "psi": psi,
        **({"phi1": orientations} if S1 is None else {"S1": S1}),
    }
    for name in plan.inputs & _RATE_ARGUMENT_NAME_BY_PLAN_INPUT_NAME.keys():
        argument = _RATE_ARGUMENT_NAME_BY_PLAN_INPUT_NAME[name]
        is_vector = S1 is not None and argument in {"omega1", "alpha1"}
        values = values_at(request.signals[argument], options.t, (3,) if is_vector else ())
        inputs[name] = rotate_to_world(S1, values) if options.omega_in_body_axes and is_vector else values
    inputs = {name: inputs[name] for name in inputs.keys() & plan.inputs}
    return compute_state(request.pair.constants, plan, inputs, {"t": shape}, execution=options.execution)


def _integrate_lazily(
    pair: Any, t: Array, motion_arguments: Mapping[str, Any], other_arguments: Mapping[str, Any]
) -> Any:
    """Return a trajectory of lazy Dask arrays, in which one task integrates each chunk of motions. Raise an
    ArgumentError for an argument of the wrong kind or shape before any task runs. `motion_arguments`, which may be
    Dask arrays, and `other_arguments` are dicts of arguments of `integrate`.
    """
    is_planar = isinstance(pair, PlanarPair)
    if not is_planar:
        check_pair(pair)
    check_single_pair(pair, " if the arguments are Dask arrays")
    execution_of(other_arguments["backend"], 1)
    R1, point, vector = motion_arguments["R1"], (2,) if is_planar else (3,), () if is_planar else (3,)
    tails: dict[str, Any] = {
        **{name: _shape_for_one_motion(motion_arguments[name], len(t), vector) for name in ("omega1", "alpha1")},
        **{name: _shape_for_one_motion(motion_arguments[name], len(t), ()) for name in ("psid", "psidd")},
        "R1": _shape_for_one_motion(R1, len(t), point),
        **{"S1_0": (3, 3), "phi_0": (), "psi_0": ()},
    }
    if isinstance(R1, tuple) and len(R1) and np.ndim(R1[0]) > 0:
        tails["R1"] = [_shape_for_one_motion(part, len(t), point) for part in R1]
    arguments = {"pair": pair, "t": t, **motion_arguments, **other_arguments}
    arrays = apply_to_chunks(
        _integrate_chunk,
        arguments,
        tails,
        template_function=_trajectory_template,
        first_index_name="first_motion_index",
    )
    errors = apply_to_chunks(
        _estimate_errors, arguments, tails, template_function=_error_template, first_index_name="first_motion_index"
    )
    arrays |= {"_error": errors["error_estimate"], "_psi_error": errors["psi_error_estimate"]}
    values = {"t": read_only(t), "method": other_arguments["method"]} | ({} if is_planar else {"pair": pair})
    make_state = functools.partial(
        STATE_CLASS_BY_MOTION_KIND[PLANAR_MOTION_KIND if is_planar else SPATIAL_MOTION_KIND],
        shape=arrays["psi"].shape,
    )
    return trajectory_from_arrays(PlanarTrajectory if is_planar else Trajectory, values, make_state, arrays)


def _shape_for_one_motion(value: Any, instant_count: int, value_shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape that the argument `value` has for one motion: `value_shape` for one constant, (1,
    *value_shape) if the value of each motion is constant, otherwise (instant_count, *value_shape).
    """
    shape = tuple(getattr(unwrap_lazy_xarray(value), "shape", ()))
    if shape == value_shape:
        return value_shape
    is_constant = shape[len(shape) - 1 - len(value_shape) :] == (1, *value_shape)
    return (1 if is_constant else instant_count, *value_shape)


def _integrate_chunk(first_motion_index: tuple[int, ...] | None, **arguments: Any) -> dict[str, NDArray[Any]]:
    """Integrate a chunk of motions and return a dict of the arrays of their trajectory. The keyword arguments are
    those of `integrate`. `first_motion_index` is the index of the chunk's first motion among all, for messages of
    errors, or None.
    """
    request = _read_request(**arguments)
    return _trajectory_arrays_by_name(_make_trajectory(request, _solve_motions(request, first_motion_index)))


def _estimate_errors(first_motion_index: tuple[int, ...] | None, **arguments: Any) -> dict[str, NDArray[Any]]:
    """Integrate a chunk of motions and return a dict of the error estimates of attitude and psi, arrays with a number
    [rad] for each motion. The keyword arguments are those of `integrate`. `first_motion_index` is the index of the
    chunk's first motion among all, for messages of errors, or None.
    """
    request = _read_request(**arguments | {"outputs": ()})
    trajectory = _make_trajectory(request, _solve_motions(request, first_motion_index))
    return {name: np.asarray(getattr(trajectory, name)) for name in ("error_estimate", "psi_error_estimate")}


def _trajectory_template(first_motion_index: None, **arguments: Any) -> dict[str, NDArray[Any]]:
    """Check all arguments of `integrate`, given as keyword arguments, and return a dict of arrays with the names,
    shapes and dtypes of the arrays that `_integrate_chunk` returns. `first_motion_index` is None.

    Only the first instant is integrated, which takes no step.
    """
    request = _read_request(**arguments)
    _check_motions(request, _list_motions(request))
    t = request.options.t
    signals = {
        name: object_array(array.shape, [ConstantSignal(one.values_at(t[:1])[0]) for one in array.ravel()])
        for name, array in request.signals.items()
    }
    points = {name: array if array.ndim == 1 else array[..., :1, :] for name, array in request.points.items()}
    request = request._replace(options=request.options._replace(t=t[:1]), signals=signals, points=points)
    arrays = _trajectory_arrays_by_name(_make_trajectory(request, _solve_motions(request, first_motion_index)))
    count = len(request.motions)
    steps = {"steps": arrays.pop("steps")}
    return steps | {
        name: np.broadcast_to(array, (*array.shape[:count], len(t), *array.shape[count + 1 :]))
        for name, array in arrays.items()
    }


def _error_template(first_motion_index: None, **arguments: Any) -> dict[str, NDArray[Any]]:  # noqa: ARG001
    """Check the arguments of `integrate`, given as keyword arguments, and return a dict of arrays of zeros with the
    names, shapes and dtypes of the arrays that `_estimate_errors` returns. `first_motion_index` is not used.
    """
    shape = _read_request(**arguments | {"outputs": ()}).motions
    return {name: np.zeros(shape) for name in ("error_estimate", "psi_error_estimate")}


def _trajectory_arrays_by_name(trajectory: Any) -> dict[str, NDArray[Any]]:
    """Return a dict of all arrays of a trajectory but t and the error estimates. Names of the outputs of its state
    begin with STATE_OUTPUT_NAME_PREFIX.
    """
    names = ("phi",) if isinstance(trajectory, PlanarTrajectory) else ("quat_wxyz", "R1")
    arrays = {name: np.asarray(getattr(trajectory, name)) for name in (*names, "psi", "steps")}
    return arrays | {STATE_OUTPUT_NAME_PREFIX + name: array for name, array in trajectory.state.arrays().items()}


def _make_integration_plan(pair: Constants, outputs: Outputs, argument_names: Set[str], kind: MotionKind) -> Plan:
    """Return the Plan that computes `outputs` from the arguments of `integrate` that `argument_names` lists. If
    `outputs` is None, compute all outputs of body 2 that these arguments allow. `pair` is the Constants object of the
    pair, and `kind` the MotionKind, spatial or planar. Raise an ArgumentError for an output that is unknown or needs
    a missing argument.
    """
    available = (
        {"S1", "phi1", "psi"}
        | pair.values.keys()
        | argument_names
        | {name for name, argument in _RATE_ARGUMENT_NAME_BY_PLAN_INPUT_NAME.items() if argument in argument_names}
    )

    def plan(names: tuple[str, ...]) -> Plan:
        return make_plan(names, None, "home" in pair.values, kind=kind)

    if outputs is None:
        return plan(tuple(name for name in default_outputs(ACCELERATION, kind) if plan((name,)).inputs <= available))
    names = check_outputs(outputs, kind.levels) if not isinstance(outputs, tuple) or outputs else ()
    for name in names:
        for missing in sorted(plan((name,)).inputs - available):
            expected = f"{_EXPECTED_R1_FORM_BY_PLAN_INPUT_NAME.get(missing, 'a value')}, since output {name} needs it"
            got = f"no {missing}" if missing in _EXPECTED_R1_FORM_BY_PLAN_INPUT_NAME else None
            raise ArgumentError(_RATE_ARGUMENT_NAME_BY_PLAN_INPUT_NAME.get(missing, "R1"), expected, got)
    return plan(names)
