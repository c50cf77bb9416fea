"""What is asked of pairs: their computations, and the requests of methods and of `prepare`."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.engine.results import Results, writable_arrays
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.bodies.body import Body, warn_of_dynamics
from hingepair.mechanism.bodies.body_motion import MOTION_SHAPES, BodyMotion, motion_inputs
from hingepair.mechanism.pairs.geometry import (
    Constants,
    body_numbers,
    constants_of,
    constraint_vectors,
    least_axis,
    tree_numbers,
)
from hingepair.mechanism.requests import (
    BODIES,
    PAIR_TASKS,
    ROWS,
    STATES,
    Request,
    Task,
    ask,
    coordinate_rows,
    read_gravity,
)
from hingepair.numeric.arrays import FloatArray, is_zero
from hingepair.plans.arguments import Arguments, CoordinateNames, check_outputs, read_arguments, requested_outputs
from hingepair.plans.computation import QUATERNIONS, Cache, Computation
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
from hingepair.plans.prepared import Prepared
from hingepair.rotations.sequences import find_sequence

COORDINATES: Final = {kind: CoordinateNames(kind.coordinates, kind.columns) for kind in (SPACE, PLANE)}
"""Names of the coordinates."""
INPUT_LABELS: Final = {f"{letter}{k}": f"body{k}.{letter}" for k in "12" for letter in MOTION_SHAPES}
"""Names of the arrays of bodies in messages, by input."""

# ---- computations


def computation_of(
    pair: Constants,
    outputs: tuple[str, ...],
    sequence: str | None = None,
    result: type[Results] | None = Results,
    by_geometry: bool = False,
    solves: bool = False,
) -> Computation:
    """Return the Computation of outputs of a pair, which is made once.

    Args:
        pair: constants of the pair.
        outputs: names of the outputs.
        sequence: Euler sequence of body 1; None if its attitude is given.
        result: class of the result; None to return the only output as an array.
        by_geometry: begin with the geometry and the masses, for derivatives by them.
        solves: whether accelerations are solved for from loads.
    """
    key = outputs, sequence, result, by_geometry, solves
    found: Computation | None = pair.cache.computations.get(key)
    if found is None:
        masses = solves or needs_masses(pair, outputs)
        tree = tree_numbers(pair, masses)
        known: dict[str, Any] = {"constants": tree_parameters(tree.numbers), "samples": tree.samples}
        if masses:
            known |= {name: np.zeros(pair.kind.shapes[name]) for name in LOADS}
        if not pair.kind.planar:
            known |= {name: _plain(pair, name) for name in ("n", "home")}
        if not CONSTRAINTS.keys().isdisjoint(outputs):
            known |= constraint_vectors(pair)
        if by_geometry:
            known |= _geometry(pair, tree.numbers)
        has_home = by_geometry or pair.has_home
        request = PairRequest((), (), pair.kind.planar, sequence, pair.points, tree.varied, by_geometry, has_home)

        def loop(names: tuple[str, ...], given: tuple[str, ...]) -> Loop:
            return pair_loop(request._replace(outputs=names, given=given))

        found = pair.cache.computations[key] = Computation(
            loop, outputs, pair.shapes, known, result, COORDINATES[pair.kind], shape=pair.shape, shared=True,
            constant_shapes={} if pair.kind.planar else GEOMETRY_SHAPES,
            by_constants=functools.partial(computation_of, pair, outputs, sequence, result, True, solves),
        )  # fmt: skip
    return found


def _plain(pair: Constants, name: str) -> Any:
    """Return n or home as an array, or as numbers of a single pair, which fold."""
    array = pair.arrays[name]
    return tuple(array.ravel().tolist()) if pair.single else array


def needs_masses(pair: Constants, outputs: Iterable[str]) -> bool:
    """Return whether an output depends on masses, where accelerations are given."""
    return not {*outputs} <= {*NO_MASSES, *CONSTRAINTS, *point_outputs(pair.points)}


def _geometry(pair: Constants, tree: tuple[float, ...]) -> dict[str, Any]:
    """Return the geometry and the masses of a pair, for programs that make the constants of the tree of them."""
    found: dict[str, Any] = {**pair.arrays, **body_numbers(pair), "least_axis": least_axis(pair.arrays["n"])}
    found["least_pivots"] = np.array((tree[35], *tree[36:38]))
    if pair.points:
        found["points"] = np.concatenate(np.broadcast_arrays(*pair.positions), axis=-1)
    return found


def compute_arrays(
    pair: Constants,
    outputs: Iterable[str],
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    dtype: np.dtype[Any] | None = None,
) -> dict[str, NDArray[Any]]:
    """Compute outputs of a pair in space from checked inputs; return new, writable arrays by output name."""
    computation = computation_of(pair, tuple(outputs))
    return writable_arrays(computation.call(tuple(values), "auto").run(values, shapes, dtype=dtype))


# ---- methods


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


def loads_that_act(**loads: Any) -> dict[str, Any]:
    """Return the loads that are not the number 0."""
    return {name: value for name, value in loads.items() if not is_zero(value)}


def _pair_request(pair: Any, task: Task, given: dict[str, Any], options: Mapping[str, Any], out: Any) -> Request:
    """Return the request of a method of a pair.

    Raises:
        ArgumentError: a body that is needed has no mass, or an output needs an input that is not given.
    """
    constants: Constants = constants_of(pair)
    kind, outputs, sequence, gravity, lasts = constants.kind, task.outputs, None, None, True
    if "outputs" in task.options:
        default = outputs or kind.default_outputs(("psid" in given) + ("psidd" in given))
        outputs = requested_outputs(options.get("outputs"), out, constants.levels, default)
        if "q" in given and not kind.planar:
            sequence = options.get("sequence", "XYZ")
            find_sequence(sequence)
    if task.masses:
        gravity = read_gravity(options.get("gravity", kind.gravity), kind.gravity)
        bodies = {one: getattr(pair, one) for one in BODIES}
        check_masses({one: body for one, body in bodies.items() if body is not None or one in task.masses}, task.hint)
        lasts = not any(body is not None and body.assumed for body in bodies.values())  # each call warns
    solves = "hinge_torque" in given
    remade = functools.partial(computation_of, constants, outputs, sequence, task.result, False, solves)
    watch = functools.partial(_watch, pair, outputs[-1]) if solves and pivot_limits(constants).any() else None
    return Request(remade(), given, INPUT_LABELS, gravity, remade, watch=watch, lasts=lasts)


class AskedPair:
    """What `ask` needs of a pair, in space or in the plane."""

    __slots__ = ()

    _constants: Constants

    @property
    def _cache(self) -> Cache:
        return self._constants.cache

    @property
    def _tasks(self) -> Mapping[str, Task]:
        return PAIR_TASKS[self._constants.kind]

    def _request(self, task: Task, given: dict[str, Any], options: Mapping[str, Any], out: Any) -> Request:
        return _pair_request(self, task, given, options, out)


def ask_pair(pair: AskedPair, task: str, given: Mapping[str, Any], options: Any) -> Any:
    """Compute what a method returns, from arguments by input name."""
    return ask(pair, task, tuple(given.values()), options, tuple(given))


# ---- masses


def check_masses(bodies: Mapping[str, Body | None], hint: str = "") -> None:
    """Raise ArgumentError for a body, by name, that is None; `hint` ends the message for body 1. Issue a
    DynamicsWarning for each assumed value.
    """
    for name, body in bodies.items():
        if body is None:
            examples = f"HingePair(..., {name}=hp.Body(mass=2.0)), or in a scene [pair.{name}] mass = 2.0"
            raise ArgumentError(
                f"pair.{name}", f"mass properties, as in {examples}{hint if name == 'body1' else ''}", None
            )
        for sentence in body.assumed:
            warn_of_dynamics(f"pair.{name}: {sentence}")


def pivot_limits(pair: Constants) -> FloatArray:
    """Return the sizes below which pivots of the hinge, of forces and of torques on body 1 are rounding, (..., 3);
    0 where they cannot be that small.
    """
    tree = tree_numbers(pair, masses=True)
    limits = np.array(tree.numbers[35:38])
    if tree.samples is None:
        return limits
    columns = dict(zip(tree.varied, np.moveaxis(tree.samples, -1, 0), strict=True))
    return np.stack(np.broadcast_arrays(*(columns.get(35 + k, limits[k]) for k in range(3))), axis=-1)


def _watch(pair: Any, output: str, result: Any, _: Any) -> None:
    """Issue a DynamicsWarning where accelerations are NaN because the mass matrix of the pair is singular."""
    constants: Constants = constants_of(pair)
    psidd = result if isinstance(result, np.ndarray) else result[output]
    psidd = psidd[..., -1] if constants.kind.planar else psidd
    if not isinstance(psidd, np.ndarray | np.generic):
        return
    bad = np.isnan(psidd)
    if not bad.any():
        return
    still: dict[str, Any] = {"phi1": 0.0} if constants.kind.planar else {"S1": np.eye(3)}
    still["psi"] = 0.0
    pivots = compute_arrays(constants, ("pivots",), still, dict.fromkeys(still, ()))["pivots"]
    low = ~(pivots > pivot_limits(constants)[..., [0, 1, 1, 1, 2, 2, 2]])  # NaN are low
    if low.any():
        which = "the hinge" if low[..., 0].any() else "body 1"
        where = f"at {int(bad.sum())} of {bad.size} samples" if bad.shape else "here"
        warn_of_dynamics(f"{pair.name}: no mass resists {which} {where}; accelerations are NaN there")


# ---- prepared calls

_INPUTS: Final = {  # that a prepared call can take
    SPACE: (
        *(*ROWS, "psi", "psid", "psidd", "R1", "S1", "v1", "omega1", "a1", "alpha1"),
        *("R2", "S2", "v2", "omega2", "a2", "alpha2", *QUATERNIONS, *LOADS),
    ),
    PLANE: (*ROWS, *LOADS),
}


def prepare(
    pair: Any,
    given: str | Iterable[str],
    outputs: Iterable[str] | None,
    sequence: str | None,
    gravity: ArrayLike,
    execution: Execution,
) -> Prepared:
    """Return the call that `HingePair.prepare` and `PlanarPair.prepare` describe; `sequence` is None in the plane.

    Raises:
        ArgumentError: unknown names, missing inputs or missing masses.
    """
    constants: Constants = constants_of(pair)
    kind = constants.kind
    tasks = PAIR_TASKS[kind]
    names = _checked_names(kind, given)
    solves, rows = any(name in LOADS for name in names), "q" in names
    if sequence is not None and rows:
        find_sequence(sequence)
    if outputs is not None:
        of_both = () if kind.planar else (name for name in CONSTRAINTS if name != "S2_check")
        of_tasks = (name for task in tasks.values() for name in task.outputs)
        output_names = check_outputs(outputs, dict.fromkeys((*constants.levels, *of_tasks, *of_both)))
    elif isinstance(given, str):
        output_names = tasks[given].outputs
    elif solves:
        output_names = tasks["forward_dynamics"].outputs
    else:
        level = sum(name in names for name in (("qd", "qdd") if rows else ("psid", "psidd")))
        output_names = kind.default_outputs(level)
    if solves or needs_masses(constants, output_names):
        needed = BODIES if solves else _bodies(tasks, output_names)
        check_masses({one: getattr(pair, one) for one in BODIES if one in needed})
    task = tasks[given] if isinstance(given, str) else None
    result = task.result if task is not None and {*output_names} <= {*task.outputs} else None
    what = constants, output_names, sequence if rows else None, result or STATES[kind], False, solves
    computation = computation_of(*what)
    _check_given(computation, names, solves)
    remade = functools.partial(
        pair.prepare, given if task else names, outputs=None if outputs is None else output_names, gravity=gravity,
        workers=execution.workers, backend=execution.backend,
        **({} if sequence is None else {"sequence": sequence}),
    )  # fmt: skip
    solved = tasks["forward_dynamics"].outputs[-1]
    watched = solves and solved in output_names and pivot_limits(constants).any()
    watch = functools.partial(_watch, pair, solved) if watched else None
    return Prepared(computation, names, execution, read_gravity(gravity, kind.gravity), remade, watch)


def _check_given(computation: Computation, names: tuple[str, ...], solves: bool) -> None:
    """Refuse arguments that do not suffice for the outputs."""
    for name in computation.outputs:
        of_both = (*names, "S2") if name in CONSTRAINTS and not solves else names
        missing = {*computation.missing_inputs(name, of_both), *of_both} - {*names}
        if missing:  # without q, motions of body 1 are inputs
            needed = ", ".join("q" if one == name else one for one in sorted(missing))
            raise ArgumentError("given", f"names with {needed}, which output {name} needs", ", ".join(names))


def _bodies(tasks: Mapping[str, Task], outputs: tuple[str, ...]) -> set[str]:
    """Return the bodies, "body1" or "body2", whose masses the outputs need."""
    fewest: dict[str, tuple[str, ...]] = {}
    for task in tasks.values():
        for name in task.outputs:
            if name not in fewest or len(task.masses) < len(fewest[name]):
                fewest[name] = task.masses
    return {body for name in outputs for body in fewest.get(name, ())}


def _checked_names(kind: PairKind, given: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of the inputs that `given` means: a word such as "velocity", or the names themselves.

    Raises:
        ArgumentError: unknown or repeated names, or any but one attitude of body 1.
    """
    tasks, allowed = PAIR_TASKS[kind], _INPUTS[kind]
    try:
        names = tasks[given].given if isinstance(given, str) else tuple(given)
    except (KeyError, TypeError):
        words = tuple(name for name, task in tasks.items() if task.given)
        raise ArgumentError("given", f"{choices(words)}, or a tuple of names", quoted(given)) from None
    for name in names:
        if name not in allowed:
            raise ArgumentError("given", choices(allowed), quoted(name))
    attitudes = [name for name in names if name in {"q", "S1", *QUATERNIONS}]
    if len(attitudes) != 1 or len({*names}) != len(names):
        expected = "q" if kind.planar else "one attitude of body 1: q, S1, quat_xyzw or quat_wxyz"
        raise ArgumentError("given", expected, quoted(names))
    return names
