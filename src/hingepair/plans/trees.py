"""What to compute of a tree of joints: which recursions (T1-T14) lead from coordinates to the outputs asked for.

The constants of a robot are one vector of numbers. Those that are 0, 1 or -1 are part of the program, which folds
them; all others are parameters, so that one program serves every robot of the same build and every payload.
"""

from __future__ import annotations

import copy
import functools
import itertools
import math
import operator
from collections import ChainMap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from hingepair.engine.binding import ArrayShape
from hingepair.engine.derivatives import Solution, jacobian, pushforward, variables
from hingepair.engine.loops import Loop
from hingepair.engine.trace import square_root, where_less
from hingepair.equations import trees as eq
from hingepair.equations.dynamics import factor_symmetric, solve_factored, solve_symmetric
from hingepair.equations.joints import Axis
from hingepair.equations.quantities import sample_shape
from hingepair.equations.spatial import (
    ZERO_VECTOR,
    Matrix,
    Scalar,
    Vector,
    add,
    cross,
    dot,
    matrix_from_columns,
    rotate,
    scale,
    subtract,
    transpose,
)
from hingepair.numeric.blocks import components
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.attitudes import rotation_defect
from hingepair.plans.changes import Moves, group_of, sum_of, with_variables
from hingepair.plans.closures import Chains, Closure, condition_count, placements
from hingepair.plans.struts import Strut, StrutForm, line_of_action

# Shapes of the constants of the base.
BASE_SHAPES: Final = {"mass": (), "first": (3,), "second": (6,)}
# Shapes of the constants of each joint.
JOINT_SHAPES: Final = {
    "S": (9,),
    "u": (3,),
    **BASE_SHAPES,
    "armature": (),
    "multiplier": (),
    "offset": (),
    "min_pivot": (),
}
PIVOT_SHAPES: Final = {"min_force_pivot": (), "min_torque_pivot": ()}  # of a free base; less is rounding
# Constants by which outputs can be differentiated: their names among those of a body or its joint, and their numbers.
BODY_CONSTANTS: Final = {
    "masses": ("mass", 1), "first_moments": ("first", 3), "inertias": ("second", 6), "lengths": ("u", 3)
}  # fmt: skip
FRAME_SHAPES: Final = {"R": (3,), "S": (9,)}  # of each frame, in the axes of its body
LOAD_SHAPES: Final = {"stiffness": (), "rest": (), "damping": (), "friction": ()}
"""Shapes of the constants of the load of each joint. The vector of constants holds those of the base, those of each
joint, the smallest pivots of the base, the numbers of loops (`Closure`) and of struts (`Strut`), those of each frame,
and those of loads where they are asked for, in the order of these five dictionaries."""


class Form(NamedTuple):
    """Structure of a robot; robots of equal form share programs. Tuples but `known` have an entry for each joint."""

    parents: tuple[int, ...]  # number of the body that carries it; 0 is the base
    axes: tuple[Axis, ...]
    columns: tuple[int, ...]  # its column in q; a mimic joint has the column of its leader
    # the constants of base and joints, and of loops, that are 0, 1 or -1; None for all others
    known: tuple[float | None, ...]
    closure: Closure | None = None  # its loops; None of a tree, whose coordinates are those of q
    struts: tuple[StrutForm, ...] = ()

    @property
    def tree_dof(self) -> int:
        """Number of coordinates of the tree."""
        return len(set(self.columns))

    @property
    def dof(self) -> int:
        """Number of coordinates in q."""
        return self.tree_dof if self.closure is None else len(self.closure.columns)

    @property
    def follows(self) -> bool:
        """Whether joints move by the coordinates of others: mimic joints, and those that loops close."""
        return self.dof < len(self.columns) or self.closure is not None


class TreeRequest(NamedTuple):
    """A request for outputs of a robot."""

    outputs: tuple[str, ...]  # names out of OUTPUTS
    free: bool  # whether forces move the base; otherwise its motion is given
    frames: tuple[int, ...] = ()  # for each frame, the number of its body
    # the constants of the frames and loads that are 0, 1 or -1; None for all others
    known: tuple[float | None, ...] = ()
    pushed: tuple[int, ...] = ()  # indices of the frames on which wrenches act, those of links
    joint_loads: bool = False  # whether springs, dampers and dry friction act at the joints (T14)
    varied: tuple[int, ...] = ()  # places of the constants that the input "samples" has
    shown_count: int | None = None  # how many frames, the first, have outputs; None: all
    single: bool = False  # whether a frame was asked for by its name: results then have no axis of frames

    @property
    def shown_bodies(self) -> tuple[int, ...]:
        """Bodies of the frames that have outputs."""
        return self.frames[: self.shown_count]


