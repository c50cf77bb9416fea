"""How calls of a robot are answered: what is computed and from what, made once, and what is said of the results."""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, quoted, warn_of_dynamics
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.linkages import open_samples
from hingepair.mechanism.options import BOUNDS_OPTIONS, DEFAULT_GRAVITY, FurtherOptions, check_options
from hingepair.mechanism.requests import (
    FREE_BASE_OUTPUTS,
    ROBOT_TASKS,
    SOLVED,
    MethodCall,
    PreparedCall,
    Subject,
    Task,
    Watch,
    ask,
    motion_level,
    read_gravity,
    warn_of_pivots,
)
from hingepair.mechanism.robots.computations import (
    ALL_OUTPUTS,
    PREPARED_ARGUMENTS,
    Loads,
    RobotComputation,
    read_wrenches,
    result_class,
)
from hingepair.mechanism.robots.constants import (
    RobotConstants,
    load_numbers,
    numbers_with_bounds,
    robot_constants,
)
from hingepair.mechanism.states import (
    MechanismState,
)
from hingepair.mechanism.struts import beyond_stroke, with_function_wrenches
from hingepair.mechanism.tree import Tree, loads_note
from hingepair.numeric.arrays import Float64Array, is_zero
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.arguments import Coordinates, requested_outputs
from hingepair.plans.bounds import output_bounds
from hingepair.plans.trees import BASE_LOADS, DYNAMICS_MATRICES, FRAME_OUTPUTS, OF_FRAMES, OUTPUTS, TreeForm


