"""Scenes: a pair and its motion as functions of time, from a TOML file. docs/scenes.md describes the format."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.dynamics.simulate import describe_stop_overrun
from hingepair.engine.results import missing_attribute_error
from hingepair.errors import ArgumentError, SceneError, choices, quoted
from hingepair.integration.trajectory import describe_instants
from hingepair.numeric.arrays import Frozen, read_only
from hingepair.numeric.suspicions import DEGREES_IN_SCENES
from hingepair.numeric.suspicions import suspicions as judge
from hingepair.numeric.tables import Sheet, cell_text, unit_of
from hingepair.pair.dynamics import Energy, Momentum
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.results import Result
from hingepair.pair.states import PairState, PlanarState
from hingepair.plans.arguments import check_outputs
from hingepair.plans.plan import (
    ACCELERATION,
    PLANAR_MOTION_KIND,
    POSE,
    SPATIAL_MOTION_KIND,
    VELOCITY,
    MotionKind,
)
from hingepair.scenes.explain import ScenePlan, explain
from hingepair.scenes.instants import Instants, Rows, SampledScene
from hingepair.scenes.motions.known import Derivatives, KnownMotion, MotionByBody1, quaternion_columns
from hingepair.scenes.motions.motion import LimitCounter, Motion, kink_sentences, massive
from hingepair.scenes.pair_table import read_pair
from hingepair.scenes.tables import Table, read_tables

if TYPE_CHECKING:
    from hingepair.mechanism.mechanism import Mechanism
    from hingepair.scenes.forces import SceneForces
    from hingepair.scenes.motions.functions import FunctionsOfTime
    from hingepair.scenes.motions.simulated import DynamicsSetup
    from hingepair.scenes.robot_scene import MechanismScene
    from hingepair.symbolic.kinks import Expr
    from hingepair.validation.report import CrossValidation

_PAIR_TABLES = ("title", "planar", "pair", "motion", "dynamics", "time", "outputs", "tolerances")
"""Keys and tables that the file of a scene of a pair may have."""
_ROBOT_TABLES = ("title", "mechanism", "joint", "base", "motion", "time", "outputs")
"""Keys and tables that the file of a scene of a mechanism may have."""
COORDINATE_OUTPUTS: Final = ("q", "qd", "qdd", "psi", "psid", "psidd")
"""Names of the outputs that are coordinates, all or psi alone, and their derivatives."""
_ATTITUDES: Final = {"quat1": "S1", "quat2": "S2"}
"""Attitude by the output that gives it as a quaternion (x, y, z, w)."""
FURTHER_OUTPUTS: Final = (*COORDINATE_OUTPUTS, *_ATTITUDES)
"""Outputs that a scene has beside those of the equations; the quaternions only in space."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SceneResult(Frozen, Result):
    """Results of a pair's scene: its instants `t`, the `state` (a PairState or PlanarState), every attribute of the
    state (R2, S2, d, v2, ...), and the coordinates.

    q, qd and qdd have shape (samples, 7), in the plane (samples, 4); psi, psid and psidd have shape (samples,). If
    the attitude of body 1 is not given by Euler angles, q is x, y, z, the quaternion qx, qy, qz, qw (qw >= 0) and
    psi; qd is v1, omega1 and psi'; qdd is a1, alpha1 and psi''. quat1 and quat2, shape (samples, 4), are the
    quaternions (x, y, z, w), w >= 0, of S1 and S2. An output is None if it was not requested or the motion does not
    have it.
    """

    #: instants; shape (samples,) s
    t: NDArray[np.float64]
    #: the PairState, or PlanarState, at these instants
    state: PairState | PlanarState
    #: the Scene that was evaluated
    scene: Scene
    #: the motion that the state was computed from
    known: KnownMotion
    #: names of the requested outputs; None for all outputs of body 2, and the hinge angle
    names: tuple[str, ...] | None
    #: index of the first instant; 0 except in blocks
    first: int = 0
    _names_hidden_from_dir: ClassVar[frozenset[str]] = Result._names_hidden_from_dir | {
        "requested_arrays",
        "energy",
        "first",
        "known",
        "momentum",
        "names",
    }

    @property
    def described(self) -> str:
        """The title of the scene."""
        return self.scene.title

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The files of the scene, which `save` refuses to overwrite."""
        return self.scene.files

    def requested_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the requested outputs as a dict of arrays by name, shape (samples, ...). Each component of q, qd,
        qdd, quat1 and quat2 is a separate array, named like the column of a log. If no outputs were requested, return
        all computed outputs, and psi with its known derivatives.
        """
        names, state = self.names, self.state.arrays()
        if names is None:
            names = (*state, *(name for name in ("psi", "psid", "psidd") if _output_level(name) <= self.known.level))
        arrays: dict[str, NDArray[Any]] = {name: array for name, array in state.items() if name in names}
        for name in names:
            components = self._components(name) if name in FURTHER_OUTPUTS else {}
            arrays |= {
                key: components[key] for key in components if key.partition("_")[0] not in arrays
            }  # v1 has v1_x already
        return arrays

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return the requested outputs and the coordinates as a dict of arrays by name; shape (samples, ...)."""
        return self.requested_arrays() | self.known.coordinates()

    def energy(self) -> Energy:
        """Compute the kinetic and potential Energy [J] of the pair at the instants (equation D7), in the scene's
        gravity; return an Energy.
        """
        moved, gravity = self._motion_in_space(), self.scene.motion.gravity(self.scene.pair)
        return massive(self.scene.pair).energy(moved.body1, moved.psi, moved.hinge[1], gravity=gravity)

    def momentum(self) -> Momentum:
        """Compute the linear and angular Momentum of the pair at the instants (equation D8); return a Momentum."""
        moved = self._motion_in_space()
        return massive(self.scene.pair).momentum(moved.body1, moved.psi, moved.hinge[1])

    def _motion_in_space(self) -> MotionByBody1:
        """Return the motion of the result in space as a MotionByBody1."""
        if self.known.level < ACCELERATION:
            raise ArgumentError("outputs", "some that need second derivatives, such as a2", self.state.outputs)
        return self.known.in_space(self.scene.pair)

    def _components(self, name: str) -> dict[str, NDArray[np.float64]]:
        """Return the components of the output `name` (q, qd, qdd, psi, psid, psidd, quat1 or quat2) as a dict of
        arrays (samples,) by column name; empty if the output was not computed.
        """
        if name in _ATTITUDES:
            S = getattr(self.state, _ATTITUDES[name], None)
            return {} if S is None else quaternion_columns(S, name[-1])
        if _output_level(name) > self.known.level:
            return {}
        return (
            self.known.log_columns(_output_level(name))
            if name[0] == "q"
            else {name: self.known.hinge_angle(_output_level(name))}
        )

    def __getattr__(self, name: str) -> Any:
        if name in FURTHER_OUTPUTS:
            components = [*self._components(name).values()]
            return None if not components else np.stack(components, -1) if name[0] == "q" else components[0]
        if not name.startswith("_") and name not in self.__dataclass_fields__ and hasattr(type(self.state), name):
            return getattr(self.state, name)
        raise missing_attribute_error(self, name)

    def __repr__(self) -> str:
        return f"SceneResult({describe_instants(self.t)}, state={self.state!r})"

    def _available_names(self) -> Iterable[str]:
        """Return a tuple of the names of the attributes and methods that are available in this result, for `dir`."""
        pair, level = self.scene.pair, self.known.level
        bodies = {"energy": pair.body2, "momentum": pair.body1 and pair.body2}
        masses = (name for name, body in bodies.items() if level == ACCELERATION and body is not None)
        beside = (name for name in self.scene.additional_output_names(level) if getattr(self, name) is not None)
        return *dir(self.state), *beside, *masses


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Scene(SampledScene):
    """Scene of a pair, as read from a scene file: the pair, its motion, and the instants."""

    #: path of the scene file
    path: Path
    #: title of the scene, a sentence
    title: str
    #: the HingePair, or for a planar scene the PlanarPair
    pair: HingePair | PlanarPair
    #: the motion of the pair and its instants
    motion: Motion
    #: names of the outputs that `evaluate` computes by default; None for all outputs of body 2 that the motion allows
    outputs: tuple[str, ...] | None
    #: constants of the file by name
    constants: Mapping[str, float]
    #: absolute paths of the files that the scene was read from: the scene file and the log, if any
    files: tuple[Path, ...]
    #: contents of the file; expressions are kept as text
    tables: Table

    def __repr__(self) -> str:
        return f"Scene({str(self.path)!r}, {self.title!r}, samples={self.samples}, t={self.span})"

    def _sheet(self) -> Sheet:
        """Return the Sheet that prints the scene: title, and rows of name, value and unit."""
        rows = [
            ("pair", self.pair.name, ""),
            ("motion", f"{self.motion.origin}; {self.motion.motion_description}", ""),
            ("instants", str(self.samples), ""),
            ("t", self.span, "s"),
            ("outputs", ", ".join(self.outputs or ("all of body 2",)), ""),
            *((name, cell_text(value), "") for name, value in self.constants.items()),
        ]
        return Sheet(self.title, (("", "value", "unit"), *rows))

    @property
    def space(self) -> HingePair:
        """The pair as a HingePair; a PlanarPair is converted by `to_spatial`."""
        return self.pair if isinstance(self.pair, HingePair) else self.pair.to_spatial()

    @property
    def kind(self) -> MotionKind:
        """The kind of motion, SPATIAL_MOTION_KIND or PLANAR_MOTION_KIND, which says which outputs exist."""
        return SPATIAL_MOTION_KIND if isinstance(self.pair, HingePair) else PLANAR_MOTION_KIND

    @property
    def sequence(self) -> str | None:
        """Euler sequence of body 1, such as "XYZ"; None if its attitude is not given by three Euler angles."""
        return self.motion.source.sequence

    def additional_output_names(self, level: int) -> tuple[str, ...]:
        """Return a tuple of the names of the coordinate outputs, and in space of the quaternion outputs, that need
        derivatives of order `level` at most.
        """
        names = FURTHER_OUTPUTS if self.kind == SPATIAL_MOTION_KIND else COORDINATE_OUTPUTS
        return tuple(name for name in names if _output_level(name) <= level)

    @property
    def instants(self) -> Instants:
        """The instants [s], an array or UniformInstants."""
        return self.motion.t

    @property
    def expressions(self) -> dict[str, Expr | None]:
        """SymPy expressions of the coordinates by name (x, y, z, phi_x, phi_y, phi_z, psi; in the plane x, y, phi,
        psi). The value of a coordinate given by way points is None.
        """
        return self.functions().expressions()

    def functions(self) -> FunctionsOfTime:
        """Return the coordinates as FunctionsOfTime, which evaluate and differentiate them."""
        from hingepair.scenes.motions.functions import MotionByFunctions

        source = self.motion.source
        if not isinstance(source, MotionByFunctions):
            wanted = "a scene whose motion is coordinates as expressions in t"
            raise ArgumentError("motion", wanted, f"one whose motion is {self.motion.origin}")
        return source.functions

    def coordinates(self, t: ArrayLike) -> Derivatives:
        """Return the coordinates and their exact derivatives, (q, qd, qdd), at any instants t. Each of q, qd and qdd
        is a tuple with one array or float per coordinate.

        Args:
            t: instants [s]; shape (...).

        Returns:
            (q, qd, qdd), tuples of seven (in the plane four): arrays of t's shape, Python floats for what does not
            depend on t. Samples where an expression has no real value are NaN; derivatives at a kink are those from
            the right.
        """
        return self.functions().derivatives(t, ACCELERATION)

    def evaluate(self, outputs: Iterable[str] | None = None) -> SceneResult:
        """Compute outputs of the pair at all instants of the scene; return a SceneResult.

        Args:
            outputs: names of outputs. In space: R2, S2, d, v2, omega2, a2, alpha2, R1, S1, v1, omega1, a1, alpha1,
                and the quaternions quat1, quat2. In the plane: R2, phi2, d, v2, omega2, a2, alpha2. In both: the
                coordinates q, qd, qdd, psi, psid, psidd. By default the outputs that the scene file names; if it
                names none, all outputs of body 2 that the motion allows. Only the derivatives that the outputs need
                are computed.

        Raises:
            ArgumentError: an unknown output, one that needs what the motion does not have, or more instants than can
                be held in memory.
        """
        return self._evaluate_rows(slice(len(self.times())), self._check_outputs(outputs))

    def sampled(self, max_instants: int, outputs: Iterable[str] | None = None) -> SceneResult:
        """Compute outputs of the pair at `max_instants` evenly spread instants, or at every instant if there are
        fewer; return a SceneResult whose motion has all derivatives of the scene.

        Args:
            max_instants: largest number of instants.
            outputs: as for `evaluate`.
        """
        return self._evaluate_rows(self.spread(max_instants), self._check_outputs(outputs), self.motion.level)

    def blocks(self, outputs: Iterable[str] | None = None) -> Iterator[SceneResult]:
        """Yield a SceneResult for each block of 131,072 instants in turn, for scenes that do not fit into memory.

        The `known` motion of each block has first derivatives if the scene's motion has them.

        Args:
            outputs: as for `evaluate`.
        """
        names = self._check_outputs(outputs)
        for rows in self.block_rows():
            yield self._evaluate_rows(rows, names, min(self.motion.level, VELOCITY))

    def _evaluate_rows(self, rows: Rows, names: tuple[str, ...] | None, min_order: int = 0) -> SceneResult:
        """Return the SceneResult of the outputs `names` at the instants with the indices `rows`, a slice or an array;
        `names` None means all outputs of body 2.
        """
        t = np.asarray(read_only(self.motion.t[rows]))
        state_outputs, order = self._needed_outputs_and_order(names)
        known_motion = self.motion.source.part(rows, max(order, min_order))
        if state_outputs == ():
            state: PairState | PlanarState = (PairState if self.kind == SPATIAL_MOTION_KIND else PlanarState)(
                {}, t.shape
            )
        else:
            state = known_motion.part(slice(None), order).forward_kinematics(self.pair, state_outputs, self.backend)
        first = (rows.start or 0) if isinstance(rows, slice) else 0
        return SceneResult(t, state, self, known_motion, names, first)

    def plan(self, outputs: Iterable[str] | None = None) -> ScenePlan:
        """Return the ScenePlan of `evaluate` with these outputs: its text lists what is computed and what is skipped,
        and why.

        Args:
            outputs: as for `evaluate`.
        """
        state_outputs, order = self._needed_outputs_and_order(self._check_outputs(outputs))
        return explain(self.pair, self.motion.source.part(slice(1), order), state_outputs, self.motion.level)

    def cross_validate(self, max_instants: int | None = None) -> CrossValidation:
        """Compare the equations of body 2's motion with Pinocchio at `max_instants` evenly spread instants, by
        default at all; return a CrossValidation. For a simulated motion, compare forces and rates too.

        For a motion that [dynamics] simulates, two more comparisons are made. Where loads alone determine the forces,
        the loads are compared with the forces that Pinocchio's `rnea` computes from the motion. The rates are
        compared with the slopes of the quantities that they are the rates of. A note says if the estimated error of
        the motion itself exceeds the bound of the comparison.

        Args:
            max_instants: largest number of instants to compare, evenly spread; all instants by default. The slopes
                are computed from all instants.

        Returns:
            A `CrossValidation` (hingepair.validation.report). `.forces` and `.rates` are filled for a simulated
            motion.

        Raises:
            MissingDependencyError: Pinocchio is not installed.
        """
        rows = slice(len(self.times())) if max_instants is None else self.spread(max_instants)
        report = self.motion.source.part(rows, self.motion.level).cross_validate(self.pair)
        report = replace(report, notes=self._error_notes(report.u))
        motion = self.motion.simulated
        if motion is None:
            return report
        from hingepair.validation.simulated import compare_forces, compare_rates

        whole, flat = (
            self.motion.source.part(slice(None), ACCELERATION).in_space(self.pair),
            self.kind == PLANAR_MOTION_KIND,
        )
        part = whole.part(rows, ACCELERATION)
        loads = {name: load[rows] for name, load in motion.loads.items()}
        forces = compare_forces(
            motion.space, part.body1, part.hinge, loads, motion.gravity, base=motion.base, is_planar=flat
        )
        moves = motion.base in {"free", "pinned"}
        rates = compare_rates(self.times(), whole.body1, whole.hinge, body1_moves=moves)
        return replace(report, forces=forces, rates=rates)

    def _error_notes(self, u: float) -> tuple[str, ...]:
        """Return a tuple of at most two sentences for a comparison with Pinocchio."""
        from hingepair.pair.accuracy import MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE

        estimates = {unit: error() for unit, error in self.motion.errors.items()}
        large = [
            f"{error:.1g} {unit}"
            for unit, error in estimates.items()
            if error > MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE * u
        ]
        notes = [self.motion.doubt] if math.isnan(self.motion.error_estimate) and self.motion.doubt else []
        if large:
            bound = f"the bound of {MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE * u:.1g} rad"
            held = "the comparison is one of the equations at each instant, not of the way there"
            notes.append(
                f"by its own estimate the motion is off by about {' and '.join(large)}, above {bound}: {held}"
            )
        return tuple(notes)

    def forces(self, gravity: ArrayLike | None = None) -> SceneForces:
        """Compute the forces that the scene's motion requires at its instants (equations D1 to D5); return a
        SceneForces.

        Args:
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,), in the plane (2,). By default the
                gravity of [dynamics], otherwise 9.81 along -z, in the plane along -y.

        Returns:
            A `SceneForces` (hingepair.scenes.forces) with these attributes, vectors in world axes:

            - hinge_force [N], (N, 3): force of body 1 on body 2 at the hinge point;
            - hinge_torque [N m], (N,): torque of body 1 on body 2 about the hinge axis;
            - bearing_torque [N m], (N, 3): torque of body 1 on body 2 perpendicular to the axis;
            - force1 [N] and torque1 [N m], (N, 3): the load that must act on body 1 at R1, if it has mass properties;
            - gravity: the gravity that was used;
            - notes: sentences on forces that are not finite, on the torque_limit of the pair and on noise of a log;
            - noise: standard deviation that the noise of a log causes in each array.

            In the plane, forces have two components, torques one, and there is no bearing torque. If [dynamics]
            simulates the motion, the loads on body 2 are subtracted, since the hinge need not supply them, and
            hinge_torque is split into motor_torque, spring_torque, damper_torque, friction_torque and stop_torque, as
            far as they act.
        """
        from hingepair.scenes.forces import pair_scene_forces

        return pair_scene_forces(self.motion, self.pair, self.times(), gravity, self.title, self.files)

    def notes(self) -> tuple[str, ...]:
        """Evaluate the whole motion, and return a tuple of sentences for readers of the results: on psi and its rate
        outside their limits, on kinks, on angles that look like degrees, and on doubts about the motion itself.
        """
        notes = self.note_collector()
        for block in self.blocks(("psi",)):
            notes.add(block)
        return notes.sentences()

    def suspicions(self) -> tuple[str, ...]:
        """Return a tuple of sentences on numbers of the file, and on the motion at up to 101 instants, that are
        probably in another unit, such as degrees or millimetres.
        """
        from hingepair.scenes import suspicions

        rows, level = self.spread(suspicions.MAX_JUDGED), self.motion.level
        t = np.asarray(self.motion.t[rows])
        sentences = judge("written angles", "limits of psi", self.space.limits or (), radians=DEGREES_IN_SCENES)
        sentences += suspicions.table_suspicions(self.tables.values, {})
        sentences += suspicions.function_suspicions(self.motion.functions, t, {})
        if level:
            known = self.motion.source.part(rows, level).in_space(self.pair)
            omega = np.broadcast_to(np.asarray(known.body1.omega), (len(t), 3))
            rates = np.linalg.norm(omega, axis=1) + np.abs(known.hinge[1])
            a = known.body1.a if level == ACCELERATION else None
            sentences += suspicions.motion_suspicions(self.motion.t, rates, known.body1.v, a)
        return tuple(dict.fromkeys(sentences))

    def note_collector(self) -> SceneNoteCollector:
        """Return a SceneNoteCollector, which collects notes from blocks of results."""
        return SceneNoteCollector(self)

    def _check_outputs(self, outputs: Iterable[str] | None) -> tuple[str, ...] | None:
        """Return the output names as a tuple."""
        if outputs is None:
            return self.outputs
        names, level = (
            check_outputs(outputs, (*self.kind.levels, *FURTHER_OUTPUTS)),
            self.motion.level,
        )
        known_names = (
            *(name for name in self.kind.levels if _output_level(name) <= level),
            *self.additional_output_names(level),
        )
        for name in names:
            if name not in known_names:
                hint = self.motion.hint if _output_level(name) > level else ""
                raise ArgumentError("outputs", choices(known_names) + hint, quoted(name))
        return names

    def _needed_outputs_and_order(self, names: tuple[str, ...] | None) -> tuple[tuple[str, ...] | None, int]:
        """Return (outputs, order) for the requested output names."""
        if names is None:
            return None, self.motion.level
        equation_outputs = (_ATTITUDES.get(name, name) for name in names if name not in COORDINATE_OUTPUTS)
        return tuple(dict.fromkeys(equation_outputs)), max(map(_output_level, names))


class SceneNoteCollector:
    """Collector of notes on a pair's scene that is evaluated in blocks."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        rate = scene.space.rate_limit if scene.motion.level else None
        self._psi = LimitCounter("psi", scene.space.limits or (-math.inf, math.inf), unit_of("psi"))
        self._psid = None if rate is None else LimitCounter("psi'", (-rate, rate), unit_of("psid"))
        self._kinks = 0

    def add(self, block: SceneResult) -> None:
        """Update the counts of kinks and of instants outside limits with one block of results, a SceneResult; the
        blocks must come in order of time.
        """
        self._kinks += self._scene.motion.count_kinks(block.first, block.first + len(block.t))
        self._psi.add(block.t, block.known.psi)
        if self._psid is not None:
            self._psid.add(block.t, block.known.hinge_angle(1))

    def sentences(self) -> tuple[str, ...]:
        """Return the notes on all added blocks and on the motion itself as a tuple of sentences."""
        motion, samples = self._scene.motion, self._scene.samples
        least, most = self._psi.least, self._psi.most
        sentences = [
            *self._scene.suspicions(),
            *self._psi.sentences(samples),
            *(self._psid.sentences(samples) if self._psid is not None else ()),
            *kink_sentences(self._kinks),
        ]
        if motion.simulated is not None:  # between the instants, too
            least, most = motion.simulated.psi_range
        if soft := describe_stop_overrun(motion.stops, least, most):
            sentences.append(f"{soft}; stop_stiffness hardens them")
        sentences += motion.notes
        sentences += [motion.doubt] if math.isnan(motion.error_estimate) else []
        return tuple(dict.fromkeys(sentences))


