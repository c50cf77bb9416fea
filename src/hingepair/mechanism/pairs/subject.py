"""What is asked of pairs: their computations, and the calls of methods and of `prepare`."""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.loops import Loop
from hingepair.engine.results import Results, writable_arrays
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.mechanism.bodies.body_motion import MOTION_SHAPES, BodyMotion, motion_inputs
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.geometry import (
    IDENTITY,
    Bodies,
    Points,
    frame_origins,
    joined,
    lifted,
    tree_of_arrays,
)
from hingepair.mechanism.requests import (
    LOAD_ARGUMENTS,
    PAIR_TASKS,
    ROWS,
    STATES,
    MethodCall,
    PreparedCall,
    Subject,
    Task,
    Watch,
    ask,
    coordinate_rows,
    motion_level,
    read_gravity,
    subject_of,
)
from hingepair.mechanism.robots.computations import moved_frames
from hingepair.mechanism.robots.constants import (
    RobotConstants,
    frame_numbers,
    numbers_with_bounds,
    program_numbers,
)
from hingepair.mechanism.robots.subject import RobotSubject
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import Float64Array, broadcast_shape, read_only
from hingepair.numeric.blocks import Components, numbers
from hingepair.numeric.bounded import UNIT_ROUNDOFF, Bounded, in_last_places
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.numeric.unit_vectors import least_axis
from hingepair.plans.arguments import Arguments, CoordinateNames, Outputs, read_arguments, requested_outputs
from hingepair.plans.bounds import Known, output_bounds
from hingepair.plans.computation import QUATERNION_INPUTS, Computation
from hingepair.plans.constraints import CONSTRAINTS
from hingepair.plans.geometry import GEOMETRY_SHAPES, Geometry
from hingepair.plans.pairs import (
    APPLIED_LOADS,
    NO_MASSES,
    PLANE,
    SPACE,
    PairKind,
    PairRequest,
    Point,
    pair_loop,
    point_outputs,
    point_shapes,
    tree_parameters,
)
from hingepair.rotations.sequences import find_sequence

COORDINATE_NAMES: Final = {kind: CoordinateNames(kind.coordinates, kind.columns) for kind in (SPACE, PLANE)}
"""Names of the coordinates."""
INPUT_LABELS: Final = {f"{letter}{k}": f"body{k}.{letter}" for k in "12" for letter in MOTION_SHAPES}
"""Names of the arrays of bodies in messages, by input."""
_INPUTS: Final = {  # that a prepared call can take
    SPACE: (
        *(*ROWS, "psi", "psid", "psidd", "R1", "S1", "v1", "omega1", "a1", "alpha1"),
        *("R2", "S2", "v2", "omega2", "a2", "alpha2", *QUATERNION_INPUTS, *APPLIED_LOADS),
    ),
    PLANE: ROWS,
}
_LETTERS: Final = {  # of the arrays of body 1 that tasks take
    task: tuple(name[:-1] for name in row.given if name in INPUT_LABELS) for task, row in PAIR_TASKS[SPACE].items()
}
# Outputs for which body 1 needs no mass.
_OF_BODY2: Final = {"hinge_force", "hinge_moment", "hinge_torque", "bearing_torque", "kinetic", "potential"}
_AXES: Final = ("e1", "e2", "e1_in_2", "e2_in_2", "n_in_2")
_UPRIGHT: Final = read_only(np.array([0.0, 0.0, 1.0]))  # n of planar pairs


class TreeNumbers(NamedTuple):
    """The constants of a pair's tree and of its frames, in the order of `plans.trees`."""

    numbers: tuple[float, ...]  # those of the first pair, if there are several
    varied: tuple[int, ...]  # places of those that differ from sample to sample
    samples: Float64Array | None  # these, shape (..., len(varied)); None if there are none


