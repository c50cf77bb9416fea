"""What is computed of robots, and the arguments that only robots have: the motion of the base, wrenches on links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final, TypeAlias

import numpy as np

from hingepair.engine.results import Results
from hingepair.equations.spatial import IDENTITY_MATRIX, ZERO_VECTOR
from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_inputs
from hingepair.mechanism.requests import PARTS_OF_LOOPS, ROBOT_TASKS
from hingepair.mechanism.robots.constants import (
    RobotConstants,
    axes_with_samples,
    frame_numbers,
    load_numbers,
    robot_constants,
    split_numbers,
)
from hingepair.mechanism.states import (
    JointResults,
    JointWrenches,
    MechanismState,
    with_names,
)
from hingepair.mechanism.tree import Frame, Tree
from hingepair.numeric.arrays import read_only
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.arguments import Arguments, read_arguments
from hingepair.plans.computation import Computation
from hingepair.plans.derivatives import body_constants
from hingepair.plans.trees import (
    BASE_LOADS,
    BASE_MOTION,
    COORDINATE_INPUTS,
    FRAME_OUTPUTS,
    OUTPUTS,
    TreeRequest,
    input_shapes,
    output_shape,
    request_loop,
)

BASE_LABELS: Final = {name: f"base_motion.{name[:-1]}" for name in BASE_MOTION}
"""Inputs of the base's motion as messages name them."""
RESTING_BASE: Final[Mapping[str, tuple[float, ...]]] = {
    **dict.fromkeys((*BASE_MOTION, *BASE_LOADS), ZERO_VECTOR),
    "S1": IDENTITY_MATRIX,
}
"""Inputs of a base that rests at the origin, without loads."""


Loads: TypeAlias = Mapping[str, tuple[Any, str]]
"""Forces and torques by input name: the value, and its name in messages."""


# Class of the result, by output; None: a bare array.
_RESULTS: Final = {
    **{name: task.result for task in ROBOT_TASKS.values() for name in task.outputs},
    **dict.fromkeys(FRAME_OUTPUTS, MechanismState),
}
ALL_OUTPUTS: Final = tuple(name for name in _RESULTS if name not in PARTS_OF_LOOPS)
PREPARED_ARGUMENTS: Final = (*COORDINATE_INPUTS, *BASE_MOTION, *BASE_LOADS)
"""Arguments that a prepared call can take."""


def result_class(
    outputs: tuple[str, ...], frames: str | tuple[str, ...], constants: RobotConstants
) -> type[Results] | None:
    """Return the class of a result with these outputs; None for a bare array. The first output decides."""
    kind = _RESULTS.get(outputs[0], Results)
    if kind is None:
        return Results if len(outputs) > 1 else None
    if kind is MechanismState:
        further = tuple(name for name in outputs if name not in FRAME_OUTPUTS)
        named = (frames,) if isinstance(frames, str) else frames
        own: Any = (
            ("frames", named),
            ("_robot_frames", constants.tree.frame_names),
            ("_single", named is not frames),
        )
        return with_names(kind, own, further)
    if issubclass(kind, JointResults):
        all_names = tuple(joint.name for joint in constants.tree.joints)
        own = (("names", all_names if kind is JointWrenches else constants.names),)
        return with_names(kind, own)  # type: ignore[arg-type]
    return kind if all(_RESULTS.get(name) is kind for name in outputs) else Results


def base_inputs(base_motion: BodyMotion | None, needed_inputs: Iterable[str]) -> dict[str, Any]:
    """Return by input name the arrays of a base's motion, at rest if a pose alone; refuse one that lacks any."""
    if base_motion is None:
        return {}
    if not isinstance(base_motion, BodyMotion):
        raise ArgumentError("base_motion", "a BodyMotion", quoted(base_motion))
    arrays = motion_inputs("base1", base_motion)
    at_rest = arrays.keys() <= {"R1", "S1"}
    for name in needed_inputs:
        if name in BASE_LABELS and name not in arrays and (name in {"R1", "S1"} or not at_rest):
            expected = f"a value, as in BodyMotion(..., {name[:-1]}=...): an output needs it"
            raise ArgumentError(BASE_LABELS[name], expected, None)
    return arrays


def read_wrenches(wrenches: Any, tree: Tree) -> tuple[Loads, tuple[str, ...]]:
    """Return the argument `wrenches` as loads force_0, torque_0, force_1, ..., and the names of the frames."""
    if wrenches is None:
        return {}, ()
    if not isinstance(wrenches, Mapping):
        raise ArgumentError("wrenches", "(force, torque) by the name of a link or frame", quoted(wrenches))
    loads = {}
    for k, (link, value) in enumerate(wrenches.items()):
        tree.known_frame("wrenches", link)
        if not isinstance(value, tuple | list) or len(value) != 2:
            raise ArgumentError(f"wrenches[{link!r}]", "a pair (force, torque)", quoted(value))
        for place, kind in enumerate(("force", "torque")):
            loads[f"{kind}_{k}"] = value[place], f"wrenches[{link!r}][{place}]"
    return loads, tuple(wrenches)