def load_scene(path: str | os.PathLike[str]) -> Scene | MechanismScene:
    """Read a TOML scene file, whose format docs/scenes.md describes. Return a Scene if the file describes a pair, or
    a MechanismScene if it describes a robot.

    Args:
        path: path of the scene file. Relative paths in the file start from the folder of the file.

    Returns:
        A Scene or a MechanismScene. Both have a method `evaluate()`, which computes the outputs at the instants of
        the scene.

    Raises:
        SceneError: the file cannot be read as a scene. The message is one line; it names the file and, if a key of
            the scene is wrong, the table and the key.
        MissingDependencyError: the file names a robot of example-robot-data, and that package is not installed.
    """
    return scene_from_tables(load_tables(path), path)


def scene_from_tables(tables: Table, path: str | os.PathLike[str]) -> Scene | MechanismScene:
    """Return the Scene or MechanismScene that `tables`, the top-level Table of the scene file at `path`, defines.
    Paths in the tables are relative to the folder of the file.
    """
    files = tuple(file.absolute() for file in _source_files(tables, Path(path)))
    if _is_of_mechanism(tables):
        from hingepair.scenes.robot_scene import read_mechanism_scene

        return read_mechanism_scene(tables, Path(path), files)
    pair, outputs = _read_pair(tables), tables.table("outputs", required=False)
    motion = _read_motion(tables, Path(path).parent, pair)
    constants = {key: float(value) for key, value in tables.constants.items()}
    scene = Scene(Path(path), tables.text("title", default=pair.name), pair, motion, None, constants, files, tables)
    outputs.check_keys(("names",))
    if "names" not in outputs.values:
        return scene
    names = outputs.values["names"]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        outputs.fail("names", 'a list of names such as ["R2", "v2"]')
    with outputs.naming("names"):
        return replace(scene, outputs=scene._check_outputs(names))


