"""What is asked of pairs: their computations, and the requests of methods and of `prepare`."""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterable, Mapping
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.loops import Loop
from hingepair.engine.results import Results, writable_arrays
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.mechanism.bodies.body import warn_of_dynamics
from hingepair.mechanism.bodies.body_motion import MOTION_SHAPES, BodyMotion, motion_inputs
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.geometry import Constants, axis_errors, least_axis, tree_errors
from hingepair.mechanism.requests import (
    PAIR_TASKS,
    PUSHES,
    ROWS,
    STATES,
    Planned,
    Request,
    Subject,
    Task,
    Watch,
    ask,
    coordinate_rows,
    motion_level,
    read_gravity,
    warn_where_singular,
)
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.blocks import numbers
from hingepair.plans.arguments import Arguments, CoordinateNames, Outputs, read_arguments, requested_outputs
from hingepair.plans.bounds import Known, output_bounds
from hingepair.plans.computation import QUATERNIONS, Computation
from hingepair.plans.constraints import CONSTRAINTS
from hingepair.plans.geometry import GEOMETRY_SHAPES
from hingepair.plans.pairs import (
    LOADS,
    NO_MASSES,
    PLANE,
    SPACE,
    PairKind,
    PairRequest,
    pair_loop,
    point_outputs,
    tree_parameters,
)
from hingepair.rotations.sequences import find_sequence

COORDINATES: Final = {kind: CoordinateNames(kind.coordinates, kind.columns) for kind in (SPACE, PLANE)}
"""Names of the coordinates."""
INPUT_LABELS: Final = {f"{letter}{k}": f"body{k}.{letter}" for k in "12" for letter in MOTION_SHAPES}
"""Names of the arrays of bodies in messages, by input."""
_INPUTS: Final = {  # that a prepared call can take
    SPACE: (
        *(*ROWS, "psi", "psid", "psidd", "R1", "S1", "v1", "omega1", "a1", "alpha1"),
        *("R2", "S2", "v2", "omega2", "a2", "alpha2", *QUATERNIONS, *LOADS),
    ),
    PLANE: ROWS,
}
_LETTERS: Final = {  # of the arrays of body 1 that tasks take
    task: tuple(name[:-1] for name in row.given if name in INPUT_LABELS) for task, row in PAIR_TASKS[SPACE].items()
}
# Outputs for which body 1 needs no mass.
_OF_BODY2: Final = {"hinge_force", "hinge_moment", "hinge_torque", "bearing_torque", "kinetic", "potential"}
_HINT: Final = "; or pair.hinge_wrench, for which body 2 suffices"