class RobotSubject(Subject):
    """What is asked of a robot, and its computations, which are made once.

    Args:
        tree: record of the robot.
        base: "fixed": the base is held, or moves as given; "free": forces move the base.
        whole: whether all matter counts with its own body (T9).
    """

    tasks, inputs = ROBOT_TASKS, PREPARED_ARGUMENTS
    _further_words = ("rollout", "inverse_kinematics")

    def __init__(self, tree: Tree, base: str, whole: bool = False) -> None:
        super().__init__()
        self.tree, self.base, self._whole = tree, base, whole

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.tree, self.base, self._whole)

    @lock_free_cached_property
    def constants(self) -> RobotConstants:
        """Constants of the robot's programs."""
        return robot_constants(self.tree, self.base == "free", self._whole)

    @lock_free_cached_property
    def whole_constants(self) -> RobotConstants:
        """The constants without masses shifted to parent bodies (T9), for the wrenches of joints."""
        return robot_constants(self.tree, self.base == "free", whole=True)

    def _method_call(self, task: Task, given: dict[str, Any], options: Mapping[str, Any], out: Any) -> MethodCall:
        """Return the call of a method, planned."""
        default = self.available(task.outputs)
        accepted = FRAME_OUTPUTS if task.result is MechanismState else default
        computed = requested_outputs(options.get("outputs"), out, accepted, default)
        wrenches, called = options.get("wrenches"), self._calls_functions(computed)
        if called and not {*computed}.isdisjoint(DYNAMICS_MATRICES):
            self.tree.refuse_functions()
        if called:
            base_motion = options.get("base_motion")
            compute = functools.partial(ask, self)
            wrenches = with_function_wrenches(compute, self.tree, given["q"], given.get("qd"), base_motion, wrenches)
        loads, links = read_wrenches(wrenches, self.tree)
        if "force1" in task.options:
            loads = {**loads, **self._base_loads(options.get("force1", 0), options.get("torque1", 0))}
        computation = self.optioned(computed, links, options)
        coordinates = {label: x for label, x in given.items() if x is not None}
        arguments, labels = computation.given(coordinates, options.get("base_motion"), loads)
        return MethodCall(
            computation, arguments, labels, read_gravity(options.get("gravity", DEFAULT_GRAVITY)),
            self.watch(computed, plain=True),
            # What the arrays of `out` ask for can be something else the next time.
            lasts=not called and (options.get("outputs") is not None or computed == default),
        )  # fmt: skip

    def _calls_functions(self, outputs: Iterable[str]) -> bool:
        """Return whether outputs depend on struts whose force is a function."""
        return self.tree.has_functions and any(OUTPUTS[name].has_struts for name in outputs)

    def _accepted(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the outputs that a prepared call can have."""
        return tuple(name for name in self.available(ALL_OUTPUTS) if name not in names)

    def _prepared_call(
        self, _: str | None, names: tuple[str, ...], outputs: tuple[str, ...], options: Any
    ) -> PreparedCall:
        """Return what a prepared call computes."""
        loads = [name for name in names if name in BASE_LOADS]
        if loads and self.base != "free":
            raise ArgumentError("given", "no forces on a fixed base (base='free' is moved by them)", ", ".join(loads))
        if self._calls_functions(outputs):
            self.tree.refuse_functions()
        given = options["wrenches"]
        links = (given,) if isinstance(given, str) else tuple(given)
        further = tuple(read_wrenches(dict.fromkeys(links, (0, 0)), self.tree)[0])
        computation = self.optioned(outputs, links, options)
        frames, joint_loads = computation.asked[1], computation.asked[3]
        remade = {**options, "frames": frames or None, "wrenches": links, "joint_loads": joint_loads}
        return PreparedCall(computation, remade, self.watch(outputs), further)

    def optioned(
        self, outputs: tuple[str, ...], pushed: tuple[str, ...], options: Mapping[str, Any]
    ) -> RobotComputation:
        """Return the computation of outputs under the options `frames` and `joint_loads`; wrenches act on the frames
        in `pushed`. The first that uses masses warns of them.
        """
        counted = any(OUTPUTS[name].has_loads for name in outputs) and self.counts_loads(options.get("joint_loads"))
        computation = self.computation(outputs, self._frames_of(outputs, options.get("frames")), pushed, counted)
        if computation.needs_masses:
            self.warn_of_masses()
        return computation

    def error_bounds(self, coordinates: Mapping[str, Any], options: FurtherOptions) -> dict[str, Float64Array]:
        """Return what `Mechanism.error_bounds` describes: by output (...), of frames' motion (..., frames)."""
        check_options("error_bounds", options, BOUNDS_OPTIONS)
        accepted = tuple(name for name in self.available(ALL_OUTPUTS) if OUTPUTS[name].has_bounds)
        asked = requested_outputs(
            options.get("outputs"), None, accepted, ROBOT_TASKS[motion_level(coordinates)].outputs
        )
        computation = self.computation(asked, self._frames_of(asked, options.get("frames")))
        computation.check_given(coordinates)
        if computation.needs_masses:
            self.check_masses()
        values = computation.read(coordinates, options.get("base_motion"), {})
        constants, request = computation.constants, computation.request
        constants.tree.plain()
        # Which constants fold is said by their errors here: one that is 0 may be 1e-17 in the exact robot.
        form = computation.form._replace(known=(None,) * len(computation.form.known))
        program = TreeForm(form, request._replace(known=(None,) * len(request.known))).compute
        numbers = numbers_with_bounds(constants, computation.frames)
        vector = read_gravity(options.get("gravity", DEFAULT_GRAVITY))
        known = {**computation.known, "gravity": vector, "constants": numbers}
        shown = 0 if request.single else len(request.shown_bodies)
        parts = {name: shown if name in FRAME_OUTPUTS else 0 for name in request.outputs}
        return output_bounds(program, values, computation.inputs, known, parts)

    def watch(self, outputs: Iterable[str], plain: bool = False) -> Watch | None:
        """Return what looks at the results of a call; None where nothing can be wrong with them."""
        watches = list[Watch]()
        if self.constants.may_be_singular and not {*outputs}.isdisjoint((*SOLVED, *DYNAMICS_MATRICES[3:])):
            watches.append(self._warn_where_singular)
        elif plain and self.tree.closure is not None:
            watches.append(self._warn_where_open)
        if plain and any(strut.law.limits for strut in self.tree.struts):
            watches.append(self._warn_beyond_strokes)

        def all_of_them(result: Any, arguments: Mapping[str, Any]) -> None:
            for one in watches:
                one(result, arguments)

        return all_of_them if len(watches) > 1 else next(iter(watches), None)

    def _computed(self, outputs: tuple[str, ...], **given: Any) -> Any:
        """Compute outputs from coordinates, for messages."""
        computation = self.computation(outputs)
        return computation.compute(given, execution_of("numpy", 1), DEFAULT_GRAVITY)

    def _warn_where_open(self, result: Any, arguments: Mapping[str, Any]) -> None:
        """Issue a DynamicsWarning that counts the samples at which the loops cannot be closed."""
        closure = self.tree.closure
        if closure is None or not _has_nan(result):
            return
        rows = self.tree.rows("q", arguments["q"])
        all_q, gaps = (self._computed((name,), q=rows) for name in ("q_all", "loop_gaps"))
        if (message := open_samples(closure, rows, all_q, gaps)) is not None:
            warn_of_dynamics(f"{self.tree.name}: {message}")

    def _warn_beyond_strokes(self, result: Any, arguments: Mapping[str, Any]) -> None:
        """Issue a DynamicsWarning for each strut that counts the samples at which it is beyond its stroke."""
        if not _has_nan(result):
            return
        lengths = self._computed(("strut_length",), q=self.tree.rows("q", arguments["q"]))
        for k, strut in enumerate(self.tree.struts):
            if (message := beyond_stroke(strut, lengths[..., k])) is not None:
                warn_of_dynamics(f"{self.tree.name}: {message}")

    def computation(
        self,
        outputs: tuple[str, ...],
        frames: str | tuple[str, ...] = (),
        pushed: tuple[str, ...] = (),
        joint_loads: bool = False,
    ) -> RobotComputation:
        """Return the computation of outputs, which is made once; wrenches act on the frames in `pushed`. Results of a
        single name have no axis of frames.
        """
        key = outputs, frames, pushed, joint_loads
        computations = self.cache.computations
        found: RobotComputation | None = computations.get(key)
        if found is None:
            constants, single = self.constants, isinstance(frames, str)
            named = ((frames,) if isinstance(frames, str) else frames), pushed
            shown_frames, pushed_frames = (
                tuple(self.tree.known_frame("frames", one) for one in group) for group in named
            )
            if not {*outputs}.isdisjoint(ROBOT_TASKS["joint_wrenches"].outputs):
                if self.tree.closure is not None:
                    expected = "one without loops; loop_wrenches has what closes them"
                    raise ArgumentError("robot", expected, "a closed mechanism")
                constants = self.whole_constants
            result = result_class(outputs, frames, constants)
            found = RobotComputation(constants, outputs, shown_frames, pushed_frames, result, joint_loads, single)
            found.asked = key
            computations[key] = found
        return found

    def available(self, outputs: tuple[str, ...]) -> tuple[str, ...]:
        """Return the outputs that exist for this base."""
        return outputs if self.base == "free" else tuple(name for name in outputs if name not in FREE_BASE_OUTPUTS)

    def _frames_of(self, outputs: tuple[str, ...], frames: str | Iterable[str] | None) -> str | tuple[str, ...]:
        """Return the argument `frames` of outputs, names or one name alone; () of outputs that have none. None stands
        for the last links of all branches; Jacobians alone need one.
        """
        if {*outputs}.isdisjoint(OF_FRAMES):
            return ()
        tips = self.tree.tips
        if frames is None and {*outputs}.isdisjoint(FRAME_OUTPUTS):
            if len(tips) != 1:
                expected = f"the name of a link or joint, such as {', '.join(tips[:4])}"
                raise ArgumentError("frames", expected, None)
            return tips[0]
        if isinstance(frames, str):
            return frames
        try:
            names = tips if frames is None else tuple(frames)
        except TypeError:
            names = ()
        if not names:
            raise ArgumentError("frames", "names of links or joints", quoted(frames))
        if len({*names}) < len(names):
            raise ArgumentError("frames", "each name once", quoted(names))
        return names

    def _base_loads(self, force1: ArrayLike, torque1: ArrayLike) -> Loads:
        """Return the loads on a free base that are not the number 0."""
        given = {"force1": force1, "torque1": torque1}
        loads = {name: (value, name) for name, value in given.items() if not is_zero(value)}
        if loads and self.base != "free":
            name = next(iter(loads))
            raise ArgumentError(name, "0: a fixed base is not moved by forces (base='free' is)", quoted(given[name]))
        return loads

    def check_masses(self, bodies: Collection[int] | None = None) -> None:
        """Refuse a body, of those with some numbers or all, whose mass was never given, and masses that overflow."""
        for number, link in self.tree.without_mass.items():
            if bodies is not None and number not in bodies:
                continue
            if number == 0 and self.base == "free":
                where = "body1 of the first pair"
            elif number > 0:
                where = f"body2 of {link!r}"
            else:
                continue
            body = where[:5]
            example = f"HingePair(..., {body}=hp.Body(mass=2.0)), or in a scene {body}.mass = 2.0 of its [[joint]]"
            if number == 0:
                example += (
                    "; base='fixed' of a simulation holds body 1, and hinge_wrench of a pair needs body 2 alone"
                )
            raise ArgumentError(where, f"mass properties, as in {example}", None)
        if self.constants.overflows:
            expected = "masses and lengths whose products mass x length^2 stay below 1.8e308 kg m^2"
            raise ArgumentError(f"robot {self.tree.name!r}", expected, "products that overflow")

    def warn_of_masses(self, bodies: Collection[int] | None = None) -> None:
        """Check the masses of bodies with some numbers, or of all; issue each DynamicsWarning on these at the first
        call for a robot.
        """
        cache, with_base = self.cache, self.base == "free" and (bodies is None or 0 in bodies)
        if bodies is None and with_base in cache.warned:
            return
        self.check_masses(bodies)
        if with_base not in cache.warned:
            said = self.tree.mass_notes(free=False) if cache.warned else []
            cache.warned |= {False, with_base}
            for note in self.tree.mass_notes(with_base):
                if note not in said:
                    warn_of_dynamics(f"{self.tree.name}: {note}")

    def counts_loads(self, joint_loads: bool | None) -> bool:
        """Return whether loads of joints act; the first call that leaves them out unasked warns."""
        if joint_loads not in (None, False, True):
            raise ArgumentError("joint_loads", "True or False", quoted(joint_loads))
        cache = self.cache
        if joint_loads is None and not cache.warned_of_loads:
            cache.warned_of_loads = True
            if note := loads_note(self.tree):
                warn_of_dynamics(
                    f"{self.tree.name}: {note}; joint_loads=True counts them, joint_loads=False is silent"
                )
        if joint_loads and self.tree.closure is not None:
            rubbing = [
                joint.name
                for joint in self.tree.joints
                if joint.load.friction and joint.name not in self.constants.names
            ]
            if rubbing:
                expected = "False, since dry friction acts at joints that are no coordinates of the closed mechanism"
                raise ArgumentError("joint_loads", expected, ", ".join(rubbing))
        return bool(joint_loads) and any(load_numbers(self.tree))

    def _warn_where_singular(self, result: Any, arguments: Mapping[str, Any]) -> None:
        """Issue a DynamicsWarning that names what no inertia resists, where accelerations are NaN for that."""
        q, arrays = arguments["q"], result.arrays()
        found = [array for name, array in arrays.items() if name in SOLVED and isinstance(array, np.ndarray)]
        # Where one derivative is NaN, all are.
        found += [array[..., 0] for name, array in arrays.items() if name.startswith("qdd_")][:1]
        bad = np.asarray(np.logical_or.reduce([np.isnan(array).any(axis=-1) for array in found] or [np.False_]))
        self.warn_where_singular(bad, q)

    def warn_where_singular(self, bad: Any, q: Any) -> None:
        """Issue a DynamicsWarning that names what no inertia resists at samples where accelerations are NaN."""
        if not bad.any():
            return
        names = ("pivots", "base_pivots") if self.base == "free" else ("pivots",)
        pivots = self._computed(names, q=q).arrays()
        constants = self.constants
        thresholds = {"pivots": constants.pivot_thresholds, "base_pivots": constants.base_pivot_thresholds}
        smallest = np.concatenate([thresholds[name] for name in names])
        values = np.concatenate([np.asarray(pivots[name]) for name in names], axis=-1)
        labels = (*(f"joint {name!r}" for name in constants.names), *["the base"] * 6)
        warn_of_pivots(self.tree.name, bad, values, smallest, labels)


def _has_nan(result: Any) -> bool:
    """Return whether a number of a result is NaN."""
    arrays = [result] if isinstance(result, np.ndarray) else result.arrays().values()
    return any(np.isnan(array).any() for array in arrays)


def count_operations(
    robot: RobotSubject,
    coordinates: tuple[Coordinates, ...],
    outputs: tuple[str, ...],
    frames: tuple[str, ...] = (),
    base_motion: BodyMotion | None = None,
) -> int:
    """Count the operations for each sample that outputs of `forward_kinematics` or `inverse_dynamics` take."""
    computation = robot.computation(outputs, frames)
    named = dict(zip(("q", "qd", "qdd"), coordinates, strict=False))
    return computation.count_operations(computation.read(named, base_motion, {}).values, DEFAULT_GRAVITY)