class TreeForm(NamedTuple):
    """What a loop of a robot computes."""

    form: Form
    request: TreeRequest

    def compute(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the outputs by name, each a scalar or a flat tuple of components, from the inputs by name, which may
        be scalars of any kind.
        """
        return TreeQuantities(self.form, self.request, values).outputs(self.request.outputs)


class Output(NamedTuple):
    """How an output of a robot is computed, and what distinguishes it."""

    inputs: tuple[str, ...]  # names of the inputs that it depends on, the constants apart
    compute: Callable[[TreeQuantities], Any]  # returns a scalar or a flat tuple of components
    needs_masses: bool = True
    of_frames: bool = False  # whether it has an axis of frames, unless one was named alone
    has_struts: bool = False  # whether forces of struts act in it
    has_loads: bool = False  # whether loads of joints (T14) act in it, where they are asked for
    has_bounds: bool = True  # whether `error_bounds` can follow it: derivatives need traced values


def velocity_count(form: Form, request: TreeRequest) -> int:
    """Return the number of velocities of a robot: one for each coordinate, and six more of a free base."""
    return form.dof + 6 * request.free


class TreeQuantities:
    """The quantities of a robot for one set of values, given a `Form`, a `TreeRequest` and the inputs by name.
    Quantities that several outputs need are properties, which are computed at first access and cached.

    Args:
        form: the robot's build.
        request: what is computed.
        values: by name: constants, q, qd, qdd, tau, gravity, the base's motion and its loads, wrenches; scalars of
            any kind, vectors as tuples.
    """

    def __init__(self, form: Form, request: TreeRequest, values: Mapping[str, Any]) -> None:
        self.form, self.request, self.values = form, request, values
        parts = iter(values.get("numbers") or complete_numbers(form, request, values))
        self.base = eq.Base(**_take_numbers(parts, BASE_SHAPES))
        joints = [_take_numbers(parts, JOINT_SHAPES) for _ in form.parents]
        self.ratios = [(joint.pop("multiplier"), joint.pop("offset")) for joint in joints]
        self.min_pivots = [joint.pop("min_pivot") for joint in joints]
        self.links = [
            eq.Link(parent, axis, **joint)
            for parent, axis, joint in zip(form.parents, form.axes, joints, strict=True)
        ]
        lowest = _take_numbers(parts, PIVOT_SHAPES)
        self.base_min_pivots = [lowest["min_force_pivot"]] * 3 + [lowest["min_torque_pivot"]] * 3
        self.chains = None
        if form.closure is not None:
            numbers = [next(parts) for _ in range(form.closure.size)]
            self.chains = Chains(form.closure, numbers, self.links, self.ratios, form.columns, values["q"])
        self.strut_list = [Strut.of_numbers(one, [next(parts) for _ in range(one.size)]) for one in form.struts]
        self.frames = [(body, _take_numbers(parts, FRAME_SHAPES)) for body in request.frames]
        self.shown_frames = self.frames[: request.shown_count]
        with_loads = form.parents if request.joint_loads else ()
        self.joint_load_list = [eq.JointLoad(**_take_numbers(parts, LOAD_SHAPES)) for _ in with_loads]
        if self.joint_load_list and "implicit_step" in values:
            # A damper of the rate at the end of the step, d (q' + h q''), resists like a rotor of the inertia h d.
            self.links = [
                link._replace(armature=link.armature + values["implicit_step"] * load.damping)
                for link, load in zip(self.links, self.joint_load_list, strict=True)
            ]

    def outputs(self, names: Iterable[str]) -> dict[str, Any]:
        """Return outputs by name, each a scalar or a flat tuple of components."""
        return {name: OUTPUTS[name].compute(self) for name in names}

    def flat(self, names: Iterable[str]) -> list[Scalar]:
        """Return the components of outputs one behind the other."""
        return [part for value in self.outputs(names).values() for part in components(value)]

    def with_values(self, **changed: Any) -> TreeQuantities:
        """Return the quantities for other values, except of the coordinates."""
        other: TreeQuantities = copy.copy(self)
        for name in self.__dict__:
            if isinstance(getattr(type(self), name, None), lock_free_cached_property):
                del other.__dict__[name]
        values: Any = self.values  # those of a pair are computed where they are read
        other.values = ChainMap(changed, values)
        return other

    @lock_free_cached_property
    def coasting(self) -> TreeQuantities:
        """The quantities for q'' = 0, and without acceleration of a free base."""
        base = dict.fromkeys(_BASE_ACCELERATIONS, ZERO_VECTOR) if self.request.free else {}
        return self.with_values(qdd=(0.0,) * self.form.dof, **base)

    @property
    def resting(self) -> TreeQuantities:
        """The quantities for a robot and a base that rest."""
        base = dict.fromkeys(("v1", "omega1", *_BASE_ACCELERATIONS), ZERO_VECTOR)
        return self.with_values(**dict.fromkeys(("qd", "qdd"), (0.0,) * self.form.dof), **base)

    # ---- coordinates of joints, and what acts along them

    @lock_free_cached_property
    def tree_q(self) -> Sequence[Scalar]:
        """Coordinates of the tree: those given, or those that close its loops."""
        return self.values["q"] if self.chains is None else self.chains.coordinates()

    @lock_free_cached_property
    def tree_qd(self) -> Sequence[Scalar]:
        """Rates of the tree's coordinates."""
        return self.values["qd"] if self.chains is None else self.chains.rates(self.values["qd"])

    @lock_free_cached_property
    def tree_qdd(self) -> Sequence[Scalar]:
        """Second derivatives of the tree's coordinates."""
        given = self.values["qdd"]
        return given if self.chains is None else self.chains.accelerations(self.values["qd"], given)

    def _values_by_joint(self, row: Sequence[Scalar]) -> list[Scalar]:
        """Return q, qd or qdd of each joint; a mimic joint has that of its leader, times the multiplier."""
        return [row[column] * ratio for column, (ratio, _) in zip(self.form.columns, self.ratios, strict=True)]

    @lock_free_cached_property
    def q(self) -> list[Scalar]:
        """List of the coordinates q of all joints."""
        pairs = zip(self._values_by_joint(self.tree_q), self.ratios, strict=True)
        return [value + offset for value, (_, offset) in pairs]

    @lock_free_cached_property
    def qd(self) -> list[Scalar]:
        """List of the rates q' of all joints."""
        return self._values_by_joint(self.tree_qd)

    @lock_free_cached_property
    def qdd(self) -> list[Scalar]:
        """List of the second derivatives q'' of all joints."""
        return self._values_by_joint(self.tree_qdd)

    @lock_free_cached_property
    def transfer(self) -> list[dict[int, Scalar]]:
        """For each joint the derivatives of its coordinate by those in q on which it depends, by their places: the
        multiplier of a mimic joint by its leader, and what loops make of it.
        """
        rows = [{k: 1.0} for k in range(self.form.tree_dof)] if self.chains is None else self.chains.transfer()
        columns = zip(self.form.columns, self.ratios, strict=True)
        return [{k: x * ratio for k, x in rows[column].items()} for column, (ratio, _) in columns]

    def efforts_by_coordinate(self, joint_efforts: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Return a tuple of efforts by coordinate from the efforts of all joints, which those that follow hand on."""
        sums: list[Scalar] = [0.0] * self.form.dof
        for row, effort in zip(self.transfer, joint_efforts, strict=True):
            for k, x in row.items():
                sums[k] = sums[k] + effort * x
        return tuple(sums)

    @lock_free_cached_property
    def placements(self) -> list[eq.Placement]:
        """List of the placements of the joints: the pose of each joint's body in the axes of its parent body."""
        return placements(self.links, self.q)

    # ---- kinematics

    @lock_free_cached_property
    def poses(self) -> list[eq.Pose]:
        """List of the poses of all bodies in world axes, the base first."""
        return eq.poses(self.links, self.placements, self.values["S1"])

    @lock_free_cached_property
    def velocities(self) -> list[eq.Rates]:
        """List of (v, omega) of all bodies, world axes, the base first."""
        base = self.values.get("v1", ZERO_VECTOR), self.values["omega1"]
        return eq.body_velocities(self.links, self.poses, self.qd, base)

    @lock_free_cached_property
    def accelerations(self) -> list[eq.Rates]:
        """List of (a, alpha) of all bodies, world axes, the base first."""
        base = self.values.get("a1", ZERO_VECTOR), self.values["alpha1"]
        return eq.body_accelerations(self.links, self.poses, self.qd, self.qdd, self.velocities, base)

    @lock_free_cached_property
    def frame_poses(self) -> list[eq.Pose]:
        """List of the poses of all frames in world axes, those with outputs first."""
        return [eq.frame_pose(self.poses[body], constants["R"], constants["S"]) for body, constants in self.frames]

    @property
    def shown_poses(self) -> list[eq.Pose]:
        """List of the poses of the frames with outputs, world axes."""
        return self.frame_poses[: self.request.shown_count]

    @lock_free_cached_property
    def frame_velocities(self) -> list[eq.Rates]:
        """List of (v, omega) of the frames with outputs, world axes."""
        bodies = (self.velocities[body] for body, _ in self.shown_frames)
        return [eq.frame_velocity(pose, body) for pose, body in zip(self.shown_poses, bodies, strict=True)]

    @lock_free_cached_property
    def frame_accelerations(self) -> list[eq.Rates]:
        """List of (a, alpha) of the frames with outputs, world axes."""
        return [
            eq.frame_acceleration(pose, self.velocities[body][1], self.accelerations[body])
            for pose, (body, _) in zip(self.shown_poses, self.shown_frames, strict=True)
        ]

    def frame_positions(self) -> tuple[Scalar, ...]:
        """Return the positions R of the frames with outputs, as one flat tuple."""
        return _chain_vectors(add(self.values["R1"], pose.d) for pose in self.shown_poses)

    def _jacobian_columns(
        self, joint_columns: Sequence[tuple[Vector, Vector]], base_columns: Sequence[tuple[Vector, Vector]]
    ) -> list[Any]:
        """Return the columns of a Jacobian: those of the base, then one for each coordinate."""
        entries = zip(*((*linear, *angular) for linear, angular in joint_columns), strict=True)
        sums = zip(*(self.efforts_by_coordinate(row) for row in entries), strict=True)
        return [*((*linear, *angular) for linear, angular in base_columns), *sums]

    def jacobian(self, in_frame: bool) -> tuple[Scalar, ...]:
        """Return the Jacobian of (v, omega) of all frames with respect to v1 and omega1 of a free base and to q', as
        a flat tuple row by row; (v, omega) in the axes of the frame if `in_frame`, else of the world.
        """
        entries: list[Scalar] = []
        for pose, (body, _) in zip(self.shown_poses, self.shown_frames, strict=True):
            columns = eq.point_jacobian_columns(self.links, self.poses, body, pose.d)
            on_base = eq.base_jacobian_columns(pose.d) if self.request.free else []
            if in_frame:
                columns, on_base = (
                    [(rotate(transpose(pose.S), v), rotate(transpose(pose.S), omega)) for v, omega in part]
                    for part in (columns, on_base)
                )
            entries += matrix_from_columns(*self._jacobian_columns(columns, on_base))
        return tuple(entries)

    def acceleration_bias(self) -> tuple[Scalar, ...]:
        """Return the accelerations (a, alpha) of all frames for q'' = 0, as one flat tuple. A free base is taken to
        have no acceleration; any other base has the given acceleration.
        """
        return _chain_vectors((*a, *alpha) for a, alpha in self.coasting.frame_accelerations)

    # ---- dynamics, base axes

    @lock_free_cached_property
    def base_axes(self) -> Matrix:
        """Rotation matrix that converts vectors from world axes to base axes."""
        return transpose(self.values["S1"])

    @lock_free_cached_property
    def motions_in_own_axes(self) -> list[eq.Acceleration]:
        """The motions of all bodies, the base first, each in the axes of the body, with a less gravity (T1)."""
        omega, alpha = (rotate(self.base_axes, self.values[name]) for name in ("omega1", "alpha1"))
        falling = rotate(self.base_axes, subtract(self.values["a1"], self.values["gravity"]))
        return eq.accelerations_in_own_axes(self.links, self.placements, self.qd, self.qdd, omega, alpha, falling)

    @lock_free_cached_property
    def transmitted_wrenches(self) -> list[eq.Wrench]:
        """List of the wrenches (force, torque) that the joints transmit, each in the axes of the joint's body about
        its reference point, with the total wrench on the base first (T2, T3).
        """
        wrenches = eq.inertial_wrenches(self.base, self.links, self.motions_in_own_axes)
        for k, place in enumerate(self.request.pushed):
            body, frame = self.frames[place]
            back = transpose(self.poses[body].S)
            force, torque = rotate(back, self.values[f"force_{k}"]), rotate(back, self.values[f"torque_{k}"])
            f, t = wrenches[body]
            wrenches[body] = subtract(f, force), subtract(t, add(torque, cross(frame["R"], force)))
        for strut, (length, along), rate in zip(self.strut_list, self.strut_lines, self.strut_rates, strict=True):
            push = scale(along, strut.force(length, rate))
            for (body, point), force in zip(strut.points(), (scale(push, -1.0), push), strict=True):
                own = rotate(transpose(self.poses[body].S), force)
                f, t = wrenches[body]
                wrenches[body] = subtract(f, own), subtract(t, cross(point, own))
        return eq.sum_inward(self.links, self.placements, wrenches)

    @lock_free_cached_property
    def joint_wrenches(self) -> list[eq.Wrench]:
        """List of what each joint's parent exerts on the joint's body, (force, torque) about the joint's point, world
        axes. It holds where the numbers of the bodies are their own, that is, where no matter counts with parents.
        """
        bodies = zip(self.poses[1:], self.transmitted_wrenches[1:], strict=True)
        return [(rotate(pose.S, force), rotate(pose.S, torque)) for pose, (force, torque) in bodies]

    @property
    def motor_efforts(self) -> list[Scalar]:
        """List of the efforts of all joints, those of springs, dampers and friction among them (T3, T10)."""
        return eq.driving_efforts(self.links, self.transmitted_wrenches, self.qdd)

    def efforts(self) -> tuple[Scalar, ...]:
        """Return a tuple of the efforts tau of all coordinates (inverse dynamics)."""
        efforts = self.motor_efforts
        if self.joint_load_list:
            rates = zip(self.joint_load_list, self.qd, strict=True)
            friction = [self._dry_friction(load.friction, 0.0, 0.0, rate) for load, rate in rates]
            parts = zip(efforts, self.spring_and_damper_efforts, friction, strict=True)
            efforts = [effort - smooth - dry for effort, smooth, dry in parts]
        return self.efforts_by_coordinate(efforts)

    def tree_efforts(self) -> tuple[Scalar, ...]:
        """Return the efforts along the coordinates of the tree that the given motion takes without loops."""
        sums: list[Scalar] = [0.0] * self.form.tree_dof
        for column, (ratio, _), effort in zip(self.form.columns, self.ratios, self.motor_efforts, strict=True):
            sums[column] = sums[column] + effort * ratio
        return tuple(sums)

    def balance(self) -> tuple[Scalar, ...]:
        """Return the forces by coordinate that the motion takes, with force1 and torque1 of a free base first, beside
        those of springs, dampers and friction.
        """
        on_base = (*self.base_wrench(0), *self.base_wrench(1)) if self.request.free else ()
        return (*on_base, *self.efforts_by_coordinate(self.motor_efforts))

    # ---- loads of joints

    @lock_free_cached_property
    def spring_and_damper_efforts(self) -> list[Scalar]:
        """List of the efforts of springs and dampers at all joints (T14); empty where loads are not asked for."""
        joints = zip(self.joint_load_list, self.q, self.qd, strict=True) if self.joint_load_list else ()
        return [eq.spring_and_damper_effort(load, q, qd) for load, q, qd in joints]

    def _dry_friction(self, most: Scalar, effort: Scalar, inertia: Scalar, rate: Scalar) -> Scalar:
        """Return the effort of dry friction, at most `most`, against a rate. Where that is 0, it takes up the effort
        of all else; in a step of a rollout, it stops the inertia within the step at most.
        """
        if type(most) is float and most == 0:
            return 0.0
        step = self.values.get("step")
        needed = -effort if step is None else -(effort + inertia * rate / step)
        held = where_less(needed, -most, -most, where_less(most, needed, most, needed))
        if step is not None:
            return held
        return where_less(rate, 0.0, most, where_less(0.0, rate, -most, held + rate))  # NaN stays NaN

    # ---- struts

    @lock_free_cached_property
    def strut_lines(self) -> list[tuple[Scalar, Vector]]:
        """List of the length of each strut and the unit vector along it, world axes."""
        ends = [
            [add(self.poses[body].d, rotate(self.poses[body].S, point)) for body, point in strut.points()]
            for strut in self.strut_list
        ]
        return [line_of_action(first, second) for first, second in ends]

    @lock_free_cached_property
    def strut_rates(self) -> list[Scalar]:
        """List of the rates of the lengths of all struts."""
        rates = []
        for strut, (_, along) in zip(self.strut_list, self.strut_lines, strict=True):
            velocities = []
            for body, point in strut.points():
                v, omega = self.velocities[body]
                velocities.append(add(v, cross(omega, rotate(self.poses[body].S, point))))
            rates.append(dot(along, subtract(velocities[1], velocities[0])))
        return rates

    def strut_forces(self) -> tuple[Scalar, ...]:
        """Return the forces of all struts."""
        parts = zip(self.strut_list, self.strut_lines, self.strut_rates, strict=True)
        return tuple(strut.force(length, rate) for strut, (length, _), rate in parts)

    # ---- derivatives, of traced values alone

    def time_rate(self, output: str) -> tuple[Scalar, ...]:
        """Return the time derivatives of the components of an output that depends on the pose."""
        turns = any(type(x) is not float or x for x in self.values["omega1"])  # S1 folds where the base does not turn
        attitude = [("S1", (3, 3))] if turns else []
        values, moves = with_variables(self.values, [("q", (self.form.dof,)), *attitude])
        changes = [*zip(values["qd"], moves["q"], strict=True)]
        changes += zip(values["omega1"], moves.get("S1", ()), strict=turns)
        moved = TreeQuantities(self.form, self.request, values)
        return tuple(pushforward(moved.flat((output,)), sum_of(changes)))

    def torque_regressor(self) -> tuple[Scalar, ...]:
        """Return the regressor Y in Y p = (force1, torque1, tau), the first two of a free base only, as a flat tuple
        row by row. p are mass, first moment and inertia of each body, in its own axes and about its reference point.
        """
        values = dict(self.values)
        tree = TreeForm(self.form, self.request)
        changes = changes_of_bodies(tree, values, ("masses", "first_moments", "inertias"))
        by_body = zip(
            changes["masses"], *(changes["first_moments"][k::3] for k in range(3)),
            *(changes["inertias"][k::6] for k in range(6)), strict=True,
        )  # fmt: skip
        names = group_of("tau", self.request.free)
        moved = TreeQuantities(self.form, self.request, values)
        return _chain_vectors(jacobian(moved.flat(names), [*itertools.chain(*by_body)]))

    def dynamics_matrix(self, name: str) -> tuple[Scalar, ...]:
        """Return a derivative of inverse or forward dynamics, such as tau_q, as a flat tuple row by row, with a row
        and a column for each velocity.
        """
        (of, _, by), free = name.partition("_"), self.request.free
        if by == "qdd":
            return self.mass_matrix()
        moved, moves = self.varied
        changes = [change for one in group_of(by, free) for change in moves[one]]
        return _chain_vectors(jacobian(moved.flat(group_of(of, free)), changes))

    @lock_free_cached_property
    def varied(self) -> tuple[TreeQuantities, Moves]:
        """The quantities for variables in the place of the arguments of dynamics, and how these change."""
        shapes = {"S1": (3, 3), **dict.fromkeys(("q", "qd", "tau"), (self.form.dof,))}
        arguments = [one for by in ("q", "qd", "tau") for one in group_of(by, self.request.free)]
        values, moves = with_variables(self.values, [(one, shapes.get(one, (3,))) for one in arguments])
        return TreeQuantities(self.form, self.request, values), moves

    def base_wrench(self, kind: int) -> Vector:
        """Return force1 (kind 0) or torque1 (kind 1), which acts on the base, world axes."""
        return rotate(self.values["S1"], self.transmitted_wrenches[0][kind])

    @lock_free_cached_property
    def composites(self) -> list[eq.Matter]:
        """List of the composite bodies, the base first, as tuples (mass, first, second): the mass and the first and
        second moments of mass. A composite body is a body with all bodies that it carries.
        """
        return eq.composites(self.base, self.links, self.placements)

    @lock_free_cached_property
    def mass_rows(self) -> list[list[Scalar]]:
        """List of the rows of the mass matrix M, each up to its diagonal entry. The six rows of a free base come
        first, then one row for each coordinate.
        """
        rows, on_base = eq.mass_matrix(self.links, self.placements, self.composites)
        shift = 6 * self.request.free
        sums: list[list[Scalar]] = [[0.0] * (shift + k + 1) for k in range(self.form.dof)]
        for i, (row, (force, torque)) in enumerate(zip(rows, on_base, strict=True)):
            S1 = self.values["S1"] if shift else None
            base = (*rotate(S1, force), *rotate(S1, torque)) if S1 is not None else ()
            for high, x in self.transfer[i].items():
                for k, part in enumerate(base):
                    sums[high][k] = sums[high][k] + part * x
            for j, entry in enumerate(row):
                for (k, x), (other, y) in itertools.product(self.transfer[i].items(), self.transfer[j].items()):
                    if i == j and k < other:  # the matrix is symmetric
                        continue
                    value = entry * x * y
                    low, high = sorted((k, other))
                    if j < i and low == high:  # entries of two joints that stand on the diagonal: both halves count
                        value = value + value
                    sums[high][shift + low] = sums[high][shift + low] + value
        return [*(eq.base_mass_rows(self.values["S1"], self.composites[0]) if shift else ()), *sums]

    def mass_matrix(self) -> tuple[Scalar, ...]:
        """Return all entries of the mass matrix M, as a flat tuple row by row."""
        rows = self.mass_rows
        size = range(len(rows))
        return tuple(rows[max(i, j)][min(i, j)] for i in size for j in size)

    # ---- forward dynamics

    @lock_free_cached_property
    def unforced(self) -> TreeQuantities:
        """The quantities for q'' = 0. Gravity acts on all bodies of a free robot alike: it is left out here, and
        added to the accelerations that are solved for.
        """
        return self.coasting.with_values(gravity=ZERO_VECTOR) if self.request.free else self.coasting

    @lock_free_cached_property
    def bias(self) -> list[Scalar]:
        """List of the efforts of all joints for which q'' = 0, beside those of springs and dampers."""
        bias = self.unforced.motor_efforts
        if not self.joint_load_list:
            return bias
        return [force - load for force, load in zip(bias, self.spring_and_damper_efforts, strict=True)]

    def _friction_of_joint(self, k: int, effort: Scalar, pivot: Scalar) -> Scalar:
        """Return the effort of dry friction at a joint; all else has this effort while the joint's parent rests."""
        return self._dry_friction(self.joint_load_list[k].friction, effort, pivot, self.qd[k])

    @lock_free_cached_property
    def articulated(self) -> tuple[list[eq.JointElimination], eq.SpatialInertia]:
        """Pair of the list of the eliminations of all joints and the articulated inertia of the base (T5)."""
        return eq.eliminate_joints(self.base, self.links, self.placements, _reciprocal)

    @property
    def articulated_base(self) -> tuple[Scalar, ...]:
        """Entries on and below the diagonal of the articulated inertia of the base, for (a, alpha) in base axes."""
        J, H, M = self.articulated[1]
        return (
            M[0], M[1], M[3], M[2], M[4], M[5],
            H[0], H[1], H[2], J[0], H[3], H[4], H[5], J[1], J[3], H[6], H[7], H[8], J[2], J[4], J[5],
        )  # fmt: skip

    @lock_free_cached_property
    def solved(self) -> tuple[tuple[Scalar, ...], ...]:
        """Solution of forward dynamics as three tuples: a1 and alpha1 of a free base in world axes, which are
        meaningless for any other base, and q''. All are NaN if M is singular.
        """
        a, *rest = self._solve_by_mass_matrix() if self.form.follows else self._solve_by_articulated_bodies()
        groups = (add(a, self.values["gravity"]), *rest)
        found = tuple(tuple(part + self.singular_doubt for part in group) for group in groups)
        return self._as_solution(*found) if self.request.free else (*found[:2], *self._as_solution(found[2]))

    def _as_solution(self, *found: tuple[Scalar, ...]) -> tuple[tuple[Scalar, ...], ...]:
        """Return accelerations as what their derivatives by T11 are taken of: they take back what a change of inputs
        adds to the torques, which takes fewer operations than to differentiate their recursion. Dry friction depends
        on what that finds for each joint.
        """
        if self.joint_load_list:
            return found
        names, loads = (group_of(kind, self.request.free) for kind in ("qdd", "tau"))
        places = [0, *itertools.accumulate(map(len, found))]

        def split(row: Sequence[Scalar]) -> tuple[tuple[Scalar, ...], ...]:
            return tuple(tuple(row[a:b]) for a, b in itertools.pairwise(places))

        def lack(unknowns: Sequence[Scalar]) -> list[Scalar]:
            moved = self.with_values(**dict(zip(names, split(unknowns), strict=True)))
            return [*map(operator.sub, _chain_vectors(self.values[one] for one in loads), moved.flat(loads))]

        def solve(b: Sequence[Scalar]) -> tuple[Scalar, ...]:
            return solve_factored(*self.factored, b[::-1])[::-1]

        return split(Solution(_chain_vectors(found), lack, solve, self.singular_doubt).unknowns)

    @lock_free_cached_property
    def factored(self) -> tuple[list[list[Scalar]], tuple[Scalar, ...]]:
        """L and the pivots D of M = L D L^T."""
        return factor_symmetric(self.mass_entries)

    def _solve_by_articulated_bodies(self) -> tuple[tuple[Scalar, ...], ...]:
        """Return (a1, alpha1, q'') by articulated bodies (T5), a1 less gravity."""
        steps, _ = self.articulated
        friction = self._friction_of_joint if self.joint_load_list else None
        loads = [
            self.values["tau"][column] - force for column, force in zip(self.form.columns, self.bias, strict=True)
        ]
        left, (force, torque) = eq.accelerations_by_loads(self.links, self.placements, steps, loads, friction)
        a = alpha = ZERO_VECTOR
        if self.request.free:
            f, t = self.unforced.transmitted_wrenches[0]
            values, back = self.values, self.base_axes
            on_base = (
                *subtract(rotate(back, values["force1"]), add(f, force)),
                *subtract(rotate(back, values["torque1"]), add(t, torque)),
            )
            accelerations, _ = solve_symmetric(self.articulated_base, on_base)
            a, alpha = accelerations[:3], accelerations[3:]
        qdd = eq.joint_accelerations(self.links, self.placements, steps, left, alpha, a)
        return rotate(self.values["S1"], a), rotate(self.values["S1"], alpha), tuple(qdd)

    @lock_free_cached_property
    def pivots(self) -> tuple[Scalar, ...]:
        """Tuple of the pivots of the factored mass matrix, one for each coordinate. At least one pivot is 0, up to
        rounding errors, if the matrix is singular.
        """
        if self.form.follows:
            return self.factored[1][::-1][6 * self.request.free :]
        return tuple(step.pivot for step in self.articulated[0])

    @lock_free_cached_property
    def base_pivots(self) -> tuple[Scalar, ...]:
        """Tuple of the six further pivots for (a1, alpha1) of a free base, each divided by the growth of rounding
        errors up to it; empty for any other base.
        """
        if not self.request.free:
            return ()
        lower, pivots = self.factored if self.form.follows else factor_symmetric(self.articulated_base)
        growths: list[Scalar] = []
        for row in lower:  # a pivot has the errors of those before it, times the squares of the entries of L
            growth: Scalar = 1.0
            for entry, before in zip(row, growths, strict=True):
                growth = growth + entry * entry * before
            growths.append(growth)
        ratios = [pivot / growth for pivot, growth in zip(pivots, growths, strict=True)][-6:]
        return tuple(ratios[::-1] if self.form.follows else ratios)

    @lock_free_cached_property
    def singular_doubt(self) -> Scalar:
        """NaN where a pivot of the mass matrix is not larger than its rounding error, or where a step of a rollout
        leads to a dead point, else 0.
        """
        limits: list[Scalar] = [0.0] * self.form.dof
        for row, limit in zip(self.transfer, self.min_pivots, strict=True):
            for k, x in row.items():
                limits[k] = limits[k] + limit * x * x
        pivots = self.pivots
        if self.request.free and any(type(limit) is not float or limit for limit in self.base_min_pivots):
            limits, pivots = [*limits, *self.base_min_pivots], (*pivots, *self.base_pivots)
        doubt: Scalar = 0.0
        if self.chains is not None and "step" in self.values:
            doubt = self.chains.crossing(self.values["qd"], self.values["step"])
        for limit, pivot in zip(limits, pivots, strict=True):
            if not (type(limit) is float and limit == 0):
                doubt = doubt + where_less(limit * limit, pivot * pivot, 0.0, math.nan)
        return doubt

    def _solve_by_mass_matrix(self) -> tuple[tuple[Scalar, ...], ...]:
        """Return (a1, alpha1, q'') by factoring M, a1 less gravity.

        M is eliminated from the tips inward, where entries between branches are zero.
        """
        values, shift = self.values, 6 * self.request.free
        pairs = zip(values["tau"], self.efforts_by_coordinate(self.bias), strict=True)
        loads = [load - force for load, force in pairs]
        if self.joint_load_list:
            loads = self._with_friction(loads)
        if shift:
            f, t = (self.unforced.base_wrench(kind) for kind in (0, 1))
            loads = [*subtract(values["force1"], f), *subtract(values["torque1"], t), *loads]
        accelerations = solve_symmetric(self.mass_entries, tuple(loads[::-1]))[0][::-1]
        a, alpha = (accelerations[:3], accelerations[3:6]) if shift else (ZERO_VECTOR, ZERO_VECTOR)
        return a, alpha, accelerations[shift:]

    def _with_friction(self, loads: Sequence[Scalar]) -> list[Scalar]:
        """Return the loads of all coordinates with dry friction, which takes the other coordinates as at rest."""
        most: list[Scalar] = [0.0] * self.form.tree_dof
        for column, (ratio, _), load in zip(self.form.columns, self.ratios, self.joint_load_list, strict=True):
            size = abs(ratio) if isinstance(ratio, float) else square_root(ratio * ratio)
            most[column] = most[column] + load.friction * size
        if self.chains is not None:  # joints that are no coordinates have no friction
            most = [most[column] if column is not None else 0.0 for column in self.chains.closure.columns]
        inertias = [row[-1] for row in self.mass_rows[6 * self.request.free :]]
        by_coordinate = zip(most, loads, inertias, self.values["qd"], strict=True)
        return [load + self._dry_friction(most, load, inertia, rate) for most, load, inertia, rate in by_coordinate]

    @property
    def mass_entries(self) -> tuple[Scalar, ...]:
        """Entries on and below the diagonal of M, row by row, with the last coordinate first: then entries between
        branches stay zero while M is factored.
        """
        rows = self.mass_rows
        order = range(len(rows) - 1, -1, -1)
        return tuple(rows[max(i, j)][min(i, j)] for i in order for j in order if j >= i)

    # ---- centre of mass, energy, momentum

    @lock_free_cached_property
    def centre_from_base(self) -> Vector:
        """Vector from the base's reference point to the centre of mass, world axes."""
        return scale(rotate(self.values["S1"], self.composites[0].first), _reciprocal(self.composites[0].mass))

    def centre_of_mass(self) -> Vector:
        """Return the position of the centre of mass of the robot."""
        return add(self.values["R1"], self.centre_from_base)

    def centre_of_mass_jacobian(self) -> tuple[Scalar, ...]:
        """Return the Jacobian of the velocity of the robot's centre of mass with respect to v1 and omega1 of a free
        base and to q', as a flat tuple row by row (three rows).
        """
        share = _reciprocal(self.composites[0].mass)
        linear = self.centroidal_momentum_matrix()[: 3 * velocity_count(self.form, self.request)]
        return tuple(x * share for x in linear)

    def centroidal_momentum_matrix(self) -> tuple[Scalar, ...]:
        """Return the matrix A of (linear momentum, angular momentum about the centre of mass) = A (v1, omega1, q'),
        the first two of a free base only, as a flat tuple row by row.
        """
        centre, matter = self.centre_from_base, self.composites
        on_base = eq.base_momentum_columns(self.values["S1"], matter[0], centre) if self.request.free else ()
        of_joints = eq.momentum_columns(self.links, self.poses, matter, centre)
        return matrix_from_columns(*self._jacobian_columns(of_joints, on_base))

    @lock_free_cached_property
    def velocities_in_own_axes(self) -> list[eq.Rates]:
        """List of the pairs (v, omega) of all bodies, the base first, each in the axes of the body."""
        v, omega = (rotate(self.base_axes, self.values[name]) for name in ("v1", "omega1"))
        return eq.velocities_in_own_axes(self.links, self.placements, self.qd, v, omega)

    @lock_free_cached_property
    def momenta(self) -> list[eq.Wrench]:
        """List of the pairs (P, L), linear and angular momentum, of all bodies, the base first. L is about the
        reference point of the body, and both are in the axes of the body.
        """
        return eq.body_momenta(self.base, self.links, self.velocities_in_own_axes)

    def kinetic(self) -> Scalar:
        """Return the kinetic energy of the robot [J]."""
        return eq.kinetic_energy(self.links, self.velocities_in_own_axes, self.momenta, self.qd)

    def potential(self) -> Scalar:
        """Return the potential energy of the robot [J], with that of struts. That of weight is zero if the centre of
        mass is at the world's origin.
        """
        mass, first, _ = self.composites[0]
        energy = -dot(self.values["gravity"], add(scale(self.values["R1"], mass), rotate(self.values["S1"], first)))
        for strut, (length, _) in zip(self.strut_list, self.strut_lines, strict=True):
            energy = energy + strut.potential(length)
        return energy

    @lock_free_cached_property
    def momentum(self) -> eq.Wrench:
        """Pair (P, L) of the linear momentum of the robot and its angular momentum about the base's reference point,
        both in world axes.
        """
        P, L = eq.sum_inward(self.links, self.placements, self.momenta)[0]
        return rotate(self.values["S1"], P), rotate(self.values["S1"], L)

    def angular_momentum_about(self, offset: Vector) -> Vector:
        """Return the angular momentum of the robot about a point, in world axes. The vector `offset` leads from this
        point to the base's reference point.
        """
        P, L = self.momentum
        return add(L, cross(offset, P))


def _reciprocal(x: Scalar) -> Scalar:
    """Return 1 / x; for a number x that is known to be 0, return infinity."""
    return math.inf if type(x) is float and x == 0 else 1.0 / x


def complete_numbers(form: Form, request: TreeRequest, values: Mapping[str, Any]) -> list[Scalar]:
    """Return all constants of a robot and its frames in order: known ones, parameters, and those of samples."""
    left = iter(values["constants"])
    numbers = [next(left) if known is None else known for known in (*form.known, *request.known)]
    for place, number in zip(request.varied, values["samples"] if request.varied else (), strict=True):
        numbers[place] = number
    return numbers


def constant_place(body: int, name: str) -> int:
    """Return where the first number of a constant of a body, or of its joint, stands among all constants.

    >>> constant_place(0, "first"), constant_place(1, "S")
    (1, 10)
    """
    sizes = {name: math.prod(tail) for name, tail in JOINT_SHAPES.items()}
    names = [*(JOINT_SHAPES if body else BASE_SHAPES)]
    base = sum(sizes[one] for one in BASE_SHAPES)
    start = base + (body - 1) * sum(sizes.values()) if body else 0
    return start + sum(sizes[one] for one in names[: names.index(name)])


def changes_of_bodies(tree: TreeForm, values: dict[str, Any], names: Iterable[str]) -> Moves:
    """Return changes from 0 of constants with these names, in the axes of the bodies; put all constants, with these
    changes, among the values as "numbers".
    """
    form, request = tree
    numbers = complete_numbers(form, request, values)
    axes = [values["axes"][k : k + 9] for k in range(0, len(values["axes"]), 9)]
    moves = Moves()
    for name in BODY_CONSTANTS.keys() & {*names}:
        constant, size = BODY_CONSTANTS[name]
        moves[name] = []
        for k in range(1 - (request.free and name != "lengths"), len(axes)):
            change = variables((0.0,) * size)
            moves[name] += [[(x, 1.0)] for x in change]
            back = transpose(axes[form.parents[k - 1] if name == "lengths" else k])
            moved: Any = change
            if size == 3:
                moved = rotate(back, moved)
            elif size == 6:  # an inertia J in Pinocchio's order; the second moment is tr(J)/2 - J
                xx, xy, yy, xz, yz, zz = change
                half = 0.5 * (xx + yy + zz)
                moved = eq.conjugate(back, (half - xx, -xy, -xz, half - yy, -yz, half - zz))
            place = constant_place(k, constant)
            for at, x in enumerate(moved, place):
                numbers[at] = numbers[at] + x
    values["numbers"] = numbers
    return moves


def _take_numbers(numbers: Any, shapes: Mapping[str, ArrayShape]) -> dict[str, Any]:
    """Return the next numbers by name, a tuple for each shape but ()."""
    return {
        name: tuple(next(numbers) for _ in range(shape[0])) if shape else next(numbers)
        for name, shape in shapes.items()
    }


def _chain_vectors(vectors: Iterable[Sequence[Scalar]]) -> tuple[Scalar, ...]:
    """Return the components of all vectors as one flat tuple."""
    return tuple(part for vector in vectors for part in vector)


def axes_shape(form: Form) -> ArrayShape:
    """Return the shape of the rotations from the program's axes to each body's own."""
    return (9 * (len(form.parents) + 1),)


def output_shape(name: str, form: Form, request: TreeRequest) -> ArrayShape:
    """Return the shape of one sample of an output."""
    sizes = {"coordinates": form.dof, "velocities": velocity_count(form, request), "joints": len(form.parents)}
    sizes |= {"tree": form.tree_dof, "conditions": 0 if form.closure is None else condition_count(form.closure)}
    sizes |= {"struts": len(form.struts), "loops": 0 if form.closure is None else len(form.closure.loops)}
    sizes["parameters"] = 10 * (len(form.parents) + request.free)  # of the torque regressor
    shape = sample_shape(name, sizes)
    return (len(request.shown_bodies), *shape) if name in OF_FRAMES and not request.single else shape


JACOBIANS: Final = ("jacobian", "jacobian_in_frame", "jacobian_rate", "jacobian_in_frame_rate")
"""Jacobians of frames, and their rates."""
DYNAMICS_MATRICES: Final = ("tau_q", "tau_qd", "tau_qdd", "qdd_q", "qdd_qd", "qdd_tau")
"""Derivatives of inverse and of forward dynamics."""
# Inputs that poses, rates, accelerations, inverse and forward dynamics depend on.
_POSE_INPUTS: Final = ("q", "S1")
_RATE_INPUTS: Final = (*_POSE_INPUTS, "qd", "omega1")
_BASE_ACCELERATIONS: Final = ("a1", "alpha1")  # accelerations of a base that moves as given
_ACCELERATION_INPUTS: Final = (*_RATE_INPUTS, "qdd", "alpha1")
_INVERSE_INPUTS: Final = (*_ACCELERATION_INPUTS, "a1", "gravity")
_FORWARD_INPUTS: Final = (*_RATE_INPUTS, *_BASE_ACCELERATIONS, "tau", "gravity", "force1", "torque1")

# Outputs that need no masses, those of frames among them; outputs in which struts, and loads of joints, too, act.
_kinematic: Final = functools.partial(Output, needs_masses=False)
_of_frames: Final = functools.partial(_kinematic, of_frames=True)
_weighted: Final = functools.partial(Output, has_struts=True)
_loaded: Final = functools.partial(_weighted, has_loads=True)

_MOTION: Final = {
    "R": _of_frames((*_POSE_INPUTS, "R1"), TreeQuantities.frame_positions),
    "S": _of_frames(_POSE_INPUTS, lambda c: _chain_vectors(pose.S for pose in c.shown_poses)),
    "d": _of_frames(_POSE_INPUTS, lambda c: _chain_vectors(pose.d for pose in c.shown_poses)),
    "v": _of_frames((*_RATE_INPUTS, "v1"), lambda c: _chain_vectors(v for v, _ in c.frame_velocities)),
    "omega": _of_frames(_RATE_INPUTS, lambda c: _chain_vectors(omega for _, omega in c.frame_velocities)),
    "a": _of_frames((*_ACCELERATION_INPUTS, "a1"), lambda c: _chain_vectors(a for a, _ in c.frame_accelerations)),
    "alpha": _of_frames(_ACCELERATION_INPUTS, lambda c: _chain_vectors(alpha for _, alpha in c.frame_accelerations)),
}
OUTPUTS: Final[Mapping[str, Output]] = {
    **_MOTION,
    "jacobian": _of_frames(_POSE_INPUTS, lambda c: c.jacobian(False)),
    "jacobian_in_frame": _of_frames(_POSE_INPUTS, lambda c: c.jacobian(True)),
    "acceleration_bias": _of_frames((*_RATE_INPUTS, *_BASE_ACCELERATIONS), TreeQuantities.acceleration_bias),
    "tau": _loaded(_INVERSE_INPUTS, TreeQuantities.efforts),
    "force1": _weighted(_INVERSE_INPUTS, lambda c: c.base_wrench(0)),
    "torque1": _weighted(_INVERSE_INPUTS, lambda c: c.base_wrench(1)),
    "force": _weighted(_INVERSE_INPUTS, lambda c: _chain_vectors(f for f, _ in c.joint_wrenches), has_bounds=False),
    "torque": _weighted(_INVERSE_INPUTS, lambda c: _chain_vectors(t for _, t in c.joint_wrenches), has_bounds=False),
    "torque_regressor": _kinematic((*_INVERSE_INPUTS, "axes"), TreeQuantities.torque_regressor, has_bounds=False),
    "mass_matrix": Output(_POSE_INPUTS, TreeQuantities.mass_matrix),
    "bias_forces": _weighted((*_RATE_INPUTS, *_BASE_ACCELERATIONS, "gravity"), lambda c: c.coasting.balance()),
    "gravity_forces": _weighted((*_POSE_INPUTS, "gravity"), lambda c: c.resting.balance()),
    "qdd": _loaded(_FORWARD_INPUTS, lambda c: c.solved[2], has_bounds=False),
    "a1": _loaded(_FORWARD_INPUTS, lambda c: c.solved[0], has_bounds=False),
    "alpha1": _loaded(_FORWARD_INPUTS, lambda c: c.solved[1], has_bounds=False),
    "pivots": Output(_POSE_INPUTS, lambda c: c.pivots),
    "base_pivots": Output(_POSE_INPUTS, lambda c: c.base_pivots),
    "centre_of_mass": Output((*_POSE_INPUTS, "R1"), TreeQuantities.centre_of_mass),
    "centre_of_mass_jacobian": Output(_POSE_INPUTS, TreeQuantities.centre_of_mass_jacobian),
    "centroidal_momentum_matrix": Output(_POSE_INPUTS, TreeQuantities.centroidal_momentum_matrix),
    "kinetic": Output((*_RATE_INPUTS, "v1"), TreeQuantities.kinetic),
    "potential": Output((*_POSE_INPUTS, "R1", "gravity"), TreeQuantities.potential),
    "linear": Output((*_RATE_INPUTS, "v1"), lambda c: c.momentum[0]),
    "angular_about_origin": Output((*_RATE_INPUTS, "v1", "R1"), lambda c: c.angular_momentum_about(c.values["R1"])),
    "angular_about_centre": Output(
        (*_RATE_INPUTS, "v1"), lambda c: c.angular_momentum_about(scale(c.centre_from_base, -1.0))
    ),
    "q_all": _kinematic(("q",), lambda c: tuple(c.tree_q)),
    "qd_all": _kinematic(("q", "qd"), lambda c: tuple(c.tree_qd)),
    "qdd_all": _kinematic(("q", "qd", "qdd"), lambda c: tuple(c.tree_qdd)),
    "tree_tau": _weighted(_INVERSE_INPUTS, TreeQuantities.tree_efforts),
    "loop_wrenches": _kinematic(_POSE_INPUTS, lambda c: () if c.chains is None else c.chains.wrenches(c.poses)),
    "loop_gaps": _kinematic(("q",), lambda c: () if c.chains is None else c.chains.gaps()),
    "loop_jacobian": _kinematic(("q",), lambda c: () if c.chains is None else c.chains.loop_jacobian()),
    "strut_length": _kinematic(_POSE_INPUTS, lambda c: tuple(length for length, _ in c.strut_lines)),
    "strut_rate": _kinematic(_RATE_INPUTS, lambda c: tuple(c.strut_rates)),
    "strut_force": _kinematic(_RATE_INPUTS, TreeQuantities.strut_forces),
    **{
        f"{name}_rate": Output(
            _RATE_INPUTS, functools.partial(TreeQuantities.time_rate, output=name), has_bounds=False,
            needs_masses=name not in JACOBIANS, of_frames=name in JACOBIANS,
        )
        for name in (*JACOBIANS[:2], "centroidal_momentum_matrix")
    },
    **{
        name: _loaded(
            _INVERSE_INPUTS if name.startswith("tau") else _FORWARD_INPUTS,
            functools.partial(TreeQuantities.dynamics_matrix, name=name), has_bounds=False,
        )
        for name in DYNAMICS_MATRICES
    },
    "S1_check": _kinematic(("S1",), lambda c: rotation_defect(c.values["S1"])),
}  # fmt: skip
"""All that can be computed of a tree, by name."""
FRAME_OUTPUTS: Final = tuple(_MOTION)
"""Motion of frames."""
OF_FRAMES: Final = frozenset(name for name, output in OUTPUTS.items() if output.of_frames)
"""What is computed of frames."""

COORDINATE_INPUTS: Final = ("q", "qd", "qdd", "tau")  # inputs with a component for each coordinate
BASE_MOTION: Final = ("R1", "S1", "v1", "omega1", "a1", "alpha1")  # inputs; a1, alpha1 of one that is not free
BASE_LOADS: Final = ("force1", "torque1")  # inputs of a free base


@functools.lru_cache(maxsize=512)
def input_shapes(form: Form, request: TreeRequest) -> dict[str, ArrayShape]:
    """Return the shape of one sample of each input that a request needs, by name, "constants" first. The dictionary
    is cached and must not be changed.
    """
    names = set()
    for output in request.outputs:
        inputs = OUTPUTS[output].inputs
        # A free base accelerates as forces have it, unless the accelerations of the joints are given, too.
        names |= {*inputs} - {*(_BASE_ACCELERATIONS if request.free and "qdd" not in inputs else ())}
    shapes: dict[str, ArrayShape] = {"constants": (sum(known is None for known in (*form.known, *request.known)),)}
    if "axes" in names:
        shapes["axes"] = axes_shape(form)
    if request.varied:
        shapes["samples"] = (len(request.varied),)
    for name in (*COORDINATE_INPUTS, "gravity", *BASE_MOTION, *BASE_LOADS):
        if name in names:
            shapes[name] = output_shape(name, form, request)
    return shapes | {f"{kind}_{k}": (3,) for k in range(len(request.pushed)) for kind in ("force", "torque")}


@functools.lru_cache(maxsize=512)
def request_loop(form: Form, request: TreeRequest) -> Loop:
    """Return the `Loop` that computes a request over samples, cached by form and request."""
    outputs = {name: output_shape(name, form, request) for name in request.outputs}
    tree = TreeForm(form, request)
    return Loop("robot", tree.compute, input_shapes(form, request), outputs, form=tree)
