"""The rollout of a robot: its arguments and results."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.engine import jax_torch
from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, quoted, warn_of_dynamics
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.options import DEFAULT_GRAVITY, ROLLOUT_OPTIONS, Options, check_options
from hingepair.mechanism.requests import ask, read_gravity
from hingepair.mechanism.robots.computations import RESTING_BASE, base_inputs, read_wrenches
from hingepair.mechanism.robots.subject import RobotSubject
from hingepair.mechanism.states import Named, with_names
from hingepair.numeric.arrays import FloatArray, check_choice, finite_number
from hingepair.plans.arguments import Coordinates, check_out
from hingepair.plans.rollouts import BASE_STATE, METHODS, RolloutStep
from hingepair.rollouts.gradients import gradients
from hingepair.rollouts.motions import Motions
from hingepair.rollouts.tracks import Feedback, Track, control_tracks, count_steps, track


class Rollout(Named):
    """Motions of a robot at the recorded steps, the start first. Only hingepair calls the constructor."""

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "q": "Coordinates; (..., steps + 1, dof).",
        "qd": "Their time derivatives; (..., steps + 1, dof).",
        "R1": "Reference point of a free base, world axes; (..., steps + 1, 3) m.",
        "S1": "Rotation of a free base, base to world; (..., steps + 1, 3, 3).",
        "v1": "Velocity of R1; (..., steps + 1, 3) m/s.",
        "omega1": "Angular velocity of a free base, world axes; (..., steps + 1, 3) rad/s.",
        "_motions": "",
    }

    q: FloatArray
    qd: FloatArray
    R1: FloatArray
    S1: FloatArray
    v1: FloatArray
    omega1: FloatArray
    _motions: Motions  # not of copies, and not of arrays of JAX and PyTorch
    _step: ClassVar[float | None] = None  # from one record to the next [s]
    _joints: ClassVar[tuple[tuple[str, str], ...]] = ()  # names and units of the coordinates

    def _recorded(self) -> dict[str, Any]:
        """Return t, and of a joint `elbow` elbow and elbowd, and the motion of a free base."""
        arrays = self.arrays()
        if self.t is None:
            return arrays
        columns: dict[str, Any] = {"t": np.broadcast_to(self.t, self.shape)}
        for ending, name in (("", "q"), ("d", "qd")):
            columns |= {joint + ending: arrays[name][..., k] for k, (joint, _) in enumerate(self._joints)}
        return columns | {name: array for name, array in arrays.items() if name not in ("q", "qd")}

    def _unit(self, name: str) -> str:
        for joint, unit in self._joints:
            if name in (joint, f"{joint}d"):
                return unit if name == joint else f"{unit}/s"
        return super()._unit(name)

    def vjp(
        self, cotangents: Mapping[str, ArrayLike], wrt: str | Iterable[str] | None = None
    ) -> dict[str, FloatArray]:
        """Compute the gradient of a weighted sum of the recorded states, such as that of a loss, by the arguments.

        The motions are stepped once more from one record to the next, and then backwards, so that the memory does not
        grow with the number of steps if `every` does. The arguments and results must not have changed since.

        Args:
            cotangents: weights by output, the derivatives of the loss by q, qd, R1, S1, v1 and omega1; each of the
                shape of the output, or of one that broadcasts to it. Those of S1 are three, (..., 3), of rotations
                about the axes of the world. Outputs without weights do not count.
            wrt: names of what the gradient is taken by: q0, qd0; of a free base R1, S1, v1 and omega1 at the start;
                tau, or those of the `Feedback`: K, D, q_ref, qd_ref and tau_ff. By default all of these.

        Returns:
            Arrays by name: (..., one sample), or (..., steps, one sample) if the argument has an axis of steps. The
            gradient of each motion is its own: it is not summed over motions that share an argument.

        Raises:
            ArgumentError: the results were not computed in this process.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> motion = robot.rollout(np.zeros(6), np.zeros(6), np.zeros((50, 6)), 1e-2)
        >>> weights = np.zeros((51, 6))
        >>> weights[-1] = motion.q[-1] - 1.0  # of the loss |q - 1|^2 / 2 at the end
        >>> motion.vjp({"q": weights}, wrt="tau")["tau"].shape
        (50, 6)
        """
        if getattr(self, "_motions", None) is None:
            raise ArgumentError(
                "rollout", "the result of a call in this process", "a copy, or arrays of JAX or PyTorch"
            )
        return gradients(self._motions, self.arrays(), cotangents, wrt)

    @property
    def t(self) -> FloatArray | None:
        """Instants of the recorded states, from 0 [s]; (steps + 1,). None for arrays of JAX and PyTorch."""
        return None if self._step is None else np.arange(self.shape[-1]) * self._step

    @property
    def base_motion(self) -> BodyMotion | None:
        """Motion of a free base, for the argument of this name of the robot's methods; None for any other base."""
        if self.R1 is None:
            return None
        return BodyMotion(R=self.R1, S=self.S1, v=self.v1, omega=self.omega1)


