"""From what a caller gives to what a plan takes, and from a plan to a state: shared by all kinds of pairs.

Of `evaluate` and its like, `pair` is the pair's constants, `values` are the other inputs by name, `shapes` those of
the samples by argument, `tails` those of one sample of each result, `rows` says whether the values are q, qd, qdd
(else their parts), and `out` holds arrays to write into.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.evaluation.backend import How
from hingepair.evaluation.binding import bind
from hingepair.evaluation.loops import Loop, Operations
from hingepair.evaluation.one_state import OneState
from hingepair.evaluation.plan import (
    INPUTS,
    PLANAR,
    PLANAR_INPUTS,
    SPATIAL,
    Plan,
    needed_steps,
    outputs_of,
)
from hingepair.evaluation.steps import COORDINATES, PLANAR_COORDINATES, PLANAR_ROW_STEPS, ROW_STEPS, Step
from hingepair.numeric.array_libraries import ForeignArray, Library, foreign_components, library_of
from hingepair.numeric.arrays import broadcast_shape, columns_by_name, is_table, real_array, result_dtype, vectors
from hingepair.numeric.blocks import Components, Named
from hingepair.pair.constants import Constants
from hingepair.pair.states import PairState, PlanarState, spans_of

Rows: TypeAlias = ArrayLike | tuple[Any, ...]
"""q, qd or qdd: an array with the coordinates last, or a tuple of coordinates that broadcast."""
Outputs: TypeAlias = Iterable[str] | None
Out: TypeAlias = Mapping[str, NDArray[Any]] | None

AUTO = How("auto", 1)

_COUNTS = {4: "four", 7: "seven"}
_DOUBLES = "dbhilqBHILQ"  # dtypes that are computed in float64, by their characters
_SEQUENCES, _NUMBERS = {tuple, list}, {float, int, np.float64, np.int64, np.int32}
StateT = TypeVar("StateT", PairState, PlanarState)


class Coordinates(NamedTuple):
    """The coordinates and their derivatives as they were given.

    Attributes:
        parts: q, qd, qdd, as far as given: tuples of components, or arrays with the components last.
        single: whether they are one state in float64, each an array.
        library: that they are arrays of; None of NumPy's, and of numbers.
    """

    parts: Mapping[str, Components | NDArray[Any]]
    single: bool
    library: Library | None = None


def read_coordinates(q: Any, qd: Any, qdd: Any, names: tuple[str, ...], foreign: bool = False) -> Coordinates:
    """The coordinates of these names as plans take them; arrays of other libraries as they are where `foreign`."""
    if qdd is not None and qd is None:
        raise ArgumentError("qd", "the first derivatives beside the second", None)
    if q is None:
        raise ArgumentError("q", "coordinates", None)
    given = {"q": q} if qd is None else {"q": q, "qd": qd} if qdd is None else {"q": q, "qd": qd, "qdd": qdd}
    floats = {name: row for name, value in given.items() if (row := float_row(value, len(names))) is not None}
    if floats.keys() == given.keys():
        return Coordinates(floats, True)
    leaves = {f"{name}[{i}]": c for name, v in given.items() if type(v) is tuple for i, c in enumerate(v)}
    library = library_of({name: v for name, v in given.items() if type(v) is not tuple} | leaves) if foreign else None
    if library is not None:
        return Coordinates({n: foreign_components(n, v, len(names)) for n, v in given.items()}, False, library)
    return Coordinates({name: _coordinates(name, value, names) for name, value in given.items()}, False)


def parts_of(given: Coordinates, planar: bool = False) -> Named:
    """Position, angles and hinge angle, and their derivatives, by the names of a plan's inputs."""
    values: Named = {}
    for part, place, (name,) in PLANAR_ROW_STEPS if planar else ROW_STEPS:
        if name in given.parts:
            row = given.parts[name]
            columns = tuple(row[..., i] for i in range(row.shape[-1])) if isinstance(row, np.ndarray) else row
            values[part] = place(columns)
    return values


