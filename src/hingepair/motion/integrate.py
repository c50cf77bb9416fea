"""E12: from omega1(t) and psi'(t) to attitudes, and to everything about body 2."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import Execution, execution_of_steps
from hingepair.equations.quantities import ACCELERATION
from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.pairs.geometry import Constants, check_pair, constants_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.pairs.requests import computation_of
from hingepair.mechanism.requests import STATES
from hingepair.motion.magnus import AngleIntegral, AttitudeIntegral, Integral, Steps
from hingepair.motion.signals import R1_PARTS, SampledSignal, Signal, read_position, read_signal
from hingepair.motion.steps import StepErrors, estimate_error, select_steps
from hingepair.motion.trajectory import (
    Deferred,
    PlanarTrajectory,
    Trajectory,
    quaternions_to_matrices,
    rotate_to_world,
)
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import (
    broadcast_shape,
    check_choice,
    finite_number,
    one_constant,
    read_only,
    vectors,
)
from hingepair.plans.arguments import Arguments, Outputs, check_outputs
from hingepair.rotations.matrices import check_rotation, matrix_to_quaternion
from hingepair.tables.instants import instants_of, warn_of_measurements
from hingepair.tables.suspicions import suspicions


class SolveOptions(NamedTuple):
    """Options of a solver."""

    t: Array  # instants [s]
    tol: float | None  # largest error [rad]; None: one step for each interval
    execution: Execution
    omega_in_body_axes: bool
    rate_names: tuple[str, str] = ("omega1", "psid")  # in errors

    def check(self) -> None:
        """Raise an ArgumentError if the tolerance cannot be used."""
        if self.tol is not None and not finite_number("tol", self.tol) > 0:
            raise ArgumentError("tol", "a positive number", self.tol)

    def integrals(self, omega: Signal, psid: Signal, *, planar: bool) -> tuple[Integral, AngleIntegral]:
        """Return the integrals of both rates."""
        names = self.rate_names
        hinge = AngleIntegral(names[1], psid, self.execution)
        if planar:
            return AngleIntegral(names[0], omega, self.execution), hinge
        return AttitudeIntegral(names[0], omega, self.execution, self.omega_in_body_axes), hinge


class Solution(Deferred):
    """The motion of a pair at the instants, and estimates of its errors, made when they are first asked for.

    Args:
        steps: steps of integration.
        integrals: those of the orientation of body 1 and of psi.
        values: their values at the ends of the steps.
        errors: measured errors of the steps, as far as there are.
    """

    def __init__(
        self,
        steps: Steps,
        integrals: tuple[Integral, AngleIntegral],
        values: tuple[Array, Array],
        errors: Mapping[Integral, StepErrors],
    ) -> None:
        self._steps, self._integrals, self._values, self._errors = steps, integrals, values, errors
        #: of body 1: unit quaternions (N, 4) without a jump of sign; in the plane angles (N,) [rad]
        self.orientations = steps.at_instants(values[0])
        #: hinge angles [rad]; shape (N,)
        self.psi = steps.at_instants(values[1])
        #: number of steps
        self.steps = steps.step_count

    @functools.cached_property
    def error(self) -> float:
        """Estimate of the largest error of the orientations [rad]."""
        return self._estimate(0)

    @functools.cached_property
    def psi_error(self) -> float:
        """Estimate of the largest error of psi [rad]."""
        return self._estimate(1)

    @property
    def largest_error(self) -> float:
        """The larger of both error estimates [rad]; NaN if one of them is."""
        return float(np.maximum(self.error, self.psi_error))

    def _estimate(self, k: int) -> float:
        integral = self._integrals[k]
        estimate = estimate_error(integral, self._steps, self._values[k], self._errors.get(integral))
        return min(estimate, integral.max_error)

    def check_tolerance(self, options: SolveOptions) -> None:
        """Raise an ArgumentError if there is a tolerance and an error estimate is above it or NaN."""
        if options.tol is not None and not self.largest_error <= options.tol:
            each = ", ".join(
                f"{name} leaves {error:.2g}"
                for name, error in zip(options.rate_names, (self.error, self.psi_error), strict=True)
            )
            raise ArgumentError(
                "tol", f"at least the error that is left, {self.largest_error:.2g} rad ({each})", options.tol
            )


def start_values(start: Any) -> Any:
    """Return attitudes (..., 3, 3) as unit quaternions (..., 4); angles as they are."""
    return matrix_to_quaternion(np.asarray(start)) if np.ndim(start) >= 2 else start


def solve_together(options: SolveOptions, omega: Signal, psid: Signal, start: Array, psi_0: Array) -> Any:
    """Return the orientations (M, N, 4), in the plane (M, N), and the hinge angles (M, N) of M motions over common
    steps, one for each interval. `start` are attitudes (M, 3, 3), in the plane angles (M,). Overflow is not refused.
    """
    steps = Steps(options.t)
    body1, hinge = options.integrals(omega, psid, planar=start.ndim == 1)
    return body1.integrate(steps, start_values(start)), hinge.integrate(steps, psi_0)


def solve(
    options: SolveOptions,
    omega: Signal,
    psid: Signal,
    start: Array | float,
    psi_0: float,
    integrated: tuple[Array, Array] | None = None,
) -> Solution:
    """Integrate the attitude and the hinge angle of one motion (E12).

    Args:
        options: instants, method and tolerance.
        omega: angular velocity of body 1, in the plane a scalar.
        psid: hinge rate.
        start: attitude of body 1 at the first instant (3, 3), in the plane an angle [rad].
        psi_0: hinge angle at the first instant [rad].
        integrated: orientations and hinge angles that `solve_together` has computed already.

    Raises:
        ArgumentError: a result overflows.
    """
    planar = np.ndim(start) == 0
    integrals = options.integrals(omega, psid, planar=planar)
    steps, errors = select_steps(integrals, options.t, options.tol)
    if integrated is None:
        integrated = integrals[0].integrate(steps, start_values(start)), integrals[1].integrate(steps, psi_0)
    else:
        for integral, values in zip(integrals, integrated, strict=True):
            integral.check_finite(values.reshape(len(values), -1), steps)

    return Solution(steps, integrals, integrated, errors)


METHODS: Final = ("magnus6",)  # of integration
RATE_FRAME_NAMES: Final = ("world", "body")  # axes in which omega1 and alpha1 may be given

RateArgument: TypeAlias = ArrayLike | Callable[[Array], Any]

# Arguments that give rates, by input of a pair's program.
_RATE_OF_INPUT: Final = {
    **{"omega1": "omega1", "alpha1": "alpha1", "phi1d": "omega1", "phi1dd": "alpha1"},
    **{"psid": "psid", "psidd": "psidd"},
}
# Forms of the argument R1 that give an input of a plan, for messages.
_R1_FORMS: Final = {"v1": "(R1, v1) or (R1, v1, a1)", "a1": "(R1, v1, a1)"}

_MAX_STEPS_TOGETHER: Final = 65_536  # of all motions that are integrated at a time


def integrate(
    pair: HingePair | PlanarPair,
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
    """Integrate the motion of a pair, in space or in the plane, over time from the angular velocity of body 1 and the
    hinge rate (E12).

    Each of the rates omega1, psid, alpha1 and psidd is one of:

    - a constant: shape (3,) for omega1 and alpha1, a number for psid and psidd;
    - samples at the instants t: shape (N, 3) or (N,); they are interpolated by a spline of degree 5, which overshoots
      at a kink or across a gap;
    - a callable that takes an array of times (n,) in seconds and returns an array (n, 3) or (n,), or a constant. The
      times count from the zero of t, or from the first instant where t is datetime64 or integer nanoseconds. (Seconds
      since 1970 as floats are rounded to 2.4e-7 s: give datetime64 or integer nanoseconds.)

    Arrays with leading axes describe many motions over the same instants: omega1, alpha1 and R1 (..., N, 3), psid and
    psidd (..., N), S1_0 (..., 3, 3), phi_0 and psi_0 (...,). Leading axes broadcast against each other. A rate or R1
    whose axis N has length 1 is constant in time in each motion. A callable, or an array without leading axes,
    applies to all motions. Each motion is integrated as if by a separate call, with bitwise the same result.

    Args:
        pair: a HingePair, or a PlanarPair (E11). For a PlanarPair, omega1 and alpha1 have the same forms as psid and
            psidd, and R1, v1 and a1 have two components instead of three.
        t: instants, increasing; shape (N,): seconds (floats), datetime64, or nanoseconds since 1970 (integers).
        omega1: angular velocity of body 1 [rad/s].
        psid: hinge rate psi' [rad/s].
        R1: position of the reference point of body 1, world axes [m]: a constant (3,), an array (N, 3), or a callable
            of times (n,) that returns either; the origin by default. For velocity [m/s] and acceleration [m/s^2] too,
            a tuple (R1, v1) or (R1, v1, a1) of arrays, or a callable that returns one. If R1 is not constant and v1
            (or a1) is not given, v2 (or a2) of the result is None.
        S1_0: attitude of body 1 at t[0], body to world, for a HingePair only; shape (..., 3, 3); the identity by
            default.
        phi_0: angle of body 1 at t[0] [rad], for a PlanarPair only; shape (...,); 0 by default.
        psi_0: hinge angle at t[0] [rad]; shape (...,); 0 by default.
        method: "magnus6", a Magnus series of order 6 from omega1 at three times in each step, the only one.
        frame: axes of omega1 and alpha1: "world" (the default) or "body" (for a HingePair only).
        tol: largest allowed error of the attitude and of psi at any instant [rad]. By default, each interval of t is
            one step, and the error has no limit. With tol, steps are divided until the error is small enough, of a
            callable into at least about 500 in all. A jump or a kink of a callable costs about sixty further steps,
            or none if it is at one of the instants t. A pulse of a callable that is shorter than a step may be
            missed; `error_estimate` may then be too small.
        alpha1: angular acceleration of body 1 [rad/s^2]. Without alpha1, a2 and alpha2 of the result are None.
        psidd: hinge acceleration psi'' [rad/s^2]. Without psidd, a2 and alpha2 of the result are None.
        outputs: names of the outputs to compute, such as ("R2", "v2"), as for `forward_kinematics`; () for none. By
            default, all outputs of body 2 that can be computed.
        backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

    Returns:
        A `Trajectory`, for a PlanarPair a `PlanarTrajectory`: the instants `.t`, the attitude of body 1 (`.S1`,
        `.quat_wxyz`; in the plane `.phi`), `.psi`, the outputs, such as `.R2`, and estimates of the largest error at
        any instant, `.error_estimate` and `.psi_error_estimate` [rad]. Of many motions, `trajectory[i]` is one.

    Raises:
        ArgumentError: an argument cannot be used, a rate is not finite, or tol is not reached. Of many motions, the
            error names the motion. A value of R1 that is not finite is no error.

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
    instants = instants_of("t", t)
    planar = isinstance(pair, PlanarPair)
    check_choice("method", method, METHODS)
    check_choice("frame", frame, ("world",) if planar else RATE_FRAME_NAMES)
    options = SolveOptions(instants, tol, execution_of_steps(backend, len(instants)), frame == "body")
    options.check()
    hinge_start = _read_start("psi_0", psi_0)
    if planar:
        if S1_0 is not None:
            raise ArgumentError("S1_0", "None for a PlanarPair, which takes phi_0", quoted(S1_0))
        start = _read_start("phi_0", 0.0 if phi_0 is None else phi_0)
    else:
        check_pair(pair)
        if phi_0 is not None:
            raise ArgumentError("phi_0", "None for a HingePair, which takes S1_0", quoted(phi_0))
        start = _read_start("S1_0", np.eye(3) if S1_0 is None else S1_0, 3, 3)
    rates = {"omega1": omega1, "alpha1": alpha1, "psid": psid, "psidd": psidd}
    signals = {
        name: read_signal(name, value, instants, () if planar or name in {"psid", "psidd"} else (3,))
        for name, value in rates.items()
        if value is not None or name in {"omega1", "psid"}
    }
    size = 2 if planar else 3
    points = read_position(np.zeros(size) if R1 is None else R1, instants, size)
    shapes = {name: signal.motions for name, signal in signals.items()}
    shapes |= {name: points[key].shape[:-2] for key, name in R1_PARTS.items() if key in points}
    shapes |= {"phi_0": start.shape} if planar else {"S1_0": start.shape[:-2]}
    motions = broadcast_shape({**shapes, "psi_0": hinge_start.shape})
    names = _checked_outputs(constants_of(pair), outputs, signals.keys() | points.keys())
    request = _Request(pair, options, signals, points, start, hinge_start, motions, names)
    trajectory = _make_trajectory(request, _solve_motions(request))
    if any(isinstance(request.signals[name], SampledSignal) for name in ("omega1", "psid")):
        warn_of_measurements(_instant_doubts(trajectory))
    return trajectory


