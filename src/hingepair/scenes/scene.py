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

[time]                        # absent where the motion is a file's
start = 0                     # s
stop = 10
samples = 1001

[outputs]                     # optional: everything about body 2 unless given
names = ["R2", "omega2"]

Scenes in the plane z = 0 begin with `planar = true`: [pair] has u1 and u2 of two numbers each, and a name; [motion]
has x, y, phi (the angle of body 1), psi; the outputs are those of a PlanarPair.

Instead of expressions, the motion may be samples in a file, whose columns `hingepair.scenes.log_file` describes:

[motion]
file = "log.csv"              # or .npz, .parquet; relative to the scene file; the instants are its column t
differentiate = true          # optional: find the derivatives that the file lacks; else what needs them is not there
sequence = "XYZ"              # optional: of Euler angles

Or it may be integrated (E12) from the angular velocity of body 1 and the hinge rate, as expressions `omega1` and
`psi_dot` or as samples: `hingepair.scenes.rate_expressions` and `hingepair.scenes.rate_file` have the layouts.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, SceneError, choices, quoted
from hingepair.evaluation.plan import ACCELERATION, PLANAR, POSE, SPATIAL, VELOCITY, check_outputs, outputs_of
from hingepair.integration.trajectory import span
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.states import PairState, PlanarState
from hingepair.scenes.explain import ScenePlan
from hingepair.scenes.expression_motion import ExpressionMotion
from hingepair.scenes.known_motion import Rows
from hingepair.scenes.pair_table import Motion, read_motion, read_outputs, read_pair, read_planar
from hingepair.scenes.tables import read_tables
from hingepair.symbolic.jets import Expr
from hingepair.symbolic.time_functions import Coordinates

if TYPE_CHECKING:
    from hingepair.validation.report import CrossValidation

_TABLES = ("title", "planar", "pair", "motion", "time", "outputs")
_LEVELS = {"v": VELOCITY, "omega": VELOCITY, "a": ACCELERATION, "alpha": ACCELERATION}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SceneResult:
    """A scene evaluated: `t`, `state`, and every attribute of the state (R2, S2, d, v2, ...).

    Attributes:
        t: instants; shape (samples,) s.
        state: the PairState, or PlanarState, at these instants.
    """

    t: NDArray[np.float64]
    state: PairState | PlanarState

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_") and name not in {"t", "state"} and hasattr(type(self.state), name):
            return getattr(self.state, name)
        known = ", ".join(("t", "state", *self.state.outputs))
        raise AttributeError(f"SceneResult has no {name!r}; it has {known}")

    def __repr__(self) -> str:
        return f"SceneResult({span(self.t)}, state={self.state!r})"

    def __dir__(self) -> list[str]:
        return ["t", "state", *(name for name in dir(type(self.state)) if not name.startswith("_"))]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A pair, its motion, and the instants to evaluate it at.

    Attributes:
        path: the file it came from.
        title: what it is, in a sentence.
        pair: the pair, a HingePair or, in the plane, a PlanarPair.
        motion: where the motion comes from; knows the instants.
        outputs: what `evaluate` computes unless told; None for everything about body 2 that the motion allows.
    """

    path: Path
    title: str
    pair: HingePair | PlanarPair
    motion: Motion
    outputs: tuple[str, ...] | None

    @property
    def space(self) -> HingePair:
        """The pair in space."""
        return self.pair if isinstance(self.pair, HingePair) else self.pair.to_spatial()

    @property
    def kind(self) -> str:
        """Whether the outputs are those of a plane or of space."""
        return SPATIAL if isinstance(self.pair, HingePair) else PLANAR

    @property
    def sequence(self) -> str | None:
        """Euler sequence of body 1; None where its attitude does not come as three Euler angles."""
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
        """The SymPy expressions by coordinate: x, y, z, phi_x, phi_y, phi_z, psi; in the plane x, y, phi, psi.

        Raises:
            ArgumentError: the motion does not come as expressions.
        """
        motion = self._by_expressions()
        return dict(zip(motion.names, motion.expressions, strict=True))

    def times(self) -> NDArray[np.float64]:
        """The instants; shape (samples,) s."""
        return self.motion.t

    def coordinates(self, t: ArrayLike) -> Coordinates:
        """The coordinates and their exact derivatives at any instants.

        Args:
            t: instants [s]; shape (...).

        Returns:
            (q, qd, qdd), tuples of seven (in the plane four): arrays of t's shape, Python floats for what does not
            depend on t. Samples where an expression has no real value are NaN.

        Raises:
            ArgumentError: the motion does not come as expressions.
        """
        return self._by_expressions().coordinates(t)

    def evaluate(self, outputs: Iterable[str] | None = None) -> SceneResult:
        """The pair's state at the scene's instants.

        Args:
            outputs: names out of R2, S2, d, v2, omega2, a2, alpha2, R1, S1, v1, omega1, a1, alpha1, or in the plane
                R2, phi2, d, v2, omega2, a2, alpha2; those of the scene file unless given, and without these
                everything about body 2 that the motion allows. Only the derivatives that the outputs need are
                computed.

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
        names = self.outputs if outputs is None else check_outputs(outputs, self.kind)
        level = self.motion.level
        for name in names or ():
            if _level(name) > level:
                known = tuple(output for output in outputs_of(self.kind) if _level(output) <= level)
                hint = "; motion.differentiate = true gives the others"
                raise ArgumentError("outputs", choices(known) + hint, quoted(name))
        return names, level if names is None else max(map(_level, names))

    def _by_expressions(self) -> ExpressionMotion:
        if not isinstance(self.motion, ExpressionMotion):
            wanted = "a scene whose motion is coordinates as expressions in t"
            raise ArgumentError("motion", wanted, f"one whose motion is {self.motion.origin}")
        return self.motion


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a TOML file; the layout stands at the top of `hingepair.scenes.scene`.

    Raises:
        SceneError: the file cannot be read as a scene; names file, table and key, in one line.
        MissingDependencyError: the pair is a robot's, and example-robot-data is not installed.
    """
    tables = read_tables(path)
    tables.check_keys(_TABLES)
    planar = read_planar(tables)
    motion = read_motion(tables, Path(path).parent, planar)
    outputs = read_outputs(tables.table("outputs", required=False), PLANAR if planar else SPATIAL)
    pair = read_pair(tables.table("pair"), planar)
    scene = Scene(Path(path), tables.text("title", default=pair.name), pair, motion, outputs)
    try:
        scene._wanted(None)
    except ArgumentError as error:
        raise SceneError(tables.table("outputs").label("names"), error.expected, error.got) from None
    return scene


def load_pair(path: str | os.PathLike[str]) -> HingePair | PlanarPair:
    """The pair of a scene file alone: its motion is not read and need not be there.

    Raises:
        SceneError: the file cannot be read, or its pair; names file, table and key, in one line.
        MissingDependencyError: the pair is a robot's, and example-robot-data is not installed.
    """
    tables = read_tables(path)
    tables.check_keys(_TABLES)
    return read_pair(tables.table("pair"), read_planar(tables))


def scene_files(path: str | os.PathLike[str]) -> tuple[Path, ...]:
    """The files that a scene is read from: its own, and the log of its motion where it has one.

    Raises:
        SceneError: the file cannot be read.
    """
    file = read_tables(path).table("motion", required=False).values.get("file")
    return (Path(path), Path(path).parent / file) if isinstance(file, str) else (Path(path),)


def _level(output: str) -> int:
    """The derivatives that an output needs."""
    return _LEVELS.get(output.rstrip("12"), POSE)
