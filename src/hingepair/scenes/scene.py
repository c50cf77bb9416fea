"""Scenes: a pair or a mechanism, its motion, and the instants to compute, from a TOML file.

docs/scenes.md describes the format.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.results import missing_attribute_error
from hingepair.equations.quantities import ACCELERATION, VELOCITY
from hingepair.errors import ArgumentError, SceneError, quoted
from hingepair.mechanism.bodies.hinge_load import HingeLoad, stop_range
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.results import RESULT_ROWS_PER_BLOCK, Record
from hingepair.motion.energy_balance import EnergyBalance
from hingepair.motion.trajectory import describe_instants
from hingepair.numeric.arrays import Float64Array, one_constant
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.scenes import suspicions
from hingepair.scenes.assembly import Acting, Assembly, Computed, Items, order_of
from hingepair.scenes.bodies import MECHANISM_TABLES, is_of_mechanism, read_mechanism, read_pair
from hingepair.scenes.forces import SceneForces
from hingepair.scenes.motions.functions import FunctionsOfTime, read_function_motion
from hingepair.scenes.motions.known import Known, Rows
from hingepair.scenes.motions.motion import Motion, limit_sentences, stop_sentences
from hingepair.scenes.motions.simulated import (
    Dynamics,
    read_dynamics,
    read_simulated_motion,
    simulated_motion,
    simulates,
)
from hingepair.scenes.numbers import NumberPath, keep_motion, number_path, with_numbers
from hingepair.scenes.tables import Table, read_constants, read_tables
from hingepair.tables.column_tables import column_table
from hingepair.tables.sheets import instant_text
from hingepair.tables.units import SI, Columns, Units, UnitsLike

if TYPE_CHECKING:
    from hingepair.motion.simulated import SimulatedRobotMotion
    from hingepair.symbolic.exact import Expr
    from hingepair.validation.report import CrossValidation


_COMMON: Final = ("title", "constants", "motion", "dynamics", "time", "outputs")
_OF_PAIRS: Final = (*_COMMON, "planar", "pair", "tolerances")
_OF_MECHANISMS: Final = (*_COMMON, *MECHANISM_TABLES)


@dataclass(frozen=True, slots=True)
class ScenePlan:
    """What a scene computes and skips."""

    #: names of the outputs that are computed
    outputs: tuple[str, ...]
    #: number of operations at each instant
    operations: int
    #: (what is left out, why)
    skipped: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        lines = [f"outputs: {', '.join(self.outputs)}", f"computed: {self.operations} operations at each instant"]
        lines += ["skipped:", *(f"  {what}: {why}" for what, why in self.skipped)] if self.skipped else []
        return "\n".join(lines)


class JointCoordinates(NamedTuple):
    """Coordinates (q, qd, qdd) of all joints at the instants; unknown derivatives are None."""

    #: shape (N, dof) rad or m
    q: NDArray[np.float64]
    #: first derivatives
    qd: NDArray[np.float64] | None = None
    #: second derivatives
    qdd: NDArray[np.float64] | None = None


class SceneResult(Record):
    """Results of a scene at its instants; an output that was not computed is None.

    Of a pair, every attribute of its state (R2, S2, d, v2, ...) and the coordinates; `result["tip"].R` is the
    position of a point. q, qd and qdd have shape (samples, 7), in the plane (samples, 4); psi, psid and psidd have
    shape (samples,). If the attitude of body 1 is not given by Euler angles, q is x, y, z, the quaternion qx, qy, qz,
    qw (qw >= 0) and psi; qd is v1, omega1 and psi'; qdd is a1, alpha1 and psi''. quat1 and quat2, shape (samples, 4),
    are the quaternions (x, y, z, w), w >= 0, of S1 and S2.

    Of a mechanism, `result["tool"].R` is the position of a frame; `result.R` holds the positions of all frames, with
    an axis of frames behind the axis of samples; likewise S, v, omega, a, alpha. q, qd, qdd and tau have shape
    (samples, dof), in the order of `scene.mechanism.names`. force1 and torque1, shape (samples, 3), act on the base
    about its reference point.

    Args:
        t: instants; shape (samples,) s.
        scene: the scene that was evaluated.
        known: the motion at the instants.
        computed: the outputs.
        first: index of the first instant; 0 except in blocks.
    """

    __slots__ = ("computed", "first", "known", "scene")

    def __init__(
        self, t: NDArray[np.float64], scene: Scene, known: Known, computed: Computed, first: int = 0
    ) -> None:
        arrays = computed.arrays | known.coordinates()
        super().__init__(t, arrays, scene.title, scene.files, scene.unit, scene.units)
        self.scene, self.known, self.computed, self.first = scene, known, computed, first

    @property
    def state(self) -> Any:
        """The computed states; None if no output needs them."""
        return self.computed.state

    def requested_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the requested outputs by name; shape (samples, ...). Coordinates are named like columns of a log."""
        return self.computed.arrays

    def __getitem__(self, name: str) -> Any:
        """Return the motion of a frame or of a point by its name, such as `result["tip"].R`, a strut such as
        `result["gas"].force`, or an output.
        """
        if name in self.computed.struts:
            return self.computed.struts[name]
        if self.state is None:
            raise ArgumentError("frame", "no frame, since no output is of one", quoted(name))
        return self.state[name]

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_") and name not in SceneResult.__slots__:
            with contextlib.suppress(KeyError):
                return self.scene.assembly.attribute(name, self.known, self.computed)
        raise missing_attribute_error(self, name)

    def _available_names(self) -> Iterable[str]:
        return (*self.recorded(), *("q", "qd", "qdd")[: self.known.level + 1])

    def __repr__(self) -> str:
        what = f"state={self.state!r}"
        if self.scene.pair is None:
            what = f"frames: {', '.join(self.state.frames) if self.state is not None else 'none'}"
        return f"SceneResult({describe_instants(self.t)}, {what})"