def _instant_doubts(trajectory: Any) -> list[str]:
    """Return a sentence if the instants of sampled rates are probably not in seconds, judged by how far body 1 and
    the hinge of the first motion turn from each of the first instants to the next.
    """
    t = trajectory.t[:4096]
    turned = np.zeros(len(t) - 1)
    for psi in trajectory.psi.reshape(-1, len(trajectory.t))[:1]:
        turned += np.abs(np.diff(psi[: len(t)]))
    if isinstance(trajectory, Trajectory):
        for quats in trajectory.quat_wxyz.reshape(-1, len(trajectory.t), 4)[:1, : len(t)]:
            turned += 2 * np.arccos(np.minimum(np.abs((quats[1:] * quats[:-1]).sum(axis=1)), 1.0))
    angle = np.concatenate(([0.0], np.cumsum(turned)))
    return suspicions("sampled motion", "t", np.stack((t, angle), axis=-1))


class _Request(NamedTuple):
    """Checked arguments of `integrate`."""

    pair: Any
    options: SolveOptions
    signals: Mapping[str, Signal]  # of the rates, by the names of the arguments
    points: Mapping[str, NDArray[Any]]  # R1, v1, a1, as far as they are known; (k,), (..., 1, k) or (..., N, k)
    start: Array  # attitudes S1_0 (..., 3, 3), in the plane angles phi_0 (...,) [rad]
    psi_0: Array  # hinge angles at t[0] [rad]; shape (...,)
    motions: tuple[int, ...]  # leading shape of the motions; () for one motion
    outputs: tuple[str, ...]

    @property
    def is_planar(self) -> bool:
        return isinstance(self.pair, PlanarPair)


