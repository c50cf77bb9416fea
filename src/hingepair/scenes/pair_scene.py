"""Scenes of pairs, in space or in the plane, and their results."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.results import missing_attribute_error
from hingepair.equations.quantities import ACCELERATION, QUANTITIES, Quantity, unit_of
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.accuracy import error_ratios, output_scales
from hingepair.mechanism.pairs.geometry import constants_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair, dynamics_in_space
from hingepair.mechanism.pairs.requests import computation_of, compute_arrays
from hingepair.mechanism.requests import ROWS
from hingepair.mechanism.states import Energy, Momentum, PairState, PlanarState
from hingepair.motion.run import stop_overrun
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.plans.arguments import check_outputs
from hingepair.plans.pairs import PLANE, SPACE, PairKind, point_outputs, unit_among
from hingepair.scenes.forces import SceneForces, pair_forces
from hingepair.scenes.instants import Rows
from hingepair.scenes.motions.known import Derivatives, KnownMotion, MotionByBody1, quaternion_columns
from hingepair.scenes.motions.motion import LimitCounter, PairMotion
from hingepair.scenes.scene import Residual, Scene, ScenePlan, SceneResult

if TYPE_CHECKING:
    from hingepair.scenes.motions.functions import FunctionsOfTime
    from hingepair.symbolic.exact import Expr
    from hingepair.validation.report import CrossValidation

COORDINATE_OUTPUTS: Final = ("q", "qd", "qdd", "psi", "psid", "psidd")
_ATTITUDES: Final = {"quat1": "S1", "quat2": "S2"}  # rotation matrix by the output with its quaternion (x, y, z, w)
FURTHER_OUTPUTS: Final = (*COORDINATE_OUTPUTS, *_ATTITUDES)
"""Outputs that a scene has beside those of the equations; the quaternions only in space."""
PAIR_FORCES: Final = (
    *("hinge_torque", "bearing_torque", "hinge_force", "force1", "torque1"),
    *(f"{part}_torque" for part in TORQUE_PARTS),
)
"""Forces of a pair with masses; the last ones, parts of hinge_torque, if [dynamics] has loads."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PairResult(SceneResult):
    """Results of a pair's scene: every attribute of its state (R2, S2, d, v2, ...), and the coordinates;
    `result["tip"].R` is the position of a point.

    q, qd and qdd have shape (samples, 7), in the plane (samples, 4); psi, psid and psidd have shape (samples,). If
    the attitude of body 1 is not given by Euler angles, q is x, y, z, the quaternion qx, qy, qz, qw (qw >= 0) and
    psi; qd is v1, omega1 and psi'; qdd is a1, alpha1 and psi''. quat1 and quat2, shape (samples, 4), are the
    quaternions (x, y, z, w), w >= 0, of S1 and S2.
    """

    state: PairState | PlanarState
    scene: PairScene
    known: KnownMotion
    #: names of the requested outputs; None for all outputs of body 2 and of points, and the hinge angle
    requested: tuple[str, ...] | None

    def requested_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the requested outputs by name; shape (samples, ...). Coordinates are named like columns of a log."""
        names, state = self.requested, self.state.arrays()
        if names is None:
            names = (*state, *("psi", "psid", "psidd")[: self.known.level + 1])
        arrays: dict[str, NDArray[Any]] = {name: array for name, array in state.items() if name in names}
        for name in names:
            components = self._components(name) if name in FURTHER_OUTPUTS else {}
            # The v1_x of qd is left out where there is v1.
            arrays |= {key: own for key, own in components.items() if key.partition("_")[0] not in arrays}
        return arrays

    def energy(self) -> Energy:
        """Compute the kinetic and potential energy [J] of the pair (equation D7), in the scene's gravity."""
        moved, gravity = self._in_space(), self.scene.motion.gravity(self.scene.pair)
        return dynamics_in_space(self.scene.pair).energy(moved.body1, moved.psi, moved.hinge[1], gravity=gravity)

    def momentum(self) -> Momentum:
        """Compute the linear and angular momentum of the pair (equation D8)."""
        moved = self._in_space()
        return dynamics_in_space(self.scene.pair).momentum(moved.body1, moved.psi, moved.hinge[1])

    def _in_space(self) -> MotionByBody1:
        if self.known.level < ACCELERATION:
            raise ArgumentError("outputs", "some that need second derivatives, such as a2", self.state.outputs)
        return self.known.in_space(self.scene.pair)

    def _components(self, name: str) -> dict[str, NDArray[np.float64]]:
        """Return the components of one of the FURTHER_OUTPUTS by column name; empty if it was not computed."""
        if name in _ATTITUDES:
            S = getattr(self.state, _ATTITUDES[name], None)
            return {} if S is None else quaternion_columns(S, name[-1])
        order = QUANTITIES[name].order
        if order > self.known.level:
            return {}
        return self.known.log_columns(order) if name[0] == "q" else {name: self.known.hinge_angle(order)}

    def residual_sizes(self) -> NDArray[np.float64]:
        """Return rows (largest residual, its ratio to u * scale) of E1 and, of a motion with rates, of E2."""
        pair, a = self.scene.space, self.known.body_arrays(self.scene.pair)
        W1, psid = a.pop("W1", None), a.pop("psid", None)
        scales = output_scales(u1=pair.u1, u2=pair.u2, R1=a["R1"], W1=W1, psid=psid)
        names, rate = (("gap",), {}) if psid is None else (("gap", "slip"), {"psid_given": psid})
        measured = compute_arrays(constants_of(pair), names, {**a, **rate}, {"R1": a["R1"].shape[:-1]})
        sizes = []
        for name, residual in zip(("R2", "omega2"), measured.values(), strict=False):
            error, ratio = error_ratios(name, residual, np.zeros_like(residual), scales[name])
            sizes.append([_largest_finite(error), _largest_finite(ratio)])
        return np.array(sizes)

    def __getitem__(self, name: str) -> Any:
        """Return the PointState of a point by its name, such as `result["tip"].R`, or an output of the state."""
        return self.state[name]

    def __getattr__(self, name: str) -> Any:
        if name in FURTHER_OUTPUTS:
            components = [*self._components(name).values()]
            return None if not components else np.stack(components, -1) if name[0] == "q" else components[0]
        if not name.startswith("_") and name not in self.__dataclass_fields__ and hasattr(type(self.state), name):
            return getattr(self.state, name)
        raise missing_attribute_error(self, name)

    def _of_what(self) -> str:
        return f"state={self.state!r}"

    def _available_names(self) -> Iterable[str]:
        """Return the names that can be asked of this result, such as energy, for its printed form."""
        pair, level = self.scene.pair, self.known.level
        bodies = {"energy": pair.body2, "momentum": pair.body1 and pair.body2}
        masses = (name for name, body in bodies.items() if level == ACCELERATION and body is not None)
        beside = (name for name in self.scene.further_outputs(level) if getattr(self, name) is not None)
        return *dir(self.state), *beside, *masses