def load_scene(path: str | os.PathLike[str], log: Any = None) -> Scene:
    """Read a TOML scene file, whose format docs/scenes.md describes.

    Args:
        path: path of the scene file. Relative paths in the file start from the folder of the file.
        log: recorded motion in place of the file that [motion] names: a pandas DataFrame, an xarray Dataset or a dict
            of arrays with the columns of a log, or the path of another file. [motion] then needs no `file`; its other
            keys count as for that file.

    Returns:
        A `Scene`. Its method `evaluate()` computes the outputs at the instants of the scene.

    Raises:
        SceneError: the file cannot be read as a scene. The message is one line; it names the file and, if a key of
            the scene is wrong, the table and the key.
        MissingDependencyError: the file names a robot of example-robot-data, and that package is not installed.
    """
    return read_scene_file(path, log).checked()


def read_scene_file(path: str | os.PathLike[str], log: Any = None) -> Scene:
    """Return a scene whose keys and motion are read when they are needed, as `load_scene`; it may have no motion."""
    tables = read_tables(path)
    if log is not None:
        is_file = isinstance(log, str | os.PathLike)
        file = os.path.abspath(log) if is_file else column_table("log", log)
        motion = {**tables.table("motion", required=False).values, "file": file}
        tables = replace(tables, values={**tables.values, "motion": motion})
    return Scene(with_constants_evaluated(tables), Path(path))