class PreparedRollout:
    """Rollouts of a robot with given options, from q0, qd0 and tau. Only hingepair calls the constructor.

    Args:
        rollout: `Mechanism.rollout` with its options.
        dof: number of coordinates.
        base: kind of the base.

    Attributes:
        given: names of the arguments, in order.
        outputs: names of the recorded states.
    """

    given: Final = ("q0", "qd0", "tau")

    def __init__(self, rollout: functools.partial[Rollout], dof: int, base: str) -> None:
        self._rollout, self._dof = rollout, dof
        self.outputs = ("q", "qd", *(BASE_STATE if base == "free" else ()))

    def __repr__(self) -> str:
        return f"PreparedRollout({', '.join(f'{name}={value!r}' for name, value in self._rollout.keywords.items())})"

    def __call__(self, q0: Coordinates, qd0: Coordinates, tau: Any, *, out: Any = None) -> Rollout:
        """Return what `Mechanism.rollout` returns."""
        return self._rollout(q0, qd0, tau, out=out)

    def jax(self, q0: Any, qd0: Any, tau: Any) -> Rollout:
        """Return the rollout of arrays of JAX: q0 and qd0 (..., dof), tau (..., steps, dof) or (dof,), or a
        `Feedback` of NumPy arrays. `jit`, `vmap`, `scan` and `grad` work; attitudes change by their nine entries.
        """
        return self._in_library("jax", q0, qd0, tau)

    def torch(self, q0: Any, qd0: Any, tau: Any) -> Rollout:
        """Return the rollout of tensors of PyTorch, in the forms of `jax`, which `backward` differentiates once."""
        return self._in_library("torch", q0, qd0, tau)

    def _in_library(self, library: str, q0: Any, qd0: Any, tau: Any) -> Rollout:
        given = {"q0": q0, "qd0": qd0}
        if not isinstance(tau, Feedback):
            given["tau"] = np.full(self._dof, float(tau)) if isinstance(tau, int | float) else tau
        arrays = [*jax_torch.library_arrays(library, dict.fromkeys(given, (self._dof,)), [*given.values()])]

        if "tau" in given and arrays[2].ndim == 1:
            if self._rollout.keywords.get("steps") is None:
                raise ArgumentError("steps", "a number of steps, since tau has no axis of steps", None)
            arrays[2] = arrays[2][None]
        ranks = [1, 1, 2][: len(arrays)]
        tails = tuple(tuple(one.shape[one.ndim - k :]) for one, k in zip(arrays, ranks, strict=True))

        def run(chain: jax_torch.Chain, values: Sequence[Any]) -> list[FloatArray]:
            motions = self._rollout(**{"tau": tau, **dict(zip(given, values, strict=False))})
            states = motions.arrays()
            if not chain:
                return [*states.values()]
            by = jax_torch.gradient_of(chain)
            cotangents = dict(zip(states, values[len(given) :], strict=True))
            if "S1" in cotangents:  # the entries of an attitude change so where it turns
                cotangents["S1"] = np.cross(states["S1"], cotangents["S1"], axis=-2).sum(axis=-1)
            wrt = [[*given][k] for k in by]
            gradients = motions.vjp(cotangents, wrt)
            return [gradients[name] for name in wrt]

        nothing = [np.zeros((0, *tail)) for tail in tails]
        function = jax_torch.Differentiable(tails, tuple(one.shape[1:] for one in run((), nothing)), run)
        applied = jax_torch.torch_function if library == "torch" else jax_torch.jax_function
        found = applied(function)(*arrays)
        result: Rollout = jax_torch.library_results(library, Rollout, self.outputs, found, 1)
        return result


