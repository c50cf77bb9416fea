"""Motion by dynamics: the table [dynamics] of a scene, what holds body 1, where it starts and what acts."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np

from hingepair.dynamics.loads import HingeLoad, Moving
from hingepair.dynamics.simulate import BASES, SimulatedMotion, SimulatedPlanarMotion, SimulationError, simulate
from hingepair.evaluation.plan import ACCELERATION
from hingepair.evaluation.steps import COORDINATES, PLANAR_COORDINATES
from hingepair.numeric.arrays import Float64Array
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.dynamics import DynamicsWarning
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.rotations.matrices import rotation_exp
from hingepair.rotations.sequences import SEQUENCES
from hingepair.scenes.expression_motion import held_instants, read_functions
from hingepair.scenes.instants import Rows
from hingepair.scenes.known_motion import ByBody1, ByCoordinates, KnownMotion
from hingepair.scenes.tables import Place, Table
from hingepair.symbolic.expressions import parse
from hingepair.symbolic.kinks import constant_value
from hingepair.symbolic.time_functions import TimeFunctions

PRESCRIBED: Final = "prescribed"

_LETTERS: Final = ("psi", "psid")
_HINGE: Final = ("stiffness", "rest", "damping", "friction", "friction_rate", "stop_stiffness", "stop_damping")
_FORCES: Final = ("force1", "torque1", "force2", "torque2")
_START: Final = ("R1_0", "v1_0", "omega1_0")
LOAD_KEYS: Final = (*_START, "psi_0", "psid_0", "hinge_torque", "stops", *_HINGE, *_FORCES, "gravity", "tol", "base")
"""What the table [dynamics] may hold, beside the attitude at the start."""

_KEYS: Final = {"body1": "R1_0", "body1.v": "v1_0", "body1.omega": "omega1_0"}


@dataclass(frozen=True, slots=True, eq=False)
class ForcedMotion:
    """A motion found from what acts.

    Attributes:
        t: instants; shape (N,) s.
        given: the motion at these instants.
        base: what holds body 1.
        found: the motion as it was simulated.
    """

    t: Float64Array
    given: ByBody1 | ByCoordinates
    base: str
    found: SimulatedMotion | SimulatedPlanarMotion
    level: ClassVar[int] = ACCELERATION
    sequence: ClassVar[None] = None
    origin: ClassVar[str] = "simulated from what acts"
    hint: ClassVar[str] = ""
    doubt: ClassVar[str] = ""

    @property
    def turning(self) -> str:
        """How body 1 turns, for a reader."""
        own = f"{self.found.error_estimate:.1g} rad of body 1, " if self.base in {"free", "pinned"} else ""
        error = f"{own}{self.found.psi_error_estimate:.1g} rad of psi"
        return f"simulated in {self.found.steps} steps, base {self.base}, error about {error}"

    @property
    def error_estimate(self) -> float:
        """How far attitude and psi are off at the worst instant [rad]: the larger of both errors."""
        return max(self.found.error_estimate, self.found.psi_error_estimate)

    @property
    def loads(self) -> Mapping[str, Float64Array]:
        """What acted, by name, in space."""
        return self.found.loads

    def take_off_loads(self, pair: HingePair, forces: dict[str, Float64Array]) -> None:
        """Take what acted on body 2 from what the hinge and body 1 must give for the motion."""
        body1, psi, loads = self.found.body1, self.found.psi, self.loads
        state = pair.forward_kinematics_from_body1(body1, psi, outputs=("S2", "d"))
        force, torque = loads["force2"], loads["torque2"]
        about = torque - np.cross(state.S2 @ pair.u2, force)
        axis = body1.S @ pair.n
        turn = (axis * about).sum(axis=-1)
        taken = {
            "hinge_torque": turn,
            "bearing_torque": about - axis * turn[:, None],
            "hinge_force": force,
            "force1": force,
            "torque1": torque + np.cross(state.d, force),
        }
        forces |= {name: array - taken[name] for name, array in forces.items()}

    def kinks(self, start: int, stop: int) -> int:  # noqa: ARG002
        """None: velocities do not jump."""
        return 0

    def known(self, rows: Rows, order: int) -> KnownMotion:
        """The motion at some of the instants, with derivatives up to an order."""
        return self.given.part(rows, order)


def read_dynamics(table: Table, motion: Table, time: Table, pair: HingePair | PlanarPair) -> ForcedMotion:
    """The motion that the tables [dynamics], [motion] and [time] describe.

    Raises:
        SceneError: a value cannot be used, or the motion cannot be followed; names file, table and key.
    """
    planar = isinstance(pair, PlanarPair)
    attitude = "phi_0" if planar else "S1_0"
    table.check_keys((attitude, *LOAD_KEYS))
    kind = table.choice("base", (*BASES, PRESCRIBED))
    for name in ("body1", "body2") if kind in {"free", "pinned"} else ("body2",):
        if getattr(pair, name) is None:
            Place(table.file, "pair").refuse(name, f"mass properties, as in [pair.{name}] mass = 2.0", "nothing")
    base: Any = kind
    body1 = None
    if kind == PRESCRIBED:
        for key in (attitude, *_START):
            if key in table.values:
                table.fail(key, f"nothing beside base = {PRESCRIBED!r}, whose body 1 moves as [motion] says")
        base = _carried(motion, pair)
    else:
        motion.check_keys(("constants",))
        body1 = _start(table, attitude, planar)
    size = 2 if planar else 3
    own: dict[str, Any] = {key: _force(table, key, planar) for key in _FORCES if key in table.values}
    if "gravity" in table.values:
        own["gravity"] = table.numbers("gravity", size)
    if "tol" in table.values:
        own["tol"] = table.number("tol")
    t = held_instants(time)
    angles = table.number("psi_0", 0.0), table.number("psid_0", 0.0)
    try:
        with table.naming(**_KEYS), warnings.catch_warnings():
            warnings.filterwarnings("ignore", "psi leaves", DynamicsWarning)  # the scene's notes say it
            found = simulate(pair, t, body1, *angles, hinge_torque=_hinge(table, pair), base=base, **own)
    except SimulationError as error:
        table.refuse("", "a motion that can be followed", f"none past t = {error.t:.6g}: {error.why}")
    return ForcedMotion(t, _known(found), kind, found)


def _known(found: SimulatedMotion | SimulatedPlanarMotion) -> ByBody1 | ByCoordinates:
    hinge = found.psi, found.psid, found.psidd
    if isinstance(found, SimulatedMotion):
        return ByBody1(found.body1, hinge)
    R, v, omega, a, alpha = motion_arrays("body1", found.body1, "R", "v", "omega", "a", "alpha").values()
    rows = zip((R, v, a), (found.phi, omega[:, 2], alpha[:, 2]), hinge, strict=True)
    return ByCoordinates(len(found.t), tuple((*vector.T[:2], angle, psi) for vector, angle, psi in rows), None)


def _start(table: Table, attitude: str, planar: bool) -> BodyMotion:
    """Where body 1 starts; at rest at the origin unless given."""
    given = {key: table.numbers(key, 2 if planar else 3) for key in ("R1_0", "v1_0") if key in table.values}
    R, v = ((*given.get(key, (0, 0)), 0)[:3] if planar else given.get(key, (0, 0, 0)) for key in ("R1_0", "v1_0"))
    with table.naming(**{"S": attitude}):
        if planar:
            spin = (0.0, 0.0, table.number("omega1_0", 0.0))
            return BodyMotion(R=R, S=rotation_exp((0, 0, table.number("phi_0", 0.0))), v=v, omega=spin)
        S = table.rotation("S1_0") if "S1_0" in table.values else np.eye(3)
        turn = table.numbers("omega1_0", 3) if "omega1_0" in table.values else (0, 0, 0)
        return BodyMotion(R=R, S=S, v=v, omega=turn)


def _carried(motion: Table, pair: HingePair | PlanarPair) -> Callable[[Float64Array], BodyMotion]:
    """Body 1 as the coordinates of [motion] move it."""
    names = (PLANAR_COORDINATES if isinstance(pair, PlanarPair) else COORDINATES)[:-1]
    planar = isinstance(pair, PlanarPair)
    motion.check_keys((*names, "constants", *(() if planar else ("sequence",))))
    functions = read_functions(motion, names)
    sequence = None if planar else motion.choice("sequence", SEQUENCES, "XYZ")

    def moved(t: Float64Array) -> BodyMotion:
        rows = tuple((*row, 0.0) for row in functions.derivatives(t, ACCELERATION))
        return ByCoordinates(len(t), rows, sequence).accelerated(pair)[0]

    return moved


def _hinge(table: Table, pair: HingePair | PlanarPair) -> HingeLoad:
    """What acts at the hinge."""
    own: dict[str, Any] = {key: table.number(key) for key in _HINGE if key in table.values}
    if table.values.get("stops") is True:
        limits = getattr(pair, "limits", None)
        if limits is None:
            table.fail("stops", "[lower, upper], or true of a pair that has limits")
        own["stops"] = limits
    elif "stops" in table.values:
        own["stops"] = tuple(table.numbers("stops", 2))
    if "hinge_torque" in table.values:
        (own["motor"],) = _functions(table, ("hinge_torque",))
    return HingeLoad(**own)


def _force(table: Table, key: str, planar: bool) -> Any:
    """A force or a torque: numbers, or a callable of (t, now)."""
    if planar and key.startswith("torque"):
        (one,) = _functions(table, (key,))
        return one if isinstance(one, float) else lambda t, now: one(t, now.psi, now.psid)
    size = 2 if planar else 3
    parts = _functions(table.entries(key, size, "t, psi and psid"), [f"{key}[{i}]" for i in range(size)])
    if all(isinstance(part, float) for part in parts):
        return parts

    def force(t: Float64Array, now: Moving) -> Float64Array:
        values = [part if isinstance(part, float) else part(t, now.psi, now.psid) for part in parts]
        return np.stack(np.broadcast_arrays(*values, t), axis=-1)[..., :-1]

    return force


def _functions(table: Table, keys: Any) -> list[Any]:
    """Numbers, or functions of t, psi and psi', of some keys."""
    known = {**table.constants, **dict.fromkeys(_LETTERS, 0.0)}
    found: list[Any] = []
    for key in keys:
        value = table.values.get(key)
        if not isinstance(value, str):
            found.append(float(table.number(key)))
            continue
        with table.naming(key):
            expression = parse(key, value, known, _LETTERS)
            if expression.free_symbols:
                functions = TimeFunctions([expression], [key], _LETTERS)
                found.append(lambda t, psi, psid, functions=functions: functions.values(t, psi, psid)[0])
            else:
                found.append(constant_value(expression))
    return found
