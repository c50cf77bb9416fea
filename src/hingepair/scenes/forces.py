"""The forces that the motion of a scene takes (D1-D5, T1-T3), with what limits and gravity mean for them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.joints import KINDS, JointKind
from hingepair.mechanism.mechanism import tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.results import Record
from hingepair.mechanism.tree import Joint, loads_note
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.motions.known import Known
from hingepair.scenes.motions.motion import impact_sentences, non_finite_sentences
from hingepair.tables.data_frames import column_names, plain_magnitudes, with_magnitudes
from hingepair.tables.sheets import Sheet, cell_text, instant_text, number_texts, ruled_table
from hingepair.tables.units import Columns, Units, UnitsLike

# Headings of the table of joints: the effort against its limit, then position and rate.
_HEADINGS = (
    *("joint", "unit", "rms", "min tau", "max tau", "max |tau| at t", "limit", "of limit"),
    *("min q", "limit", "max q", "limit", "max |q'|", "limit"),
)


@dataclass(frozen=True, slots=True)
class JointLoad:
    """Summary of one joint over all instants: its effort (torque of a hinge [N m], force of a slider [N]), position
    and rate beside their limits, which are infinite where there are none.
    """

    #: name of the joint
    joint: str
    #: kind of the joint
    kind: JointKind
    #: root mean square of the effort; NaN if no value is finite
    rms: float
    #: least and greatest effort; NaN if no value is finite
    effort: tuple[float, float]
    #: instant of the largest effort [s]
    t_of_largest: float
    #: largest absolute value of the effort that the joint allows
    effort_limit: float
    #: number of instants at which the effort exceeds effort_limit
    beyond: int
    #: the first of these instants [s]; NaN if there are none
    t_of_first: float
    #: least and greatest coordinate [rad or m]
    position: tuple[float, float]
    #: limits of the coordinate
    position_limits: tuple[float, float]
    #: largest absolute value of the rate [rad/s or m/s]
    rate: float
    #: limit of the absolute value of the rate
    rate_limit: float

    @property
    def unit(self) -> str:
        """Unit of the joint's effort: N m for a hinge, N for a slider."""
        return KINDS[self.kind].effort

    @property
    def largest(self) -> float:
        """Largest absolute value of the effort."""
        return max(-self.effort[0], self.effort[1]) + 0.0

    @property
    def use(self) -> float:
        """The largest effort as a fraction of the effort limit; NaN without a limit."""
        if not math.isfinite(self.effort_limit):
            return math.nan
        if not self.effort_limit:  # a joint that may take no load
            return math.inf if self.largest else 0.0
        return self.largest / self.effort_limit


