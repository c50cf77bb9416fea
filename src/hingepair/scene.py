"""Scenes: a pair and its motion as functions of time, from a TOML file.

title = "one sentence that says what it is"      # optional

[pair]
u1 = [0.5, 0.2, 0.1]          # hinge point in body 1's axes, m
u2 = [-0.25, 0.1, 0.3]        # hinge point in body 2's axes, m
n = [1, 0, 0]                 # hinge axis in body 1's axes, of any length
home = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]    # optional: body 2 against body 1 at psi = 0
limits = [-1.5, 1.5]          # optional: of psi, rad, for the URDF and MJCF; the motion may pass them
name = "arm"                  # optional; or, instead of all these: robot = "...", joint = "..."

[motion]                      # numbers, or expressions in t
x = "3*t"
y = 0                         # and z, m
phi_x = "amplitude*sin(t)"    # and phi_y, phi_z: FIRST, SECOND and THIRD angle of the sequence, rad
psi = "pi/2*tanh(t)"          # rad
sequence = "XYZ"              # optional: one of 24, as SciPy writes them
[motion.constants]            # optional
amplitude = 0.5

[time]
start = 0                     # s
stop = 10
samples = 1001

[outputs]                     # optional: everything about body 2 unless given
names = ["R2", "omega2"]
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.coordinates import Coordinates, check_real, compile_coordinates, exact
from hingepair.errors import ArgumentError, SceneError
from hingepair.euler import find_sequence
from hingepair.explain import ScenePlan, explain
from hingepair.jets import Expr
from hingepair.kinematics import COORDINATES, PARTS
from hingepair.pair import HingePair
from hingepair.plan import ACCELERATION, POSE, VELOCITY, check_outputs, default_outputs, make_plan
from hingepair.scene_file import Table, read_tables
from hingepair.state import PairState

MAX_SAMPLES: Final = 10_000_000

_TABLES = ("title", "pair", "motion", "time", "outputs")
_LEVELS = {"v": VELOCITY, "omega": VELOCITY, "a": ACCELERATION, "alpha": ACCELERATION}


@dataclass(frozen=True, slots=True, eq=False)
class SceneResult:
    """A scene evaluated: `t`, `state`, and every attribute of the state (R2, S2, d, v2, ...).

    Attributes:
        t: instants; shape (samples,) s.
        state: the PairState at these instants.
    """

    t: NDArray[np.float64]
    state: PairState

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_") and name not in {"t", "state"} and hasattr(PairState, name):
            return getattr(self.state, name)
        known = ", ".join(("t", "state", *self.state.outputs))
        raise AttributeError(f"SceneResult has no {name!r}; it has {known}")

    def __dir__(self) -> list[str]:
        return ["t", "state", *(name for name in dir(PairState) if not name.startswith("_"))]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A pair, its seven coordinates as expressions in t, and the instants to evaluate them at.

    Attributes:
        path: the file it came from.
        title: what it is, in a sentence.
        pair: the pair.
        motion: SymPy expressions of x, y, z, phi_x, phi_y, phi_z, psi in t [m, rad].
        sequence: Euler sequence of body 1.
        start: first instant [s].
        stop: last instant [s].
        samples: number of instants.
        outputs: what `evaluate` computes unless told; None for everything about body 2.
    """

    path: Path
    title: str
    pair: HingePair
    motion: tuple[Expr, ...]
    sequence: str
    start: float
    stop: float
    samples: int
    outputs: tuple[str, ...] | None

    @property
    def expressions(self) -> dict[str, Expr]:
        """The SymPy expressions by coordinate: x, y, z, phi_x, phi_y, phi_z, psi."""
        return dict(zip(COORDINATES, self.motion, strict=True))

    def times(self) -> NDArray[np.float64]:
        """The instants start + k h; shape (samples,) s."""
        return np.linspace(self.start, self.stop, self.samples)

    def coordinates(self, t: ArrayLike) -> Coordinates:
        """The coordinates and their exact derivatives at any instants.

        Args:
            t: instants [s]; shape (...).

        Returns:
            (q, qd, qdd), tuples of seven: arrays of t's shape, Python floats for what does not depend on t. Samples
            where an expression has no real value are NaN.
        """
        return _compiled(self.motion, ACCELERATION)(t)

    def evaluate(self, outputs: Iterable[str] | None = None) -> SceneResult:
        """The pair's state at the scene's instants.

        Args:
            outputs: names out of R2, S2, d, v2, omega2, a2, alpha2, R1, S1, v1, omega1, a1, alpha1; those of the
                scene file unless given, and without these everything about body 2. Only the derivatives that the
                outputs need are computed.

        Raises:
            ArgumentError: an unknown output.
        """
        names, order = self._wanted(outputs)
        t = self.times()
        q, *rates = _compiled(self.motion, order)(t)
        if not any(isinstance(value, np.ndarray) for value in q):
            q = (np.full(t.shape, q[0]), *q[1:])
        return SceneResult(t, self.pair.forward_kinematics(q, *rates, outputs=names, sequence=self.sequence))

    def plan(self, outputs: Iterable[str] | None = None) -> ScenePlan:
        """What `evaluate` computes and what it leaves out, and why; print it.

        Args:
            outputs: as for `evaluate`.

        Raises:
            ArgumentError: an unknown output.
        """
        names, order = self._wanted(outputs)
        derivatives = _compiled(self.motion, order)(self.times()[:1])
        constant = set()
        for parts, seven in zip(PARTS.values(), derivatives, strict=False):
            still = [not isinstance(value, np.ndarray) for value in seven]
            constant |= {
                part for part, own in zip(parts, (still[:3], still[3:6], still[6:]), strict=True) if all(own)
            }
        constant |= {name for name, expr in self.expressions.items() if not expr.free_symbols}
        plan = make_plan(names or default_outputs(order), self.sequence, "home" in self.pair._constants.values)
        return explain(plan, order, frozenset(constant))

    def _wanted(self, outputs: Iterable[str] | None) -> tuple[tuple[str, ...] | None, int]:
        """The outputs, None for all of body 2, and the derivatives of the coordinates that they need."""
        names = self.outputs if outputs is None else check_outputs(outputs)
        return names, ACCELERATION if names is None else max((_level(name) for name in names), default=POSE)


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a TOML file; the layout stands at the top of `hingepair.scene`.

    Raises:
        SceneError: the file cannot be read as a scene; names file, table and key, in one line.
        MissingDependencyError: the pair is a robot's, and example-robot-data is not installed.
    """
    tables = read_tables(path)
    tables.check_keys(_TABLES)
    time = tables.table("time")
    time.check_keys(("start", "stop", "samples"))
    start, stop = time.number("start"), time.number("stop")
    if not 0 <= stop - start < np.inf:
        time.fail("stop", f"a number from start = {start!r} on, at a finite distance")
    samples = time.integer("samples", 1, MAX_SAMPLES)
    outputs = _outputs(tables.table("outputs", required=False))
    pair = _pair(tables.table("pair"))
    motion = tables.table("motion")
    return Scene(
        path=Path(path),
        title=tables.text("title", default=pair.name),
        pair=pair,
        motion=_motion(motion),
        sequence=_sequence(motion),
        start=start,
        stop=stop,
        samples=samples,
        outputs=outputs,
    )


def _pair(table: Table) -> HingePair:
    if "robot" in table.values or "joint" in table.values:
        table.check_keys(("robot", "joint", "u1", "u2", "n", "home", "name", "limits"))
        for key in table.values:
            if key not in {"robot", "joint"}:
                table.fail(key, "nothing beside robot and joint")
        return _robot_pair(table)
    table.check_keys(("u1", "u2", "n", "home", "name", "limits", "robot", "joint"))
    values: dict[str, Any] = {key: table.numbers(key, 3) for key in ("u1", "u2", "n")}
    if "home" in table.values:
        values["home"] = table.numbers("home", 3, 3)
    if "limits" in table.values:
        values["limits"] = table.numbers("limits", 2)
    if "name" in table.values:
        values["name"] = table.text("name")
    try:
        return HingePair(**values)
    except ArgumentError as error:
        raise SceneError(table.label(error.name), error.expected, error.got) from None


def _robot_pair(table: Table) -> HingePair:
    from hingepair.robots import load_robot_hinge

    robot, joint = table.text("robot"), table.text("joint")
    try:
        return load_robot_hinge(robot, joint)
    except ArgumentError as error:
        raise SceneError(table.label(error.name), error.expected, error.got) from None


def _motion(table: Table) -> tuple[Expr, ...]:
    table.check_keys((*COORDINATES, "sequence", "constants"))
    constants = _constants(table.table("constants", required=False))
    motion = tuple(_expression(table, key, constants) for key in COORDINATES)
    try:
        check_real([table.label(key) for key in COORDINATES], motion)
    except ArgumentError as error:
        raise SceneError(error.name, error.expected, error.got) from None
    return motion


def _expression(table: Table, key: str, constants: dict[str, float]) -> Expr:
    value = table.values.get(key)
    if not isinstance(value, str):
        if isinstance(value, bool) or not isinstance(value, int | float):
            table.fail(key, "a finite number or an expression in t")
        return exact(table.number(key))
    from hingepair.expressions import parse

    return parse(table.label(key), value, constants)


def _constants(table: Table) -> dict[str, float]:
    from hingepair.expressions import constant_name_fault

    for key in table.values:
        fault = constant_name_fault(key)
        if fault:
            raise SceneError(table.label(key), fault, key)
    return {key: table.number(key) for key in table.values}


def _sequence(table: Table) -> str:
    sequence = table.text("sequence", default="XYZ")
    try:
        find_sequence(sequence)
    except ArgumentError as error:
        raise SceneError(table.label("sequence"), error.expected, error.got) from None
    return sequence


def _outputs(table: Table) -> tuple[str, ...] | None:
    table.check_keys(("names",))
    if "names" not in table.values:
        return None
    names = table.values["names"]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        table.fail("names", 'a list of names such as ["R2", "v2"]')
    try:
        return check_outputs(names)
    except ArgumentError as error:
        raise SceneError(table.label("names"), error.expected, error.got) from None


def _level(output: str) -> int:
    """The derivatives that an output needs."""
    return _LEVELS.get(output.rstrip("12"), POSE)


@functools.lru_cache(maxsize=16)
def _compiled(motion: tuple[Expr, ...], order: int) -> Callable[[ArrayLike], Coordinates]:
    return compile_coordinates(motion, order)