class Scene:
    """Scene as read from a scene file: what moves, how, and when to look.

    Args:
        tables: contents of the file, with evaluated constants; expressions are kept as text.
        path: path of the scene file.
        made: properties that are known already, by name.
    """

    def __init__(self, tables: Table, path: Path, **made: Any) -> None:
        self.tables, self.path = tables, path
        self.__dict__.update(made)

    def checked(self) -> Scene:
        """Return the scene, once all of its keys are read and its motion is computed."""
        _ = self.assembly, self.dynamics, self.motion, self.title, self.units, self.outputs
        return self

    # ---- what the file says

    @lock_free_cached_property
    def assembly(self) -> Assembly:
        """What moves."""
        base = self.tables.table("dynamics", required=False).values.get("base")
        if not is_of_mechanism(self.tables):
            return Assembly(read_pair(self.tables), is_fixed=base == "fixed")
        frames = self.tables.table("mechanism", required=False).table("frames", required=False)
        robot = read_mechanism(self.tables, self.path.parent, base="free" if base in ("free", "pinned") else "fixed")
        return Assembly(robot, tuple(frames.values) or robot.tips)

    @lock_free_cached_property
    def dynamics(self) -> Dynamics:
        """What the table [dynamics] says, or what counts without it."""
        return read_dynamics(self.tables, self.assembly)

    @lock_free_cached_property
    def motion(self) -> Motion:
        """The motion and its instants."""
        tables, assembly, dynamics = self.tables, self.assembly, self.dynamics
        if self.is_simulated:
            return read_simulated_motion(tables, assembly, dynamics)
        if "file" in tables.table("motion").values:
            from hingepair.scenes.motions.logged import read_log

            motion = read_log(tables, self.path.parent, assembly)
        else:
            motion = read_function_motion(tables, assembly)
        return replace(motion, loads=dynamics.loads, wrenches=dynamics.wrenches)

    @lock_free_cached_property
    def title(self) -> str:
        """Title of the scene, a sentence."""
        return self.tables.text("title", default=self.assembly.name)

    @lock_free_cached_property
    def outputs(self) -> tuple[str, ...] | None:
        """Names of the outputs that `evaluate` computes by default; None for all of body 2, or for the motion of a
        robot's frames and moving joints.
        """
        outputs = self._outputs_table
        names = outputs.names("names", 'a list of names such as ["R2", "v2"], of a robot ["R", "tau"]')
        if names is not None:
            with outputs.naming("names"):
                self.assembly.request(names, self.motion)
        return names

    @lock_free_cached_property
    def units(self) -> Units:
        """Units of tables, plots and files unless others are asked for."""
        outputs = self._outputs_table
        with outputs.naming("units"):
            return Units(outputs.text("units")) if "units" in outputs.values else SI

    @property
    def _outputs_table(self) -> Table:
        table = self.tables.table("outputs", required=False)
        table.check_keys(("names", "units"))
        return table

    @lock_free_cached_property
    def gravity(self) -> tuple[float, ...]:
        """Acceleration of free fall, world axes [m/s^2]; (3,)."""
        return self.dynamics.gravity

    @property
    def constants(self) -> dict[str, float]:
        """Constants of the file by name, but those that depend on t."""
        constants = self.tables.constants.items()
        return {key: float(own) for key, own in constants if isinstance(own, float) or "t" not in own.names}

    @lock_free_cached_property
    def files(self) -> tuple[Path, ...]:
        """Absolute paths of the files that the scene is read from: its own, and those of its URDF and its log."""
        named = (("mechanism", "urdf"), ("motion", "file"))
        files = [self.tables.table(table, required=False).values.get(key) for table, key in named]
        others = (self.path.parent / file for file in files if isinstance(file, str))
        return tuple(file.absolute() for file in (self.path, *others))

    @property
    def has_motion(self) -> bool:
        """Whether there is [dynamics], [motion] with keys, or [motion] together with [time]."""
        keys = self.tables.table("motion", required=False).values
        return bool(keys) or "dynamics" in self.tables.values or {"motion", "time"} <= self.tables.values.keys()

    @property
    def is_simulated(self) -> bool:
        """Whether [dynamics] simulates the motion."""
        return simulates(self.tables, self.assembly)

    def refuse_linkage(self, reason: str) -> None:
        """Raise a SceneError if the scene has loops or struts."""
        for key in ("loop", "strut"):
            if key in self.tables.values:
                self.tables.refuse(f"[[{key}]]", f"no such table, since {reason}", "a linkage")

    # ---- what moves

    @property
    def pair(self) -> HingePair | PlanarPair | None:
        """The HingePair, or for a planar scene the PlanarPair; None in the scene of a mechanism."""
        pair: HingePair | PlanarPair | None = self.assembly.pair
        return pair

    @property
    def mechanism(self) -> Mechanism | None:
        """The robot, with the frames and the payload of the file; None in the scene of a pair."""
        return self.assembly.mechanism

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames of a mechanism that are computed by default; none of a pair."""
        return self.assembly.frames

    @property
    def space(self) -> HingePair:
        """The pair as a HingePair; a SceneError in the scene of a mechanism."""
        if self.pair is None:
            self.tables.refuse("pair", "the scene of a pair, which has a table [pair]", "the scene of a mechanism")
        return self.assembly.space

    @property
    def sequence(self) -> str | None:
        """Euler sequence of body 1, such as "XYZ"; None if its attitude is not given by three Euler angles."""
        return self.motion.source.sequence

    @property
    def dimensions(self) -> int:
        """Number of components of a vector such as gravity."""
        return self.assembly.dimensions

    def coordinates(self) -> JointCoordinates:
        """Return (q, qd, qdd) of the joints at all instants, each of shape (samples, dof); psi of a pair."""
        known = self.known(slice(None), self.motion.level)
        return JointCoordinates(*(known.array(order) for order in range(known.level + 1)))

    def known(self, rows: Rows, order: int) -> Known:
        """Return the motion at some of the instants, with derivatives up to `order`."""
        return self.motion.source.part(rows, order)

    @property
    def functions(self) -> FunctionsOfTime:
        """The coordinates as functions of time, those of body 1 unless it rests at the origin; raise an ArgumentError
        without them.
        """
        if self.pair is None or self.motion.functions is None:
            wanted = "a scene of a pair whose motion is functions of t"
            raise ArgumentError("motion", wanted, f"one whose motion is {self.motion.origin}")
        functions: FunctionsOfTime = self.motion.functions
        return functions

    @property
    def expressions(self) -> dict[str, Expr | None]:
        """SymPy expressions of the coordinates of a pair by name (x, y, z, phi_x, phi_y, phi_z, psi; in the plane x,
        y, phi, psi). The value of a coordinate given by way points is None.
        """
        import sympy

        return dict.fromkeys(self.assembly.base_names, sympy.S.Zero) | self.functions.expressions()

    @property
    def has_own_gravity(self) -> bool:
        """Whether [dynamics] gives gravity."""
        return "gravity" in self.tables.table("dynamics", required=False).values

    # ---- the instants

    @property
    def start(self) -> float:
        """First instant [s]."""
        return float(self.motion.t[0])

    @property
    def stop(self) -> float:
        """Last instant [s]."""
        return float(self.motion.t[-1])

    @property
    def span(self) -> str:
        """First and last instant as a short text such as 0..10."""
        return f"{instant_text(self.start)}..{instant_text(self.stop)}"

    @property
    def samples(self) -> int:
        """Number of instants."""
        return len(self.motion.t)

    @property
    def t(self) -> Float64Array:
        """All instants, read-only; shape (samples,) s."""
        return self.motion.t

    def spread(self, max_instants: int) -> Rows:
        """Return the indices of `max_instants` evenly spread instants, or of all if there are fewer."""
        return np.unique(np.linspace(0, self.samples - 1, min(self.samples, max_instants)).astype(np.intp))

    @property
    def backend(self) -> str:
        """Name of the backend for the whole scene and its blocks, which so agree to the bit."""
        return "auto" if self.samples <= RESULT_ROWS_PER_BLOCK else "compiled"

    # ---- variants

    def with_values(self, values: Mapping[str, float]) -> Scene:
        """Return the scene with other numbers; what they do not change is taken over.

        Args:
            values: numbers by their keys in the file, such as "pair.u1[0]", "dynamics.psi.damping" or
                "joint[1].body2.mass"; an expression is text, such as "deg(30)".

        Raises:
            ArgumentError: a key leads to no number of the scene.
            SceneError: there is no scene with these numbers.

        >>> import hingepair as hp
        >>> scene = hp.load_scene("models/landing_gear.toml").with_values({"pair.u1[0]": 0.3})
        >>> float(scene.pair.u1[0])
        0.3
        """
        entry = Table("values", "", {}, {})
        return self.changed([number_path(entry, self.tables.values, key) for key in values], [*values.values()])

    def changed(self, paths: Sequence[NumberPath], numbers: Sequence[Any]) -> Scene:
        """Return the scene with other numbers at these places of the file."""
        tables = replace(self.tables, values=with_numbers(self.tables.values, paths, numbers), constants={})
        made: dict[str, Any] = {}
        if {path[0] for path in paths} <= {"motion", "time", "outputs", "title"}:
            made["assembly"] = self.assembly
        if self.motion.simulated is None and keep_motion(paths):
            made["motion"] = self.motion
        return Scene(with_constants_evaluated(tables), self.path, **made).checked()

    # ---- results

    def evaluate(self, outputs: Iterable[str] | None = None) -> SceneResult:
        """Compute outputs at all instants of the scene.

        Args:
            outputs: names of outputs; only the derivatives that they need are computed. By default the outputs that
                the scene file names; if it names none, all outputs of body 2 that the motion allows, or the motion of
                a robot's frames and of the joints that move.

                Of a pair in space: R2, S2, d, v2, omega2, a2, alpha2, R1, S1, v1, omega1, a1, alpha1, and the
                quaternions quat1, quat2; in the plane: R2, phi2, d, v2, omega2, a2, alpha2; in both: the coordinates
                q, qd, qdd, psi, psid, psidd; of a point tip, its position, velocity and acceleration: tip, tip_v,
                tip_a; and with masses the forces that `forces` lists, such as hinge_torque.

                Of a robot: R, S, quat, d, v, omega, a or alpha for all frames of the scene; the name of a link, a
                joint or another frame for all motion of it; a name such as R_tool for one quantity of one frame; q,
                qd, qdd or tau for all joints; tau_elbow for tau of one joint; length, rate and force for all struts;
                the name of a strut, or length_gas, rate_gas or force_gas, for one; force1 and torque1, the load on
                the base.

        Returns:
            A SceneResult, whose attributes are the outputs.

        Raises:
            ArgumentError: an unknown output, one that needs what the motion does not have, or more instants than can
                be held in memory.
        """
        return self._evaluated(slice(None), self.request(outputs))

    def sampled(self, max_instants: int, outputs: Iterable[str] | None = None) -> SceneResult:
        """Compute outputs at evenly spread instants; the motion of the result has all derivatives of the scene.

        Args:
            max_instants: largest number of instants.
            outputs: as for `evaluate`.
        """
        return self._evaluated(self.spread(max_instants), self.request(outputs), self.motion.level)

    def blocks(self, outputs: Iterable[str] | None = None) -> Iterator[SceneResult]:
        """Yield a SceneResult for each block of 131,072 instants in turn, for scenes that do not fit into memory.

        The motion of each block has first derivatives if the scene's motion has them.

        Args:
            outputs: as for `evaluate`.
        """
        request = self.request(outputs)
        for start in range(0, self.samples, RESULT_ROWS_PER_BLOCK):
            rows = slice(start, start + RESULT_ROWS_PER_BLOCK)
            yield self._evaluated(rows, request, min(self.motion.level, VELOCITY))

    def request(self, outputs: Iterable[str] | None) -> Items:
        """Return what `evaluate` computes for these outputs; raise an ArgumentError for unknown ones, or for outputs
        that need derivatives that the motion lacks.
        """
        return self.assembly.request(self.outputs if outputs is None else outputs, self.motion)

    def arrays(self, outputs: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
        """Return outputs by name; shape (samples, ...)."""
        return self.evaluate(outputs).requested_arrays()

    def _evaluated(self, rows: Rows, request: Items, min_order: int = 0) -> SceneResult:
        known = self.known(rows, max(order_of(request), min_order))
        computed = self.assembly.compute(request, known, self._acting(rows), self.backend)
        first = (rows.start or 0) if isinstance(rows, slice) else 0
        return SceneResult(self.motion.t[rows], self, known, computed, first)

    def _acting(self, rows: Rows, gravity: tuple[float, ...] | None = None) -> Acting:
        return Acting(self.motion, rows, self.gravity if gravity is None else gravity)

    def plan(self, outputs: Iterable[str] | None = None) -> ScenePlan:
        """Return what `evaluate` would compute and skip, and why, as an object whose text says so.

        Args:
            outputs: as for `evaluate`.
        """
        request, level = self.request(outputs), self.motion.level
        names = tuple(item.name for item in request if item.of in ("state", "force"))
        operations = self.assembly.operations(request, self.motion)
        reasons = ["no output needs them" if i < level else "the motion does not give them" for i in range(2)]
        skipped = [
            (f"{('first', 'second')[i]} derivatives of the coordinates", reasons[i])
            for i in range(order_of(request), 2)
        ]
        return ScenePlan(names, operations, tuple(skipped))

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components such as R2_x."""
        return self.assembly.unit(name)

    def in_units(self, units: UnitsLike) -> Columns:
        """Return names and numbers of columns in units; None for those of the scene."""
        return Columns(self.units if units is None else Units.of(units), self.unit)

    def cross_validate(self, max_instants: int | None = None) -> CrossValidation:
        """Compare the equations with Pinocchio along the motion, as far as it has derivatives.

        For a motion that [dynamics] simulates, the loads are compared with the forces that Pinocchio's `rnea`
        computes from the motion, where loads alone determine them. A note says if the estimated error of the motion
        itself exceeds the bound of the comparison.

        Args:
            max_instants: largest number of instants to compare, evenly spread; all instants by default.
        """
        rows = slice(None) if max_instants is None else self.spread(max_instants)
        with self.tables.naming():
            return self.assembly.compare(self.known(rows, self.motion.level), self._acting(rows))

    def forces(self, gravity: ArrayLike | None = None) -> SceneForces:
        """Compute the forces that the motion requires at the instants.

        Args:
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,), in the plane (2,). By default the
                gravity of the scene, otherwise 9.81 along -z, in the plane along -y.

        Returns:
            A `SceneForces` (hingepair.scenes.forces) with arrays in world axes and these attributes:

            - gravity: the gravity that was used;
            - notes: sentences on forces that are not finite, on limits that are exceeded.

            Of a pair (equations D1 to D5):

            - hinge_force [N], (N, 3): force of body 1 on body 2 at the hinge point;
            - hinge_torque [N m], (N,): torque of body 1 on body 2 about the hinge axis;
            - bearing_torque [N m], (N, 3): torque of body 1 on body 2 perpendicular to the axis;
            - force1 [N] and torque1 [N m], (N, 3): the load that must act on body 1 at R1, if it has mass properties.

            In the plane, forces have two components, torques one, and there is no bearing torque. Loads on body 2 are
            subtracted, since the hinge need not supply them, and with loads of the joint hinge_torque is split into
            motor_torque, spring_torque, damper_torque, friction_torque and stop_torque, as far as they act.

            Of a robot (equations T1 to T3):

            - tau, (N, dof): what motors exert, torques of hinges [N m] and forces of sliders [N];
            - force1 [N] and torque1 [N m], (N, 3): the load on the base about its reference point; of a fixed base,
              its reaction.

        Raises:
            ArgumentError: the motion has no accelerations, body 2 of a pair has no mass properties, or gravity is
                given although [dynamics] has a gravity of its own.
        """
        motion, size = self.motion, self.dimensions
        if gravity is not None:
            if motion.simulated is not None or self.has_own_gravity:
                which = "motion is simulated in the gravity of the scene"
                which = "table [dynamics] of the scene has a gravity" if self.has_own_gravity else which
                raise ArgumentError("gravity", f"None, since the {which}", gravity)
            fall: tuple[float, ...] = (*one_constant("gravity", gravity, size).tolist(), 0.0)[:3]
        else:
            fall = self.gravity
        if motion.level < ACCELERATION:
            expected = f"a motion with accelerations, which forces need{motion.hint}"
            raise ArgumentError("scene", expected, motion.origin)
        assumed = gravity is None and not self.has_own_gravity
        known, acting = self.known(slice(None), ACCELERATION), self._acting(slice(None), fall)
        with self.tables.naming():
            arrays = self.assembly.forces(known, acting)
        struts = tuple(
            item for item in self.assembly.items.values() if item.of == "strut" and item.quantity != "rate"
        )
        arrays |= self.assembly.compute(struts, known, acting, self.backend).arrays
        return SceneForces(self, known, arrays, fall, assumed=assumed)

    def energy_balance(self) -> EnergyBalance:
        """Compute the energy balance of a motion that [dynamics] simulates: the work of each load since the first
        instant, and the energies. `print` shows it as a table.

        Raises:
            ArgumentError: the motion is not simulated.
        """
        simulated = self.motion.simulated
        if simulated is None:
            expected = "a motion that [dynamics] simulates, for its energy balance"
            raise ArgumentError("motion", expected, self.motion.origin)
        balance: EnergyBalance = simulated.energy_balance()
        return balance

    # ---- what is said about a scene

    def notes(self, units: UnitsLike = None) -> tuple[str, ...]:
        """Return sentences for readers of the results: on limits that are left, on kinks, on numbers in another unit,
        and on doubts about the motion itself.

        Args:
            units: units of limits that are left, in place of SI units; by default those of the scene.
        """
        motion, shown = self.motion, self.in_units(units).units
        pieces = [slice(i, i + RESULT_ROWS_PER_BLOCK) for i in range(0, self.samples, RESULT_ROWS_PER_BLOCK)]
        level = min(motion.level, VELOCITY)
        parts = [self.known(piece, level) for piece in pieces]  # all instants at once would take much memory
        q, *rates = (np.concatenate([part.array(order) for part in parts]) for order in range(level + 1))
        sentences, last = [*self.suspicions()], list[str]()
        for i, joint in enumerate(self.assembly.joints):
            own, unit = q[:, i], joint.unit
            stops = stop_range(motion.loads.get(joint.name, HingeLoad()))
            (lower, upper), extremes = joint.position_limits, (float(np.fmin.reduce(own)), float(np.fmax.reduce(own)))
            limits = (-math.inf if stops[0] >= lower else lower, math.inf if stops[1] <= upper else upper)
            sentences += limit_sentences(joint.name, limits, unit, self.t, own, shown)
            whole = extremes if motion.simulated is None else motion.simulated.q_range[i].tolist()
            last += stop_sentences(joint.name, stops, unit, extremes, whole, shown)
            for qd in rates:
                most = (-joint.rate_limit, joint.rate_limit)
                sentences += limit_sentences(f"{joint.name}'", most, f"{unit}/s", self.t, qd[:, i], shown)
        if kinks := 0 if motion.functions is None else int(motion.functions.switches(self.t).sum()):
            where = f"{kinks} interval{'s' * (kinks != 1)}"
            sentences.append(f"kinks or jumps in {where}; derivatives there are those from the right")
        doubts = [motion.doubt] * math.isnan(motion.error_estimate)
        return tuple(dict.fromkeys((*sentences, *last, *motion.notes, *doubts)))

    def suspicions(self) -> tuple[str, ...]:
        """Return sentences on numbers of the file, and on functions at up to 101 instants, that are probably in
        another unit, such as degrees or millimetres.
        """
        limits = {joint.name: joint.position_limits for joint in self.assembly.joints if joint.unit == "rad"}
        sentences = [*suspicions.file_suspicions(self.tables.values, limits)]
        if self.has_motion and self.motion.functions is not None:
            rows, motion = self.spread(suspicions.MAX_JUDGED), self.motion
            step = (self.stop - self.start) / max(self.samples - 1, 1)
            sentences += suspicions.function_suspicions(motion.functions, np.asarray(motion.t[rows]), step, limits)
        return tuple(dict.fromkeys(sentences))

    # ---- how a scene is shown

    def heading(self) -> tuple[str, str]:
        """Return a line on what moves, and a line on the instants."""
        t = f"t = {instant_text(self.start)} to {instant_text(self.stop)} s"
        count = f"{self.samples} instant{'s' * (self.samples != 1)}, {t}; {self.motion.description}"
        return self.assembly.describe(self.motion.moving), count

    def facts(self) -> dict[str, Any]:
        """Return what commands with --json print of the scene."""
        facts = {"scene": str(self.path), "title": self.title, "samples": self.samples}
        return {**facts, "start": self.start, "stop": self.stop, **self.assembly.facts(self.motion)}

    def __repr__(self) -> str:
        return f"Scene({str(self.path)!r}, {self.title!r}, samples={self.samples}, t={self.span})"