def load_pair(path: str | os.PathLike[str]) -> HingePair | PlanarPair:
    """Read the pair of a scene file, which need not have a motion; return a HingePair or PlanarPair."""
    return _read_pair(load_tables(path))


def load_mechanism(path: str | os.PathLike[str]) -> Mechanism | None:
    """Read the mechanism of a scene file, which need not have a motion; return a Mechanism, or None if the scene
    describes a pair.
    """
    tables = load_tables(path)
    if not _is_of_mechanism(tables):
        return None
    from hingepair.scenes.robot_table import read_mechanism

    return read_mechanism(tables, Path(path).parent)


def load_dynamics_setup(path: str | os.PathLike[str]) -> DynamicsSetup | None:
    """Read the table [dynamics] of a scene file without simulating it; return a DynamicsSetup, or None if there is no
    such table.
    """
    from hingepair.scenes.motions.simulated import read_dynamics_setup

    tables = load_tables(path)
    return read_dynamics_setup(tables.table("dynamics"), _read_pair(tables)) if "dynamics" in tables.values else None


def load_tables(path: str | os.PathLike[str]) -> Table:
    """Read a scene file, evaluate its constants, and return its top-level Table."""
    return with_constants_evaluated(read_tables(path))


def with_constants_evaluated(tables: Table) -> Table:
    """Return a copy of a scene's top-level Table whose attribute `constants` holds the evaluated constants of
    [motion.constants].
    """
    if {"scene", "vary"} <= tables.values.keys():
        raise SceneError(tables.file, "a scene", f"a sweep (hingepair sweep {tables.file} computes it)")
    if _is_of_mechanism(tables):
        for key in tables.values:
            if key in _PAIR_TABLES and key not in _ROBOT_TABLES:
                tables.fail(key, "nothing of this name in the scene of a mechanism, by [mechanism] or [[joint]]")
        tables.check_keys(_ROBOT_TABLES)
    else:
        tables.check_keys((*_PAIR_TABLES, "mechanism", "joint"))
    motion = tables.table("motion", required=False)
    constants = motion.table("constants", required=False)
    value_by_name: dict[str, Any] = {}
    for key, value in constants.values.items():
        from hingepair.symbolic.expressions import constant_name_fault, parse_constant

        fault = constant_name_fault(key)
        if fault:
            constants.refuse(key, fault, quoted(key))
        with constants.naming(key):
            value_by_name[key] = (
                parse_constant(key, value, value_by_name) if isinstance(value, str) else constants.number(key)
            )
    return replace(tables, constants=value_by_name)


