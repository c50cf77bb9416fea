"""Scenes: a pair or a robot, its motion, and the instants to compute, from a TOML file.

docs/scenes.md describes the format. What depends on what moves is in `pair_scene` and `robot_scene`.
"""

from __future__ import annotations

import abc
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.loops import OperationCounts
from hingepair.equations.quantities import VELOCITY, unit_of
from hingepair.errors import ArgumentError
from hingepair.mechanism.results import MAX_HELD_INSTANTS, RESULT_ROWS_PER_BLOCK, Result
from hingepair.motion.energy_balance import EnergyBalance
from hingepair.motion.trajectory import describe_instants
from hingepair.numeric.arrays import Float64Array, Frozen, read_only
from hingepair.scenes import suspicions
from hingepair.scenes.forces import SceneForces
from hingepair.scenes.instants import Instants, Rows
from hingepair.scenes.motions.motion import LimitCounter, Motion, kink_sentences
from hingepair.scenes.tables import Table
from hingepair.tables.sheets import Sheet, Shown, cell_text, instant_text
from hingepair.tables.units import SI, Columns, Units, UnitsLike

if TYPE_CHECKING:
    from hingepair.validation.report import CrossValidation


class Residual(NamedTuple):
    """A constraint whose residual a run reports."""

    label: str
    meaning: str
    unit: str