def leading_shapes(given: Coordinates) -> dict[str, tuple[int, ...]]:
    """The shapes of the samples of q, qd, qdd."""
    shapes = {}
    for name, part in given.parts.items():
        if isinstance(part, np.ndarray):
            shapes[name] = part.shape[:-1]
        else:
            shapes[name] = broadcast_shape({f"{name}[{i}]": np.shape(c) for i, c in enumerate(part)})
    return shapes


def component(name: str, value: Any) -> Any:
    """One coordinate: a Python number stays one, so that it follows the dtype of the arrays beside it."""
    if type(value) is float or (type(value) is int and value.bit_length() < 1024):
        return float(value)
    return real_array(name, value)


@functools.lru_cache(maxsize=1024)
def loop_of(plan: Plan, rows: bool) -> Loop:
    """The loop that runs a plan.

    Args:
        plan: what to compute.
        rows: whether the coordinates are given as q, qd, qdd; else part by part.
    """
    planar = plan.kind == PLANAR
    tails, names = (PLANAR_INPUTS, PLANAR_COORDINATES) if planar else (INPUTS, COORDINATES)
    splits = [step for step in (PLANAR_ROW_STEPS if planar else ROW_STEPS) if rows and step.result in plan.inputs]
    inputs = sorted(plan.inputs.difference(step.result for step in splits) | {step.arguments[0] for step in splits})
    whole = replace(plan, steps=(*splits, *plan.steps))
    outputs = {name: outputs_of(plan.kind)[name].tail for name in plan.outputs}
    labels = {name: tuple(f"{one}{name[1:]}" for one in names) for name in ("q", "qd", "qdd")}
    return Loop("state", whole.run, {name: tails[name] for name in inputs}, outputs, labels=labels)


def evaluate_one(
    state: type[StateT], plan: Plan, rows: bool, pair: Constants, values: Mapping[str, Any], out: Out, how: How
) -> StateT:
    """One state of one pair in float64: no array but the one that holds the results, and those of `out`."""
    key = plan, rows, how.backend
    one = pair.prepared.get(key)
    if one is None:
        own = {name: value for name, value in pair.values.items() if name in plan.inputs}
        loop = loop_of(plan, rows)
        one = pair.prepared[key] = OneState(loop, own, how.backend), spans_of(loop.outputs)
    run, spans = one
    fresh = state.of_buffer(run(values), spans)
    return fresh if out is None else written(fresh, out, {})


def evaluate(
    state: type[StateT],
    plan: Plan,
    rows: bool,
    pair: Constants,
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    out: Out,
    how: How,
) -> StateT:
    """The state at all samples."""
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    loop, dtype = loop_of(plan, rows), _dtype(values)
    arrays = rooms(loop.outputs, shape, dtype, out, values)
    loop.run({**(pair.values if pair.single else pair.arrays), **values}, arrays, shape, dtype, how)
    return state(arrays, shape)


def follow_steps(
    steps: Iterable[Step],
    tails: Mapping[str, tuple[int, ...]],
    pair: Constants,
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    dtype: np.dtype[Any] | None = None,
    how: How = AUTO,
) -> dict[str, NDArray[Any]]:
    """New arrays of some results of steps at all samples; in the dtype of the values unless one is given."""
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    dtype = _dtype(values) if dtype is None else dtype
    if shape == ():
        values = {name: np.asarray(v) if isinstance(v, float) else v for name, v in values.items()}
    given = {**(pair.values if pair.single else pair.arrays), **values}
    inputs = tuple((name, _tail(name, value)) for name, value in given.items())
    loop = loop_of_steps(tuple(steps), tuple(tails.items()), inputs)
    out = rooms(loop.outputs, shape, dtype, None, {})
    loop.run(given, out, shape, dtype, how)
    return out


@functools.lru_cache(maxsize=256)
def loop_of_steps(
    steps: tuple[Step, ...], tails: tuple[tuple[str, tuple[int, ...]], ...], given: tuple[tuple[str, Any], ...]
) -> Loop:
    """The loop from what is given to some results of steps; the shape of one sample stands beside each name."""
    taken, needed = needed_steps(steps, (name for name, _ in tails))
    plan = Plan(tuple(name for name, _ in tails), taken, needed, (), None, True, SPATIAL)
    return Loop("state", plan.run, {name: tail for name, tail in given if name in needed}, dict(tails))