class SceneForces(Record):
    """Forces at the instants of a scene. They print as a table and can be saved to a file.

    Args:
        scene: the Scene.
        arrays: the coordinates of the joints and the forces, by name.
        gravity: acceleration of free fall that the forces were computed with [m/s^2]; shape (3,), in the plane (2,).
        notes: sentences for readers of the forces.
        tau: of a robot, joint efforts: torques of hinges [N m], forces of sliders [N]; shape (N, dof).
        loads: of a robot, a JointLoad for each joint that has a coordinate of its own.
    """

    __slots__ = ("_joints", "gravity", "loads", "notes", "tau")

    def __init__(
        self,
        scene: Any,
        arrays: Mapping[str, NDArray[Any]],
        *,
        gravity: tuple[float, ...],
        notes: tuple[str, ...],
        tau: Float64Array | None = None,
        loads: tuple[JointLoad, ...] = (),
    ) -> None:
        super().__init__(scene.t, arrays, f"forces: {scene.title}", scene.files, scene.unit, scene.units)
        self.gravity, self.notes, self._joints = gravity, notes, scene.subject.names
        self.tau, self.loads = tau, loads

    def __str__(self) -> str:
        lines = [line for rows in self.tables() for line in ("", *ruled_table(rows, 2))]
        return "\n".join((f"{self.described}: {len(self.t)} instants", *lines, "", *self.notes)).rstrip()

    def _sheet(self) -> Sheet:
        """Return what notebooks show."""
        return Sheet(f"{self.described}: {len(self.t)} instants", self.tables()[0], self.notes)

    def ranges(self, units: UnitsLike = None) -> dict[str, dict[str, float]]:
        """Return, by component, the first, smallest, largest and rms value, and the instant of the largest size. The
        efforts of joints are in `loads`.

        Args:
            units: units in place of SI units; by default those of the scene.
        """
        return self._ranges(self._vectors(), self.in_units(units))

    def _vectors(self) -> dict[str, NDArray[Any]]:
        """Return what is recorded beside coordinates and efforts of joints."""
        arrays = self.recorded().items()
        return {name: array for name, array in arrays if name not in self._joints and not name.startswith("tau_")}

    def _ranges(self, arrays: Mapping[str, NDArray[Any]], shown: Columns) -> dict[str, dict[str, float]]:
        """Return `ranges` of some arrays, in the units of `shown`."""
        arrays = {name: shown.converted(name.strip("|"), array) for name, array in arrays.items()}
        v = np.concatenate([array.reshape(len(self.t), -1) for array in arrays.values()], axis=1)
        finite = np.isfinite(v)
        v = np.where(finite, v, np.nan)
        known = finite.any(axis=0)
        largest = np.where(finite, np.abs(v), -1.0).argmax(axis=0)
        squares, count = np.nansum(v * v, axis=0), np.maximum(finite.sum(axis=0), 1)
        columns = {"first": v[0], "smallest": np.fmin.reduce(v), "largest": np.fmax.reduce(v)}
        columns |= {"rms": np.where(known, np.sqrt(squares / count), np.nan)}
        columns |= {"t_of_largest_size": np.where(known, shown.converted("t", self.t)[largest], np.nan)}
        return {
            name: {key: float(values[i]) for key, values in columns.items()}
            for i, name in enumerate(column_names(arrays))
        }

    def tables(self, units: UnitsLike = None) -> list[list[tuple[str, ...]]]:
        """Return the rows of the tables that `hingepair forces` prints, headings first.

        Args:
            units: units in place of SI units; by default those of the scene.
        """
        shown = self.in_units(units)
        ranges = self._ranges(with_magnitudes(self._vectors(), shown.si_unit), shown)
        offset, name = shown.units.offset_of_instants(self.t[0], self.t[-1])
        at = name or _time_name(shown.units)
        keys = ("first", "smallest", "largest", "rms", "t_of_largest_size")
        texts = number_texts([*ranges], [[row[key] for key in keys[:-1]] for row in ranges.values()], digits=5)
        rows: list[tuple[str, ...]] = [("", "unit", *keys[:-1], f"max |.| at {at}")]
        plain = plain_magnitudes(ranges, [name for name, own in zip(ranges, texts, strict=True) if {*own} == {"0"}])
        for (name, row), numbers in zip(ranges.items(), texts, strict=True):
            if name not in plain:
                at = instant_text(row["t_of_largest_size"] - offset)
                rows.append((name, shown.unit(name.strip("|")), *numbers, at))
        return [_load_rows(self.loads, self.t, shown.units), rows] if self.loads else [rows]

    def facts(self, units: UnitsLike = None) -> dict[str, Any]:
        """Return what the JSON of `hingepair forces` says.

        Args:
            units: units in place of SI units; by default those of the scene.
        """
        shown = self.in_units(units)
        converted = [_converted_load(load, shown.units) for load in self.loads]
        loads = {load.joint: {**asdict(load), "largest": load.largest} for load in converted}
        for own in loads.values():
            del own["joint"]
        joints = {} if self.tau is None else {"joints": loads}
        if shown.units:
            for load in self.loads:
                kind = KINDS[load.kind]
                texts = {"effort": kind.effort, "position": kind.unit, "rate": f"{kind.unit}/s", "time": "s"}
                loads[load.joint]["units"] = {key: shown.units.unit(si) for key, si in texts.items()}
        ranges = {shown.heading(name): own for name, own in self.ranges(units).items()}
        return {"gravity": list(self.gravity), **joints, "outputs": ranges}