def _is_of_mechanism(tables: Table) -> bool:
    """Return whether a scene file, of which `tables` is the top-level Table, describes a mechanism by a table
    [mechanism] or [[joint]].
    """
    return not tables.values.keys().isdisjoint({"mechanism", "joint"})


def _read_pair(tables: Table) -> HingePair | PlanarPair:
    """Return the HingePair or PlanarPair of a scene's top-level Table."""
    if _is_of_mechanism(tables):
        tables.refuse("pair", "the scene of a pair, which has a table [pair]", "the scene of a mechanism")
    return read_pair(tables.table("pair"), tables.flag("planar"))


def _read_motion(tables: Table, folder: Path, pair: HingePair | PlanarPair) -> Motion:
    """Return the Motion of a pair that the tables [motion], [dynamics] and [time] define."""
    planar = isinstance(pair, PlanarPair)
    if "dynamics" in tables.values:
        from hingepair.scenes.motions.simulated import read_simulated_motion

        motion_table = tables.table("motion", required=False)
        return read_simulated_motion(tables.table("dynamics"), motion_table, tables.table("time"), pair)
    motion = tables.table("motion")
    if "file" not in motion.values:
        if "psi_dot" in motion.values and "omega1" not in motion.values:
            motion.fail("omega1", "the angular velocity of body 1, since psi_dot is given")
        from hingepair.scenes.motions.functions import read_expression_motion

        return read_expression_motion(motion, tables.table("time"), planar)
    from hingepair.scenes.motions.logs import read_log

    if planar:
        motion.fail("file", "no such key in a planar scene, whose motion is expressions")
    if "time" in tables.values:
        tables.fail("time", "no such table, since the column t of motion.file has the instants")
    return read_log(motion, folder)