def scene_of_simulation(found: SimulatedRobotMotion) -> Scene:
    """Return a simulated motion of a robot as a scene, for pictures; it has no file, and stops are not noted."""
    robot = found.robot
    assembly = Assembly(robot, found.state().frames)
    return Scene(
        Table(robot.name, "", {}, {}), Path(robot.name), title=found.described, assembly=assembly, files=(),
        motion=simulated_motion(assembly, found, {}), gravity=found.gravity,
    )  # fmt: skip


def with_constants_evaluated(tables: Table) -> Table:
    """Return a scene's top-level table with its constants evaluated, behind those that the table has
    already; refuse a sweep and unknown tables.
    """
    if {"scene", "vary"} <= tables.values.keys():
        raise SceneError(tables.file, "a scene", f"a sweep (hingepair sweep {tables.file} computes it)")
    for key in () if is_of_mechanism(tables) else MECHANISM_TABLES[2:]:
        if key in tables.values:
            tables.refuse(
                key, f"no [[{key}]] in the scene of a pair: it needs a mechanism, [[joint]] tables", "a pair"
            )
    tables.check_keys(_OF_MECHANISMS if is_of_mechanism(tables) else (*_OF_PAIRS, "mechanism", "joint"))
    tables = replace(tables, written=tables.table("constants", required=False).values)
    return replace(tables, constants=read_constants(tables))
