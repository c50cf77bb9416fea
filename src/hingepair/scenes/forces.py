"""The forces that the motion of a scene takes (D1-D5, T1-T3), with what limits and gravity mean for them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.joints import KINDS, JointKind
from hingepair.mechanism.mechanism import tree_of
from hingepair.mechanism.results import Record
from hingepair.mechanism.tree import Joint, loads_note
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.motions.known import Known
from hingepair.scenes.motions.motion import impact_sentences, non_finite_sentences
from hingepair.tables.data_frames import column_names, plain_magnitudes, with_magnitudes
from hingepair.tables.sheets import Sheet, cell_text, instant_text, number_texts, ruled_table
from hingepair.tables.units import Columns, Units, UnitsLike

_RANGES: Final = ("first", "smallest", "largest", "rms")


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

    def converted(self, units: Units) -> JointLoad:
        """Return the summary with its numbers in units."""
        position = KINDS[self.kind].unit
        fields = {self.unit: ("rms", "effort", "effort_limit"), position: ("position", "position_limits")}
        fields |= {f"{position}/s": ("rate", "rate_limit"), "s": ("t_of_largest", "t_of_first")}
        changed: dict[str, Any] = {}
        for si, names in fields.items():
            for name in names:
                value, factor = getattr(self, name), units.factor(si)
                changed[name] = tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value
        return replace(self, **changed)


def _joint_load(joint: Joint, t: Float64Array, q: Float64Array, qd: Float64Array, tau: Float64Array) -> JointLoad:
    """Return the JointLoad of a joint from its motion and its effort at the instants t; (N,) each."""
    finite = np.isfinite(tau)
    known, when = tau[finite], t[np.where(finite, np.abs(tau), -1.0).argmax()]
    least, most = joint.effort_bounds
    beyond = np.flatnonzero((tau < least) | (tau > most))
    return JointLoad(
        joint=joint.name,
        kind=joint.kind,
        rms=float(np.sqrt(np.mean(known**2))) if known.size else math.nan,
        effort=(float(known.min()), float(known.max())) if known.size else (math.nan, math.nan),
        t_of_largest=float(when) if known.size else math.nan,
        effort_limit=joint.effort_limit,
        beyond=int(beyond.size),
        t_of_first=float(t[beyond[0]]) if beyond.size else math.nan,
        position=(float(np.fmin.reduce(q)), float(np.fmax.reduce(q))),
        position_limits=joint.position_limits,
        rate=float(np.fmax.reduce(np.abs(qd))),
        rate_limit=joint.rate_limit,
    )


class SceneForces(Record):
    """Forces at the instants of a scene. They print as a table and can be saved to a file.

    Args:
        scene: the Scene.
        known: its motion at all instants, with accelerations.
        arrays: the forces by name.
        gravity: acceleration of free fall that the forces were computed with [m/s^2]; shape (3,).
        assumed: whether nobody gave gravity.

    Attributes:
        gravity: acceleration of free fall that the forces were computed with [m/s^2]; shape (3,), in the plane (2,).
        notes: sentences for readers of the forces.
        tau: of a robot, joint efforts: torques of hinges [N m], forces of sliders [N]; shape (N, dof).
        loads: of a robot, a JointLoad for each joint that has a coordinate of its own.
    """

    __slots__ = ("_joints", "gravity", "loads", "notes", "tau")

    def __init__(
        self, scene: Any, known: Known, arrays: dict[str, Any], gravity: tuple[float, ...], *, assumed: bool
    ) -> None:
        subject, t = scene.subject, scene.t
        self.tau, self.gravity, self._joints = arrays.pop("tau", None), gravity[: subject.dimensions], subject.names
        columns = known.joint_columns(0) | arrays
        super().__init__(t, columns, f"forces: {scene.title}", scene.files, scene.unit, scene.units)
        of_pair: Any = arrays.get("motor_torque", arrays.get("hinge_torque"))
        loads = []
        for k, joint in enumerate(subject.joints):
            tau = of_pair if subject.mechanism is None else self.tau[:, k]
            loads.append(_joint_load(joint, t, known.column(0, k), known.column(1, k), tau))
        self.loads = tuple(loads) if subject.mechanism is not None else ()
        self.notes = tuple(_notes(scene, known, arrays, loads, assumed=assumed))

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
        rms = np.where(known, np.sqrt(squares / count), np.nan)
        columns = dict(zip(_RANGES, (v[0], np.fmin.reduce(v), np.fmax.reduce(v), rms), strict=True))
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
        second = shown.units.unit("s")
        offset, name = shown.units.offset_of_instants(self.t[0], self.t[-1])
        at = name or ("t" if second == "s" else f"t [{second}]")
        texts = number_texts([*ranges], [[row[key] for key in _RANGES] for row in ranges.values()], digits=5)
        rows: list[tuple[str, ...]] = [("", "unit", *_RANGES, f"max |.| at {at}")]
        plain = plain_magnitudes(ranges, [name for name, own in zip(ranges, texts, strict=True) if {*own} == {"0"}])
        for (name, row), numbers in zip(ranges.items(), texts, strict=True):
            if name not in plain:
                when = instant_text(row["t_of_largest_size"] - offset)
                rows.append((name, shown.unit(name.strip("|")), *numbers, when))
        if not self.loads:
            return [rows]
        efforts = ("rms", "min tau", "max tau", f"max |tau| at {at}", "limit", "of limit")
        headings = ("joint", "unit", *efforts, "min q", "limit", "max q", "limit", "max |q'|", "limit")
        return [[headings, *(_load_row(load, shown.units, offset) for load in self.loads)], rows]

    def facts(self, units: UnitsLike = None) -> dict[str, Any]:
        """Return what the JSON of `hingepair forces` says.

        Args:
            units: units in place of SI units; by default those of the scene.
        """
        shown, joints = self.in_units(units), {}
        for load in (load.converted(shown.units) for load in self.loads):
            kind = KINDS[load.kind]
            own = {**asdict(load), "largest": load.largest}
            texts = {"effort": kind.effort, "position": kind.unit, "rate": f"{kind.unit}/s", "time": "s"}
            joints[own.pop("joint")] = own
            if shown.units:
                own["units"] = {key: shown.units.unit(si) for key, si in texts.items()}
        ranges = {shown.heading(name): own for name, own in self.ranges(units).items()}
        of_joints = {} if self.tau is None else {"joints": joints}
        return {"gravity": list(self.gravity), **of_joints, "outputs": ranges}


def _load_row(load: JointLoad, units: Units, offset: float) -> tuple[str, ...]:
    """Return a joint's row of the table of joints in units; an infinite limit is an empty cell."""

    def limit(value: float) -> str:
        return cell_text(value) if math.isfinite(value) else ""

    load = load.converted(units)
    position = units.unit(KINDS[load.kind].unit)
    unit = f"{units.unit(load.unit)}, {position}" if units else load.unit
    use = "" if math.isnan(load.use) else f"{load.use:.0%}"
    when = instant_text(load.t_of_largest - offset)
    efforts = (cell_text(load.rms), *map(cell_text, load.effort), when, limit(load.effort_limit), use)
    both = zip(load.position, load.position_limits, strict=True)
    q = (text for value, end in both for text in (cell_text(value), limit(end)))
    return (load.joint, unit, *efforts, *q, cell_text(load.rate), limit(load.rate_limit))