@dataclass(frozen=True, slots=True)
class ScenePlan:
    """What a scene computes and skips."""

    #: names of the outputs that are computed
    outputs: tuple[str, ...]
    #: numbers of operations at each instant, once for all instants, and where nothing is known
    operations: OperationCounts
    #: (what is left out, why)
    skipped: tuple[tuple[str, str], ...]

    @classmethod
    def of(
        cls, outputs: Iterable[str], counts: Iterable[OperationCounts], order: int, level: int, still: Iterable[str]
    ) -> ScenePlan:
        """Return the plan of programs with these counts of operations.

        Args:
            outputs: names of the outputs that are computed.
            counts: numbers of operations of each program.
            order: highest order of the derivatives that the outputs need.
            level: highest order of the derivatives that the motion has.
            still: names of the coordinates that do not change.
        """
        operations = OperationCounts(*map(sum, zip((0, 0, 0), *counts, strict=True)))
        reasons = ["no output needs them" if i < level else "the motion does not give them" for i in range(2)]
        skipped = [(f"{('first', 'second')[i]} derivatives of the coordinates", reasons[i]) for i in range(order, 2)]
        if operations.folded:
            skipped.append(
                (f"{operations.folded} operations", "their results are known, such as products with 0 or 1")
            )
        if operations.shared:
            skipped.append((f"operations at each instant: {operations.shared}", "they depend on constants only"))
        if names := ", ".join(still):
            skipped.append((f"sines, cosines and rates of {names}", "these coordinates do not change"))
        return cls(tuple(outputs), operations, tuple(skipped))

    def __str__(self) -> str:
        left = f"{self.operations.per_sample} operations at each instant, of {self.operations.unfolded} in all"
        lines = [f"outputs: {', '.join(self.outputs)}", f"computed: {left}"]
        lines += ["skipped:", *(f"  {what}: {why}" for what, why in self.skipped)] if self.skipped else []
        return "\n".join(lines)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SceneResult(Frozen, Result, abc.ABC):
    """Results of a scene at its instants; an output that was not computed is None."""

    #: instants; shape (samples,) s
    t: NDArray[np.float64]
    #: the computed states; None if no output needs them
    state: Any
    #: the scene that was evaluated
    scene: Any
    #: the motion that the state was computed from
    known: Any
    #: the requested outputs
    requested: Any
    #: index of the first instant; 0 except in blocks
    first: int = 0
    _names_hidden_from_dir: ClassVar[frozenset[str]] = Result._names_hidden_from_dir | {
        *("coincident_frames", "energy", "energy_balance", "first", "known", "momentum", "requested"),
        *("requested_arrays", "residual_sizes"),
    }

    @property
    def described(self) -> str:
        """The title of the scene."""
        title: str = self.scene.title
        return title

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The files of the scene, which `save` refuses to overwrite."""
        files: tuple[Path, ...] = self.scene.files
        return files

    def unit(self, name: str) -> str:
        """Return the unit of a recorded array, or of one of its components, by its name."""
        unit: str = self.scene.unit(name)
        return unit

    def in_units(self, units: UnitsLike) -> Columns:
        """Return names and numbers of columns in units; None for those of the scene."""
        columns: Columns = self.scene.in_units(units)
        return columns

    @abc.abstractmethod
    def requested_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the requested outputs by name; shape (samples, ...). Coordinates are named like columns of a log."""

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return the requested outputs and the coordinates by name; shape (samples, ...)."""
        coordinates: dict[str, NDArray[Any]] = self.known.coordinates()
        return self.requested_arrays() | coordinates

    def residual_sizes(self) -> NDArray[np.float64]:
        """Return rows (largest value, its ratio to u * scale) for the scene's `residuals`; NaN if none is finite."""
        return np.empty((0, 2))

    def coincident_frames(self) -> dict[str, str]:
        """Return, by frame of a robot, the earlier frame that moves exactly as it."""
        return {}

    def energy_balance(self) -> EnergyBalance:
        """Compute the energy balance of the whole motion, as `Scene.energy_balance`."""
        balance: EnergyBalance = self.scene.energy_balance()
        return balance

    def __repr__(self) -> str:
        return f"SceneResult({describe_instants(self.t)}, {self._of_what()})"

    @abc.abstractmethod
    def _of_what(self) -> str: ...


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class Scene(Shown, abc.ABC):
    """Scene as read from a scene file: what moves, how, and when to look."""

    #: path of the scene file
    path: Path
    #: title of the scene, a sentence
    title: str
    #: the motion and its instants
    motion: Motion
    #: names of the outputs that `evaluate` computes by default; None for all of body 2, or for the motion of a
    #: robot's frames and moving joints
    outputs: tuple[str, ...] | None
    #: constants of the file by name
    constants: Mapping[str, float]
    #: absolute paths of the files that the scene was read from
    files: tuple[Path, ...]
    #: contents of the file; expressions are kept as text
    tables: Table
    #: units of tables, plots and files unless others are asked for
    units: Units = SI

    #: number of instants that are compared with Pinocchio in a second or some
    max_check_instants: ClassVar[int]
    _noted: ClassVar[str]  # a cheap output, evaluated for the sake of the notes

    # ---- the instants

    @property
    def instants(self) -> Instants:
        """The instants [s], an array or UniformInstants."""
        return self.motion.t

    @property
    def start(self) -> float:
        """First instant [s]."""
        return float(self.instants[0])

    @property
    def stop(self) -> float:
        """Last instant [s]."""
        return float(self.instants[-1])

    @property
    def span(self) -> str:
        """First and last instant as a short text such as 0..10."""
        return f"{instant_text(self.start)}..{instant_text(self.stop)}"

    @property
    def samples(self) -> int:
        """Number of instants."""
        return len(self.instants)

    @property
    def t(self) -> NDArray[np.float64]:
        """All instants; shape (samples,) s. Raises an ArgumentError if they are too many to be held in memory."""
        return self.times()

    def times(self) -> NDArray[np.float64]:
        """Return all instants as a read-only array; shape (samples,) s."""
        if self.samples > MAX_HELD_INSTANTS:
            way = (
                "hingepair run SCENE --out FILE.parquet (or .csv) computes any number, scene.blocks() piece by piece"
            )
            most = f"at most {MAX_HELD_INSTANTS} instants to be held in memory; {way}"
            raise ArgumentError("samples", most, self.samples)
        return np.asarray(read_only(self.instants[:]))

    def spread(self, max_instants: int) -> Rows:
        """Return the indices of `max_instants` evenly spread instants, or of all if there are fewer."""
        return np.unique(np.linspace(0, self.samples - 1, min(self.samples, max_instants)).astype(np.intp))

    @property
    def backend(self) -> str:
        """Name of the backend for the whole scene and its blocks, which so agree to the bit."""
        return "auto" if self.samples <= RESULT_ROWS_PER_BLOCK else "compiled"

    @property
    def dimensions(self) -> int:
        """Number of components of a vector such as gravity."""
        return 3

    # ---- results

    def evaluate(self, outputs: Iterable[str] | None = None) -> Any:
        """Compute outputs at all instants of the scene.

        Args:
            outputs: names of outputs; only the derivatives that they need are computed. By default the outputs that
                the scene file names; if it names none, all outputs of body 2 that the motion allows, or the motion of
                a robot's frames and of the joints that move.

                Of a pair in space: R2, S2, d, v2, omega2, a2, alpha2, R1, S1, v1, omega1, a1, alpha1, and the
                quaternions quat1, quat2; in the plane: R2, phi2, d, v2, omega2, a2, alpha2; in both: the coordinates
                q, qd, qdd, psi, psid, psidd, and of a point tip, its position, velocity and acceleration: tip, tip_v,
                tip_a.

                Of a robot: R, S, quat, d, v, omega, a or alpha for all frames of the scene; the name of a link, a
                joint or another frame for all motion of it; a name such as R_tool for one quantity of one frame; q,
                qd, qdd or tau for all joints; tau_elbow for tau of one joint; force1 and torque1, the load on the
                base.

        Returns:
            A SceneResult, whose attributes are the outputs.

        Raises:
            ArgumentError: an unknown output, one that needs what the motion does not have, or more instants than can
                be held in memory.
        """
        return self._evaluated(slice(len(self.times())), self.request(outputs))

    def sampled(self, max_instants: int, outputs: Iterable[str] | None = None) -> Any:
        """Compute outputs at evenly spread instants; the motion of the result has all derivatives of the scene.

        Args:
            max_instants: largest number of instants.
            outputs: as for `evaluate`.
        """
        return self._evaluated(self.spread(max_instants), self.request(outputs), self.motion.level)

    def blocks(self, outputs: Iterable[str] | None = None) -> Iterator[Any]:
        """Yield a SceneResult for each block of 131,072 instants in turn, for scenes that do not fit into memory.

        The motion of each block has first derivatives if the scene's motion has them.

        Args:
            outputs: as for `evaluate`.
        """
        request = self.request(outputs)
        for start in range(0, self.samples, RESULT_ROWS_PER_BLOCK):
            rows = slice(start, start + RESULT_ROWS_PER_BLOCK)
            yield self._evaluated(rows, request, min(self.motion.level, VELOCITY))

    @abc.abstractmethod
    def request(self, outputs: Iterable[str] | None) -> Any:
        """Return what `evaluate` computes for these outputs; raise an ArgumentError for unknown ones, or for outputs
        that need derivatives that the motion lacks.
        """

    @abc.abstractmethod
    def _evaluated(self, rows: Rows, request: Any, min_order: int = 0) -> SceneResult:
        """Return the result at some of the instants; its motion has derivatives of `min_order` at least."""

    @abc.abstractmethod
    def plan(self, outputs: Iterable[str] | None = None) -> ScenePlan:
        """Return what `evaluate` would compute and skip, and why, as an object whose text says so.

        Args:
            outputs: as for `evaluate`.
        """

    def check_arrays(self, outputs: Iterable[str]) -> None:
        """Raise an ArgumentError for outputs that `arrays` does not compute."""
        self.request(outputs)

    @abc.abstractmethod
    def arrays(self, outputs: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
        """Return outputs by name, those of `forces` too; shape (samples, ...)."""

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components such as R2_x."""
        return unit_of(name)

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
        return self._compared(slice(len(self.times())) if max_instants is None else self.spread(max_instants))

    @abc.abstractmethod
    def _compared(self, rows: Rows) -> CrossValidation: ...

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

            In the plane, forces have two components, torques one, and there is no bearing torque. If [dynamics]
            simulates the motion, the loads on body 2 are subtracted, since the hinge need not supply them, and
            hinge_torque is split into motor_torque, spring_torque, damper_torque, friction_torque and stop_torque, as
            far as they act.

            Of a robot (equations T1 to T3):

            - tau, (N, dof): torques of hinges [N m] and forces of sliders [N];
            - force1 [N] and torque1 [N m], (N, 3): the load on the base about its reference point; of a fixed base,
              its reaction;
            - loads: a JointLoad for each joint with a coordinate of its own, with the rms and the largest value of
              its effort, and its extremes beside its limits.

        Raises:
            ArgumentError: the motion has no accelerations, body 2 of a pair has no mass properties, or gravity is
                given although [dynamics] has a gravity of its own.
        """
        record = {"described": f"forces: {self.title}", "inputs": self.files, "unit": self.unit, "units": self.units}
        return self._forces(self.times(), gravity, record)

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

    @abc.abstractmethod
    def _forces(self, t: Float64Array, gravity: ArrayLike | None, record: dict[str, Any]) -> SceneForces: ...

    # ---- what is said about a scene

    def notes(self, units: UnitsLike = None) -> tuple[str, ...]:
        """Evaluate the whole motion, and return sentences for readers of the results: on limits that are left, on
        kinks, on numbers in another unit, and on doubts about the motion itself.

        Args:
            units: units of limits that are left, in place of SI units; by default those of the scene.
        """
        collector = NoteCollector(self, units)
        for block in self.blocks((self._noted,)):
            collector.add(block)
        return collector.sentences()

    @abc.abstractmethod
    def watches(self) -> list[LimitCounter]:
        """Return a new counter for each quantity that has limits."""

    def last_notes(self, _watches: Sequence[LimitCounter]) -> Iterable[str]:
        """Return sentences on the motion itself, from what was watched of it."""
        return self.motion.notes

    def suspicions(self) -> tuple[str, ...]:
        """Return sentences on numbers of the file, and on the motion at up to 101 instants, that are probably in
        another unit, such as degrees or millimetres.
        """
        rows, motion, limits = self.spread(suspicions.MAX_JUDGED), self.motion, self.angle_limits()
        sentences = suspicions.file_suspicions(self.tables.values, limits)
        sentences += suspicions.function_suspicions(motion.functions, np.asarray(motion.t[rows]), limits)
        if motion.level:
            sentences += suspicions.motion_suspicions(motion.t, *self._sizes(rows))
        return tuple(dict.fromkeys(sentences))

    @abc.abstractmethod
    def angle_limits(self) -> dict[str, Sequence[float]]:
        """Return the limits of the hinges by the names of their angles; empty where there are none."""

    @abc.abstractmethod
    def _sizes(self, rows: Rows) -> tuple[Float64Array, Any, Any]:
        """Return sizes of the rates [rad/s], (N,), and velocity and acceleration of body 1, (N, 3) or None."""

    @property
    def residuals(self) -> tuple[Residual, ...]:
        """Constraints whose residuals results have."""
        return ()

    @abc.abstractmethod
    def is_moved_by(self, keys: Sequence[Sequence[str | int]]) -> bool:
        """Return whether the motion may depend on numbers of the file, to which paths of keys and indices lead."""

    @abc.abstractmethod
    def require_pair(self) -> Any:
        """Return the scene if it is one of a pair; otherwise raise an ArgumentError."""

    # ---- how a scene is shown

    def heading(self) -> tuple[str, str]:
        """Return a line on what moves, and a line on the instants."""
        t = f"t = {instant_text(self.start)} to {instant_text(self.stop)} s"
        return self._subject(), f"{self.samples} instant{'s' * (self.samples != 1)}, {t}; {self.motion.description}"

    @abc.abstractmethod
    def _subject(self) -> str: ...

    def facts(self) -> dict[str, Any]:
        """Return what commands with --json print of the scene."""
        facts = {"scene": str(self.path), "title": self.title, "samples": self.samples}
        return {**facts, "start": self.start, "stop": self.stop, **self._own_facts()}

    @abc.abstractmethod
    def _own_facts(self) -> dict[str, Any]: ...

    def __repr__(self) -> str:
        return f"Scene({str(self.path)!r}, {self.title!r}, samples={self.samples}, t={self.span})"

    def _sheet(self) -> Sheet:
        """Return what notebooks show."""
        what, *more = self._motion_rows()
        rows = [
            what,
            ("instants", str(self.samples)),
            ("t", self.span, "s"),
            *more,
            *((name, cell_text(value)) for name, value in self.constants.items()),
        ]
        return Sheet(self.title, (("", "value", "unit"), *((*row, "")[:3] for row in rows)))

    @abc.abstractmethod
    def _motion_rows(self) -> list[tuple[str, str]]:
        """Return rows of a table on what moves, on the motion, and on the outputs."""


class NoteCollector:
    """Collector of notes on a scene that is evaluated in blocks, in units or those of the scene."""

    def __init__(self, scene: Scene, units: UnitsLike = None) -> None:
        self._units = scene.in_units(units).units
        self._scene, self._watches, self._kinks = scene, scene.watches(), 0

    def add(self, block: SceneResult) -> None:
        """Count kinks and instants outside limits in one block of results; the blocks come in order of time."""
        self._kinks += self._scene.motion.count_kinks(block.first, block.first + len(block.t))
        for watch in self._watches:
            watch.add(block.t, block.known)

    def sentences(self) -> tuple[str, ...]:
        """Return the notes on all added blocks and on the motion itself."""
        scene = self._scene
        sentences = [*scene.suspicions()]
        for watch in self._watches:
            sentences += watch.sentences(scene.samples, self._units)
        return tuple(dict.fromkeys((*sentences, *kink_sentences(self._kinks), *scene.last_notes(self._watches))))