def scene_forces(
    scene: Any, known: Known, arrays: dict[str, NDArray[Any]], gravity: tuple[float, ...], *, assumed: bool
) -> SceneForces:
    """Return the forces `arrays` of a Scene along its known motion, computed with `gravity`, as `Scene.forces`
    describes them; `assumed` says whether nobody gave it.
    """
    subject, motion, t = scene.subject, scene.motion, scene.t
    dynamics = scene.tables.table("dynamics", required=False)
    notes = [*non_finite_sentences(arrays)]
    tau: Any = arrays.pop("tau", None)
    columns = known.joint_columns(0) | arrays
    if motion.simulated is not None:
        notes += impact_sentences(motion.simulated.impacts, {joint.name: joint.unit for joint in subject.joints})
    else:
        own = {name: load for name, load in motion.loads.items() if name in dynamics.values}
        notes += _rest_friction_sentences(own, known, subject.pair is not None)
        if subject.planar and assumed:
            down = ", ".join(f"{component:g}" for component in gravity[:2])
            notes.append(
                f"gravity is taken along -y of the plane, ({down}) m/s^2; seen from above it is --gravity 0,0"
            )
    if subject.mechanism is None:
        notes += _torque_limit_sentences(subject.pair, t, arrays)
        return SceneForces(scene, columns, gravity=gravity[: subject.dimensions], notes=tuple(notes))
    loads = tuple(_summarize_joint(joint, i, t, known, tau[:, i]) for i, joint in enumerate(subject.joints))
    for load in loads:
        notes += _effort_limit_sentences(load, len(t))
    if (left_out := loads_note(tree_of(subject.mechanism))) and not dynamics.flag("joint_loads"):
        notes.append(f"{left_out}; joint_loads = true in [dynamics] counts them")
    return SceneForces(scene, columns, gravity=gravity, notes=tuple(notes), tau=tau, loads=loads)


def _rest_friction_sentences(loads: Mapping[str, HingeLoad], known: Known, is_pair: bool) -> Iterator[str]:
    """Yield a sentence for each joint at whose instants of rest dry friction is not known."""
    for name, load in loads.items():
        rates = known.column(1, known.names.index(name))
        still = int((rates == 0).sum())
        if still and load.sticking_friction:
            friction, motor = (
                ("friction_torque", "motor_torque") if is_pair else (f"friction of {name}", f"tau_{name}")
            )
            unit = "N m" if is_pair else "N m or N"
            yield (
                f"{friction} is 0 at {still} of {rates.size} instants, where {name}' is 0; friction may hold up to "
                f"{load.sticking_friction:g} {unit} of {motor} there"
            )


def _torque_limit_sentences(
    pair: HingePair | PlanarPair | None, t: Float64Array, arrays: Mapping[str, NDArray[Any]]
) -> Iterator[str]:
    """Yield one sentence if the pair has a torque_limit and motor_torque, or hinge_torque if there is no motor,
    exceeds this limit at any of the instants t; otherwise yield nothing.
    """
    limit = getattr(pair, "torque_limit", None)
    if limit is None:
        return
    name = "motor_torque" if "motor_torque" in arrays else "hinge_torque"
    beyond = np.flatnonzero(np.abs(arrays[name]) > limit)
    if beyond.size:
        first = f"first at t = {instant_text(t[beyond[0]])} s ({arrays[name][beyond[0]]:.6g})"
        yield f"{name} exceeds the torque_limit, {limit:g} N m, at {beyond.size} of {len(t)} instants, {first}"