def _notes(
    scene: Any, known: Known, arrays: Mapping[str, NDArray[Any]], loads: list[JointLoad], *, assumed: bool
) -> Iterator[str]:
    """Yield sentences on forces that are not finite or not known, on gravity and on limits that are exceeded."""
    subject, motion, count = scene.subject, scene.motion, scene.samples
    dynamics = scene.tables.table("dynamics", required=False)
    units = {joint.name: joint.unit for joint in subject.joints}
    yield from non_finite_sentences(arrays)
    if motion.simulated is not None:
        yield from impact_sentences(motion.simulated.impacts, units)
    for name, load in motion.loads.items() if motion.simulated is None else ():
        still = int((known.column(1, known.names.index(name)) == 0).sum())
        if name in dynamics.values and still and load.sticking_friction:
            unit = "N m" if units[name] == "rad" else "N"
            yield (
                f"friction of {name} is 0 at {still} of {count} instants, where {name}' is 0; it may hold up to "
                f"{load.sticking_friction:g} {unit} there"
            )
    if motion.simulated is None and subject.planar and assumed:
        down = ", ".join(f"{component:g}" for component in scene.gravity[:2])
        yield f"gravity is taken along -y of the plane, ({down}) m/s^2; seen from above it is --gravity 0,0"
    for own in loads:
        if own.beyond:
            yield (
                f"{own.joint} takes up to {own.largest:.4g} {own.unit}, more than its limit of {own.effort_limit:g}, "
                f"at {own.beyond} of {count} instants, first at t = {instant_text(own.t_of_first)} s"
            )
    left_out = loads_note(tree_of(subject.mechanism)) if subject.mechanism is not None else ""
    if left_out and not dynamics.flag("joint_loads"):
        yield f"{left_out}; joint_loads = true in [dynamics] counts them"
