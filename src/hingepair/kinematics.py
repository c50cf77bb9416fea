"""Forward kinematics: arrays in, a plan of steps over them, a PairState out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Set
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.arrays import broadcast_shape, real_array, result_dtype, vectors
from hingepair.backend import How
from hingepair.blocks import Components, Values, components_of, compute
from hingepair.errors import ArgumentError, DtypeError, ShapeError, choices
from hingepair.euler import find_sequence
from hingepair.motion import BodyMotion
from hingepair.plan import OUTPUTS, Plan, check_outputs, default_outputs, make_plan
from hingepair.state import PairState, layout_of

COORDINATES = ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")

Outputs: TypeAlias = Iterable[str] | None
Out: TypeAlias = Mapping[str, NDArray[Any]] | None


class Constants(NamedTuple):
    """What a pair brings: u1, u2 and n, and home where it is not the identity, by component.

    Attributes:
        values: components by name; floats where the pair is one.
        arrays: the same as arrays, with the components last.
        shape: leading shape of the pair; () for one pair.
    """

    values: Values
    arrays: Values
    shape: tuple[int, ...]

    @property
    def single(self) -> bool:
        """Whether it is one pair."""
        return self.shape == ()


PARTS = {"q": ("R1", "phi", "psi"), "qd": ("v1", "phid", "psid"), "qdd": ("a1", "phidd", "psidd")}
_OF_COORDINATES = {part: name for name, parts in PARTS.items() for part in parts}
_LETTERS = {"R1": "R", "S1": "S", "v1": "v", "omega1": "omega", "a1": "a", "alpha1": "alpha"}
_OF_BODY1 = {name: f"body1.{letter}" for name, letter in _LETTERS.items()} | {"psid": "psid", "psidd": "psidd"}


def from_coordinates(
    pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, out: Out, sequence: str, how: How
) -> PairState:
    """The pair's state from the seven coordinates and as many derivatives as are given (E1-E10)."""
    if qdd is not None and qd is None:
        raise ArgumentError("qd", "the first derivatives beside the second", None)
    if sequence != "XYZ":
        find_sequence(sequence)
    given = {name: value for name, value in zip(PARTS, (q, qd, qdd), strict=True) if value is not None}
    if "q" not in given:
        raise ArgumentError("q", "coordinates", None)
    single = out is None and _seven_floats(given)
    parts: Mapping[str, Components | NDArray[Any]]
    parts = single or {name: coordinates(name, value) for name, value in given.items()}
    values: Values = {}
    for name, seven in parts.items():
        point, angles, hinge = PARTS[name]
        if isinstance(seven, np.ndarray):
            values[point], values[angles], values[hinge] = seven[..., 0:3], seven[..., 3:6], seven[..., 6]
        else:
            values[point], values[angles], values[hinge] = seven[0:3], seven[3:6], seven[6]
    if outputs is None and not out:
        plan = make_plan(default_outputs(len(given) - 1), sequence, "home" in pair.values)
    else:
        names = _wanted(outputs, out, len(given) - 1)
        plan = _plan(names, sequence, values.keys() | pair.values.keys(), _OF_COORDINATES)
    if single and pair.single:
        return _evaluate_one(plan, {**pair.values, **values}, how)
    shapes = {name: _leading(name, seven) for name, seven in parts.items()}
    return _evaluate(plan, pair, values, shapes, out, how)


def from_body1(
    pair: Constants, body1: BodyMotion, psi: Any, psid: Any, psidd: Any, outputs: Outputs, out: Out, how: How
) -> PairState:
    """The pair's state from the motion of body 1 and the hinge angle with its derivatives (E1, E2, E5-E9)."""
    if not isinstance(body1, BodyMotion):
        raise ArgumentError("body1", "a BodyMotion", body1)
    if psidd is not None and psid is None:
        raise ArgumentError("psid", "the first derivative beside the second", None)
    if psi is None:
        raise ArgumentError("psi", "hinge angles", None)
    given = {"psi": psi, "psid": psid, "psidd": psidd}
    hinge = {name: component(name, value) for name, value in given.items() if value is not None}
    arrays = {name: array for name, letter in _LETTERS.items() if (array := getattr(body1, letter)) is not None}
    given_names = hinge.keys() | arrays.keys() | pair.values.keys()
    plan = _plan(_wanted(outputs, out, len(hinge) - 1), None, given_names, _OF_BODY1)
    if out is None and body1.shape == () and pair.single and _in_doubles(arrays, hinge):
        one = {name: tuple(array.ravel().tolist()) for name, array in arrays.items()}
        return _evaluate_one(plan, {**pair.values, **one, **hinge}, how)
    shapes = {"body1": body1.shape, **{name: np.shape(value) for name, value in hinge.items()}}
    return _evaluate(plan, pair, {**arrays, **hinge}, shapes, out, how)


def coordinates(name: str, value: Any) -> Components | NDArray[Any]:
    """A tuple of seven broadcastable coordinates, or one array of shape (..., 7)."""
    if isinstance(value, tuple) and len(value) == len(COORDINATES):
        return tuple(component(f"{name}[{i}]", part) for i, part in enumerate(value))
    try:
        return vectors(name, value, len(COORDINATES))
    except ShapeError as error:
        raise ShapeError(name, f"{error.expected}, or a tuple of seven coordinates", error.got) from None