def count_operations(plan: Plan, pair: Constants, rows: Mapping[str, Any]) -> Operations:
    """How many operations of a plan are left for a pair, with coordinates of which some are known numbers.

    Args:
        plan: what is computed.
        pair: the constants of one pair.
        rows: q, qd, qdd as tuples of numbers and arrays; none where the parts are given otherwise.
    """
    loop = loop_of(plan, bool(rows))
    many = {name: np.empty((2, *tail)) for name, tail in loop.inputs}
    moving = np.empty(2)  # whatever the number of samples, which may be one
    own = {name: tuple(moving + 0 if isinstance(c, np.ndarray) else c for c in row) for name, row in rows.items()}
    full = loop.program(bind(loop.inputs, many).pattern)
    return loop.program(bind(loop.inputs, {**many, **pair.values, **own}).pattern).count(full)


def _tail(name: str, value: Any) -> tuple[int, ...]:
    """The shape of one sample of an input."""
    known = INPUTS.get(name)
    if known is not None:
        return known
    if isinstance(value, tuple):
        return (len(value),)
    return value.shape[-1:] if isinstance(value, np.ndarray) else ()


def _dtype(values: Mapping[str, Any]) -> np.dtype[Any]:
    """The dtype that values are computed in."""
    return result_dtype(c for group in values.values() for c in (group if isinstance(group, tuple) else (group,)))


def _coordinates(name: str, value: Any, names: tuple[str, ...]) -> Components | NDArray[Any]:
    """A tuple of broadcastable coordinates, or one array with the coordinates last, or a table with their names."""
    count = len(names)
    several = f"{_COUNTS[count]} coordinates"
    if isinstance(value, tuple) and len(value) == count:
        if all(isinstance(part, list | tuple) and len(part) == count for part in value):
            expected = f"an array of states (numpy.array(...)), or a tuple of arrays of {several}"
            raise ShapeError(name, expected, f"{count} sequences of {count} numbers, which could be either")
        return tuple(component(f"{name}[{i}]", part) for i, part in enumerate(value))
    if is_table(value):
        endings = {"q": (), "qd": ("_dot", "d"), "qdd": ("_ddot", "dd")}[name]
        meaning = {f"{one}{ending}": one for one in names for ending in ("", *endings)}
        value = columns_by_name(name, value, meaning, names)
    try:
        return vectors(name, value, count)
    except ShapeError as error:
        raise ShapeError(name, f"{error.expected}, or a tuple of {several}", error.got) from None


def float_row(value: Any, count: int) -> NDArray[np.float64] | None:
    """So many numbers that are computed in float64, as an array of it; None of anything else."""
    if type(value) is np.ndarray:
        known = value.shape == (count,) and value.dtype.char in _DOUBLES
    else:
        known = type(value) in _SEQUENCES and len(value) == count and _NUMBERS.issuperset(map(type, value))
    try:
        return np.asarray(value, np.float64) if known else None
    except OverflowError:
        return None


def rooms(
    tails: Iterable[tuple[str, tuple[int, ...]]],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    out: Out,
    values: Mapping[str, Any],
) -> dict[str, NDArray[Any]]:
    """Arrays for results: those of `out`, which overlap none of the values, and new ones."""
    sizes = {name: (*shape, *tail) for name, tail in tails}
    own = {name: _room_for(name, array, sizes[name], dtype) for name, array in (out or {}).items()}
    if own:
        _check_apart(own, values)
    return {name: own[name] if name in own else np.empty(size, dtype) for name, size in sizes.items()}