def _largest_finite(values: NDArray[Any]) -> float:
    return float(np.fmax.reduce(np.where(np.isfinite(values), values, np.nan), axis=None, initial=np.nan))


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class PairScene(Scene):
    """Scene of a pair."""

    motion: PairMotion
    #: the HingePair, or for a planar scene the PlanarPair
    pair: HingePair | PlanarPair
    max_check_instants: ClassVar[int] = 10_001  # about a second
    _noted: ClassVar[str] = "psi"

    @property
    def space(self) -> HingePair:
        """The pair as a HingePair; a PlanarPair is converted by `to_spatial`."""
        return self.pair if isinstance(self.pair, HingePair) else self.pair.to_spatial()

    @property
    def kind(self) -> PairKind:
        """The kind of motion, which says which outputs exist."""
        return SPACE if isinstance(self.pair, HingePair) else PLANE

    @property
    def dimensions(self) -> int:
        """Number of components of a vector, 3, or 2 in the plane."""
        return len(self.pair.u1)

    @property
    def sequence(self) -> str | None:
        """Euler sequence of body 1, such as "XYZ"; None if its attitude is not given by three Euler angles."""
        return self.motion.source.sequence

    @property
    def of_points(self) -> dict[str, Quantity]:
        """The quantities of the outputs of points, such as tip, tip_v and tip_a, by name."""
        return point_outputs(constants_of(self.pair).points)

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components such as R2_x or tip_x."""
        return unit_among(self.of_points, name)

    def _level(self, output: str) -> int:
        """Return the derivative order that an output needs."""
        return {**QUANTITIES, **self.of_points}[_ATTITUDES.get(output, output)].order

    def further_outputs(self, level: int) -> tuple[str, ...]:
        """Return the FURTHER_OUTPUTS that need derivatives of order `level` at most."""
        names = FURTHER_OUTPUTS if self.kind == SPACE else COORDINATE_OUTPUTS
        return tuple(name for name in names if self._level(name) <= level)

    @property
    def expressions(self) -> dict[str, Expr | None]:
        """SymPy expressions of the coordinates by name (x, y, z, phi_x, phi_y, phi_z, psi; in the plane x, y, phi,
        psi). The value of a coordinate given by way points is None.
        """
        return self.functions().expressions()

    def functions(self) -> FunctionsOfTime:
        """Return the coordinates as functions of time; raise an ArgumentError if the motion does not come as such."""
        from hingepair.scenes.motions.functions import MotionByFunctions

        source = self.motion.source
        if not isinstance(source, MotionByFunctions):
            wanted = "a scene whose motion is coordinates as expressions in t"
            raise ArgumentError("motion", wanted, f"one whose motion is {self.motion.origin}")
        return source.functions

    def coordinates(self, t: ArrayLike) -> Derivatives:
        """Return all coordinates and their exact derivatives at any instants of a motion by functions of time.

        Args:
            t: instants [s]; shape (...).

        Returns:
            (q, qd, qdd), tuples of seven (in the plane four): arrays of t's shape, Python floats for what does not
            depend on t. Samples where an expression has no real value are NaN; derivatives at a kink are those from
            the right.
        """
        return self.functions().derivatives(t, ACCELERATION)

    def request(self, outputs: Iterable[str] | None) -> tuple[str, ...] | None:
        """Return the names of the outputs, by default those that the scene names; None for all of body 2."""
        if outputs is None:
            return self.outputs
        level = self.motion.level
        levels = constants_of(self.pair).levels
        names = check_outputs(outputs, (*levels, *FURTHER_OUTPUTS), self._remark_on_unknown)
        known = (*(name for name in levels if self._level(name) <= level), *self.further_outputs(level))
        for name in names:
            if name not in known:
                hint = self.motion.hint if self._level(name) > level else ""
                raise ArgumentError("outputs", choices(known) + hint, quoted(name))
        return names

    def _remark_on_unknown(self, name: str) -> str:
        """Return what a message on an unknown output adds: what it is instead, or the nearest name."""
        known = (*constants_of(self.pair).levels, *FURTHER_OUTPUTS)
        if name in PAIR_FORCES:
            return f" (hingepair forces and scene.forces() give {name})"
        whole, _, component = name.rpartition("_")
        if component in ("x", "y", "z") and whole in known:
            return f" ({whole} has all its components)"
        return nearest(name, (*known, *PAIR_FORCES))

    def _needed(self, names: tuple[str, ...] | None) -> tuple[tuple[str, ...] | None, int]:
        """Return the outputs of the equations and the derivative order that the named outputs need."""
        if names is None:
            level = self.motion.level
            of_points = (name for name, quantity in self.of_points.items() if quantity.order <= level)
            return (*self.kind.default_outputs(level), *of_points), level
        of_equations = (_ATTITUDES.get(name, name) for name in names if name not in COORDINATE_OUTPUTS)
        return tuple(dict.fromkeys(of_equations)), max(map(self._level, names))

    def _evaluated(self, rows: Rows, request: tuple[str, ...] | None, min_order: int = 0) -> PairResult:
        t = np.asarray(read_only(self.motion.t[rows]))
        needed, order = self._needed(request)
        known = self.motion.source.part(rows, max(order, min_order))
        state: PairState | PlanarState
        if needed == ():
            state = (PairState if self.kind == SPACE else PlanarState)({}, t.shape)
        else:
            state = known.part(slice(None), order).forward_kinematics(self.pair, needed, self.backend)
        first = (rows.start or 0) if isinstance(rows, slice) else 0
        return PairResult(t, state, self, known, request, first)

    def plan(self, outputs: Iterable[str] | None = None) -> ScenePlan:
        """Return what `evaluate` would compute and skip, and why, as an object whose text says so.

        Args:
            outputs: as for `evaluate`.
        """
        needed, order = self._needed(self.request(outputs))
        motion = self.motion.source.part(slice(1), order)
        names = self.kind.default_outputs(order) if needed is None else needed
        # Two samples of what varies: one sample would be a known constant.
        samples = {
            part: tuple(np.empty(2) if isinstance(value, np.ndarray) else value for value in values)
            for part, values in zip(ROWS, motion.derivatives, strict=False)
        }
        computation = computation_of(constants_of(self.pair), names, motion.sequence)
        counts = [computation.count_operations(samples)] if names else []
        return ScenePlan.of(names, counts, order, self.motion.level, motion.constant_names())

    def check_arrays(self, outputs: Iterable[str]) -> None:
        """Raise an ArgumentError for outputs that `arrays` does not compute."""
        names, known = tuple(outputs), (*constants_of(self.pair).levels, *FURTHER_OUTPUTS, *PAIR_FORCES)
        for name in names:
            if name not in known:
                raise ArgumentError("outputs", choices(known) + nearest(name, known), quoted(name))
        if moving := [name for name in names if name not in PAIR_FORCES]:
            self.request(moving)

    def arrays(self, outputs: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
        """Return outputs by name, those of `forces` too; shape (samples, ...)."""
        if outputs is None:
            found: dict[str, NDArray[Any]] = self.evaluate().requested_arrays()
            return found
        names = tuple(outputs)
        self.check_arrays(names)
        moving = [name for name in names if name not in PAIR_FORCES]
        arrays: dict[str, NDArray[Any]] = self.evaluate(moving).requested_arrays() if moving else {}
        if len(moving) == len(names):
            return arrays
        if self.motion.level < ACCELERATION:
            self.tables.refuse("motion", "a motion with accelerations, which forces need", self.motion.origin)
        forces = self.forces().recorded()
        for name in names:
            if name in PAIR_FORCES:
                if name not in forces:
                    needed = "loads in [dynamics]" if name.removesuffix("_torque") in TORQUE_PARTS else "masses"
                    self.tables.refuse("pair", f"{needed} and a kind of pair that {name} needs", "none")
                arrays[name] = forces[name]
        return arrays

    def _compared(self, rows: Rows) -> CrossValidation:
        report = self.motion.source.part(rows, self.motion.level).cross_validate(self.pair)
        report = replace(report, notes=self.motion.error_notes(report.u))
        motion = self.motion.simulated
        if motion is None:
            return report
        from hingepair.validation.cross_validate import compare_loads, compare_rates

        part = self.motion.source.part(rows, ACCELERATION).in_space(self.pair)
        robot = Mechanism(
            [replace(motion.space, name="body2")], base="free" if motion.base in {"free", "pinned"} else "fixed"
        )
        given = {name: load[rows] for name, load in motion.loads.items()}
        of_joint = {"hinge_torque": "tau", **{f"{part}_torque": part for part in TORQUE_PARTS}}
        loads = {name: given[own][:, None] for own, name in of_joint.items() if own in given}
        loads |= {"force1": given["force1"], "torque1": given["torque1"]}
        loads |= {"force_body2": given["force2"], "torque_body2": given["torque2"]}
        q, qd, qdd = (np.asarray(one)[:, None] for one in part.hinge)
        compared = compare_loads(
            robot, q, qd, qdd, part.body1, motion.gravity, loads, motion.base, is_planar=self.kind == PLANE
        )
        whole = self.motion.source.part(slice(self.samples), ACCELERATION).in_space(self.pair).hinge
        rates = compare_rates(self.instants[:], [np.asarray(one)[:, None] for one in whole], ("psi",))
        forces = [replace(row, worst_part="") for row in compared]
        return replace(report, forces=(replace(forces[0], output="hinge_torque"), *forces[1:], *rates))

    def _forces(self, t: Float64Array, gravity: ArrayLike | None, record: dict[str, Any]) -> SceneForces:
        return pair_forces(self.pair, self.motion, t, gravity, record)

    def watches(self) -> list[LimitCounter]:
        """Return counters of psi and, of a pair with a rate limit, of its rate."""
        space, rate = self.space, self.space.rate_limit if self.motion.level else None
        limits, unit = space.limits or (-math.inf, math.inf), unit_of("psi")
        psi = LimitCounter("psi", limits, unit, lambda known: known.psi, self.motion.stops)
        if rate is None:
            return [psi]
        return [psi, LimitCounter("psi'", (-rate, rate), unit_of("psid"), lambda known: known.hinge_angle(1))]

    def last_notes(self, watches: Sequence[LimitCounter]) -> Iterable[str]:
        """Return sentences on soft stops and on the motion itself."""
        motion, (psi, *_) = self.motion, watches
        least, most = psi.least, psi.most
        if motion.simulated is not None:  # between the instants, too
            least, most = motion.simulated.psi_range
        if soft := stop_overrun("psi", "rad", motion.stops, least, most):
            yield f"{soft}; stop_stiffness hardens them"
        stops = motion.stops
        shown, deepest = (
            max(stops[0] - low, high - stops[1]) for low, high in ((psi.least, psi.most), (least, most))
        )
        if deepest > max(1.05 * shown, 1e-9):  # rad; less is rounding
            depths = f"{deepest:.3g} rad into a stop between instants, {max(shown, 0):.3g} rad at them"
            yield f"psi presses {depths}: more instants show the peak of its force"
        yield from motion.notes
        if math.isnan(motion.error_estimate):
            yield motion.doubt

    def angle_limits(self) -> dict[str, Sequence[float]]:
        """Return the limits of psi; empty where there are none."""
        return {"psi": self.space.limits or ()}

    def _sizes(self, rows: Rows) -> tuple[Float64Array, Any, Any]:
        """Return |omega1| + |psi'| [rad/s], v1, and a1 if it is known."""
        known = self.motion.source.part(rows, self.motion.level).in_space(self.pair)
        omega = np.broadcast_to(np.asarray(known.body1.omega), (len(known.psi), 3))
        rates = np.linalg.norm(omega, axis=1) + np.abs(known.hinge[1])
        return rates, known.body1.v, known.body1.a if self.motion.level == ACCELERATION else None

    @property
    def residuals(self) -> tuple[Residual, ...]:
        """E1 and, of a motion with rates, E2."""
        both = (
            Residual("E1", "R1 + S1 u1 - (R2 + S2 u2)", "m"),
            Residual("E2", "omega2 - omega1 - S2 C^T n psi'", "rad/s"),
        )
        return both[: self.motion.level + 1]

    def is_moved_by(self, keys: Sequence[Sequence[str | int]]) -> bool:
        """Return whether the motion may depend on numbers of the file: a given one without loads does not depend on
        [pair]; of loads, stops may stand at the limits of the pair.
        """
        loaded = self.motion.simulated is not None or self.motion.hinge_load is not None
        return loaded or any(steps[0] != "pair" for steps in keys)

    def by_body1(self, outputs: Sequence[str] | None) -> PairScene:
        """Return the scene with its motion as that of body 1, which is computed once, unless outputs need the
        coordinates.
        """
        if self.sequence is None or not outputs or {"q", "qd", "qdd"} & {*outputs}:
            return self
        source = self.motion.source.part(slice(None), self.motion.level).in_space(self.pair)
        return replace(self, motion=replace(self.motion, source=source))

    def require_pair(self) -> PairScene:
        """Return the scene itself."""
        return self

    def _subject(self) -> str:
        keys = ("u1", "u2", "n") if self.kind == SPACE else ("u1", "u2")
        vectors = (f"{key} = ({', '.join(f'{c:g}' for c in getattr(self.pair, key))})" for key in keys)
        return f"{self.pair.name}: {', '.join(vectors)}"

    def _own_facts(self) -> dict[str, Any]:
        vectors = {key: getattr(self.space, key).tolist() for key in ("u1", "u2", "n", "home")}
        return {"sequence": self.sequence, "error_estimate": self.motion.error_estimate, "pair": vectors}

    def _motion_rows(self) -> list[tuple[str, str]]:
        outputs = self.outputs or ("all of body 2", *(point.name for point in constants_of(self.pair).points))
        return [
            ("pair", self.pair.name),
            ("motion", f"{self.motion.origin}; {self.motion.description}"),
            ("outputs", ", ".join(outputs)),
        ]
