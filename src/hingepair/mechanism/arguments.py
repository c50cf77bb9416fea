"""Checks of the arguments of a robot's methods: coordinates, the motion of the base, wrenches on links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError, choices, nearest, quoted
from hingepair.numeric.array_libraries import Library, check_sample_shape, is_foreign, library_of
from hingepair.numeric.arrays import broadcast_shape, columns_by_name, is_square_list, is_table, is_zero, vectors
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.forward_kinematics import read_component

Coordinates: TypeAlias = ArrayLike | Mapping[str, Any]
"""One array of shape (..., dof), a table with the joints' names, or a value by each joint's name."""

BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME: Final = {
    "R1": "R",
    "S1": "S",
    "v1": "v",
    "omega1": "omega",
    "a1": "a",
    "alpha1": "alpha",
}
"""Attributes of a BodyMotion by the names of the inputs that describe the base's motion."""

RESTING_BASE_VALUE_BY_INPUT_NAME: Final[Mapping[str, tuple[float, ...]]] = {
    **dict.fromkeys(("R1", "v1", "omega1", "a1", "alpha1"), (0.0, 0.0, 0.0)),
    "S1": (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
}
"""Inputs of a base that rests at the origin, by name."""

ZERO_BASE_LOAD_BY_INPUT_NAME: Final[Mapping[str, tuple[float, ...]]] = dict.fromkeys(
    ("force1", "torque1"), (0.0, 0.0, 0.0)
)
"""Inputs of a base without loads, by name."""


class InputValues(NamedTuple):
    """Checked arguments of a robot's method: `value_by_input`, a dict of the values in the form that generated
    programs take, `shape_by_argument`, a dict of the shapes of the sample axes, and `library`, the array library,
    which is None for NumPy.

    Attributes:
        value_by_input: values by input name: arrays with the components last, or tuples of components (numbers or
            arrays).
        shape_by_argument: shape of the samples, by the argument's name.
        library: library of the arrays; None for NumPy arrays and numbers.
        label_by_input: what users call an input, where it is not its name.
    """

    value_by_input: dict[str, Any]
    shape_by_argument: dict[str, tuple[int, ...]]
    library: Library | None
    label_by_input: Mapping[str, str] | None = None


def read_arguments(
    joint_names: tuple[str, ...],
    coordinates: Mapping[str, Any],
    base_motion: BodyMotion | None,
    needed_inputs: Iterable[str],
    labelled_loads: Mapping[str, Any],
) -> InputValues:
    """Check the arguments of a robot's method, and return them as InputValues, the form that generated programs take.
    `coordinates` is a dict of q, qd, qdd or tau by name, `base_motion` is a BodyMotion or None (a base at rest), and
    `labelled_loads` is a dict of (value, name for messages) by input name. Raise an ArgumentError if an argument
    cannot be used.

    Args:
        joint_names: names of the joints with a coordinate, in order.
        coordinates: q, qd, qdd or tau by argument name.
        base_motion: the motion of the base; None where it rests at the origin.
        needed_inputs: names of the inputs that the outputs need.
        labelled_loads: forces and torques by input name: a value, and its name for messages.

    Raises:
        ArgumentError: an argument cannot be used; the error names it and the joint.
    """
    for name, value in coordinates.items():
        if value is None:
            raise ArgumentError(name, "values of the joints, since the method needs them", None)
    base = _base_arrays(base_motion, needed_inputs)
    loads = {label: value for value, label in labelled_loads.values() if is_foreign(value)}
    motion = {f"base_motion.{BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME[name]}": value for name, value in base.items()}
    library = common_library({**coordinates, **motion, **loads})
    parts: dict[str, Any] = {}
    shapes: dict[str, tuple[int, ...]] = {}
    for name, value in coordinates.items():
        parts[name], shapes[name] = read_coordinates(name, value, joint_names, library)
    if base_motion is not None:
        parts |= base
        shapes["base_motion"] = base_motion.shape
    for name, (value, label) in labelled_loads.items():
        parts[name], shapes[label] = _read_vector(label, value)
    labels = {name: f"base_motion.{BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME[name]}" for name in base}
    labels |= {name: label for name, (_, label) in labelled_loads.items()}
    return InputValues(parts, shapes, library, labels)


def common_library(arguments: Mapping[str, Any]) -> Library | None:
    """Return the array library, such as JAX, of `arguments`, a dict by argument name; return None if all are numbers
    and NumPy arrays. An argument may itself be a dict of values by joint. Raise an ArgumentError if arrays of two
    libraries are mixed.

    Raises:
        ArgumentError: they are arrays of two libraries; names one of them.
    """
    leaves: dict[str, Any] = {}
    for name, value in arguments.items():
        if isinstance(value, Mapping):
            leaves |= {f"{name}[{joint!r}]": one for joint, one in value.items()}
        else:
            leaves[name] = value
    if not any(is_foreign(value) for value in leaves.values()):
        return None
    return library_of(leaves)


def read_coordinates(
    name: str, value: Any, joint_names: tuple[str, ...], library: Library | None
) -> tuple[Any, tuple[int, ...]]:
    """Check a value (an array, a table such as a DataFrame, or a dict by joint) of the argument `name`: q, qd, qdd or
    tau. Return (values, shape of the sample axes); the values are an array with one column for each joint, or a tuple
    with one component for each joint. Raise an ArgumentError if the value cannot be used. `library` is None or the
    library of the arrays that are not NumPy arrays.

    Args:
        name: name of the argument: q, qd, qdd or tau.
        value: one array, a table, or values by the joint's name.
        joint_names: names of the joints with a coordinate, in order.
        library: library of the arrays that are not NumPy's.

    Raises:
        ArgumentError: the value cannot be used; the error names the argument and the joint.
    """
    if is_table(value):
        columns = coordinate_columns(name, value, joint_names)
        value = dict(zip(joint_names, columns.values(), strict=True))
    if isinstance(value, Mapping):
        return _read_by_joint(name, value, joint_names)
    if library is not None and is_foreign(value):
        check_sample_shape(name, value, len(joint_names))
        return tuple(value[..., k] for k in range(len(joint_names))), tuple(value.shape[:-1])
    count = len(joint_names)
    if count > 1 and is_square_list(value, count):
        expected = "an array of states (numpy.array(...)), or a dict of arrays by the joints' names"
        raise ShapeError(name, expected, f"{count} arrays of {count} numbers, which could be either")
    try:
        array = vectors(name, value, count)
    except ShapeError as error:
        expected = f"{error.expected}, a column for each of {_joint_list(joint_names)}"
        if isinstance(value, tuple | list) and len(value) == len(joint_names):
            expected += " (numbers and arrays that broadcast: a dict by the joints' names)"
        raise ShapeError(name, expected, error.got) from None
    return array, array.shape[:-1]


def coordinate_columns(name: str, table: Any, joint_names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Return the columns of a table (such as a DataFrame) that hold the argument `name` (q, qd, qdd or tau), as a
    dict of arrays by column name, in the order of `joint_names`. Raise an ArgumentError if columns are missing.
    """
    endings = {"qd": ("_dot", "d"), "qdd": ("_ddot", "dd")}.get(name, ("",))
    families = [tuple(f"{joint}{ending}" for joint in joint_names) for ending in endings]
    return columns_by_name(name, table, families, last_family=joint_names)


def _read_by_joint(name: str, values: Mapping[str, Any], joint_names: tuple[str, ...]) -> tuple[Any, tuple[int, ...]]:
    """Check `values`, a dict by joint, which was given as the argument `name`. Return (components, shape of the
    sample axes); the components are a tuple in the order of `joint_names`. Raise an ArgumentError if a joint is
    unknown or missing, or if a value cannot be used.
    """
    for joint in values:
        if joint not in joint_names:
            expected = choices(joint_names) if joint_names else "no joint, since none moves"
            raise ArgumentError(name, expected + nearest(str(joint), joint_names), quoted(joint))
    for joint in joint_names:
        if joint not in values:
            raise ArgumentError(f"{name}[{joint!r}]", "a number or an array", "none")
    parts = tuple(
        values[joint] if is_foreign(values[joint]) else read_component(f"{name}[{joint!r}]", values[joint])
        for joint in joint_names
    )
    shapes = {f"{name}[{joint!r}]": tuple(np.shape(part)) for joint, part in zip(joint_names, parts, strict=True)}
    return parts, broadcast_shape(shapes)


def _joint_list(names: Sequence[str]) -> str:
    """Return names of joints as text for a message: all of them up to eight, else six and their number."""
    return ", ".join(names) if len(names) <= 8 else f"{', '.join(names[:6])}, ... ({len(names)} joints)"


def _base_arrays(base_motion: BodyMotion | None, needed_inputs: Iterable[str]) -> dict[str, Any]:
    """Return those arrays of a BodyMotion that are among `needed_inputs`, as a dict by input name such as "R1"; for
    None, return an empty dict. If the motion has only a pose, velocities and accelerations are not needed. Raise an
    ArgumentError if `base_motion` is not a BodyMotion, or if a needed array is missing.
    """
    if base_motion is None:
        return {}
    if not isinstance(base_motion, BodyMotion):
        raise ArgumentError("base_motion", "a BodyMotion", quoted(base_motion))
    arrays = {}
    at_rest = all(getattr(base_motion, letter) is None for letter in ("v", "omega", "a", "alpha"))
    for name in needed_inputs:
        if name in BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME and (name in {"R1", "S1"} or not at_rest):
            letter = BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME[name]
            arrays[name] = getattr(base_motion, letter)
            if arrays[name] is None:
                expected = f"a value, as in BodyMotion(..., {letter}=...): an output needs it"
                raise ArgumentError(f"base_motion.{letter}", expected, None)
    return arrays


def _read_vector(name: str, value: Any) -> tuple[Any, tuple[int, ...]]:
    """Check a force or a torque, an array of shape (..., 3) or the number 0, and return (value, shape of the sample
    axes). The number 0 becomes a tuple of three zeros. Raise an ArgumentError for the argument `name` if the value
    has another shape.
    """
    if is_zero(value):
        return (0.0, 0.0, 0.0), ()
    if is_foreign(value):
        check_sample_shape(name, value, 3)
        return value, tuple(value.shape[:-1])
    array = vectors(name, value, 3)
    return array, array.shape[:-1]


def read_wrenches(wrenches: Any, links: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Check the argument `wrenches`, None or a dict of pairs by link, and return a dict of (force, torque) by link,
    which is empty for None. Raise an ArgumentError for a link that is not a key of `links`, or for a value that is
    not a pair. The forces and torques are not checked.

    Raises:
        ArgumentError: an unknown link, or no pair of vectors; the error names it.
    """
    if wrenches is None:
        return {}
    if not isinstance(wrenches, Mapping):
        raise ArgumentError("wrenches", "(force, torque) by the link's name", quoted(wrenches))
    for link, value in wrenches.items():
        if link not in links:
            link_names = tuple(links)
            raise ArgumentError("wrenches", choices(link_names) + nearest(str(link), link_names), quoted(link))
        if not isinstance(value, tuple | list) or len(value) != 2:
            raise ArgumentError(f"wrenches[{link!r}]", "a pair (force, torque)", quoted(value))
    return {link: (value[0], value[1]) for link, value in wrenches.items()}


def check_out_names(out: Any, output_names: Sequence[str]) -> None:
    """Check that the argument `out` is None or a dict whose keys are among `output_names`; raise an ArgumentError if
    not.

    Raises:
        ArgumentError: names the output.
    """
    if out is None:
        return
    if not isinstance(out, Mapping):
        raise ArgumentError("out", "a dict of arrays by output name", quoted(out))
    for name in out:
        if name not in output_names:
            raise ArgumentError("out", f"arrays by names out of {', '.join(output_names)}", quoted(name))