def _read_start(name: str, value: Any, *one: int) -> Array:
    """Return a value at t[0] of one motion or of many, (..., *one), as a float64 array."""
    if np.ndim(value) == 0 and not one:
        return np.array(finite_number(name, value))
    return vectors(name, value, *one).astype(np.float64)


def _name_of_motion(name: str, index: Sequence[int]) -> str:
    """Return the name of an argument in messages of a motion.

    >>> [_name_of_motion("psi_0", index) for index in [(), (3,), (2, 5)]]
    ['psi_0', 'psi_0 of motion 3', 'psi_0 of motion (2, 5)']
    """
    return f"{name} of motion {index[0] if len(index) == 1 else tuple(index)}" if len(index) else name


@contextlib.contextmanager
def _named_by_motion(index: tuple[int, ...]) -> Iterator[None]:
    """Add the index of a motion to the name in an ArgumentError of the block."""
    try:
        yield
    except ArgumentError as error:
        if not index:
            raise
        raise type(error)(_name_of_motion(error.name, index), error.expected, error.got) from None


def _check_finite(request: _Request) -> None:
    """Raise an ArgumentError if a number is not finite, or an attitude at the start is not a rotation."""
    for name, signal in request.signals.items():
        bad = signal.first_bad()
        if bad is not None:
            with _named_by_motion(bad[0]):
                raise ArgumentError(name, "finite numbers", bad[1])
    for index in np.ndindex(request.psi_0.shape):
        with _named_by_motion(index):
            finite_number("psi_0", float(request.psi_0[index]))
    for index in np.ndindex(request.start.shape[: None if request.is_planar else -2]):
        with _named_by_motion(index):
            if request.is_planar:
                finite_number("phi_0", float(request.start[index]))
            else:
                check_rotation("S1_0", one_constant("S1_0", request.start[index], 3, 3))


