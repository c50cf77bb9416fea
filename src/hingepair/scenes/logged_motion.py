"""Motion by samples: what a file of samples says, and derivatives found from them where that is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, SceneError
from hingepair.numeric.arrays import read_only
from hingepair.numeric.finite_differences import check_instants, differentiate, unwrap
from hingepair.pair.body_motion import BodyMotion
from hingepair.rotations.angular_velocity import angular_velocity_from_samples
from hingepair.rotations.matrices import quaternion_to_matrix
from hingepair.scenes.expression_motion import read_sequence
from hingepair.scenes.known_motion import BodySamples, CoordinateSamples, Rows, Samples
from hingepair.scenes.log_file import ARRAYS, Columns, SampleFile
from hingepair.scenes.tables import Table

ORDER = 6
"""Of the derivatives in the step between samples."""

Float64Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SampledMotion:
    """Samples at instants that need not be uniform.

    Attributes:
        t: instants; shape (N,) s.
        given: the motion at these instants.
    """

    t: Float64Array
    given: CoordinateSamples | BodySamples
    origin: ClassVar[str] = "samples in a file"

    @property
    def level(self) -> int:
        """The highest derivative that there is."""
        return self.given.level

    @property
    def sequence(self) -> str | None:
        """Euler sequence of body 1; None where its attitude is given as quaternions."""
        return self.given.sequence if isinstance(self.given, CoordinateSamples) else None

    @property
    def turning(self) -> str:
        """How body 1 turns, for a reader."""
        angles = f"phi_x, phi_y, phi_z turn about {', '.join(self.sequence)}" if self.sequence else None
        return angles or "attitude as quaternions"

    def samples(self, rows: Rows, order: int) -> Samples:
        """The motion at some of the instants, with derivatives up to an order."""
        return self.given.part(rows, order)


_POSITION = ("R1", "v1", "a1")
_HINGE = ("psi", "psid", "psidd")
_EULER = ("phi", "phid", "phidd")
_QUATERNION = ("quat_xyzw", "omega1", "alpha1")

Derivatives: TypeAlias = list[Float64Array | None]  # a quantity, its first and its second derivative; (N, k) each


def read_sampled_motion(table: Table, folder: Path) -> SampledMotion:
    """The motion in the file that the table [motion] names; derivatives that it lacks are found on request.

    What is missing is the derivative (`hingepair.differentiate`, order 6) of the highest one that is there: of the
    rates, or twice of the positions, angles (without their jumps by 2 pi) and attitudes.

    Args:
        table: [motion], with file, differentiate and sequence.
        folder: what the file's name is relative to.

    Raises:
        SceneError: a key of the table, the file or one of its columns cannot be used; names it.
        MissingDependencyError: the file is a .parquet and pyarrow is not installed.
    """
    table.check_keys(("file", "differentiate", "sequence", "integrate"))
    completed = table.values.get("differentiate", False)
    if not isinstance(completed, bool):
        table.fail("differentiate", "true or false")
    file = SampleFile(folder / table.text("file"))
    columns = file.columns()
    t = _instants(file, columns, ORDER if completed else 0)
    attitude = _attitude(file, columns)
    if attitude is _QUATERNION and "sequence" in table.values:
        table.fail("sequence", "nothing, since the file has quaternions")
    names = (_POSITION, attitude, _HINGE)
    parts = [
        [file.together(columns, ARRAYS.get(name, (name,)), name in {"R1", "psi"}) for name in own] for own in names
    ]
    if completed:
        parts = [_completed(file, t, own, part) for own, part in zip(names, parts, strict=True)]
    level = _level(file, names, parts)
    found = [[array for array in part[: level + 1] if array is not None] for part in parts]
    position, turning, hinge = found
    if attitude is _EULER:
        derivatives = tuple(_seven(*group) for group in zip(position, turning, hinge, strict=True))
        return SampledMotion(t, CoordinateSamples(t.size, derivatives, read_sequence(table)))
    turning[0] = _rotations(file, turning[0])
    linear = dict(zip(("R", "v", "a"), position, strict=False))
    angular = dict(zip(("S", "omega", "alpha"), turning, strict=False))
    return SampledMotion(t, BodySamples(BodyMotion(**linear, **angular), tuple(angle[:, 0] for angle in hinge)))


def _instants(file: SampleFile, columns: Columns, order: int) -> Float64Array:
    if "t" not in columns:
        file.fail("t", "a column", "no such column")
    try:
        return np.asarray(read_only(check_instants("t", columns["t"], order)))
    except ArgumentError as error:
        file.fail("t", error.expected, error.got)


def _attitude(file: SampleFile, columns: Columns) -> tuple[str, ...]:
    """Which of the two ways the attitude is given in; refuses columns of the other."""
    euler = any(column in columns for column in ARRAYS["phi"])
    own, other = (_EULER, _QUATERNION) if euler else (_QUATERNION, _EULER)
    if not euler and not any(column in columns for column in ARRAYS["quat_xyzw"]):
        file.fail("phi_x", "columns phi_x, phi_y, phi_z, or qx, qy, qz, qw", "neither")
    for column in (column for name in other for column in ARRAYS[name]):
        if column in columns:
            file.fail(column, f"nothing of this kind beside {ARRAYS[own[0]][0]}", "a column")
    return own


def _level(file: SampleFile, names: tuple[tuple[str, ...], ...], parts: list[Derivatives]) -> int:
    """The highest derivative of the motion; refuses derivatives of some parts without those of the others."""
    there = [[array is not None for array in part] for part in parts]
    level = max(i for own in there for i in range(3) if own[i])
    for own, name in zip(there, names, strict=True):
        for i in range(level + 1):
            if not own[i]:
                column = ARRAYS.get(name[i], (name[i],))[0]
                file.fail(column, "a column, beside rates of others (or differentiate = true)", "no such column")
    return level


def _completed(file: SampleFile, t: Float64Array, names: tuple[str, ...], part: Derivatives) -> Derivatives:
    """A quantity with both derivatives."""
    value, rate, second = part
    if rate is None:
        found = _derivatives(file, t, names[0], value)
        return [value, found[0], found[1] if second is None else second]
    return [value, rate, _derivatives(file, t, names[1], rate)[0] if second is None else second]


def _derivatives(
    file: SampleFile, t: Float64Array, name: str, value: Float64Array | None
) -> tuple[Float64Array, Float64Array]:
    """First and second derivative of columns; of an attitude, omega and alpha."""
    array = np.asarray(value)
    own = ARRAYS.get(name, (name,))
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        sample, i = bad[0]
        file.fail(own[i], "finite numbers, to be differentiated", f"{array[sample, i]} at sample {sample}")
    if name == "quat_xyzw":
        try:
            omega, alpha = angular_velocity_from_samples(t, _rotations(file, array), ORDER, with_alpha=True)
            return np.asarray(omega), np.asarray(alpha)
        except ArgumentError as error:
            if isinstance(error, SceneError):
                raise
            file.fail(", ".join(own), error.expected, error.got)
    angles = name in {"phi", "psi"}
    found = [differentiate(t, unwrap(column) if angles else column, ORDER) for column in array.T]
    return np.stack([first for first, _ in found], axis=-1), np.stack([second for _, second in found], axis=-1)


def _rotations(file: SampleFile, quat_xyzw: Float64Array) -> Float64Array:
    zero = np.flatnonzero((quat_xyzw == 0).all(axis=-1))
    if zero.size:
        file.fail("qx, qy, qz, qw", "quaternions that are not zero", f"a zero quaternion at sample {zero[0]}")
    return np.asarray(quaternion_to_matrix("quat_xyzw", quat_xyzw, scalar_first=False))


def _seven(*parts: Float64Array) -> tuple[float | Float64Array, ...]:
    """Seven coordinates; those that never change as one number."""
    columns = [np.ascontiguousarray(column) for part in parts for column in part.T]
    return tuple(float(column[0]) if (column == column[0]).all() else column for column in columns)