def roll_out(
    robot: RobotSubject,
    q0: Coordinates,
    qd0: Coordinates,
    tau: Any,
    dt: float | None,
    method: str,
    steps: int | None,
    every: int,
    effort_limits: Any,
    options: Options,
) -> Rollout:
    """Return what `Mechanism.rollout` describes."""
    check_options("rollout", options, ROLLOUT_OPTIONS)
    tree, base_motion = robot.tree, options.get("base_motion")
    loads, links = read_wrenches(options.get("wrenches"), tree)
    computation = robot.optioned(("qdd",), links, options)
    form, request, dof = computation.form, computation.request, computation.form.dof
    check_choice("method", method, METHODS)
    if not isinstance(every, int | np.integer) or isinstance(every, bool) or every < 1:
        raise ArgumentError("every", "a whole number from 1", quoted(every))
    if not (dof or request.free):
        raise ArgumentError("robot", "joints that move, or a free base", f"{dof}")
    tree.refuse_functions()
    starts = {"q": tree.rows("q0", q0), "qd": tree.rows("qd0", qd0)}
    gravity = read_gravity(options.get("gravity", DEFAULT_GRAVITY))
    known = {**RESTING_BASE, "constants": computation.known["constants"], "gravity": gravity}
    known["h"] = finite_number("dt", dt)
    if known["h"] <= 0:
        raise ArgumentError("dt", "a number above 0", quoted(dt))
    control, tracks = control_tracks(tau, dof, effort_limits)
    tracks |= {name: track(label, value, 3) for name, (value, label) in loads.items()}
    base = base_inputs(base_motion, BASE_STATE if request.free else ("S1",))
    if request.free:
        for name, tail in BASE_STATE.items():
            start = np.asarray({**known, **base}[name], np.float64)
            starts[name] = start.reshape(tail) if start.size == math.prod(tail) else start
    elif base:
        if base.keys() - {"R1", "S1"}:
            expected = "R and S of a base that is at rest; hp.simulate moves a base"
            raise ArgumentError("base_motion", expected, quoted(base_motion))
        tracks["S1"] = Track("base_motion", np.asarray(base["S1"], np.float64)[..., None, :, :], (3, 3), False)
    if request.varied:
        samples = computation.known["samples"]
        tracks["samples"] = Track(computation.owner, samples[..., None, :], samples.shape[-1:], False)
    known = {name: value for name, value in known.items() if name not in tracks and name not in starts}
    step, workers = RolloutStep(form, request._replace(outputs=()), method, control), options.get("workers", 1)
    count = count_steps(tracks, steps)
    motions = Motions(step, known, starts, tracks, count, int(every), execution_of("auto", workers).workers)
    joints = tuple((joint.name, joint.unit) for joint in tree.coordinates)
    made: Any = with_names(Rollout, (("_joints", joints), ("_step", motions.every * known["h"])))
    arrays = motions.run(check_out(options.get("out"), tuple(starts)))
    result: Rollout = made(arrays, (*motions.shape, motions.records + 1))
    object.__setattr__(result, "_motions", motions)
    lost = np.isnan(result.q[..., -1, :]).any(axis=-1)
    if robot.constants.may_be_singular and lost.any():
        ask(robot, "forward_dynamics", (q0, qd0, np.zeros(dof)), {"joint_loads": False})  # which warns
    lost &= np.isfinite(result.q[..., 0, :]).all(axis=-1)
    if tree.closure is not None and lost.any():
        count_of = f"{int(lost.sum())} of {lost.size} motions"
        warn_of_dynamics(f"{tree.name}: {count_of} become NaN, as at a dead point or by too long steps")
    return result
