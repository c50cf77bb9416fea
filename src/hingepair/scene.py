"""Scenes: a pair and its motion as functions of time, from a TOML file.

title = "one sentence that says what it is"      # optional

[pair]
u1 = [0.5, 0.2, 0.1]          # hinge point in body 1's axes, m
u2 = [-0.25, 0.1, 0.3]        # hinge point in body 2's axes, m
n = [1, 0, 0]                 # hinge axis in body 1's axes, of any length
home = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]    # optional: body 2 against body 1 at psi = 0
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

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.coordinates import Coordinates
from hingepair.errors import ArgumentError, SceneError
from hingepair.explain import ScenePlan
from hingepair.expression_motion import ExpressionMotion, read_expression_motion
from hingepair.jets import Expr
from hingepair.kinematics import COORDINATES
from hingepair.pair import HingePair
from hingepair.plan import ACCELERATION, POSE, VELOCITY, check_outputs
from hingepair.samples import Rows
from hingepair.scene_file import Table, read_tables
from hingepair.state import PairState

if TYPE_CHECKING:
    from hingepair.cross_validation import CrossValidation

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
    """A pair, its motion, and the instants to evaluate it at.

    Attributes:
        path: the file it came from.
        title: what it is, in a sentence.
        pair: the pair.
        motion: where the motion comes from; knows the instants.
        outputs: what `evaluate` computes unless told; None for everything about body 2 that the motion allows.
    """

    path: Path
    title: str
    pair: HingePair
    motion: ExpressionMotion
    outputs: tuple[str, ...] | None

    @property
    def sequence(self) -> str | None:
        """Euler sequence of body 1; None where its attitude does not come as Euler angles."""
        return self.motion.sequence

    @property
    def start(self) -> float:
        """First instant [s]."""
        return float(self.motion.t[0])

    @property
    def stop(self) -> float:
        """Last instant [s]."""
        return float(self.motion.t[-1])

    @property
    def samples(self) -> int:
        """Number of instants."""
        return self.motion.t.size

    @property
    def expressions(self) -> dict[str, Expr]:
        """The SymPy expressions by coordinate: x, y, z, phi_x, phi_y, phi_z, psi.

        Raises:
            ArgumentError: the motion does not come as expressions.
        """
        return dict(zip(COORDINATES, self._by_expressions().expressions, strict=True))

    def times(self) -> NDArray[np.float64]:
        """The instants; shape (samples,) s."""
        return self.motion.t

    def coordinates(self, t: ArrayLike) -> Coordinates:
        """The coordinates and their exact derivatives at any instants.

        Args:
            t: instants [s]; shape (...).

        Returns:
            (q, qd, qdd), tuples of seven: arrays of t's shape, Python floats for what does not depend on t. Samples
            where an expression has no real value are NaN.

        Raises:
            ArgumentError: the motion does not come as expressions.
        """
        return self._by_expressions().coordinates(t)

    def evaluate(self, outputs: Iterable[str] | None = None) -> SceneResult:
        """The pair's state at the scene's instants.

        Args:
            outputs: names out of R2, S2, d, v2, omega2, a2, alpha2, R1, S1, v1, omega1, a1, alpha1; those of the
                scene file unless given, and without these everything about body 2 that the motion allows. Only the
                derivatives that the outputs need are computed.

        Raises:
            ArgumentError: an unknown output, or one that needs derivatives which the motion does not have.
        """
        names, order = self._wanted(outputs)
        samples = self.motion.samples(slice(None), order)
        return SceneResult(self.motion.t, samples.forward_kinematics(self.pair, names))

    def plan(self, outputs: Iterable[str] | None = None) -> ScenePlan:
        """What `evaluate` computes and what it leaves out, and why; print it.

        Args:
            outputs: as for `evaluate`.

        Raises:
            ArgumentError: as for `evaluate`.
        """
        names, order = self._wanted(outputs)
        return self.motion.samples(slice(1), order).plan(self.pair, names, self.motion.level)

    def cross_validate(self, most: int | None = None) -> CrossValidation:
        """The pair's motion by the equations and by Pinocchio, compared.

        Args:
            most: so many instants at most, evenly spread; all unless given.

        Raises:
            MissingDependencyError: Pinocchio is not installed.
        """
        rows: Rows = slice(None)
        if most is not None and self.samples > most:
            rows = np.linspace(0, self.samples - 1, most).astype(np.intp)
        return self.motion.samples(rows, self.motion.level).cross_validate(self.pair)

    def _wanted(self, outputs: Iterable[str] | None) -> tuple[tuple[str, ...] | None, int]:
        """The outputs, None for all of body 2, and the derivatives of the motion that they need."""
        names = self.outputs if outputs is None else check_outputs(outputs)
        return names, self.motion.level if names is None else max((_level(name) for name in names), default=POSE)

    def _by_expressions(self) -> ExpressionMotion:
        return self.motion


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a TOML file; the layout stands at the top of `hingepair.scene`.

    Raises:
        SceneError: the file cannot be read as a scene; names file, table and key, in one line.
        MissingDependencyError: the pair is a robot's, and example-robot-data is not installed.
    """
    tables = read_tables(path)
    tables.check_keys(_TABLES)
    time = tables.table("time")
    outputs = _outputs(tables.table("outputs", required=False))
    pair = _pair(tables.table("pair"))
    motion = read_expression_motion(tables.table("motion"), time)
    return Scene(Path(path), tables.text("title", default=pair.name), pair, motion, outputs)


def _pair(table: Table) -> HingePair:
    if "robot" in table.values or "joint" in table.values:
        table.check_keys(("robot", "joint", "u1", "u2", "n", "home", "name"))
        for key in table.values:
            if key not in {"robot", "joint"}:
                table.fail(key, "nothing beside robot and joint")
        return _robot_pair(table)
    table.check_keys(("u1", "u2", "n", "home", "name", "robot", "joint"))
    values: dict[str, Any] = {key: table.numbers(key, 3) for key in ("u1", "u2", "n")}
    if "home" in table.values:
        values["home"] = table.numbers("home", 3, 3)
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
