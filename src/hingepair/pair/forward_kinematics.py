"""Forward kinematics: the state of a pair from its coordinates, or from the motion of body 1."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.calls import Call, Out
from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.numeric.array_libraries import Library, foreign_components, is_foreign, library_of
from hingepair.numeric.arrays import broadcast_shape, columns_by_name, is_square_list, is_table, real_array, vectors
from hingepair.numeric.blocks import Components, Named
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import cached_call
from hingepair.plans.plan import (
    PLANAR_MOTION_KIND,
    SPATIAL_MOTION_KIND,
    MotionKind,
    Plan,
    check_outputs,
    default_outputs,
    make_plan,
)
from hingepair.plans.steps import LOG_COLUMN_NAMES_OF_Q_QD_QDD_BY_COORDINATE_NAMES
from hingepair.rotations.sequences import find_sequence

CoordinateInput: TypeAlias = ArrayLike | tuple[Any, ...]
"""q, qd or qdd: an array with the coordinates last, or a tuple of coordinates that broadcast."""
Outputs: TypeAlias = Iterable[str] | None

_NUMBER_WORD_BY_COORDINATE_COUNT = {4: "four", 7: "seven"}  # the numbers of coordinates, in messages
_DTYPE_CHARACTERS_COMPUTED_IN_FLOAT64 = "dbhilqBHILQ"  # dtypes that are computed in float64, by their characters
_FLOAT_ROW_SEQUENCE_TYPES = {tuple, list}  # sequences that `float_row` converts
_FLOAT_ROW_NUMBER_TYPES = {float, int, np.float64, np.int64, np.int32}  # numbers in them that it converts
# The attributes of BodyMotion by the names of inputs.
_MOTION_ATTRIBUTE_BY_BODY1_INPUT = {"R1": "R", "S1": "S", "v1": "v", "omega1": "omega", "a1": "a", "alpha1": "alpha"}
# The names of these inputs in messages.
_ARGUMENT_NAME_BY_BODY1_INPUT = {name: f"body1.{letter}" for name, letter in _MOTION_ATTRIBUTE_BY_BODY1_INPUT.items()}


class PairCoordinates(NamedTuple):
    """Coordinates of a pair and their derivatives, as read from the arguments q, qd and qdd, as a named tuple.
    `parts` and `shapes` are dicts with the keys "q", "qd" and "qdd", as far as given: `parts` holds arrays or tuples
    of components, `shapes` the leading shapes. `library` is the array library, or None for NumPy.

    Attributes:
        parts: q, qd and qdd by name, as far as given: tuples of components, or arrays with the components last.
        shapes: shapes of the samples, by the same names.
        library: array library of the components; None for NumPy arrays and numbers.
    """

    parts: Mapping[str, Components | NDArray[Any]]
    shapes: Mapping[str, tuple[int, ...]]
    library: Library | None = None


def read_pair_coordinates(kind: MotionKind, q: Any, qd: Any, qdd: Any, keep_foreign: bool = False) -> PairCoordinates:
    """Return the arguments q, qd and qdd (None if not given) as PairCoordinates; `kind` is the MotionKind of the
    pair, spatial or planar. Raise ArgumentError, ShapeError or DtypeError for unusable arguments. Arrays of libraries
    other than NumPy stay as they are if `keep_foreign`, and otherwise become NumPy arrays.
    """
    if qdd is not None and qd is None:
        raise ArgumentError("qd", "the first derivatives too, since the second are given", None)
    if q is None:
        raise ArgumentError("q", "coordinates", None)
    value_by_name = {"q": q} if qd is None else {"q": q, "qd": qd} if qdd is None else {"q": q, "qd": qd, "qdd": qdd}
    count = len(kind.coordinates)
    floats = {name: row for name, value in value_by_name.items() if (row := float_row(value, count)) is not None}
    if floats.keys() == value_by_name.keys():
        return PairCoordinates(floats, dict.fromkeys(floats, ()))
    leaves = {f"{name}[{i}]": c for name, v in value_by_name.items() if type(v) is tuple for i, c in enumerate(v)}
    library = (
        library_of({name: v for name, v in value_by_name.items() if type(v) is not tuple} | leaves)
        if keep_foreign
        else None
    )
    parts: dict[str, Any]
    if library is not None:
        parts = {name: foreign_components(name, v, count) for name, v in value_by_name.items()}
    else:
        parts = {name: _read_coordinates(name, value, kind.coordinates) for name, value in value_by_name.items()}
    return PairCoordinates(parts, {name: _leading_shape(name, part) for name, part in parts.items()}, library)


def _leading_shape(name: str, components: Components | NDArray[Any]) -> tuple[int, ...]:
    """Return the leading shape of an array with components on the last axis, or the common shape of a tuple of
    components. Raise ShapeError, which names the argument `name`, if the components do not broadcast.
    """
    if isinstance(components, np.ndarray):
        return components.shape[:-1]
    return broadcast_shape({f"{name}[{i}]": np.shape(c) for i, c in enumerate(components)})


def _read_coordinates(name: str, value: Any, coordinate_names: tuple[str, ...]) -> Components | NDArray[Any]:
    """Return the value of an argument q, qd or qdd (`name` says which) as a tuple of components if it is a tuple or a
    data frame, and otherwise as one array with the coordinates on the last axis. Raise ArgumentError, ShapeError or
    DtypeError for unusable values.
    """
    count = len(coordinate_names)
    several = f"{_NUMBER_WORD_BY_COORDINATE_COUNT[count]} coordinates"
    is_tuple = isinstance(value, tuple) and len(value) == count
    if (is_tuple and all(isinstance(part, list | tuple) and len(part) == count for part in value)) or (
        isinstance(value, list) and is_square_list(value, count)
    ):
        expected = f"an array of states (numpy.array(...)), or a tuple of arrays of {several}"
        raise ShapeError(name, expected, f"{count} sequences of {count} numbers, which could be either")
    if is_tuple:
        return tuple(read_component(f"{name}[{i}]", part) for i, part in enumerate(value))
    if is_table(value):
        columns = _coordinate_columns(name, value, coordinate_names)
        return tuple(read_component(f"{name}[{column!r}]", array) for column, array in columns.items())
    if isinstance(value, Mapping):
        expected = (
            f"{several} in the order ({', '.join(coordinate_names)}), as an array or a tuple of numbers and arrays"
        )
        raise DtypeError(name, expected, quoted(value))
    try:
        return vectors(name, value, count)
    except ShapeError as error:
        got = error.got
        if isinstance(value, tuple) and len(value) != count:
            got = f"a tuple of {len(value)}"
        elif isinstance(value, list) and len(value) == count:
            got = "a list of numbers and arrays: make it a tuple"
        raise ShapeError(name, f"{error.expected}, or a tuple of {several}", got) from None


def _coordinate_columns(name: str, table: Any, coordinate_names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Return the columns of a data frame `table` that hold q, qd or qdd (`name` says which), as a dict of arrays by
    column name, in the order of `coordinate_names`. Raise ArgumentError if a needed column is missing or a column has
    an unknown name.
    """
    column_names_by_level, endings = (
        LOG_COLUMN_NAMES_OF_Q_QD_QDD_BY_COORDINATE_NAMES[coordinate_names],
        {"q": (), "qd": ("_dot", "d"), "qdd": ("_ddot", "dd")}[name],
    )
    families = [
        column_names_by_level[name],
        *(tuple(f"{one}{ending}" for one in coordinate_names) for ending in endings),
    ]
    others = {column for family in column_names_by_level.values() for column in family}
    return columns_by_name(name, table, families, others, last_family=coordinate_names)


