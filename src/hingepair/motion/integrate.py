"""E12: from omega1(t) and psi'(t) to attitudes, and to everything about body 2."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.engine.backend import Execution, execution_of, execution_of_steps
from hingepair.equations.quantities import ACCELERATION
from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.pairs.subject import PairSubject, check_pair
from hingepair.mechanism.requests import STATES, subject_of
from hingepair.motion.magnus import AngleIntegral, AttitudeIntegral, Integral
from hingepair.motion.signals import SampledSignal, interpolate, read_position, read_signal
from hingepair.motion.steps import estimate_error, select_steps
from hingepair.motion.trajectory import (
    Deferred,
    PlanarTrajectory,
    Trajectory,
    quaternions_to_matrices,
    rotate_to_world,
)
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import (
    check_choice,
    finite_number,
    one_constant,
    read_only,
)
from hingepair.plans.arguments import Outputs, check_outputs
from hingepair.rotations.matrices import check_rotation, matrix_to_quaternion
from hingepair.tables.instants import instants_of, warn_of_measurements
from hingepair.tables.suspicions import suspicions


class Solution(Deferred):
    """The attitude of body 1 and the hinge angle over steps, and estimates of their errors, made when they are first
    asked for.

    Args:
        integrals: those of the attitude of body 1 and of psi.
        t: instants.
        tol: largest error [rad]; None: one step for each interval.

    Raises:
        ArgumentError: a result overflows.
    """

    def __init__(self, integrals: Sequence[Integral], t: Array, tol: float | None) -> None:
        self._integrals, self._steps = integrals, select_steps(integrals, t, tol)
        self._values = [one.accumulated(one.changes(self._steps)) for one in integrals]
        for one, values in zip(integrals, self._values, strict=True):
            if not np.isfinite(values[-1]).all():
                finite = np.isfinite(self._steps.at_instants(values)).reshape(len(t), -1).all(axis=1)
                first = int(np.argmin(finite))
                got = f"overflow between the instants {first - 1} and {first}"
                raise ArgumentError(one.name, "a rate that turns by a finite angle in each step", got)
        #: unit quaternions of body 1, without a jump of sign, or its angles in the plane; and hinge angles [rad]
        self.attitudes, self.psi = map(self._steps.at_instants, self._values)
        #: number of steps
        self.steps = self._steps.step_count

    @functools.cached_property
    def error(self) -> float:
        """Estimate of the largest error of the attitude [rad]."""
        return min(estimate_error(self._integrals[0], self._steps, self._values[0]), np.pi)

    @functools.cached_property
    def psi_error(self) -> float:
        """Estimate of the largest error of psi [rad]."""
        return estimate_error(self._integrals[1], self._steps, self._values[1])


METHODS: Final = ("magnus6",)  # of integration
RATE_FRAME_NAMES: Final = ("world", "body")  # axes in which omega1 and alpha1 may be given

RateArgument: TypeAlias = ArrayLike | Callable[[Array], Any]

# Arguments that give rates, by input of a pair's program.
_RATES: Final = {
    **{"omega1": "omega1", "alpha1": "alpha1", "phi1d": "omega1", "phi1dd": "alpha1"},
    **{"psid": "psid", "psidd": "psidd"},
}
# Forms of the argument R1 that give an input of a plan, for messages.
_R1_FORMS: Final = {"v1": "(R1, v1) or (R1, v1, a1)", "a1": "(R1, v1, a1)"}


def integrate(
    pair: HingePair | PlanarPair,
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
) -> Trajectory:
    """Integrate the motion of a pair over time from the angular velocity of body 1 and the hinge rate (E12).

    Each of the rates omega1, psid, alpha1 and psidd is one of:

    - a constant: shape (3,) for omega1 and alpha1, a number for psid and psidd;
    - samples at the instants t: shape (N, 3) or (N,); they are interpolated by a spline of degree 5, which overshoots
      at a kink or across a gap;
    - a callable that takes an array of times (n,) in seconds and returns an array (n, 3) or (n,), or a constant. The
      times count from the zero of t, or from the first instant where t is datetime64 or integer nanoseconds. (Seconds
      since 1970 as floats are rounded to 2.4e-7 s: give datetime64 or integer nanoseconds.)

    Args:
        pair: a HingePair; or a PlanarPair, whose omega1 and alpha1 are numbers like psid, and whose R1, v1 and a1
            have two components.
        t: instants, increasing; shape (N,): seconds (floats), datetime64, or nanoseconds since 1970 (integers).
        omega1: angular velocity of body 1 [rad/s].
        psid: hinge rate psi' [rad/s].
        R1: position of the reference point of body 1, world axes [m]: a constant (3,), an array (N, 3), or a callable
            of times (n,) that returns either; the origin by default. For velocity [m/s] and acceleration [m/s^2] too,
            a tuple (R1, v1) or (R1, v1, a1) of arrays, or a callable that returns one. If R1 is not constant and v1
            (or a1) is not given, v2 (or a2) of the result is None.
        S1_0: attitude of body 1 at t[0], body to world; shape (3, 3); the identity by default.
        phi_0: in place of S1_0, the angle of body 1 of a PlanarPair at t[0] [rad]; 0 by default.
        psi_0: hinge angle at t[0] [rad]; 0 by default.
        method: "magnus6", a Magnus series of order 6 from omega1 at three times in each step, the only one.
        frame: axes of omega1 and alpha1: "world" (the default) or "body".
        tol: largest allowed error of the attitude and of psi at any instant [rad]. By default, each interval of t is
            one step, and the error has no limit. With tol, steps are divided until the error is small enough; of a
            callable it is measured by at least 500 steps in all. A jump or a kink of a callable costs about sixty
            further steps, or none if it is at one of the instants t. A pulse of a callable that is shorter than a
            step may be missed; `error_estimate` may then be too small.
        alpha1: angular acceleration of body 1 [rad/s^2]. Without alpha1, a2 and alpha2 of the result are None.
        psidd: hinge acceleration psi'' [rad/s^2]. Without psidd, a2 and alpha2 of the result are None.
        outputs: names of the outputs to compute, such as ("R2", "v2"), as for `forward_kinematics`; () for none. By
            default, all outputs of body 2 that can be computed.
        backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

    Returns:
        A `Trajectory`: the instants `.t`, the attitude of body 1 (`.S1`, `.quat_wxyz`), `.psi`, the outputs, such as
        `.R2`, and estimates of the largest error at any instant, `.error_estimate` and `.psi_error_estimate` [rad].
        Of a PlanarPair, a `PlanarTrajectory`, with the angle `.phi` of body 1.

    Raises:
        ArgumentError: an argument cannot be used, a rate is not finite, or tol is not reached. A
            value of R1 that is not finite is no error.

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
    planar = isinstance(pair, PlanarPair)
    if not planar:
        check_pair(pair)
    check_choice("method", method, METHODS)
    check_choice("frame", frame, RATE_FRAME_NAMES)
    start = _start(planar, S1_0, phi_0)
    if tol is not None and not finite_number("tol", tol) > 0:
        raise ArgumentError("tol", "a positive number", tol)
    instants = instants_of("t", t)
    execution = execution_of_steps(backend, len(instants))
    rates = {"omega1": omega1, "alpha1": alpha1, "psid": psid, "psidd": psidd}
    signals = {
        name: read_signal(name, value, instants, () if planar or name in {"psid", "psidd"} else (3,))
        for name, value in rates.items()
        if value is not None or name in {"omega1", "psid"}
    }
    size = 2 if planar else 3
    points = read_position(np.zeros(size) if R1 is None else R1, instants, size)
    subject = subject_of(pair)
    names = _checked_outputs(subject, outputs, signals.keys() | points.keys())
    sampled = [one for name in ("omega1", "psid") if isinstance(one := signals[name], SampledSignal)]
    interpolate(sampled)
    turning: Integral = AngleIntegral("omega1", signals["omega1"], execution, start)
    if not planar:
        turning = AttitudeIntegral("omega1", signals["omega1"], execution, start, frame == "body")
    angle = AngleIntegral("psid", signals["psid"], execution, finite_number("psi_0", psi_0))
    solution = Solution((turning, angle), instants, tol)
    if tol is not None and not (left := float(np.maximum(solution.error, solution.psi_error))) <= tol:
        each = f"omega1 leaves {solution.error:.2g}, psid leaves {solution.psi_error:.2g}"
        raise ArgumentError("tol", f"at least the error that is left, {left:.2g} rad ({each})", tol)
    inputs = {**points, "psi": solution.psi}
    if planar:
        inputs["phi1"] = solution.attitudes
    elif names:
        inputs["S1"] = quaternions_to_matrices(solution.attitudes)
    for name in _needed_inputs(subject, names) & _RATES.keys():
        inputs[name] = signals[_RATES[name]].values_at(instants)
        if frame == "body" and name in {"omega1", "alpha1"}:
            inputs[name] = rotate_to_world(inputs["S1"], inputs[name])
    fields: dict[str, Any] = {
        "t": read_only(instants),
        "psi": read_only(solution.psi),
        "R1": read_only(np.broadcast_to(points["R1"], (len(instants), size))),
        "state": _state(subject, names, inputs, execution_of(backend, 1)),
        "pair": pair,
        "method": method,
        "steps": solution.steps,
        "_solution": solution,
    }
    if planar:
        phi = solution.attitudes
        quats = np.stack((np.cos(phi / 2), 0 * phi, 0 * phi, np.sin(phi / 2)), axis=-1)
        trajectory: Trajectory = PlanarTrajectory(**fields, phi=read_only(phi), quat_wxyz=read_only(quats))
    else:
        trajectory = Trajectory(**fields, quat_wxyz=read_only(solution.attitudes))
    if sampled and _median_turn(trajectory) >= 1.0:  # [rad]; a slow motion may be sampled each second
        warn_of_measurements(suspicions("instants", "t", instants))
    return trajectory