def moved_frames(constants: RobotConstants, frames: tuple[Frame, ...], behind: int = 0) -> dict[int, Any]:
    """Return, by place among the `frame_numbers` of frames, those that differ between samples; `behind` numbers stand
    before these.
    """
    found: dict[int, Any] = {}
    sampled = axes_with_samples(constants.tree, constants.axes)
    for k, frame in enumerate(frames):
        axes = sampled[frame.body]
        if frame.samples is not None or axes.ndim > 2:
            R, S = (frame.origin[..., None, :] @ axes)[..., 0, :], np.swapaxes(axes, -1, -2) @ frame.S
            columns = [*np.moveaxis(R, -1, 0), *np.moveaxis(S.reshape(*S.shape[:-2], 9), -1, 0)]
            found |= {behind + 12 * k + i: column for i, column in enumerate(columns) if np.ptp(column)}
    return found


class RobotComputation(Computation):
    """Outputs of a robot and of its frames.

    Args:
        constants: constants of the robot.
        outputs: names out of `plans.trees.OUTPUTS`.
        frames: frames whose motion is computed.
        pushed: frames on which wrenches act.
        result: class of the result; None to return the only output as a bare array.
        joint_loads: whether springs, dampers and dry friction act at the joints.
        single: whether results have no axis of frames.
    """

    def __init__(
        self,
        constants: RobotConstants,
        outputs: tuple[str, ...],
        frames: tuple[Frame, ...],
        pushed: tuple[Frame, ...] = (),
        result: type[Results] | None = None,
        joint_loads: bool = False,
        single: bool = False,
    ) -> None:
        self._arguments = outputs, frames, pushed, result, joint_loads, single
        shown_count, free, places = len(frames), constants.free, tuple(range(len(frames), len(frames) + len(pushed)))
        frames = (*frames, *pushed)
        numbers = frame_numbers(constants, frames)
        if joint_loads:
            numbers += load_numbers(constants.tree)
        samples, moved = constants.tree.samples, moved_frames(constants, frames)
        folded, parameters = split_numbers(numbers, moved)
        self.constants, self.frames, self.form = constants, frames, constants.form
        self.needs_masses = any(OUTPUTS[name].needs_masses for name in outputs)
        varied: dict[int, Any] = {}
        if samples is not None and (self.needs_masses or samples.lengths):
            behind = len(self.form.known)
            varied = {**constants.varied, **{behind + place: column for place, column in moved.items()}}
        bodies = tuple(frame.body for frame in frames)
        self.request = TreeRequest(
            outputs, free, bodies, folded, places, joint_loads, tuple(varied), shown_count, single
        )
        self.inputs = input_shapes(self.form, self.request)
        known: dict[str, Any] = {
            **RESTING_BASE,
            "constants": read_only(np.array([*constants.numbers, *parameters], dtype=np.float64)),
            "axes": tuple(np.ravel(constants.axes).tolist()),  # which fold where they are 0 or 1
        }
        if varied:
            known["samples"] = read_only(np.stack(np.broadcast_arrays(*varied.values()), axis=-1))
        super().__init__(
            lambda names, _: request_loop(self.form, self.request._replace(outputs=names)), outputs,
            {**{name: output_shape(name, self.form, self.request) for name in PREPARED_ARGUMENTS}, **self.inputs},
            known, result, constants.tree.coordinate_names,
            owner="robot" if samples is None else "lengths" if samples.lengths else "payload",
            shape=known["samples"].shape[:-1] if varied else (),
            constant_shapes=body_constants(len(self.form.parents), free),
        )  # fmt: skip

    @lock_free_cached_property
    def by_constants(self) -> RobotComputation:
        """The same computation with all mass counted with its own body, whose derivatives by constants are taken."""
        constants = robot_constants(self.constants.tree, self.constants.free, whole=True)
        return RobotComputation(constants, *self._arguments)

    def given(
        self, coordinates: Mapping[str, Any], base_motion: BodyMotion | None, loads: Loads
    ) -> tuple[dict[str, Any], dict[str, str]]:
        """Return arguments by input name, and their labels in messages.

        Args:
            coordinates: q, qd, qdd or tau by name.
            base_motion: motion of the base; None where it rests at the origin.
            loads: forces and torques by input name, each with its label.
        """
        base = base_inputs(base_motion, self.inputs)
        given = {**coordinates, **base, **{name: value for name, (value, _) in loads.items()}}
        return given, BASE_LABELS | {name: label for name, (_, label) in loads.items()}

    def read(self, coordinates: Mapping[str, Any], base_motion: BodyMotion | None, loads: Loads) -> Arguments:
        """Return checked arguments, as `given` takes them."""
        given, labels = self.given(coordinates, base_motion, loads)
        return read_arguments(given, self.shapes, self.coordinates, labels)