def spatial_columns(name: str, table: Any) -> tuple[str, ...]:
    """Return the names of the columns of a data frame `table` that hold q, qd or qdd of a HingePair (`name` says
    which), as a tuple in the order of the coordinates. Raise ArgumentError if a needed column is missing or a column
    has an unknown name.
    """
    return tuple(_coordinate_columns(name, table, SPATIAL_MOTION_KIND.coordinates))


def planar_columns(name: str, table: Any) -> tuple[str, ...]:
    """Return the names of the columns of a data frame `table` that hold q, qd or qdd of a PlanarPair (`name` says
    which), as a tuple in the order of the coordinates. Raise ArgumentError if a needed column is missing or a column
    has an unknown name.
    """
    return tuple(_coordinate_columns(name, table, PLANAR_MOTION_KIND.coordinates))


def float_row(value: Any, count: int) -> NDArray[np.float64] | None:
    """Return exactly `count` numbers, given as a NumPy array, list or tuple, as a float64 array of shape (count,).
    Return None for any other value, and for numbers of a dtype that is not computed in float64.
    """
    if type(value) is np.ndarray:
        is_supported = value.shape == (count,) and value.dtype.char in _DTYPE_CHARACTERS_COMPUTED_IN_FLOAT64
    else:
        is_supported = (
            type(value) in _FLOAT_ROW_SEQUENCE_TYPES
            and len(value) == count
            and _FLOAT_ROW_NUMBER_TYPES.issuperset(map(type, value))
        )
    try:
        return np.asarray(value, np.float64) if is_supported else None
    except OverflowError:
        return None