class PairRequests(Constants, Subject):
    """What is asked of a pair, and its computations, which are made once."""

    def __init__(self, *constants: Any) -> None:
        Constants.__init__(self, *constants)
        Subject.__init__(self)
        self.tasks, self.inputs = PAIR_TASKS[self.kind], _INPUTS[self.kind]
        self._warned: set[str] = set()  # bodies whose assumed masses were told

    def ask(self, task: str, given: Mapping[str, Any], options: Any) -> Any:
        """Compute what a method returns, from arguments by input name."""
        return ask(self, task, tuple(given.values()), options, tuple(given))

    def ask_of_body1(self, task: str, body1: BodyMotion | None, options: Any, **hinge: Any) -> Any:
        """Compute what a method returns, from the arrays of body 1 that its task takes, and values of the hinge."""
        return self.ask(task, {**motion_inputs("body1", body1, _LETTERS[task]), **hinge}, options)

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
            masses, spatial = bool(self.massive_bodies(outputs, solves)), not self.kind.planar
            tree = self.tree_with_masses if masses else self.tree
            known: dict[str, Any] = {"constants": tree_parameters(tree.numbers), "samples": tree.samples}
            if masses:
                known |= {name: np.zeros(self.kind.shapes[name]) for name in LOADS}
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

            found = self.cache.computations[key] = Computation(
                loop, outputs, self.shapes, known, result, COORDINATES[self.kind], shape=self.shape, shared=True,
                constant_shapes=GEOMETRY_SHAPES if spatial and not masses else {},
                by_constants=functools.partial(self.computation, outputs, sequence, result, True, solves),
            )  # fmt: skip
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

    def massive_bodies(self, outputs: Iterable[str], solves: bool) -> tuple[str, ...]:
        """Return the bodies on whose masses outputs depend; `solves`: accelerations are solved for."""
        depend = {*outputs} - {*NO_MASSES, *CONSTRAINTS, *point_outputs(self.points)}
        if not (solves or depend):
            return ()
        return ("body1", "body2") if solves or not depend <= _OF_BODY2 else ("body2",)

    def require_masses(self, names: Collection[str], hint: str = _HINT) -> None:
        """Refuse bodies, "body1" or "body2", without mass properties; `hint` ends the message for body 1."""
        for name, body in zip(("body1", "body2"), self.bodies, strict=True):
            if name in names and body is None:
                examples = f"HingePair(..., {name}=hp.Body(mass=2.0)), or in a scene [pair.{name}] mass = 2.0"
                expected = f"mass properties, as in {examples}{hint if name == 'body1' else ''}"
                raise ArgumentError(f"pair.{name}", expected, None)

    def _check_masses(self, outputs: tuple[str, ...], solves: bool) -> None:
        """Refuse bodies whose mass outputs need and that have none; warn once of each mass that is assumed."""
        needed = self.massive_bodies(outputs, solves)
        self.require_masses(needed)
        for name, body in zip(("body1", "body2"), self.bodies, strict=True):
            if needed and body is not None and name not in self._warned:
                self._warned.add(name)
                for sentence in body.assumed:
                    warn_of_dynamics(f"pair.{name}: {sentence}")

    def _watch(self, outputs: tuple[str, ...], solves: bool) -> Watch | None:
        """Return what looks at accelerations that are solved for; None where the mass matrix is regular."""
        return self._warn_where_singular if solves and "psidd" in outputs and self.pivot_limits.any() else None

    def _warn_where_singular(self, result: Any, _: Any) -> None:
        """Issue a DynamicsWarning where accelerations are NaN because the mass matrix is singular."""
        psidd = result["psidd"]
        if isinstance(psidd, np.ndarray | np.generic) and np.isnan(psidd).any():
            still = {"S1": np.eye(3), "psi": 0.0}
            pivots = self.compute_arrays(("pivots",), still, dict.fromkeys(still, ()))["pivots"]
            limits = self.pivot_limits[..., [0, 1, 1, 1, 2, 2, 2]]
            warn_where_singular(self.name, np.isnan(psidd), pivots, limits, ("the hinge", *["body 1"] * 6))

    # ---- requests

    def _request(self, task: Task, given: dict[str, Any], options: Mapping[str, Any], out: Any) -> Request:
        """Return the request of a method."""
        outputs, sequence = task.outputs, None
        if "outputs" in task.options:
            default = self.kind.default_outputs(("psid" in given) + ("psidd" in given))
            outputs = requested_outputs(options.get("outputs"), out, self.levels, outputs or default)
            sequence = self._sequence(given, options.get("sequence", "XYZ"))
        solves = "hinge_torque" in given
        self._check_masses(outputs, solves)
        gravity = read_gravity(options.get("gravity", DEFAULT_GRAVITY))
        remade = functools.partial(self.computation, outputs, sequence, task.result, False, solves)
        return Request(remade(), given, INPUT_LABELS, gravity, remade, self._watch(outputs, solves))

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

    def _planned(self, task: str | None, names: tuple[str, ...], outputs: tuple[str, ...], options: Any) -> Planned:
        """Return what a prepared call computes."""
        if sum(name in {"q", "S1", *QUATERNIONS} for name in names) != 1:
            expected = "q" if self.kind.planar else "one attitude of body 1: q, S1, quat_xyzw or quat_wxyz"
            raise ArgumentError("given", expected, quoted(names))
        solves = not PUSHES.isdisjoint(names)
        self._check_masses(outputs, solves)
        of_task = self.tasks[task] if task is not None else None
        result = of_task.result if of_task is not None and {*outputs} <= {*of_task.outputs} else None
        sequence = self._sequence(names, options.get("sequence", "XYZ"))
        computation = self.computation(outputs, sequence, result or STATES[self.kind], False, solves)
        return Planned(computation, options, self._watch(outputs, solves))

    def error_bounds(
        self, given: Mapping[str, Any], outputs: Outputs, sequence: str = "XYZ"
    ) -> dict[str, Float64Array]:
        """Return bounds on the rounding errors of outputs of forward kinematics, (...), by name, for arguments by
        input name.
        """
        names = requested_outputs(outputs, None, self.levels, self.tasks[motion_level(given)].outputs)
        of_q = self._sequence(given, sequence)
        self.computation(names, of_q).check_given(given, INPUT_LABELS)
        arguments = read_arguments(given, self.shapes, COORDINATES[self.kind], INPUT_LABELS)
        read, planar = tuple(arguments.values), self.kind.planar
        request = PairRequest(names, read, planar, of_q, self.points, has_home=self.has_home)
        constants = self.tree.components, tree_errors(self)
        known: dict[str, Any] = {"constants": Known(*map(tree_parameters, constants))}
        if not planar:
            known |= {
                "n": Known(numbers(self.arrays["n"]), axis_errors(self)),
                "home": numbers(self.arrays["home"], 2),
            }
        parts = dict.fromkeys(names, 0)
        return output_bounds(request.compute, arguments, request.inputs(), known, parts, shape=self.shape)


# ---- arguments of methods


def read_rows(kind: PairKind, q: Any, qd: Any = None, qdd: Any = None) -> Arguments:
    """Check the coordinates of a pair and their derivatives, and return them in the form that calls take."""
    rows = dict(zip(ROWS, coordinate_rows(q, qd, qdd), strict=False))
    return read_arguments(rows, kind.shapes, COORDINATES[kind])


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


class _Pair(Protocol):
    """A HingePair or a PlanarPair."""

    @property
    def _constants(self) -> PairRequests: ...


def constants_of(pair: _Pair) -> PairRequests:
    """Return the checked geometry and masses of a pair, and what is asked of it."""
    return pair._constants


def check_pair(pair: object) -> None:
    """Raise ArgumentError if `pair` is not a HingePair."""
    if not all(hasattr(pair, name) for name in ("u1", "u2", "n", "home", "forward_kinematics")):
        hint = " (a PlanarPair's is pair.to_spatial())" if hasattr(pair, "to_spatial") else ""
        raise ArgumentError("pair", f"a HingePair{hint}", quoted(pair))


def check_single_pair(pair: Any, condition: str = "") -> None:
    """Raise ShapeError if a HingePair or PlanarPair holds more than one pair, that is, if its geometry has leading
    axes.

    Args:
        pair: a HingePair or a PlanarPair.
        condition: text that follows "one pair" in the message, such as " if the arguments are Dask arrays".

    Raises:
        ShapeError: u1, u2, n or home have leading axes.
    """
    constants = constants_of(pair)
    if not constants.single:
        expected = f"one pair{condition}, such as {type(pair).__name__}(u1[i], ...)"
        raise ShapeError("pair", expected, f"pairs of shape {constants.shape}")