def _median_turn(trajectory: Trajectory) -> float:
    """Return by how far body 1 and the hinge turn from one of the first instants to the next [rad]."""
    quats, psi = trajectory.quat_wxyz[:4096], trajectory.psi[:4096]
    turned = 2 * np.arccos(np.minimum(np.abs((quats[1:] * quats[:-1]).sum(axis=1)), 1.0)) + np.abs(np.diff(psi))
    return float(np.median(turned)) if turned.size else 0.0


def _start(planar: bool, S1_0: Any, phi_0: Any) -> Any:
    """Return the attitude of body 1 at the first instant: its angle in the plane, or a unit quaternion."""
    other, unused = ("S1_0", S1_0) if planar else ("phi_0", phi_0)
    if unused is not None:
        raise ArgumentError(other, f"None for a {'PlanarPair' if planar else 'HingePair'}", quoted(unused))
    if planar:
        return finite_number("phi_0", 0.0 if phi_0 is None else phi_0)
    S = np.eye(3) if S1_0 is None else one_constant("S1_0", S1_0, 3, 3)
    check_rotation("S1_0", S)
    return matrix_to_quaternion(S)


def _state(pair: PairSubject, outputs: tuple[str, ...], inputs: Mapping[str, Any], execution: Execution) -> Any:
    """Return the outputs at all instants as a `PairState` or `PlanarState`."""
    result, shape = STATES[pair.kind], inputs["psi"].shape
    if not outputs:
        return result({}, shape)
    needed = {name: inputs[name] for name in inputs if name in _needed_inputs(pair, outputs)}
    call = pair.computation(outputs, result=result).call(tuple(needed), execution.backend)
    return call.run(needed, {"t": shape}, workers=execution.workers)