def _converted_load(load: JointLoad, units: Units) -> JointLoad:
    """Return a load with its numbers in units."""
    kind = KINDS[load.kind]
    effort, position, rate, second = (units.factor(si) for si in (kind.effort, kind.unit, f"{kind.unit}/s", "s"))
    return replace(
        load,
        **{name: effort * getattr(load, name) for name in ("rms", "effort_limit")},
        effort=(effort * load.effort[0], effort * load.effort[1]),
        **{name: second * getattr(load, name) for name in ("t_of_largest", "t_of_first")},
        **{name: rate * getattr(load, name) for name in ("rate", "rate_limit")},
        position=(position * load.position[0], position * load.position[1]),
        position_limits=(position * load.position_limits[0], position * load.position_limits[1]),
    )


def _load_rows(loads: tuple[JointLoad, ...], t: Float64Array, units: Units) -> list[tuple[str, ...]]:
    """Return the table of joints in units, headings first; an infinite limit is an empty cell."""
    offset, name = units.offset_of_instants(t[0], t[-1])
    at = name or _time_name(units)
    headings = tuple(f"max |tau| at {at}" if text.endswith("at t") else text for text in _HEADINGS)
    rows: list[tuple[str, ...]] = [headings]
    for load in (_converted_load(load, units) for load in loads):
        use = "" if math.isnan(load.use) else f"{load.use:.0%}"
        sizes = (
            cell_text(load.rms),
            *map(cell_text, load.effort),
            instant_text(load.t_of_largest - offset),
            _limit_text(load.effort_limit),
            use,
        )
        both = zip(load.position, load.position_limits, strict=True)
        q = (text for value, limit in both for text in (cell_text(value), _limit_text(limit)))
        position = units.unit(KINDS[load.kind].unit)
        unit = f"{units.unit(load.unit)}, {position}" if units else load.unit
        rows.append((load.joint, unit, *sizes, *q, cell_text(load.rate), _limit_text(load.rate_limit)))
    return rows


def _time_name(units: Units) -> str:
    """Return t, with its unit unless that is the second: t [ms]."""
    unit = units.unit("s")
    return "t" if unit == "s" else f"t [{unit}]"


def _limit_text(value: float) -> str:
    return cell_text(value) if math.isfinite(value) else ""


def _summarize_joint(
    joint: Joint, joint_index: int, t: Float64Array, known_motion: Known, tau: Float64Array
) -> JointLoad:
    """Return the JointLoad of a joint from its effort `tau` (N,) and its motion at the instants t."""
    finite = np.isfinite(tau)
    extremes, when = (math.nan, math.nan), math.nan
    if finite.any():
        when = float(t[np.where(finite, np.abs(tau), -1.0).argmax()])
        extremes = float(tau[finite].min()), float(tau[finite].max())
    least, most = joint.effort_bounds
    beyond = np.flatnonzero((tau < least) | (tau > most))
    q, qd = known_motion.column(0, joint_index), np.abs(known_motion.column(1, joint_index))
    return JointLoad(
        joint.name,
        joint.kind,
        float(np.sqrt(np.mean(tau[finite] ** 2))) if finite.any() else math.nan,
        extremes,
        when,
        joint.effort_limit,
        int(beyond.size),
        float(t[beyond[0]]) if beyond.size else math.nan,
        (float(np.fmin.reduce(q)), float(np.fmax.reduce(q))),
        joint.position_limits,
        float(np.fmax.reduce(qd)),
        joint.rate_limit,
    )


def _effort_limit_sentences(load: JointLoad, instant_count: int) -> Iterator[str]:
    """Yield one sentence if a JointLoad exceeds the joint's effort limit at some instants, otherwise nothing."""
    if load.beyond:
        yield (
            f"{load.joint} takes up to {load.largest:.4g} {load.unit}, more than its limit of {load.effort_limit:g}, "
            f"at {load.beyond} of {instant_count} instants, first at t = {instant_text(load.t_of_first)} s"
        )