class PairSubject(Subject):
    """What is asked of a pair, and its computations, which are made once.

    Args:
        name: name of the pair.
        kind: in space or in the plane.
        arrays: u1 and u2 [m]; in space also n, of unit length, and home.
        axis: hinge axis as it was given, of any length; None for a planar pair.
        points: points of body 1 and of body 2 by name, from the reference point of the body, its axes [m]; checked.
        bodies: mass properties of body 1 and of body 2.

    Raises:
        ArgumentError: a point stands twice.
        ShapeError: leading axes do not broadcast.
    """

    def __init__(
        self,
        name: str,
        kind: PairKind,
        arrays: Mapping[str, NDArray[np.float64]],
        axis: NDArray[np.float64] | None,
        points: tuple[Points, Points],
        bodies: Bodies,
    ) -> None:
        super().__init__()
        self.name, self.kind, self.arrays, self.axis, self.bodies = name, kind, arrays, axis, bodies
        self.tasks, self.inputs = PAIR_TASKS[kind], _INPUTS[kind]
        for one in points[1]:
            if one in points[0]:
                raise ArgumentError("points2", "names that points1 does not have", quoted(one))
        self.points = tuple(Point(one, body) for body, group in enumerate(points, 1) for one in group)
        self.positions = (*points[0].values(), *points[1].values())
        places = {**arrays, **points[0], **points[1]}
        self.shape = broadcast_shape(  # leading shape of the pair; () for a single pair
            {one: array.shape[: -2 if one == "home" else -1] for one, array in places.items()}
        )
        self._given = name, kind, arrays, axis, tuple(map(dict, points)), bodies

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._given

    @property
    def single(self) -> bool:
        """Whether this is a single pair, without leading axes."""
        return self.shape == ()

    @property
    def has_home(self) -> bool:
        """Whether home differs from the identity."""
        return "home" in self.arrays and not (self.arrays["home"] == IDENTITY).all()

    @property
    def levels(self) -> Mapping[str, int | None]:
        """The outputs of kinematics, those of points too; the level from which it is a default output, or None."""
        return {**self.kind.levels, **dict.fromkeys(point_outputs(self.points))} if self.points else self.kind.levels

    @property
    def shapes(self) -> Mapping[str, tuple[int, ...]]:
        """Shape of one sample of all that can be given or computed."""
        return (
            {**self.kind.shapes, **point_shapes(self.points, self.kind.planar)} if self.points else self.kind.shapes
        )

    # ---- the pair as a robot

    @lock_free_cached_property
    def in_space(self) -> dict[str, Float64Array]:
        """u1, u2, n and home of the pair in space."""
        return {"n": _UPRIGHT, "home": IDENTITY, **{name: lifted(array) for name, array in self.arrays.items()}}

    @lock_free_cached_property
    def robot(self) -> RobotSubject:
        """The robot with one joint and a free base that this pair is; its masses are whole, as wrenches need them."""
        points = [*zip(self.points, map(lifted, self.positions), strict=True)]
        arrays = {**self.in_space, "n": _UPRIGHT if self.axis is None else self.axis}
        return RobotSubject(tree_of_arrays(self.name, arrays, points, self.bodies), "free", whole=True)

    @property
    def constants(self) -> RobotConstants:
        """The constants of the robot's programs."""
        return self.robot.constants

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Frames of body 2 and of all points."""
        return tuple(self.robot.tree.frames.values())

    @lock_free_cached_property
    def tree_numbers(self) -> TreeNumbers:
        """The constants of the tree and of its frames."""
        own, frames = program_numbers(self.constants), self.frames
        varied = {**self.constants.varied, **moved_frames(self.constants, frames, len(own))}
        samples = read_only(joined(tuple(varied.values()))) if varied else None
        return TreeNumbers((*own, *frame_numbers(self.constants, frames)), tuple(varied), samples)

    @lock_free_cached_property
    def constraint_vectors(self) -> dict[str, Components]:
        """u1, u2, and e1, e2 and n in the axes of body 1 and, times C^-1, of body 2: the constants of E1 and E2.

        With C^T instead, a home that is a rotation to only nine digits would appear as a tilt.
        """
        n, home = self.in_space["n"], self.in_space["home"]
        given = {"n": numbers(n), "home": numbers(home, 2), "least_axis": numbers(least_axis(n))}
        axes = Geometry(given, ())
        turned = {name: numbers(joined(getattr(axes, name)) + 0.0) for name in _AXES}
        return {"n": given["n"], **turned, **{name: numbers(self.arrays[name]) for name in ("u1", "u2")}}

    def ask_of_body1(self, task: str, body1: BodyMotion | None, options: Any, **hinge: Any) -> Any:
        """Compute what a method returns, from the arrays of body 1 that its task takes, and values of the hinge."""
        given = {**motion_inputs("body1", body1, _LETTERS[task]), **hinge}
        return ask(self, task, tuple(given.values()), options, tuple(given))

    def computation(
        self,
        outputs: tuple[str, ...],
        sequence: str | None = None,
        result: type[Results] | None = Results,
        by_geometry: bool = False,
        solves: bool = False,
    ) -> Computation:
        """Return the Computation of outputs, which is made once.

        Args:
            outputs: names of the outputs.
            sequence: Euler sequence of body 1; None if its attitude is given.
            result: class of the result; None to return the only output as an array.
            by_geometry: begin with the geometry, for derivatives by it.
            solves: whether accelerations are solved for from loads.
        """
        key = outputs, sequence, result, by_geometry, solves
        found: Computation | None = self.cache.computations.get(key)
        if found is None:
            tree, spatial = self.tree_numbers, not self.kind.planar
            masses = bool(self.massive_bodies(outputs, solves))
            known: dict[str, Any] = {"constants": tree_parameters(tree.numbers), "samples": tree.samples}
            if masses:
                known |= {name: np.zeros(self.kind.shapes[name]) for name in APPLIED_LOADS}
            if spatial:  # numbers of a single pair fold
                known |= {
                    name: tuple(self.arrays[name].ravel().tolist()) if self.single else self.arrays[name]
                    for name in ("n", "home")
                }
            if not CONSTRAINTS.keys().isdisjoint(outputs):
                known |= self.constraint_vectors
            if by_geometry:
                known |= {**self.arrays, "least_axis": least_axis(self.arrays["n"])}
                if self.points:
                    known["points"] = np.concatenate(np.broadcast_arrays(*self.positions), axis=-1)
            has_home = by_geometry or self.has_home
            request = PairRequest((), (), self.kind.planar, sequence, self.points, tree.varied, by_geometry, has_home)

            def loop(names: tuple[str, ...], given: tuple[str, ...]) -> Loop:
                return pair_loop(request._replace(outputs=names, given=given))

            found = Computation(
                loop, outputs, self.shapes, known, result, COORDINATE_NAMES[self.kind], shape=self.shape, shared=True,
                constant_shapes=GEOMETRY_SHAPES if spatial and not masses else {},
                by_constants=functools.partial(self.computation, outputs, sequence, result, True, solves),
            )  # fmt: skip
            found.asked = key
            self.cache.computations[key] = found
        return found

    def compute_arrays(
        self,
        outputs: Iterable[str],
        values: Mapping[str, Any],
        shapes: Mapping[str, tuple[int, ...]],
        dtype: np.dtype[Any] | None = None,
    ) -> dict[str, NDArray[Any]]:
        """Compute outputs from checked inputs; return new, writable arrays by output name."""
        call = self.computation(tuple(outputs)).call(tuple(values), "auto")
        return writable_arrays(call.run(values, shapes, dtype=dtype))

    # ---- masses

    def massive_bodies(self, outputs: Iterable[str], solves: bool) -> tuple[int, ...]:
        """Return the numbers in the tree, 0 of body 1 and 1 of body 2, of the bodies on whose masses outputs depend;
        `solves`: accelerations are solved for.
        """
        depend = {*outputs} - {*NO_MASSES, *CONSTRAINTS, *point_outputs(self.points)}
        if not (solves or depend):
            return ()
        return (0, 1) if solves or not depend <= _OF_BODY2 else (1,)

    def require_masses(self, bodies: Collection[int]) -> None:
        """Refuse bodies, by their numbers in the tree, without mass properties, and masses that overflow; warn once
        of those that are assumed.
        """
        if not bodies:
            return
        try:
            self.robot.warn_of_masses(bodies)
        except ArgumentError as error:
            raise error.renamed(f"pair.{error.name[:5]}" if error.name.startswith("body") else "pair") from None

    def _watch(self, outputs: tuple[str, ...], solves: bool) -> Watch | None:
        """Return what looks at accelerations that are solved for; None where the mass matrix is regular."""
        watched = solves and "psidd" in outputs and self.constants.may_be_singular
        return self._warn_where_singular if watched else None

    def _warn_where_singular(self, result: Any, _: Any) -> None:
        """Issue a DynamicsWarning where accelerations are NaN because the mass matrix is singular."""
        psidd = result["psidd"]
        if isinstance(psidd, np.ndarray | np.generic):
            self.robot.warn_where_singular(np.isnan(psidd), np.zeros(1))  # psi does not matter to the hinge's pivot

    # ---- calls

    def _method_call(self, task: Task, given: dict[str, Any], options: Mapping[str, Any], out: Any) -> MethodCall:
        """Return the call of a method, planned."""
        outputs, sequence = task.outputs, None
        if "outputs" in task.options:
            default = self.kind.default_outputs(("psid" in given) + ("psidd" in given))
            outputs = requested_outputs(options.get("outputs"), out, self.levels, outputs or default)
            sequence = self._sequence(given, options.get("sequence", "XYZ"))
        solves = "hinge_torque" in given
        self.require_masses(self.massive_bodies(outputs, solves))
        gravity = read_gravity(options.get("gravity", DEFAULT_GRAVITY))
        computation = self.computation(outputs, sequence, task.result, False, solves)
        return MethodCall(computation, given, INPUT_LABELS, gravity, self._watch(outputs, solves))

    def _sequence(self, names: Collection[str], sequence: str) -> str | None:
        """Return the Euler sequence of arguments; None without Euler angles."""
        if "q" not in names or self.kind.planar:
            return None
        find_sequence(sequence)
        return sequence

    def _accepted(self, _: tuple[str, ...]) -> Collection[str]:
        """Return the outputs that a prepared call can have."""
        of_both = () if self.kind.planar else (name for name in CONSTRAINTS if name != "S2_check")
        of_tasks = (name for task in self.tasks.values() for name in task.outputs)
        return dict.fromkeys((*self.levels, *of_tasks, *of_both))

    def _prepared_call(
        self, task: str | None, names: tuple[str, ...], outputs: tuple[str, ...], options: Any
    ) -> PreparedCall:
        """Return what a prepared call computes."""
        if sum(name in {"q", "S1", *QUATERNION_INPUTS} for name in names) != 1:
            expected = "q" if self.kind.planar else "one attitude of body 1: q, S1, quat_xyzw or quat_wxyz"
            raise ArgumentError("given", expected, quoted(names))
        solves = not LOAD_ARGUMENTS.isdisjoint(names)
        self.require_masses(self.massive_bodies(outputs, solves))
        of_task = self.tasks[task] if task is not None else None
        result = of_task.result if of_task is not None and {*outputs} <= {*of_task.outputs} else None
        sequence = self._sequence(names, options.get("sequence", "XYZ"))
        computation = self.computation(outputs, sequence, result or STATES[self.kind], False, solves)
        return PreparedCall(computation, options, self._watch(outputs, solves))

    def error_bounds(
        self, given: Mapping[str, Any], outputs: Outputs, sequence: str = "XYZ"
    ) -> dict[str, Float64Array]:
        """Return bounds on the rounding errors of outputs of forward kinematics, (...), by name, for arguments by
        input name.
        """
        names = requested_outputs(outputs, None, self.levels, self.tasks[motion_level(given)].outputs)
        of_q = self._sequence(given, sequence)
        self.computation(names, of_q).check_given(given, INPUT_LABELS)
        arguments = read_arguments(given, self.shapes, COORDINATE_NAMES[self.kind], INPUT_LABELS)
        read, planar = tuple(arguments.values), self.kind.planar
        request = PairRequest(names, read, planar, of_q, self.points, has_home=self.has_home)
        check_single(self)
        numbers_of_tree = numbers_with_bounds(self.constants, self.frames, self._bounded_origins())
        known: dict[str, Any] = {"constants": Known(*map(tree_parameters, numbers_of_tree))}
        if not planar:
            n = self.arrays["n"]
            is_exact = np.isin(n, (-1.0, 0.0, 1.0)).all()
            errors = np.zeros(3) if is_exact else in_last_places(0.5, np.abs(n), UNIT_ROUNDOFF)
            known |= {"n": Known(numbers(n), numbers(errors)), "home": numbers(self.arrays["home"], 2)}
        parts = dict.fromkeys(names, 0)
        return output_bounds(request.compute, arguments, request.inputs(), known, parts)

    def _bounded_origins(self) -> list[Any]:
        """Return the origins of the frames with bounds on their errors."""
        home, u2 = (tuple(map(Bounded, numbers(self.in_space[name], k))) for name, k in (("home", 2), ("u2", 1)))
        ends = [tuple(map(Bounded, numbers(lifted(p)))) for p in self.positions]
        origins = frame_origins(home, u2, zip(self.points, ends, strict=True))
        return [np.array(one, dtype=object) for one in origins]


# ---- arguments of methods


def read_rows(kind: PairKind, q: Any, qd: Any = None, qdd: Any = None) -> Arguments:
    """Check the coordinates of a pair and their derivatives, and return them in the form that calls take."""
    rows = dict(zip(ROWS, coordinate_rows(q, qd, qdd), strict=False))
    return read_arguments(rows, kind.shapes, COORDINATE_NAMES[kind])


def body1_inputs(body1: BodyMotion | None, psi: Any, psid: Any = None, psidd: Any = None) -> dict[str, Any]:
    """Return the motion of body 1 and the hinge angle by input name.

    Raises:
        ArgumentError: `body1` is no BodyMotion, or a derivative is given without those before it.
    """
    if psidd is not None and psid is None:
        raise ArgumentError("psid", "the first derivative too, since the second is given", None)
    if psi is None:
        raise ArgumentError("psi", "hinge angles", None)
    hinge = {name: value for name, value in (("psi", psi), ("psid", psid), ("psidd", psidd)) if value is not None}
    return {**motion_inputs("body1", body1), **hinge}


# ---- pairs as arguments


def check_pair(pair: object) -> None:
    """Raise ArgumentError if `pair` is not a HingePair."""
    if not all(hasattr(pair, name) for name in ("u1", "u2", "n", "home", "forward_kinematics")):
        hint = " (a PlanarPair's is pair.to_spatial())" if hasattr(pair, "to_spatial") else ""
        raise ArgumentError("pair", f"a HingePair{hint}", quoted(pair))


def check_single_pair(pair: Any) -> None:
    """Raise ShapeError if a HingePair or PlanarPair holds more than one pair, that is, if its geometry has leading
    axes.

    Raises:
        ShapeError: u1, u2, n or home have leading axes.
    """
    check_single(subject_of(pair), type(pair).__name__)


def check_single(pair: PairSubject, kind: str = "HingePair") -> None:
    """Raise ShapeError if a pair has leading axes; see `check_single_pair`."""
    if not pair.single:
        raise ShapeError("pair", f"one pair, such as {kind}(u1[i], ...)", f"pairs of shape {pair.shape}")