def _room_for(output: str, array: Any, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """An array to write into, if it is one of this shape and dtype."""
    name = f"out[{output!r}]"
    if not isinstance(array, np.ndarray):
        raise ArgumentError(name, "an array to write into", quoted(array))
    if array.shape != shape:
        raise ShapeError(name, f"shape {shape}", f"shape {array.shape}")
    if array.dtype != dtype:
        raise DtypeError(name, f"dtype {dtype.name}", f"dtype {array.dtype}")
    if not array.flags.writeable:
        raise ArgumentError(name, "a writable array", "a read-only one")
    return array


def written(state: StateT, out: Mapping[str, NDArray[Any]], given: Mapping[str, Any]) -> StateT:
    """The state, copied into arrays: for a few samples, quicker than to compute them there."""
    arrays = state.arrays()
    own = {name: _room_for(name, room, arrays[name].shape, arrays[name].dtype) for name, room in out.items()}
    _check_apart(out, given)
    for name, room in own.items():
        room[...] = arrays[name]
    return type(state)(arrays | own, state.shape)


def _check_apart(out: Mapping[str, NDArray[Any]], groups: Mapping[str, Any]) -> None:
    """Refuse an output that lies over an input or over another output: blocks would read what they wrote."""
    taken = [
        (name, c, c.flags.owndata)
        for name, group in groups.items()
        for c in (group if isinstance(group, tuple) else (group,))
        if isinstance(c, np.ndarray)
    ]
    for name, array in out.items():
        own = array.flags.owndata
        for other, c, owned in taken:
            apart = own and owned and array is not c  # two arrays with memory of their own
            if not apart and np.may_share_memory(array, c) and np.shares_memory(array, c):
                raise ArgumentError(f"out[{name!r}]", "memory of its own", f"an array that overlaps {other}")
        taken.append((f"out[{name!r}]", array, own))


def evaluate_foreign(
    state: type[StateT],
    plan: Plan,
    pair: Constants,
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    library: Library,
    out: Out,
    how: How,
) -> StateT:
    """The state at all samples, as arrays of the library.

    Raises:
        ArgumentError: an option that is of NumPy arrays only.
    """
    check_options(library, out, how)
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    tails = {name: outputs_of(plan.kind)[name].tail for name in plan.outputs}
    return state(run_foreign(plan.run, pair, values, tails, shape, library), shape)


def check_options(library: Library, out: Out, how: How) -> None:
    """Refuse what is of NumPy arrays only.

    Raises:
        ArgumentError: names the option.
    """
    if out is not None:
        raise ArgumentError("out", f"None, since {library.name} makes its own arrays", quoted(out))
    if how.backend != "auto":
        raise ArgumentError("backend", f"'auto', since {library.name} runs the equations", quoted(how.backend))
    if how.workers != 1:
        raise ArgumentError("workers", f"1, since {library.name} has threads of its own", how.workers)


def run_foreign(
    run: Callable[[dict[str, Any]], Mapping[str, Any]],
    pair: Constants,
    values: Mapping[str, Any],
    tails: Mapping[str, tuple[int, ...]],
    shape: tuple[int, ...],
    library: Library,
) -> dict[str, ForeignArray]:
    """What `run`, a function of values by name, makes of a pair and of arrays of another library."""
    constants = {
        name: tuple(library.array(c) if isinstance(c, np.ndarray) else c for c in group)  # a number stays one
        if isinstance(group, tuple)
        else group
        for name, group in pair.values.items()
    }
    found = run({**constants, **values})
    if library.name == "jax":
        _teach_jax()
    results = {name: found[name] if isinstance(found[name], tuple) else (found[name],) for name in tails}
    return {name: library.joined(results[name], shape, tail) for name, tail in tails.items()}


@functools.cache
def _teach_jax() -> None:
    """Tell JAX what states are made of, so that its functions take and return them."""
    from jax.tree_util import register_pytree_node

    def parts(state: Any) -> tuple[tuple[Any, ...], tuple[tuple[str, ...], int]]:
        arrays = tuple(state.arrays().values())
        return arrays, (state.outputs, arrays[0].ndim - len(state.shape))

    def joined(state: Any, form: tuple[tuple[str, ...], int], arrays: Any) -> Any:
        names, axes = form  # of the first output, how many axes one sample has
        own = dict(zip(names, arrays, strict=True))
        shape = getattr(own[names[0]], "shape", ())  # JAX also asks for states of what is no array
        return state(own, tuple(shape[: len(shape) - axes]))

    for state in (PairState, PlanarState):
        register_pytree_node(state, parts, functools.partial(joined, state))