def component(name: str, value: ArrayLike) -> Any:
    """One coordinate: a Python number stays one, so that it follows the dtype of the arrays beside it."""
    if type(value) is float or type(value) is int:
        return float(value)
    return real_array(name, value)


def _seven_floats(given: Mapping[str, Any]) -> dict[str, Components] | None:
    """The coordinates as Python floats, where each of q, qd, qdd is one state in float64."""
    parts = {}
    for name, value in given.items():
        if type(value) is np.ndarray and value.shape == (7,) and value.dtype.char == "d":
            parts[name] = tuple(value.tolist())
        elif type(value) is tuple and len(value) == len(COORDINATES) and all(type(c) is float for c in value):
            parts[name] = value
        else:
            return None
    return parts


def _in_doubles(arrays: Mapping[str, NDArray[Any]], hinge: Mapping[str, Any]) -> bool:
    return all(type(v) is float for v in hinge.values()) and all(v.dtype.char == "d" for v in arrays.values())


def _leading(name: str, seven: Components | NDArray[Any]) -> tuple[int, ...]:
    if isinstance(seven, np.ndarray):
        return seven.shape[:-1]
    return broadcast_shape({f"{name}[{i}]": np.shape(c) for i, c in enumerate(seven)})


def _wanted(outputs: Outputs, out: Out, level: int) -> tuple[str, ...]:
    """What to compute: the names asked for, or the level's defaults and whatever `out` has room for."""
    if out is not None and not isinstance(out, Mapping):
        raise ArgumentError("out", "a dict of arrays by output name", out)
    room = tuple(out or ())
    for name in room:
        if name not in OUTPUTS:
            raise ArgumentError("out", choices(tuple(OUTPUTS)), name)
    if outputs is None:
        return tuple(dict.fromkeys((*default_outputs(level), *room))) if room else default_outputs(level)
    names = check_outputs(outputs)
    for name in room:
        if name not in names:
            raise ArgumentError("out", f"arrays for nothing but the outputs named ({', '.join(names)})", name)
    return names


def _plan(names: tuple[str, ...], sequence: str | None, given: Set[str], sources: Mapping[str, str]) -> Plan:
    home = "home" in given
    plan = make_plan(names, sequence, home)
    if plan.inputs <= given:
        return plan
    for name in names:
        for missing in sorted(make_plan((name,), sequence, home).inputs - given):
            raise ArgumentError(sources[missing], f"a value, since output {name} needs it", None)
    return plan


def _evaluate_one(plan: Plan, values: Values, how: How) -> PairState:
    """One state in Python floats: no array but the one that holds the results."""
    if how.compiles_one():
        from hingepair.compiled import one_state

        return PairState._of_one(one_state(plan, values), layout_of(plan.outputs))
    plan.run(values)
    numbers: list[float] = []
    for name in plan.outputs:
        numbers.extend(values[name])
    return PairState._of_one(np.array(numbers), layout_of(plan.outputs))


def _evaluate(
    plan: Plan, pair: Constants, values: Values, shapes: Mapping[str, tuple[int, ...]], out: Out, how: How
) -> PairState:
    dtype = result_dtype(c for group in values.values() for c in (group if isinstance(group, tuple) else (group,)))
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    arrays = {}
    for name in plan.outputs:
        if out is not None and name in out:
            arrays[name] = _room(f"out[{name!r}]", out[name], (*shape, *OUTPUTS[name].tail), dtype)
        else:
            arrays[name] = np.empty((*shape, *OUTPUTS[name].tail), dtype)
    if out is not None:
        _check_apart(out, values)
    if how.compiles(math.prod(shape)):
        from hingepair.compiled import compute as compute_compiled

        compute_compiled(plan, {**pair.arrays, **values}, arrays, shape, dtype, how.workers)
    else:
        groups = {name: group for name, group in {**pair.values, **values}.items() if name in plan.inputs}
        parts = {name: _components(name, group) for name, group in groups.items()}
        compute(plan.run, parts, arrays, shape, dtype, how.workers)
    return PairState(arrays, shape)


def _components(name: str, group: Any) -> Any:
    """A group as the equations take it: a component, or a tuple of components."""
    if not isinstance(group, np.ndarray) or name.startswith("psi"):
        return group
    return components_of(group, 2 if name == "S1" else 1)


def _room(name: str, array: Any, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    if not isinstance(array, np.ndarray):
        raise ArgumentError(name, "an array to write into", array)
    if array.shape != shape:
        raise ShapeError(name, f"shape {shape}", f"shape {array.shape}")
    if array.dtype != dtype:
        raise DtypeError(name, f"dtype {dtype.name}", f"dtype {array.dtype}")
    if not array.flags.writeable:
        raise ArgumentError(name, "a writable array", "a read-only one")
    return array


def _check_apart(out: Mapping[str, NDArray[Any]], groups: Values) -> None:
    """Refuse an output that lies over an input or over another output: blocks would read what they wrote."""
    taken = [
        (name, c)
        for name, group in groups.items()
        for c in (group if isinstance(group, tuple) else (group,))
        if isinstance(c, np.ndarray)
    ]
    for name, array in out.items():
        for other, c in taken:
            if np.may_share_memory(array, c) and np.shares_memory(array, c):
                raise ArgumentError(f"out[{name!r}]", "memory of its own", f"an array that overlaps {other}")
        taken.append((f"out[{name!r}]", array))