def read_component(name: str, value: Any) -> Any:
    """Return the value of one coordinate, the argument `name`: a Python number as a float, and any other value as an
    array of real numbers. A float takes the dtype of the arrays that it is combined with. Raise DtypeError if the
    value does not hold real numbers.
    """
    if type(value) is float or (type(value) is int and value.bit_length() < 1024):
        return float(value)
    return real_array(name, value)


def from_coordinates(
    kind: MotionKind,
    pair: Constants,
    q: Any,
    qd: Any,
    qdd: Any,
    outputs: Outputs,
    out: Out,
    sequence: str | None,
    execution: Execution,
) -> Any:
    """Compute the PairState or PlanarState of a pair from the coordinates q and, if they are not None, the
    derivatives qd and qdd (E1-E11). `kind` is the MotionKind of the pair, spatial or planar, `pair` holds its
    Constants, and `execution` says the backend and the number of threads. Results are written into the arrays
    of the dict `out`, if given. The compiled call is cached in `pair.prepared`. Raise ArgumentError for
    unusable arguments.
    """
    rows = (q,) if qd is None else (q, qd) if qdd is None else (q, qd, qdd)
    if type(outputs) is list:
        outputs = tuple(outputs)
    complete = qd is not None or qdd is None
    writes = out is None or type(out) is dict
    added = None if outputs is not None or out is None or not writes else tuple(out)  # outputs that `out` asks for
    key = None
    if execution.workers == 1 and complete and writes and (outputs is None or type(outputs) is tuple):
        key = outputs, added, sequence, execution.backend, len(rows)
        try:
            call: Call | None = pair.prepared.get(key)
        except TypeError:  # outputs that are not hashable, for which an error is raised below
            call = key = None
        if call is not None:
            state = call.rows(*rows) if out is None else call.rows(*rows, out=out)
            if state is not None:
                return state
    plan, coordinates = plan_from_coordinates(kind, pair, q, qd, qdd, outputs, out, sequence, keep_foreign=True)
    call = cached_call(pair, plan, tuple(coordinates.parts), execution.backend)
    if coordinates.library is not None:
        return call.run_foreign(coordinates.parts, coordinates.shapes, coordinates.library, out, execution.workers)
    if key is not None:
        pair.prepared[key] = call
    return call.run(coordinates.parts, coordinates.shapes, out, execution.workers)


def plan_from_coordinates(
    kind: MotionKind,
    pair: Constants,
    q: Any,
    qd: Any,
    qdd: Any,
    outputs: Outputs,
    out: Out,
    sequence: Any,
    keep_foreign: bool = False,
) -> tuple[Plan, PairCoordinates]:
    """Return (plan, coordinates): the Plan that computes the requested outputs from the coordinates, and the
    arguments q, qd and qdd as PairCoordinates. `kind` is the MotionKind of the pair, spatial or planar, and `pair`
    holds its Constants. Arrays of libraries other than NumPy are kept if `keep_foreign`. Raise ArgumentError for
    unusable arguments.
    """
    if kind is SPATIAL_MOTION_KIND and (type(sequence) is not str or sequence != "XYZ"):
        find_sequence(sequence)
    coordinates = read_pair_coordinates(kind, q, qd, qdd, keep_foreign)
    names = _requested_outputs(outputs, out, len(coordinates.parts) - 1, kind)
    return _checked_plan(names, pair, tuple(coordinates.parts), sequence, kind), coordinates


def from_body1(
    pair: Constants,
    body1: BodyMotion,
    psi: Any,
    psid: Any,
    psidd: Any,
    outputs: Outputs,
    out: Out,
    execution: Execution,
) -> Any:
    """Compute the PairState of a pair from the BodyMotion of body 1 and the hinge angle with its derivatives (E1, E2,
    E5-E9). `pair` holds the Constants of the pair, and `execution` says the backend and the number of threads.
    Results are written into the arrays of the dict `out`, if given. The compiled call is cached in `pair.prepared`.
    Raise ArgumentError for unusable arguments.
    """
    plan, values, shapes = plan_from_body1(pair, body1, psi, psid, psidd, outputs, out)
    library = library_of({_ARGUMENT_NAME_BY_BODY1_INPUT.get(name, name): value for name, value in values.items()})
    call = cached_call(pair, plan, tuple(values), execution.backend)
    if library is not None:
        return call.run_foreign(values, shapes, library, out, execution.workers)
    return call.run(values, shapes, out, execution.workers)


