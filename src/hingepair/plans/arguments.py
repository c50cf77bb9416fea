"""The reader of arguments: of methods and prepared calls, of pairs, planar pairs and robots."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.binding import ArrayShape
from hingepair.errors import ArgumentError, ShapeError, choices, nearest, quoted
from hingepair.numeric.arrays import (
    broadcast_shape,
    is_table,
    is_zero,
    real_array,
    vectors,
)
from hingepair.plans.trees import COORDINATE_INPUTS

Coordinates: TypeAlias = ArrayLike | tuple[Any, ...] | Mapping[str, Any]
"""q, qd, qdd or tau: an array with the coordinates last; a tuple, or a dict by name, of numbers and arrays that
broadcast; or a table with a column for each."""

Outputs: TypeAlias = Iterable[str] | None

_LOADS: Final = ("force", "torque")  # beginnings of the arguments for which the number 0 is no load
_NUMBERS: Final = {float, int, np.float64, np.int64, np.int32}  # types; a row of such numbers becomes float64


class CoordinateNames(NamedTuple):
    """Names of the coordinates of a pair or a robot."""

    names: tuple[str, ...]  # in the order of q
    columns: Mapping[str, tuple[str, ...]] = {}  # of q, qd and qdd in saved tables, where they are no joints
    noun: str = "coordinates"
    leaders: Mapping[str, str] = {}  # whom joints without a coordinate follow, by their names

    def described(self) -> str:
        """Return the names as a phrase of a message."""
        few = self.names if len(self.names) <= 8 else (*self.names[:6], "...")
        return f"the {len(self.names)} {self.noun} {', '.join(few)}"

    def of_table(self, name: str, table: Any) -> dict[str, NDArray[Any]]:
        """Return the columns of a table that hold the argument `name`, by column name, in the order of q.

        Raises:
            ArgumentError: a column is missing, or unknown.
        """
        endings = {"qd": ("_dot", "d"), "qdd": ("_ddot", "dd")}.get(name, ("",))
        families = [tuple(f"{one}{ending}" for one in self.names) for ending in endings]
        if self.columns:
            families = [*dict.fromkeys((self.columns[name], *families))]
        names = [str(column) for column in table.columns]
        if {*names} == {*self.names}:  # as results have them, whose qdd is called by the names of the joints
            families.append(self.names)
        known = {"t"}.union(*self.columns.values(), *families)
        family = next((family for family in families if {*family} <= {*names}), None)
        if family is None or len({*names}) < len(names) or not known.issuperset(names):
            wanted = " or ".join(", ".join(family) for family in families)
            expected = f"the columns {wanted}, in any order (without names: .to_numpy())"
            raise ArgumentError(name, expected, f"the columns {', '.join(names)}")
        return {column: np.asarray(table[table.columns[names.index(column)]].to_numpy()) for column in family}


class Arguments(NamedTuple):
    """Arguments in the form that calls take."""

    values: dict[str, Any]  # by input: arrays with the components last, or tuples of numbers and arrays
    shapes: dict[str, ArrayShape]  # of the samples, by the name that messages use
    labels: Mapping[str, str]  # names of inputs in messages, where they differ


def read_arguments(
    given: Mapping[str, Any],
    sample_shapes: Mapping[str, ArrayShape],
    coordinates: CoordinateNames,
    labels: Mapping[str, str] | None = None,
) -> Arguments:
    """Check arguments, and return them in the form that calls take.

    Args:
        given: values by input name.
        sample_shapes: shape of one sample by input name.
        coordinates: names of the coordinates, for q, qd, qdd, tau and their changes.
        labels: names of inputs in messages, where they differ.
    """
    labels = labels or {}
    values, shapes = {}, {}
    for name, value in given.items():
        label, tail = labels.get(name, name), sample_shapes[name]
        is_coordinates = name.removeprefix("change_") in COORDINATE_INPUTS
        if value is None:
            expected = f"values of the {coordinates.noun}" if is_coordinates else "a value"
            raise ArgumentError(label, f"{expected}, since what is asked for needs it", None)
        if is_coordinates:
            values[name], shapes[label] = read_coordinates(label, value, coordinates)
        elif name.startswith(_LOADS) and tail and is_zero(value):
            values[name], shapes[label] = (0.0,) * tail[0], ()
        else:
            values[name], shapes[label] = _read_quantity(label, value, tail)
    return Arguments(values, shapes, labels)


def _read_quantity(name: str, value: Any, tail: ArrayShape) -> tuple[Any, ArrayShape]:
    """Return a scalar, vector or matrix as number or array, and the shape of its samples."""
    if not tail:
        component = read_component(name, value)
        return component, np.shape(component)
    array = vectors(name, value, *tail)
    return array, array.shape[: array.ndim - len(tail)]


def read_component(name: str, value: Any) -> Any:
    """Return a number as a float, which takes the dtype of the arrays it is combined with, and others as an array."""
    if type(value) is float or (type(value) is int and value.bit_length() < 1024):
        return float(value)
    return real_array(name, value)


def read_coordinates(name: str, value: Any, coordinates: CoordinateNames) -> tuple[Any, ArrayShape]:
    """Return q, qd, qdd or tau as an array or a tuple of components, and the shape of its samples.

    Raises:
        ArgumentError: the value cannot be used; names the argument, and the coordinate where it is one.
    """
    names = coordinates.names
    if (row := _float_row(value, len(names))) is not None:
        return row, ()
    if is_table(value):
        value = dict(zip(names, coordinates.of_table(name, value).values(), strict=True))
    if isinstance(value, Mapping):
        _check_keys(name, value, coordinates)
        return _components({f"{name}[{one!r}]": value[one] for one in names})
    is_tuple = isinstance(value, tuple) and len(value) == len(names)
    kinds = (list, tuple) if is_tuple else np.ndarray  # lists in a tuple and arrays in a list can be either
    rows = [part for part in value if isinstance(part, kinds)] if isinstance(value, list | tuple) else []
    is_square = all(getattr(row, "ndim", 1) == 1 and len(row) == len(names) for row in rows)
    if rows and is_square and len(rows) == len(value) == len(names) > 1:
        expected = f"an array of states (numpy.array(...)), or a tuple of arrays, one for each of {coordinates.noun}"
        raise ShapeError(name, expected, f"{len(names)} sequences of {len(names)} numbers, which could be either")
    if is_tuple:
        return _components({f"{name}[{k}]": part for k, part in enumerate(value)})
    try:
        array = vectors(name, value, len(names))
    except ShapeError as error:
        got = error.got
        if isinstance(value, tuple):
            got = f"a tuple of {len(value)}"
        elif isinstance(value, list) and len(value) == len(names):
            got = "a list of numbers and arrays: make it a tuple"
        expected = f"{error.expected}, or a tuple or a dict, of {coordinates.described()}"
        raise ShapeError(name, expected, got) from None
    return array, array.shape[:-1]


def _float_row(value: Any, count: int) -> NDArray[np.float64] | None:
    """Return floats in an array, or numbers in a list or a tuple, as one row of float64; None for all else."""
    if type(value) is np.ndarray:
        is_row = value.shape == (count,) and value.dtype.char == "d"
    else:
        is_row = type(value) in {tuple, list} and len(value) == count and _NUMBERS.issuperset(map(type, value))
    try:
        return np.asarray(value, np.float64) if is_row else None
    except OverflowError:
        return None


def _check_keys(name: str, values: Mapping[str, Any], coordinates: CoordinateNames) -> None:
    """Refuse a dict that lacks a coordinate, or has another key."""
    names = coordinates.names
    for key in values:
        if key not in names:
            expected = choices(names) if names else "no joint, since none moves"
            remark = nearest(str(key), names)
            if key in coordinates.leaders:
                remark = f" ({key} follows {coordinates.leaders[key]} and has no coordinate)"
            raise ArgumentError(name, expected + remark, quoted(key))
    absent = [one for one in names if one not in values]
    if absent:
        expected = "a number or an array" + ", 0 for no torque or force" * (name == "tau")
        more = f", nor for {', '.join(absent[1:4])}" + ", ..." * (len(absent) > 4) if len(absent) > 1 else ""
        raise ArgumentError(f"{name}[{absent[0]!r}]", expected, f"none{more}")


def _components(values: Mapping[str, Any]) -> tuple[Any, ArrayShape]:
    parts = {label: read_component(label, value) for label, value in values.items()}
    return tuple(parts.values()), broadcast_shape({label: tuple(np.shape(part)) for label, part in parts.items()})


# ---- what is asked for


def check_outputs(outputs: Any, known_names: Collection[str]) -> tuple[str, ...]:
    """Return the names of the argument `outputs`, or the only one, as a tuple without repetitions.

    Raises:
        ArgumentError: not a collection of known names.
    """
    try:
        names = (outputs,) if isinstance(outputs, str) else tuple(dict.fromkeys(outputs))
    except TypeError:
        names = ()
    known = tuple(known_names)
    if not names:
        raise ArgumentError("outputs", f"a tuple of names such as {known[:2]}", quoted(outputs))
    for name in names:
        if name not in known:
            raise ArgumentError("outputs", choices(known) + nearest(str(name), known), quoted(name))
    return names


def requested_outputs(
    outputs: Outputs, out: Any, known_names: Collection[str], default_names: Iterable[str]
) -> tuple[str, ...]:
    """Return the names of the outputs to compute: `outputs`, or by default the default names and those in `out`.

    Raises:
        ArgumentError: an unknown name, or an `out` for something else.
    """
    if outputs is not None:
        return check_outputs(outputs, known_names)
    more = (name for name in out if name in known_names) if isinstance(out, Mapping) else ()
    return tuple(dict.fromkeys((*default_names, *more)))


def check_out(out: Any, outputs: Sequence[str]) -> Mapping[str, Any] | None:
    """Return the argument `out` as arrays by name; one array stands for the only output.

    Raises:
        ArgumentError: neither arrays by the names of outputs, nor one array of one output.
    """
    if out is None or (type(out) is dict and out.keys() <= {*outputs}):
        return out
    if isinstance(out, np.ndarray) and len(outputs) == 1:
        return {outputs[0]: out}
    if not isinstance(out, Mapping):
        more = ", or one array" if len(outputs) == 1 else ""
        raise ArgumentError("out", f"a dict of arrays by output name{more}", quoted(out))
    for name in out:
        if name not in outputs:
            raise ArgumentError("out", f"arrays for nothing but the outputs {', '.join(outputs)}", quoted(name))
    return out


def renamed_out(out: Any, names: Mapping[str, str]) -> Any:
    """Return the argument `out` with other names for some outputs."""
    return {names.get(name, name): array for name, array in out.items()} if isinstance(out, Mapping) else out


def chosen_names(argument: str, names: Iterable[Any], accepted: Collection[str]) -> tuple[str, ...]:
    """Check the names of an argument, keys of a dict of arrays unless it is `wrt`; return them in the accepted order.

    Raises:
        ArgumentError: another name, or none.
    """
    names = (names,) if isinstance(names, str) else names
    kind, text = (Iterable, "names") if argument == "wrt" else (Mapping, "a dict of arrays, with names")
    chosen = [*names] if isinstance(names, kind) else []
    if not chosen or not all(name in accepted for name in chosen):
        raise ArgumentError(argument, f"{text} out of {', '.join(accepted)}", quoted(chosen or names))
    return tuple(name for name in accepted if name in chosen)
