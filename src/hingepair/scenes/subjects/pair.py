"""A pair in a scene, in space or in the plane: its outputs, forces and comparison with Pinocchio."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from hingepair.equations.quantities import QUANTITIES, VELOCITY, Quantity
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.geometry import constants_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair, dynamics_in_space
from hingepair.mechanism.pairs.requests import check_masses, computation_of
from hingepair.mechanism.requests import ROWS
from hingepair.mechanism.states import PairState, PlanarState
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.arguments import check_outputs
from hingepair.plans.pairs import PLANE, SPACE, PairKind, point_outputs, unit_among
from hingepair.scenes.motions.known import PSI, Derivatives, Known, quaternion_columns
from hingepair.scenes.motions.motion import Motion
from hingepair.scenes.subjects.subject import Acting, Arrays, Computed, Plan, SubjectBase, compared_rates
from hingepair.scenes.tables import Table

if TYPE_CHECKING:
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

_MAX_POINTS: Final = 60  # outputs of points in one kernel, whose time to compile grows with them

Request = tuple[str, ...] | None
"""Names of outputs; None for all of body 2 and of points, and psi."""


class PairSubject(SubjectBase):
    """A pair, whose joint is psi."""

    max_check_instants: ClassVar[int] = 10_001  # about a second
    mechanism: None = None

    def __init__(self, pair: HingePair | PlanarPair) -> None:
        self.pair = pair
        self.planar = isinstance(pair, PlanarPair)

    @property
    def name(self) -> str:
        """Name of the pair."""
        return self.pair.name

    @property
    def names(self) -> tuple[str, ...]:
        """The joint psi."""
        return PSI

    @lock_free_cached_property
    def robot(self) -> Mechanism:
        """The pair as a mechanism with the joint and link psi; in the plane with its planar dynamics."""
        space = replace(dynamics_in_space(self.pair), name=PSI[0])
        return Mechanism([space], base="fixed" if space.body1 is None else "free", name=self.name)

    @property
    def base_names(self) -> tuple[str, ...]:
        """Keys of [motion] for the coordinates of body 1."""
        return self.kind.coordinates[:-1]

    @property
    def rests(self) -> Mapping[str, float]:
        """Where psi rests: it has a motion."""
        return {PSI[0]: 0.0}

    @property
    def space(self) -> HingePair:
        """The pair as a HingePair; a PlanarPair is converted by `to_spatial`."""
        return self.pair if isinstance(self.pair, HingePair) else self.pair.to_spatial()

    @property
    def kind(self) -> PairKind:
        """The kind of motion, which says which outputs exist."""
        return PLANE if self.planar else SPACE

    @property
    def of_points(self) -> dict[str, Quantity]:
        """The quantities of the outputs of points, such as tip, tip_v and tip_a, by name."""
        return point_outputs(constants_of(self.pair).points)

    def check_motion_keys(self, motion: Table, further: Collection[str] = ()) -> None:
        """Refuse keys of [motion] other than coordinates and `further` options."""
        own = () if self.planar else ("sequence", *further)
        motion.check_keys((*self.kind.coordinates, *own))

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components such as R2_x or tip_x."""
        return unit_among(self.of_points, name)

    def _level(self, output: str) -> int:
        return {**QUANTITIES, **self.of_points}[_ATTITUDES.get(output, output)].order

    def _further_outputs(self, level: int) -> tuple[str, ...]:
        names = COORDINATE_OUTPUTS if self.planar else FURTHER_OUTPUTS
        return tuple(name for name in names if self._level(name) <= level)

    def request(self, outputs: Iterable[str] | None, motion: Motion) -> Request:
        """Return the names of the outputs; None for all of body 2."""
        if outputs is None:
            return None
        level, levels = motion.level, constants_of(self.pair).levels
        names = check_outputs(outputs, (*levels, *FURTHER_OUTPUTS), self._remark_on_unknown)
        known = (*(name for name in levels if self._level(name) <= level), *self._further_outputs(level))
        for name in names:
            if name not in known:
                hint = motion.hint if self._level(name) > level else ""
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

    def _of_equations(self, request: Request, level: int) -> tuple[str, ...]:
        """Return the outputs of the equations that a request needs."""
        if request is None:
            of_points = (name for name, quantity in self.of_points.items() if quantity.order <= level)
            return (*self.kind.default_outputs(level), *of_points)
        of_equations = (_ATTITUDES.get(name, name) for name in request if name not in COORDINATE_OUTPUTS)
        return tuple(dict.fromkeys(of_equations))

    def order(self, request: Request, level: int) -> int:
        """Return the order of the derivatives that a request needs."""
        return level if request is None else max(map(self._level, request))

    def compute(self, request: Request, known: Known, acting: Acting, backend: str) -> Computed:
        """Compute the requested outputs of the equations."""
        level = acting.motion.level
        names, known = self._of_equations(request, level), known.part(slice(None), self.order(request, level))
        if not names:
            return Computed((PlanarState if self.planar else PairState)({}, (known.count,)))
        return Computed(self.state(known, names, backend))

    def state(self, known: Known, outputs: tuple[str, ...] | None, backend: str = "auto") -> Any:
        """Return the PairState or PlanarState of a known motion."""
        pair: Any = self.pair
        points = [name for name in outputs or () if name not in QUANTITIES]
        if len(points) > _MAX_POINTS and not self.planar:
            return self._with_points(
                known, points, tuple(name for name in outputs or () if name not in points), backend
            )
        if rows := self._coordinates(known):
            of_space = {"sequence": known.sequence} if known.sequence else {}
            return pair.forward_kinematics(*rows, outputs=outputs, backend=backend, **of_space)
        return pair.forward_kinematics_from_body1(known.body1, *known.hinge, outputs=outputs, backend=backend)

    def _coordinates(self, known: Known) -> Derivatives:
        """Return q and its derivatives, with at least one array, which shows the number of instants; nothing where
        the attitude of body 1 is given otherwise.
        """
        rows = known.derivatives
        if self.planar and known.base is None:  # body 1 rests at the origin
            rows = tuple((0.0, 0.0, 0.0, *joint) for joint in known.joints)
        if not rows or any(isinstance(value, np.ndarray) for value in rows[0]):
            return rows
        (first, *others), *rates = rows
        return (np.full(known.count, first), *others), *rates

    def _with_points(self, known: Known, points: Sequence[str], others: tuple[str, ...], backend: str) -> Any:
        """Return the state with outputs of points that are too many for a kernel, from those of their bodies (E1, E8,
        E9).
        """
        bodies, orders = {point.name: point.body for point in constants_of(self.pair).points}, self.of_points
        motions = ("R", "S", "v", "omega", "a", "alpha")[: 2 * max(orders[name].order for name in points) + 2]
        needed = {*others, *(f"{letter}{body}" for letter in motions for body in {*bodies.values()})}
        state, arrays = self.state(known, tuple(needed), backend), {}
        found, places = state.arrays(), {**self.space.points1, **self.space.points2}
        for name in points:
            order = orders[name].order
            point = name[:-2] if order else name
            R, S, *rates = (found[f"{letter}{bodies[point]}"] for letter in motions)
            arm = S @ places[point]
            if not order:
                arrays[name] = R + arm
            elif order == VELOCITY:
                arrays[name] = rates[0] + np.cross(rates[1], arm)
            else:
                turned = np.cross(rates[3], arm) + np.cross(rates[1], np.cross(rates[1], arm))
                arrays[name] = rates[2] + turned
        kept = {name: array for name, array in found.items() if name in others}
        return type(state)(kept | arrays, state.shape)

    def poses(self, known: Known) -> Arrays:
        """Return R1, S1, R2 and S2 in space, those of a planar pair in the plane z = 0."""
        names = ("R1", "S1", "R2", "S2")
        return self.space.forward_kinematics_from_body1(known.body1, known.psi, outputs=names).arrays()

    def arrays(self, request: Request, known: Known, computed: Computed) -> Arrays:
        """Return the requested outputs by name."""
        state = computed.state.arrays()
        names = (*state, *("psi", "psid", "psidd")[: known.level + 1]) if request is None else request
        arrays: Arrays = {name: array for name, array in state.items() if name in names}
        for name in names:
            components = self._components(name, known, computed) if name in FURTHER_OUTPUTS else {}
            # The v1_x of qd is left out where there is v1.
            arrays |= {key: own for key, own in components.items() if key.partition("_")[0] not in arrays}
        return arrays

    def _components(self, name: str, known: Known, computed: Computed) -> Arrays:
        """Return the components of one of the FURTHER_OUTPUTS by column name; empty if it was not computed."""
        if name in _ATTITUDES:
            S = getattr(computed.state, _ATTITUDES[name], None)
            return {} if S is None else {**quaternion_columns(S, name[-1])}
        order = QUANTITIES[name].order
        if order > known.level:
            return {}
        psi = {("psi", "psid", "psidd")[order]: known.column(order, 0)}
        return {**(known.base_columns(order) if name[0] == "q" else {}), **psi}

    def attribute(self, name: str, known: Known, computed: Computed) -> Any:
        """Return a coordinate, a quaternion or an attribute of the state."""
        if name in FURTHER_OUTPUTS:
            components = [*self._components(name, known, computed).values()]
            return None if not components else np.stack(components, -1) if name[0] == "q" else components[0]
        if hasattr(type(computed.state), name):
            return getattr(computed.state, name)
        if name in self.of_points:  # None where it was not computed
            return computed.state.arrays().get(name)
        raise KeyError(name)

    def plan(self, request: Request, motion: Motion) -> Plan:
        """Return the program that computes a request."""
        order, names = self.order(request, motion.level), self._of_equations(request, motion.level)
        known = motion.source.part(slice(1), order)
        # Two samples of what varies: one sample would be a known constant.
        samples = {
            part: tuple(np.empty(2) if isinstance(value, np.ndarray) else value for value in values)
            for part, values in zip(ROWS, known.derivatives, strict=False)
        }
        computation = computation_of(constants_of(self.pair), names, known.sequence)
        return Plan(names, [computation.count_operations(samples)] if names else [], order)

    @property
    def force_names(self) -> tuple[str, ...]:
        """Forces of a pair with masses."""
        return PAIR_FORCES

    def forces(self, known: Known, acting: Acting) -> Arrays:
        """Return the forces of the hinge and, of a body 1 with masses, the load on body 1: what must act beside the
        loads on body 2.
        """
        check_masses({"body2": self.pair.body2})
        body1, options = known.body1, {"gravity": acting.gravity, "wrenches": acting.wrenches(known)}
        robot: Any = self.robot
        wrench = robot.joint_wrenches(*known.arguments(), base_motion=body1, **options)[PSI[0]]
        axis = (body1.S @ np.asarray(self.space.n)[..., None])[..., 0]
        torque = (axis * wrench.torque).sum(axis=-1)
        arrays: Arrays = {"bearing_torque": wrench.torque - axis * torque[..., None], "hinge_force": wrench.force}
        if self.pair.body1 is not None:
            outputs = ("force1", "torque1")
            on_body1 = robot.inverse_dynamics(*known.arguments(), outputs=outputs, base_motion=body1, **options)
            arrays |= {"force1": on_body1.force1, "torque1": on_body1.torque1}
        motion = acting.motion
        parts = {f"{name}_torque": part[:, 0] for name, part in acting.parts(known).items()}
        if parts or (motion.simulated is None and motion.loads):
            simulated = motion.simulated is not None
            motor = acting.loads()["motor"][:, 0] if simulated else torque - sum(parts.values())
            parts = {"motor_torque": motor, **parts}
        arrays = {"hinge_torque": torque, **parts, **arrays}
        return _in_plane(arrays) if self.planar else arrays

    def compare(self, known: Known, acting: Acting) -> CrossValidation:
        """Compare the pair, and what acts in a simulated motion, with Pinocchio."""
        from hingepair.validation import cross_validate as validation

        compared: Any = validation.cross_validate
        report: CrossValidation
        if coordinates := self._coordinates(known):
            of_space = {"sequence": known.sequence} if known.sequence else {}
            report = compared(self.pair, *coordinates, **of_space)
        else:
            report = compared(self.pair, known.body1, *known.hinge)
        report = replace(report, notes=acting.motion.error_notes(report.u))
        simulated = acting.motion.simulated
        if simulated is None:
            return report
        q, qd, qdd = (known.array(order) for order in range(3))
        torque, *on_body1 = validation.compare_loads(
            *(simulated.robot, q, qd, qdd, known.body1, acting.gravity, acting.loads(), simulated.base),
            is_planar=self.planar,
        )
        rows = (replace(torque, output="hinge_torque"), *on_body1, *compared_rates(acting.motion, PSI))
        return replace(report, forces=tuple(replace(row, worst_part="") for row in rows))

    def describe(self, moving: tuple[str, ...]) -> str:  # noqa: ARG002
        """Return a line with the geometry of the pair."""
        keys = ("u1", "u2") if self.planar else ("u1", "u2", "n")
        vectors = (f"{key} = ({', '.join(f'{c:g}' for c in getattr(self.pair, key))})" for key in keys)
        return f"{self.pair.name}: {', '.join(vectors)}"

    def facts(self, motion: Motion) -> dict[str, Any]:
        """Return the geometry of the pair."""
        space = self.space
        vectors = {key: getattr(space, key).tolist() for key in ("u1", "u2", "n", "home")}
        return {"sequence": motion.source.sequence, "error_estimate": motion.error_estimate, "pair": vectors}


def _in_plane(arrays: Arrays) -> Arrays:
    """Return forces in the plane: x and y of hinge_force and force1, z of torque1, no bearing_torque."""
    components: dict[str, slice | int] = {"hinge_force": slice(2), "force1": slice(2), "torque1": 2}
    return {
        name: array[..., components[name]] if name in components else array
        for name, array in arrays.items()
        if name != "bearing_torque"
    }