def plan_from_body1(
    pair: Constants, body1: BodyMotion, psi: Any, psid: Any, psidd: Any, outputs: Outputs, out: Out
) -> tuple[Plan, Named, dict[str, tuple[int, ...]]]:
    """Return (plan, values, shapes): the Plan that computes the requested outputs from the BodyMotion of body 1 and
    the hinge angle with its derivatives, a dict of the inputs of this plan, and a dict of the leading shapes of
    "body1", "psi" and the given derivatives of psi. `pair` holds the Constants of the pair. Raise ArgumentError for
    unusable arguments.
    """
    if not isinstance(body1, BodyMotion):
        raise ArgumentError("body1", "a BodyMotion", quoted(body1))
    if psidd is not None and psid is None:
        raise ArgumentError("psid", "the first derivative too, since the second is given", None)
    if psi is None:
        raise ArgumentError("psi", "hinge angles", None)
    angles = {name: v for name, v in {"psi": psi, "psid": psid, "psidd": psidd}.items() if v is not None}
    hinge = {name: v if is_foreign(v) else read_component(name, v) for name, v in angles.items()}
    arrays = {
        name: array
        for name, letter in _MOTION_ATTRIBUTE_BY_BODY1_INPUT.items()
        if (array := getattr(body1, letter)) is not None
    }
    names = _requested_outputs(outputs, out, len(hinge) - 1, SPATIAL_MOTION_KIND)
    plan = _checked_plan(names, pair, (*arrays, *hinge), None, SPATIAL_MOTION_KIND)
    shapes = {"body1": body1.shape, **{name: np.shape(value) for name, value in hinge.items()}}
    return plan, {**arrays, **hinge}, shapes


def _requested_outputs(outputs: Outputs, out: Out, level: int, kind: MotionKind) -> tuple[str, ...]:
    """Return a tuple of the names of the outputs to compute: `outputs`, or if this is None, the default outputs at
    the level (0 pose, 1 velocity, 2 acceleration) and the keys of the dict `out`. `kind` is the MotionKind of the
    pair, spatial or planar. Raise ArgumentError for unknown names.
    """
    if outputs is not None:
        names = check_outputs(outputs, kind.levels)
        check_out(out, names)
        return names
    check_out(out, tuple(kind.levels))
    return tuple(dict.fromkeys((*default_outputs(level, kind), *(out or ()))))


def check_out(out: Out, names: tuple[str, ...]) -> None:
    """Raise ArgumentError if `out` is neither None nor a mapping, or has a key that is not among the output `names`.

    Raises:
        ArgumentError: names the argument `out`.
    """
    if out is None:
        return
    if not isinstance(out, Mapping):
        raise ArgumentError("out", "a dict of arrays by output name", quoted(out))
    for name in out:
        if name not in names:
            raise ArgumentError("out", f"arrays for nothing but the outputs {', '.join(names)}", quoted(name))


def _checked_plan(
    names: tuple[str, ...], pair: Constants, input_names: tuple[str, ...], sequence: str | None, kind: MotionKind
) -> Plan:
    """Return the Plan that computes the outputs `names` from the inputs `input_names` and the Constants `pair`.
    `kind` is the MotionKind of the pair, spatial or planar; `sequence` is the Euler sequence or None. Raise
    ArgumentError, which names a missing input, if the inputs do not suffice.
    """
    home = "home" in pair.values
    plan = make_plan(names, sequence, home, kind=kind, given_names=input_names)
    known_names = {*input_names, *pair.values}
    if plan.inputs <= known_names:
        return plan
    for name in names:
        for missing in sorted(
            make_plan((name,), sequence, home, kind=kind, given_names=input_names).inputs - known_names
        ):
            argument = missing if "q" in input_names else _ARGUMENT_NAME_BY_BODY1_INPUT.get(missing, missing)
            raise ArgumentError(argument, f"a value, since output {name} needs it", None)
    return plan