def describes_motion(path: str | os.PathLike[str]) -> bool:
    """Return whether a scene file has a motion: a table [dynamics], or a table [motion] with more than constants."""
    tables = read_tables(path)
    motion = tables.table("motion", required=False).values
    return (
        "dynamics" in tables.values
        or bool(motion.keys() - {"constants"})
        or {"motion", "time"} <= tables.values.keys()
    )


def scene_files(path: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return a tuple of the paths of the files that a scene is read from: the scene file, and its URDF file and log
    if any.
    """
    return _source_files(read_tables(path), Path(path))


def _source_files(tables: Table, path: Path) -> tuple[Path, ...]:
    """Return a tuple of paths: the scene file `path`, and the URDF file and the log that its top-level Table names,
    if any, relative to the folder of the scene.
    """
    named = (("mechanism", "urdf"), ("motion", "file"))
    files = [tables.table(table, required=False).values.get(key) for table, key in named]
    return (path, *(path.parent / file for file in files if isinstance(file, str)))


def _output_level(output: str) -> int:
    """Return the derivative order that an output needs, by its name: 1 for rates, 2 for accelerations,
    otherwise 0.
    """
    quantity = output.rstrip("12")
    if quantity in {"v", "omega", "qd", "psid"}:
        return VELOCITY
    return ACCELERATION if quantity in {"a", "alpha", "qdd", "psidd"} else POSE