def _solve_motions(request: _Request) -> list[Solution]:
    """Check and solve the motions of a request; return a `Solution` of each in C order, or refuse the tolerance."""
    _check_finite(request)
    options, motions, is_planar = request.options, request.motions, request.is_planar
    rates: list[Any] = [request.signals[name] for name in ("omega1", "psid")]
    # One axis of motions; rates without motions are shared by all.
    rates = [rate.flattened(motions) if rate.motions else rate for rate in rates]
    starts = np.broadcast_to(request.start, motions + (() if is_planar else (3, 3)))
    starts = starts.reshape(-1) if is_planar else starts.reshape(-1, 3, 3)
    psi_0 = np.broadcast_to(request.psi_0, motions).reshape(-1)
    size = max(1, _MAX_STEPS_TOGETHER // len(options.t))
    solutions: list[Solution] = []
    for begin in range(0, len(psi_0), size):
        group = slice(begin, begin + size)
        integrated: Any = None
        if options.tol is None and len(psi_0[group]) > 1:  # else each motion has steps of its own
            omega, psid = (rate[group] if rate.motions else rate for rate in rates)
            integrated = solve_together(options, omega, psid, starts[group], psi_0[group])
        for k in range(begin, begin + len(psi_0[group])):
            own = [rate[k] if rate.motions else rate for rate in rates]
            start = float(starts[k]) if is_planar else starts[k]
            with _named_by_motion(tuple(int(i) for i in np.unravel_index(k, motions))):
                given = None if integrated is None else tuple(part[k - begin] for part in integrated)
                solution = solve(options, own[0], own[1], start, float(psi_0[k]), given)
                solution.check_tolerance(options)
            solutions.append(solution)
    return solutions


def _make_trajectory(request: _Request, solutions: Sequence[Solution]) -> Any:
    """Return the trajectory of all motions, with the requested outputs at all instants."""
    t, motions = request.options.t, request.motions

    def stacked(rows: Sequence[Any], *shape: int) -> Any:
        array = rows[0] if len(rows) == 1 else np.array(rows)
        return read_only(array.reshape(*motions, *shape))

    count = len(t)
    orientations = stacked([one.orientations for one in solutions], *((count,) if request.is_planar else (count, 4)))
    psi = stacked([one.psi for one in solutions], count)
    values: dict[str, Any] = {"phi": orientations}
    if not request.is_planar:
        R1 = np.broadcast_to(request.points["R1"], (*motions, count, 3))
        values = {"quat_wxyz": orientations, "R1": read_only(R1), "pair": request.pair}
    steps = np.array([one.steps for one in solutions], np.int64)
    return (PlanarTrajectory if request.is_planar else Trajectory)(
        t=read_only(t),
        psi=psi,
        state=_compute_state(request, orientations, psi),
        method=METHODS[0],
        steps=read_only(steps.reshape(motions)) if motions else int(steps[0]),
        _solutions=np.array(solutions, object).reshape(motions),
        **values,
    )


def _compute_state(request: _Request, orientations: Array, psi: Array) -> Any:
    """Return the requested outputs at all instants of all motions as a `PairState` or `PlanarState`."""
    options, constants = request.options, constants_of(request.pair)
    if not request.outputs:
        return STATES[constants.kind]({}, psi.shape)
    needed = _needed_inputs(constants, request.outputs)
    S1 = None if request.is_planar else quaternions_to_matrices(orientations)
    inputs: dict[str, Any] = {**request.points, "psi": psi, **({"phi1": orientations} if S1 is None else {"S1": S1})}
    for name in needed & _RATE_OF_INPUT.keys():
        argument = _RATE_OF_INPUT[name]
        values = request.signals[argument].values_at(options.t)
        turned = S1 is not None and options.omega_in_body_axes and argument in {"omega1", "alpha1"}
        inputs[name] = rotate_to_world(S1, values) if turned and S1 is not None else values
    inputs = {name: inputs[name] for name in inputs if name in needed}
    computation = computation_of(constants, request.outputs, result=STATES[constants.kind])
    return computation.run(Arguments(inputs, {"t": psi.shape}, {}), options.execution)


def _needed_inputs(pair: Constants, outputs: tuple[str, ...]) -> set[str]:
    """Return the names of the inputs that outputs need, the constants of the pair apart."""
    computation, attitude = computation_of(pair, outputs), "phi1" if pair.kind.planar else "S1"
    return {name for one in outputs for name in computation.missing_inputs(one, ())} | {attitude, "psi"}


def _checked_outputs(pair: Constants, outputs: Outputs, arguments: Set[str]) -> tuple[str, ...]:
    """Return the names of the outputs, all of body 2 for which the `arguments` suffice if `outputs` is None; refuse
    those that need more.
    """
    available = {"S1", "phi1", "psi"} | arguments
    available |= {name for name, argument in _RATE_OF_INPUT.items() if argument in arguments}
    if outputs is None:
        default = pair.kind.default_outputs(ACCELERATION)
        return tuple(name for name in default if _needed_inputs(pair, (name,)) <= available)
    names = check_outputs(outputs, pair.levels) if not isinstance(outputs, tuple) or outputs else ()
    for name in names:
        for missing in sorted(_needed_inputs(pair, (name,)) - available):
            expected = f"{_R1_FORMS.get(missing, 'a value')}, since output {name} needs it"
            got = f"no {missing}" if missing in _R1_FORMS else None
            raise ArgumentError(_RATE_OF_INPUT.get(missing, "R1"), expected, got)
    return names
