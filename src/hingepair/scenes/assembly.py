"""What moves in a scene, a pair or a mechanism: what can be asked of it, its motion, its forces."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final, NamedTuple, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from hingepair.equations.quantities import ACCELERATION, POSE, QUANTITIES, VELOCITY, unit_of
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair, dynamics_in_space
from hingepair.mechanism.requests import ROWS, subject_of
from hingepair.mechanism.robots.subject import count_operations
from hingepair.mechanism.states import PairState, PlanarState
from hingepair.mechanism.tree import Joint
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.pairs import PLANE, SPACE, point_outputs
from hingepair.plans.trees import FRAME_OUTPUTS
from hingepair.scenes.motions.known import PSI, RATE_SUFFIXES, Derivatives, Known, Rows, quaternion_columns
from hingepair.scenes.motions.motion import Motion
from hingepair.scenes.tables import Table

if TYPE_CHECKING:
    from hingepair.validation.report import CrossValidation

Arrays = dict[str, NDArray[Any]]
"""Arrays by name; shape (N, ...) for N instants."""

FURTHER_OUTPUTS: Final = ("q", "qd", "qdd", "psi", "psid", "psidd", "quat1", "quat2")
"""Outputs of a pair beside those of the equations; the quaternions (x, y, z, w) of S1 and S2 only in space."""
PAIR_FORCES: Final = (
    "hinge_torque",
    *(f"{part}_torque" for part in TORQUE_PARTS),
    *("bearing_torque", "hinge_force", "force1", "torque1"),
)
"""Forces of a pair with masses. Parts of hinge_torque exist if [dynamics] has loads."""
_COORDINATES: Final = ("q", "qd", "qdd")
_ATTITUDES: Final = {"quat1": "S1", "quat2": "S2", "quat": "S"}  # by the outputs with their quaternions (x, y, z, w)
_OF_FRAMES: Final = (*FRAME_OUTPUTS, "quat")
_FRAME_DEFAULTS: Final = ("R", "S", "v", "omega", "a", "alpha")  # what the name of a frame alone requests
_OF_BASE: Final = ("force1", "torque1")
_OF_STRUTS: Final = {"length": ("m", POSE), "rate": ("m/s", VELOCITY), "force": ("N", VELOCITY)}
_OF_LOGS: Final = ("columns", "smooth", "loss", "gaps", "frame")  # keys of [motion]
_MAX_POINTS: Final = 60  # outputs of points in one kernel, whose time to compile grows with them


class Item(NamedTuple):
    """What can be asked of what moves: one array."""

    name: str  # of the array, such as R2, R_tool, elbowd, tau_elbow
    of: str  # "state" (of a pair or a frame), "joint", "coordinates" (all of a pair), "strut" or "force"
    quantity: str
    owner: str = ""  # the frame, joint or strut
    order: int = POSE  # of the derivatives that it needs
    unit: str = "1"


Items = tuple[Item, ...]


def order_of(request: Items) -> int:
    """Return the order of the derivatives that a request needs."""
    return max((item.order for item in request), default=POSE)


@dataclass(frozen=True, slots=True, eq=False)
class Computed:
    """What was computed of a motion at some instants."""

    arrays: Arrays  # what was requested, by name; a quaternion has four, q of a pair one for each coordinate
    state: Any = None  # PairState, PlanarState or MechanismState; None if no output of a mechanism needs it
    struts: Mapping[str, Any] = field(default_factory=dict)  # StrutState by name
    tau: Float64Array | None = None  # efforts of all joints of a mechanism


@dataclass(frozen=True, slots=True, eq=False)
class Acting:
    """What acts on what moves at some instants, beside motors and what holds the base."""

    motion: Motion
    #: indices of the instants
    rows: Rows
    #: acceleration of free fall [m/s^2]; (3,)
    gravity: tuple[float, ...]

    def wrenches(self, known: Known) -> dict[str, tuple[Any, Any]] | None:
        """Return (force, torque) on links by name, world axes; None without any."""
        motion = self.motion
        if motion.simulated is not None:
            own = motion.simulated.wrenches
            return {link: (force[self.rows], torque[self.rows]) for link, (force, torque) in own.items()} or None
        t, now = np.asarray(motion.t[self.rows]), SimpleNamespace(q=known.array(0), qd=known.array(1))

        def vectors(load: Any) -> Float64Array:
            return np.broadcast_to(np.asarray(load(t, now) if callable(load) else load, np.float64), (len(t), 3))

        return {link: (vectors(force), vectors(torque)) for link, (force, torque) in motion.wrenches.items()} or None

    def loads(self) -> Arrays:
        """Return the loads of a simulated motion by name; shape (N, ...)."""
        return {name: load[self.rows] for name, load in self.motion.simulated.loads.items()}

    def parts(self, known: Known) -> dict[str, Float64Array]:
        """Return the efforts of springs, dampers, friction and stops at the joints, as far as there are any; (N, dof)
        each.
        """
        if self.motion.simulated is not None:
            loads = self.loads()
            return {part: loads[part] for part in TORQUE_PARTS if part != "motor" and part in loads}
        found: dict[str, Float64Array] = {}
        for name, load in self.motion.loads.items():
            k = known.names.index(name)
            for part, effort in load.parts(0.0, known.column(0, k), known.column(1, k)).items():
                if part != "motor":
                    found.setdefault(part, np.zeros((known.count, len(known.names))))[:, k] = effort
        return found


class Assembly:
    """What moves in a scene. A pair is the mechanism `robot` of one joint, psi, whose base is body 1; its motion is
    computed by the pair itself.

    Args:
        moving: the pair, or the mechanism with the frames and the payload of the file.
        frames: frames of a mechanism that are computed by default, those of the file or else the last links.
        is_fixed: whether body 1 of a pair is fixed, so that its mass counts only if it is given.
    """

    def __init__(
        self, moving: HingePair | PlanarPair | Mechanism, frames: tuple[str, ...] = (), *, is_fixed: bool = False
    ) -> None:
        self.mechanism = moving if isinstance(moving, Mechanism) else None
        self.pair: Any = None if isinstance(moving, Mechanism) else moving
        self.planar = isinstance(moving, PlanarPair)
        self.frames, self.name, self.kind = frames, moving.name, PLANE if self.planar else SPACE
        self._is_fixed = is_fixed

    @lock_free_cached_property
    def robot(self) -> Mechanism:
        """The mechanism; of a pair that with the joint and link psi, in the plane with its planar dynamics."""
        if self.mechanism is not None:
            return self.mechanism
        space = replace(dynamics_in_space(self.pair), name=PSI[0], body1=self._body1)
        return Mechanism([space], base="fixed" if space.body1 is None else "free", name=self.name)

    @property
    def _body1(self) -> Body | None:
        """Body 1 of a pair, if its masses count."""
        body: Body | None = self.pair.body1
        return None if body is not None and self._is_fixed and body.assumed else body

    @property
    def space(self) -> HingePair:
        """The pair as a HingePair."""
        space: HingePair = self.pair.to_spatial() if self.planar else self.pair
        return space

    @property
    def dimensions(self) -> int:
        """Number of components of a vector such as gravity."""
        return 2 if self.planar else 3

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Records of the joints that have a coordinate."""
        return tuple(tree_of(self.robot).coordinates)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints that have a coordinate."""
        return PSI if self.pair is not None else self.robot.names

    @property
    def base_names(self) -> tuple[str, ...]:
        """Keys of [motion] for the coordinates of body 1 or the base; not those that name joints."""
        names = self.kind.coordinates[:-1]
        return names if set(names).isdisjoint(self.names) else ()

    @property
    def rests(self) -> Mapping[str, float]:
        """Where joints without a motion rest [rad or m]: at 0, or at the limit closest to 0."""
        return {joint.name: float(np.clip(0.0, *joint.position_limits)) for joint in self.joints}

    def moved_by(self, motion: Table) -> tuple[str, ...]:
        """Return the joints that are keys of the Table [motion], in order."""
        return tuple(name for name in self.names if name in motion.values)

    # ---- keys and columns that name joints

    def check_motion_keys(self, motion: Table) -> None:
        """Refuse keys of [motion] without a file other than joints, coordinates of the base and `sequence`."""
        for key in _OF_LOGS:
            if key in motion.values:
                motion.fail(key, "no such key without file = ..., whose samples it concerns")
        options = (*self.base_names, *(() if self.planar else ("sequence", "file")))
        self.check_joint_names(motion, options)
        self.check_keys(motion, options)

    def check_keys(self, table: Table, options: Collection[str]) -> None:
        """Refuse keys of a Table that are neither options nor joints that move, with what they are instead."""
        known = (*self.names, *options)
        for key in table.values:
            if key not in known:
                got = "an unknown key"
                if self.mechanism is not None and key in tree_of(self.mechanism).frame_names:
                    got = "a link, or a joint that is locked, fixed, follows another or is moved by loops"
                table.refuse_key(key, known, got)

    def check_joint_names(self, table: Table, options: Collection[str]) -> None:
        """Raise a SceneError if a joint has the name of an option of the Table [motion] or [dynamics], or a name for
        which a column of a log would have two meanings.
        """
        taken = {"t", *options}
        for name in self.names if self.pair is None else ():
            for column in (name + ending for ending in RATE_SUFFIXES):
                arrays = [self.items.get(array) for array in (column, column.rpartition("_")[0])]
                if column in taken or any(item is not None and item.of != "joint" for item in arrays):
                    expected = f"joints of other names: {column} has another meaning in [{table.name}] or in files"
                    table.refuse(name, expected, f"a joint {name!r}")
                taken.add(column)

    # ---- what can be asked

    @lock_free_cached_property
    def items(self) -> dict[str, Item]:
        """All that can be asked, by the name of the array."""
        found: dict[str, Item] = {}
        for item in self._items_of_mechanism() if self.pair is None else self._items_of_pair():
            if item.of != "joint" or item.name not in found:  # a joint may have the name of another array
                found[item.name] = item
        return found

    def _items_of_pair(self) -> Iterator[Item]:
        quantities = {name: QUANTITIES[name] for name in self.kind.levels}
        for name, quantity in (quantities | point_outputs(subject_of(self.pair).points)).items():
            yield Item(name, "state", name, "", quantity.order, quantity.unit)
        for order, ending in enumerate(RATE_SUFFIXES):
            yield Item(PSI[0] + ending, "joint", _COORDINATES[order], PSI[0], order, unit_of(PSI[0] + ending))
            yield Item(_COORDINATES[order], "coordinates", _COORDINATES[order], PSI[0], order)
        for body in () if self.planar else "12":
            yield Item(f"quat{body}", "state", f"quat{body}")
        for name in PAIR_FORCES if self.pair.body2 is not None else ():
            if not (self.planar and name == "bearing_torque"):
                yield Item(name, "force", name, "", ACCELERATION, unit_of(name))

    def _items_of_mechanism(self) -> Iterator[Item]:
        tree = tree_of(self.robot)
        for frame in tree.frame_names:
            for name in _OF_FRAMES:
                yield Item(f"{name}_{frame}", "state", name, frame, QUANTITIES[name].order, QUANTITIES[name].unit)
        for joint in self.joints:
            for order, per in enumerate(("", "/s", "/s^2")):
                name = joint.name + RATE_SUFFIXES[order]
                yield Item(name, "joint", _COORDINATES[order], joint.name, order, joint.unit + per)
            yield Item(f"tau_{joint.name}", "force", "tau", joint.name, ACCELERATION, joint.effort_unit)
        for name in _OF_BASE:
            yield Item(name, "force", name, "", ACCELERATION, QUANTITIES[name].unit)
        for kind, (unit, order) in _OF_STRUTS.items():
            for strut in tree.struts:
                if strut.name not in self.names:  # those are joints
                    yield Item(f"{kind}_{strut.name}", "strut", kind, strut.name, order, unit)

    @lock_free_cached_property
    def groups(self) -> dict[str, list[Item]]:
        """What each name requests; of a mechanism the names of quantities, and of frames and struts."""
        items = self.items.values()
        if self.pair is not None:
            return {item.name: [item] for item in items}
        found: dict[str, list[Item]] = {}
        for item in items:
            if item.of != "state" or item.owner in self.frames:
                found.setdefault(item.quantity, []).append(item)
        quantities = {item.quantity for item in items}
        for item in items:
            is_default = item.of == "strut" or (item.of == "state" and item.quantity in _FRAME_DEFAULTS)
            if is_default and item.owner not in quantities:  # a link may be called q
                found.setdefault(item.owner, []).append(item)
        return found

    def item(self, name: str) -> Item | None:
        """Return what an array, or a component of it such as R2_x, is."""
        return self.items.get(name) or self.items.get(name.rpartition("_")[0])

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components, such as R2_x, R_tool_x or tau_elbow."""
        found = self.item(name)
        return unit_of(name) if found is None else found.unit

    def request(self, outputs: Iterable[str] | None, motion: Motion) -> Items:
        """Return what names ask for; by default the motion of body 2, of its points and of psi, or of the scene's
        frames, of the joints that move and of struts.
        """
        level = motion.level
        if outputs is None:
            return tuple(item for item in self._defaults(motion.moving) if item.order <= level)
        listed = [name for name, items in self.groups.items() if any(item.order <= level for item in items)]
        try:
            names: list[Any] = [outputs] if isinstance(outputs, str) else [*outputs]
        except TypeError:
            names = []
        if not names:
            raise ArgumentError("outputs", f"names out of {', '.join(listed)}", quoted(outputs))
        found: dict[Item, None] = {}
        for name in names:
            asked = self.groups.get(name) or [self.items[name]] if name in (*self.groups, *self.items) else []
            own = [item for item in asked if item.order <= level]
            if not own:
                hint = motion.hint if asked else self._remark(str(name))
                raise ArgumentError("outputs", choices(listed) + hint, quoted(name))
            found |= dict.fromkeys(own)
        return tuple(found)

    def _defaults(self, moving: tuple[str, ...]) -> Iterator[Item]:
        if self.pair is not None:
            names = (*self.kind.default_outputs(ACCELERATION), *point_outputs(subject_of(self.pair).points))
            yield from (self.items[name] for name in (*names, *(PSI[0] + ending for ending in RATE_SUFFIXES)))
        else:
            for name in (*_FRAME_DEFAULTS, *_COORDINATES, *_OF_STRUTS):
                own = self.groups.get(name, ())
                yield from (item for item in own if item.of != "joint" or item.owner in moving)

    def _remark(self, name: str) -> str:
        """Return what a message on an unknown output adds: what it is instead, or the nearest name."""
        if (item := self.item(name)) is not None:
            return f" ({item.name} has all its components)"
        several = f", or both such as R_{self.frames[0]}" if self.frames else ""
        name = name.replace(".", "_")
        return several + (nearest(name, self.items) or nearest(name, self.groups))

    # ---- results

    def compute(self, request: Items, known: Known, acting: Acting, backend: str) -> Computed:
        """Compute what a request needs.

        Raises:
            ArgumentError: a force of a pair without the masses or the load that exerts it.
        """
        of_state = tuple(item for item in request if item.of == "state")
        moved, state = known.part(slice(None), order_of(of_state)), cast("Any", None)
        found: dict[str, Any] = {}  # arrays of the state, of a mechanism by frame
        names = tuple(dict.fromkeys(_ATTITUDES.get(item.quantity, item.quantity) for item in of_state))
        if self.pair is not None:
            state = self._pair_state(moved, names, backend)
            found[""] = state.arrays()
        elif of_state:
            outputs = tuple(name for name in FRAME_OUTPUTS if name in names)
            frames = tuple(dict.fromkeys(item.owner for item in of_state))
            options: Any = {"outputs": outputs, "base_motion": moved.base_motion, "backend": backend}
            state = self.robot.forward_kinematics(*moved.arguments(), frames=frames, **options)
            found = {frame: state[frame].arrays() for frame in frames}
        needed = {item.quantity for item in request if item.of == "force"}
        forces = self.forces(known, acting, needed, backend) if needed else {}
        has_struts = any(item.of == "strut" for item in request)
        struts = self.robot.struts(*known.arguments()[:2], backend=backend) if has_struts else {}
        arrays: Arrays = {}
        for item in request:
            name, of, quantity, owner, order, _ = item
            if of == "force":
                arrays[name] = forces[name] if name in forces else self._refuse_force(name)
            elif of == "strut":
                arrays[name] = np.asarray(getattr(struts[owner], quantity))
            elif of in ("joint", "coordinates"):
                arrays |= known.base_columns(order) if of == "coordinates" else {}
                arrays[owner + RATE_SUFFIXES[order]] = known.column(order, known.names.index(owner))
            elif quantity in _ATTITUDES:
                ends = (f"{name}_",) if owner else ("q", name[-1])
                arrays |= quaternion_columns(found[owner][_ATTITUDES[quantity]], *ends)
            else:
                arrays[name] = np.asarray(found[owner][quantity])
        # The v1_x of the qd of a pair is left out where there is v1.
        whole = arrays.keys() & {"v1", "omega1", "a1", "alpha1"} if self.pair is not None else ()
        arrays = {name: own for name, own in arrays.items() if name.rpartition("_")[0] not in whole}
        return Computed(arrays, state, struts, forces.get("tau"))

    def _refuse_force(self, name: str) -> NoReturn:
        """Raise an ArgumentError for a force of a pair without the masses or the load that exerts it."""
        subject_of(self.pair).require_masses((0,) if name in _OF_BASE else ())
        part = name.removesuffix("_torque")
        raise ArgumentError("outputs", f"a load in [dynamics.psi] whose part {part} is", quoted(name))

    def _pair_state(self, known: Known, names: tuple[str, ...], backend: str) -> Any:
        """Return the PairState or PlanarState of a known motion."""
        if not names:
            return (PlanarState if self.planar else PairState)({}, (known.count,))
        if sum(name not in QUANTITIES for name in names) > _MAX_POINTS:
            backend = "numpy"
        if rows := self._pair_coordinates(known):
            of_space = {"sequence": known.sequence} if known.sequence else {}
            return self.pair.forward_kinematics(*rows, outputs=names, backend=backend, **of_space)
        return self.pair.forward_kinematics_from_body1(known.body1, *known.hinge, outputs=names, backend=backend)

    def _pair_coordinates(self, known: Known) -> Derivatives:
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

    def forces(
        self, known: Known, acting: Acting, needed: Collection[str] = ("tau", *_OF_BASE), backend: str = "auto"
    ) -> Arrays:
        """Return, by name, the efforts of the joints of a mechanism or the forces of a pair's hinge, beside all other
        loads, and the load on the base, of a pair as far as body 1 has masses (D1-D5, T1-T3).
        """
        body1 = known.base_motion if self.pair is None else known.body1
        options: Any = {"gravity": acting.gravity, "wrenches": acting.wrenches(known), "base_motion": body1}
        outputs = tuple(name for name in ("tau", *_OF_BASE) if name in needed or self.pair is not None)
        parts, arguments = acting.parts(known), known.arguments()
        if self.pair is None:
            options |= {"joint_loads": False, "backend": backend}  # loads of joints are among what acts
            found = dict(self.robot.inverse_dynamics(*arguments, outputs=outputs, **options).arrays())
            if "tau" not in found:
                return found
            tau = np.asarray(found.pop("tau") - sum(parts.values()), np.float64)
            return {"tau": tau, **{f"tau_{name}": tau[..., i] for i, name in enumerate(self.names)}, **found}
        if self.pair.body2 is None:
            subject_of(self.pair).require_masses((1,))
        wrench = self.robot.joint_wrenches(*arguments, **options)[PSI[0]]
        axis = (known.body1.S @ np.asarray(self.space.n)[..., None])[..., 0]
        torque = (axis * wrench.torque).sum(axis=-1)
        forces: Arrays = {"hinge_torque": torque}
        simulated, of_hinge = acting.motion.simulated, {name: part[:, 0] for name, part in parts.items()}
        if of_hinge or (simulated is None and acting.motion.loads):
            motor = torque - sum(of_hinge.values()) if simulated is None else acting.loads()["motor"][:, 0]
            forces |= {f"{name}_torque": part for name, part in {"motor": motor, **of_hinge}.items()}
        forces |= {"bearing_torque": wrench.torque - axis * torque[..., None], "hinge_force": wrench.force}
        if self._body1 is not None:
            forces |= self.robot.inverse_dynamics(*arguments, outputs=_OF_BASE, **options).arrays()
        if self.planar:
            in_plane: dict[str, Any] = {"hinge_force": slice(2), "force1": slice(2), "torque1": 2}
            del forces["bearing_torque"]
            forces |= {name: forces[name][..., part] for name, part in in_plane.items() if name in forces}
        return forces

    def attribute(self, name: str, known: Known, computed: Computed) -> Any:
        """Return a coordinate, a force, an output or an attribute of the state; None of one that was not computed."""
        item, level = self.items.get(name), known.level
        if name in _COORDINATES[: level + 1]:  # of all joints, also where one is called q
            order = _COORDINATES.index(name)
            columns = {} if self.pair is None else known.base_columns(order)
            return np.stack([*columns.values(), *known.array(order).T], axis=-1) if columns else known.array(order)
        if name in computed.arrays:
            return computed.arrays[name]
        if item is not None and item.of == "joint" and item.order <= level:
            return known.column(item.order, known.names.index(item.owner))
        if self.pair is not None and name in _ATTITUDES and _ATTITUDES[name] in computed.state.arrays():
            return np.stack([*quaternion_columns(computed.state[_ATTITUDES[name]]).values()], axis=-1)
        if hasattr(type(computed.state), name):
            return getattr(computed.state, name)
        if item is None and not (self.pair is None and name in (*FRAME_OUTPUTS, *_COORDINATES, "tau")):
            raise KeyError(name)
        return computed.tau if name == "tau" else None

    def operations(self, request: Items, motion: Motion) -> int:
        """Return the number of operations at each instant of the programs that compute a request."""
        known = motion.source.part(np.zeros(2, dtype=np.intp), order_of(request))  # one sample would be a constant
        of_state, of_robot = tuple(item for item in request if item.of == "state"), subject_of(self.robot)
        names = tuple(dict.fromkeys(_ATTITUDES.get(item.quantity, item.quantity) for item in of_state))
        count, base = 0, known.base_motion
        if of_state and self.pair is not None:
            computation = subject_of(self.pair).computation(names, known.sequence)
            count += computation.count_operations(dict(zip(ROWS, known.derivatives, strict=False)))
        elif of_state:
            arguments = known.arguments()[: 1 + order_of(of_state)]
            frames = tuple(dict.fromkeys(item.owner for item in of_state))
            count += count_operations(of_robot, arguments, names, frames, base)
        if any(item.of == "force" for item in request):
            count += count_operations(of_robot, known.arguments(), ("tau", *_OF_BASE), base_motion=base)
        return count

    # ---- reports

    @property
    def max_check_instants(self) -> int:
        """Number of instants at which `check` compares: about a second of a pair, some seconds of a humanoid."""
        return 501 if self.pair is None else 10_001

    def compare(self, known: Known, acting: Acting) -> CrossValidation:
        """Compare what moves, and what acts in a simulated motion, with Pinocchio."""
        from hingepair.validation import cross_validate as validation

        compared: Any = validation.cross_validate
        base, motion, simulated = known.base_motion, acting.motion, acting.motion.simulated
        report: CrossValidation
        if self.mechanism is not None:
            report = compared(self.mechanism, *known.arguments(), base_motion=base, gravity=acting.gravity)
        elif coordinates := self._pair_coordinates(known):
            report = compared(self.pair, *coordinates, **({"sequence": known.sequence} if known.sequence else {}))
        else:
            report = compared(self.pair, known.body1, *known.hinge)
        notes = (*report.notes, *motion.error_notes(report.u))
        if simulated is None:
            return replace(report, notes=notes)
        rows = [known.array(order) for order in range(3)]
        times = np.asarray(motion.t[:])
        whole = motion.source.part(slice(len(times)), ACCELERATION)
        rates = validation.compare_rates(times, [whole.array(order) for order in range(3)], self.names)
        if tree_of(self.robot).closure is not None or tree_of(self.robot).struts:
            left_out = "what acts beside loops and struts is not compared; hingepair run --energy shows its balance"
            return replace(report, rows=(*report.rows, *rates), notes=(*notes, left_out))
        held = known.body1 if self.mechanism is None else base
        loads = (acting.gravity, acting.loads(), simulated.base)
        compared_loads: Any = validation.compare_loads
        forces = compared_loads(simulated.robot, *rows, held, *loads, is_planar=self.planar)
        if self.mechanism is None:
            torque, *others = (replace(row, worst_part="") for row in forces)
            forces = (replace(torque, output="hinge_torque"), *others)
            rates = tuple(replace(row, worst_part="") for row in rates)
        last = "the last rows compare loads with the forces that the motion takes by Pinocchio, and rates with slopes"
        return replace(report, rows=(*report.rows, *forces, *rates), notes=(last, *notes))

    def describe(self, moving: tuple[str, ...]) -> str:
        """Return a line on the geometry of a pair, or on the joints of a mechanism."""
        if self.pair is not None:
            keys = ("u1", "u2") if self.planar else ("u1", "u2", "n")
            vectors = (f"{key} = ({', '.join(f'{c:g}' for c in getattr(self.pair, key))})" for key in keys)
            return f"{self.name}: {', '.join(vectors)}"
        tree = tree_of(self.robot)
        driven = {strut.name for strut in tree.struts} & {*self.names}
        counts = {"coordinate": self.robot.dof} if self.robot.loops else {}
        counts |= {"joint": len(tree.own_coordinates), "loop": len(self.robot.loops) - len(driven)}
        counts |= {"strut": len(tree.struts)}
        size = ", ".join(f"{n} {name}{'s' * (n != 1)}" for name, n in counts.items() if n or name == "joint")
        rest = f", {self.robot.dof - len(moving)} rest" if len(moving) < self.robot.dof else ""
        return f"{self.name}: {size}, {self.robot.base} base; moving: {', '.join(moving) or 'none'}{rest}"

    def facts(self, motion: Motion) -> dict[str, Any]:
        """Return the geometry of a pair, or names of the mechanism, its joints and frames."""
        if self.pair is not None:
            vectors = {key: getattr(self.space, key).tolist() for key in ("u1", "u2", "n", "home")}
            return {"sequence": motion.source.sequence, "error_estimate": motion.error_estimate, "pair": vectors}
        facts = {"name": self.name, "base": self.robot.base, "joints": self.names, "frames": self.frames}
        return {"mechanism": facts, "moving": motion.moving}
