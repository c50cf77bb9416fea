"""Motion by rates: the angular velocity of body 1 and the hinge rate, integrated (E12).

As expressions in t:

[motion]
omega1 = ["0.1*sin(t)", 0, "w"]  # rad/s; in a planar scene one expression
psi_dot = "0.5*cos(t)"           # rad/s
x = "3*t"                        # and y, z, m; 0 unless given
S1_0 = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]  # optional: attitude of body 1 at the start; in a planar scene phi_0, rad
psi_0 = 0.2                      # optional, rad
frame = "body"                   # optional: the axes of omega1, "world" unless given
method = "magnus6"               # optional, as for `integrate`
tol = 1e-12                      # optional: largest error, rad
[motion.constants]               # optional
w = 1.5

As samples in a file, with columns t, omega1_x, omega1_y, omega1_z, psid, and as far as known x, v1_x, a1_x, ...,
alpha1_x, ..., psidd (`hingepair.sample_file`):

[motion]
file = "gyro.csv"
integrate = true
S1_0 = ...                       # and psi_0, frame, method as above
differentiate = true             # optional: find the derivatives that the file lacks
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.antiderivative import antiderivative
from hingepair.arrays import check_choice, read_only
from hingepair.backend import choose
from hingepair.coordinates import Coordinates, compile_coordinates, exact
from hingepair.differentiate import check_instants, differentiate
from hingepair.errors import ArgumentError, SceneError
from hingepair.expression_motion import check_real_values, read_constants, read_expression, read_instants
from hingepair.integration import FRAMES
from hingepair.jets import Expr
from hingepair.motion import BodyMotion
from hingepair.rotations import check_rotation
from hingepair.routes import METHODS, Course, check_reached, hinge_angles, space_attitudes
from hingepair.sample_file import ARRAYS, Columns, SampleFile
from hingepair.samples import BodySamples, Rows, Samples
from hingepair.scene_file import Table
from hingepair.signals import Constant, Function, Signal
from hingepair.signals import Samples as SampledSignal
from hingepair.trajectory import rotations
from hingepair.trajectory_state import turned

Float64Array: TypeAlias = NDArray[np.float64]

TOLERANCE: Final = 1e-12
"""Of scenes whose rates are expressions [rad]."""

ORDER: Final = 6
"""Of the derivatives of samples."""

_OMEGA: Final = ("omega1[0]", "omega1[1]", "omega1[2]")
_START: Final = ("S1_0", "psi_0", "frame", "method")
_NAMES: Final = ("omega1", "psid", "alpha1", "psidd", "R1", "v1", "a1")
_COLUMNS: Final = {name: ARRAYS.get(name, (name,)) for name in _NAMES}


@dataclass(frozen=True, slots=True, eq=False)
class IntegratedMotion:
    """A motion found from rates.

    Attributes:
        t: instants; shape (N,) s.
        given: the motion at these instants.
        method: how it was found.
        error_estimate: how far attitude and psi are off at the worst instant [rad].
    """

    t: Float64Array
    given: BodySamples
    method: str
    error_estimate: float

    @property
    def level(self) -> int:
        """The highest derivative that there is."""
        return self.given.level

    @property
    def sequence(self) -> None:
        """None: the attitude is no three Euler angles."""
        return

    @property
    def turning(self) -> str:
        """How body 1 turns, for a reader."""
        return f"omega1 and psi' integrated by {self.method}, error about {self.error_estimate:.1g} rad"

    def samples(self, rows: Rows, order: int) -> Samples:
        """The motion at some of the instants, with derivatives up to an order."""
        return self.given.part(rows, order)


def read_rate_expressions(table: Table, time: Table) -> IntegratedMotion:
    """The motion whose rates the table [motion] has as expressions.

    Raises:
        SceneError: a value cannot be used; names file, table and key.
    """
    table.check_keys((*_START, "tol", "omega1", "psi_dot", "x", "y", "z", "constants"))
    t, constants = read_instants(time), read_constants(table)
    turning = tuple(read_expression(_entries(table, "omega1"), key, constants) for key in _OMEGA)
    hinge = (read_expression(table, "psi_dot", constants),)
    point = tuple(read_expression(table, key, constants) if key in table.values else exact(0) for key in "xyz")
    check_real_values(table, (*_OMEGA, "psi_dot", "x", "y", "z"), (*turning, *hinge, *point))
    omega, alpha = _columns(turning, t, 1)
    psid, psidd = _columns(hinge, t, 1)
    known = dict(zip(("R1", "v1", "a1"), _columns(point, t, 2), strict=True))
    known |= {"omega1": omega, "alpha1": alpha, "psid": psid[:, 0], "psidd": psidd[:, 0]}
    whole = antiderivative(hinge[0])
    if whole is not None:
        known["psi"] = _columns((whole,), t, 0)[0][:, 0]
    signals = (
        Function("omega1", lambda times: _columns(turning, times, 0)[0], (3,)),
        Function("psi_dot", lambda times: _columns(hinge, times, 0)[0][:, 0], ()),
    )
    return _integrated(table, t, signals, known, table.number("tol") if "tol" in table.values else TOLERANCE)


def read_rate_file(table: Table, folder: Path) -> IntegratedMotion:
    """The motion whose rates are in the file that the table [motion] names.

    Raises:
        SceneError: a key of the table, the file or one of its columns cannot be used; names it.
        MissingDependencyError: the file is a .parquet and pyarrow is not installed.
    """
    table.check_keys((*_START, "file", "integrate", "differentiate"))
    completed = table.values.get("differentiate", False)
    if not isinstance(completed, bool):
        table.fail("differentiate", "true or false")
    file = SampleFile(folder / table.text("file"))
    columns = file.columns()
    for column in columns:
        if column != "t" and not any(column in own for own in _COLUMNS.values()):
            file.fail(column, "columns of rates and of R1, since motion.integrate is true", "a column")
    if "t" not in columns:
        file.fail("t", "a column", "no such column")
    known = _arrays(file, columns)
    try:
        t = check_instants("t", columns["t"], ORDER if completed else 0)
    except ArgumentError as error:
        file.fail("t", error.expected, error.got)
    if completed:
        known = _completed(t, known)
    if "v1" not in known:
        file.fail("v1_x", "a column beside x (or differentiate = true)", "no such column")
    signals = SampledSignal(t, known["omega1"]), SampledSignal(t, known["psid"])
    return _integrated(table, t, signals, known, None)


def _integrated(
    table: Table,
    t: Float64Array,
    signals: tuple[Signal, Signal],
    known: Mapping[str, Float64Array],
    tol: float | None,
) -> IntegratedMotion:
    """The motion from rates; `known` are R1 and derivatives at the instants, and psi from t = 0 where it is exact."""
    body = _choice(table, "frame", FRAMES) == "body"
    course = Course(t, _choice(table, "method", METHODS), tol, choose("auto", 1), body)
    omega, psid = signals if "psi" not in known else (signals[0], Constant(np.zeros(())))
    try:
        found = space_attitudes(course, omega, psid, _attitude(table))
        hinge = hinge_angles(course, psid, table.number("psi_0") if "psi_0" in table.values else 0.0, found.steps)
        check_reached(tol, found.error, hinge.error)
        error = max(found.error(), hinge.error())
    except ArgumentError as fault:
        if isinstance(fault, SceneError):
            raise
        raise SceneError(table.label(fault.name.removesuffix("(t)")), fault.expected, fault.got) from None
    psi = hinge.values if "psi" not in known else hinge.values + (known["psi"] - known["psi"][0])
    S1 = rotations(found.values)
    rates = {name: known[name] for name in ("omega1", "alpha1") if name in known}
    if body:
        rates = {name: turned(S1, values) for name, values in rates.items()}
    body1, angles = {"R": known["R1"], "S": S1, "v": known["v1"], "omega": rates["omega1"]}, [psi, known["psid"]]
    if {"alpha1", "psidd", "a1"} <= known.keys():
        body1 |= {"a": known["a1"], "alpha": rates["alpha1"]}
        angles.append(known["psidd"])
    given = BodySamples(BodyMotion(**body1), tuple(angles))
    return IntegratedMotion(read_only(t), given, course.method, error)


def _entries(table: Table, key: str) -> Table:
    """The three entries of a list, by the names omega1[0], ..."""
    values = table.values.get(key)
    if not isinstance(values, list) or len(values) != 3:
        table.fail(key, "three numbers or expressions in t")
    return Table(table.file, table.name, {f"{key}[{i}]": value for i, value in enumerate(values)})


def _columns(expressions: tuple[Expr, ...], t: Float64Array, order: int) -> list[Float64Array]:
    """Values and derivatives of expressions, shape (N, k) each."""
    derivatives = _compiled(expressions, order)(t)
    return [np.stack([np.broadcast_to(np.asarray(c, float), t.shape) for c in row], axis=-1) for row in derivatives]


@functools.lru_cache(maxsize=16)
def _compiled(expressions: tuple[Expr, ...], order: int) -> Callable[[ArrayLike], Coordinates]:
    return compile_coordinates(expressions, order)


def _arrays(file: SampleFile, columns: Columns) -> dict[str, Float64Array]:
    """What the file has, by name; a body 1 that stays at the origin where it has no R1."""
    found = {}
    for name, own in _COLUMNS.items():
        there = [column for column in own if column in columns]
        for column in own:
            if column not in columns and (there or name in {"omega1", "psid"}):
                file.fail(column, f"a column beside {there[0]}" if there else "a column", "no such column")
        if there:
            found[name] = np.stack([columns[column] for column in own], axis=-1) if len(own) > 1 else columns[own[0]]
    for name in ("omega1", "psid"):
        bad = np.argwhere(~np.isfinite(found[name].reshape(len(columns["t"]), -1)))
        if bad.size:
            sample, i = bad[0]
            file.fail(_COLUMNS[name][i], "finite numbers, to be integrated", f"nan or inf at sample {sample}")
    if "R1" not in found:
        found |= dict.fromkeys(("R1", "v1", "a1"), np.zeros((len(columns["t"]), 3)))
    return found


def _completed(t: Float64Array, known: dict[str, Float64Array]) -> dict[str, Float64Array]:
    """The same with the derivatives that are missing."""
    found = dict(known)
    for names in (("omega1", "alpha1"), ("psid", "psidd"), ("R1", "v1", "a1"), ("v1", "a1")):
        if not found.keys() >= set(names):
            columns = found[names[0]].reshape(t.size, -1).T
            each = zip(*(differentiate(t, column, ORDER) for column in columns), strict=True)
            shape = found[names[0]].shape
            for name, derivative in zip(names[1:], each, strict=False):
                found.setdefault(name, np.stack(derivative, axis=-1).reshape(shape))
    return found


def _choice(table: Table, key: str, known: tuple[str, ...]) -> str:
    value = table.text(key, default=known[0])
    try:
        check_choice(key, value, known)
    except ArgumentError as error:
        raise SceneError(table.label(key), error.expected, error.got) from None
    return value


def _attitude(table: Table) -> Float64Array:
    if "S1_0" not in table.values:
        return np.eye(3)
    S1_0 = np.array(table.numbers("S1_0", 3, 3), dtype=float)
    check_rotation("S1_0", S1_0)
    return S1_0