def _needed_inputs(pair: PairSubject, outputs: tuple[str, ...]) -> set[str]:
    """Return the names of the inputs that outputs need, the constants of the pair apart."""
    computation, attitude = pair.computation(outputs), "phi1" if pair.kind.planar else "S1"
    return {name for one in outputs for name in computation.missing_inputs(one, ())} | {attitude, "psi"}


def _checked_outputs(pair: PairSubject, outputs: Outputs, arguments: Set[str]) -> tuple[str, ...]:
    """Return the names of the outputs, all of body 2 for which the `arguments` suffice if `outputs` is None; refuse
    those that need more.
    """
    available = {"S1", "phi1", "psi"} | arguments
    available |= {name for name, argument in _RATES.items() if argument in arguments}
    if outputs is None:
        default = pair.kind.default_outputs(ACCELERATION)
        return tuple(name for name in default if _needed_inputs(pair, (name,)) <= available)
    names = check_outputs(outputs, pair.levels) if not isinstance(outputs, tuple) or outputs else ()
    for name in names:
        for missing in sorted(_needed_inputs(pair, (name,)) - available):
            expected = f"{_R1_FORMS.get(missing, 'a value')}, since output {name} needs it"
            got = f"no {missing}" if missing in _R1_FORMS else None
            raise ArgumentError(_RATES.get(missing, "R1"), expected, got)
    return names
