"""Motion by dynamics: the table [dynamics] of a scene, what holds body 1, where it starts and what acts."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.equations.quantities import ACCELERATION
from hingepair.errors import SimulationError
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_arrays
from hingepair.mechanism.bodies.hinge_load import HingeLoad, stop_range
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.motion.loads import MotionAtInstants
from hingepair.motion.pairs import BASES
from hingepair.motion.simulate import simulate
from hingepair.motion.simulated import SimulatedMotion, SimulatedPlanarMotion
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.pairs import PLANE, SPACE
from hingepair.rotations.matrices import rotation_exp
from hingepair.scenes.instants import read_instants_array
from hingepair.scenes.motions.functions import read_coordinate_functions
from hingepair.scenes.motions.known import MotionByBody1, MotionByCoordinates
from hingepair.scenes.motions.motion import PRESCRIBED, LazyValue, PairMotion, impact_sentences
from hingepair.scenes.tables import Key, NamedSource, Table, numbers_key
from hingepair.symbolic.expressions import number, parse_expression
from hingepair.symbolic.time_functions import TimeFunctions
from hingepair.tables.sheets import instant_text

_HINGE_NAMES: Final = ("psi", "psid")
"""Names in expressions, beside t, for the hinge angle [rad] and its rate [rad/s]."""
HINGE_LOAD_KEYS: Final = (
    *("stiffness", "rest", "damping", "friction", "friction_rate"),
    *("stop_stiffness", "stop_damping", "stop_restitution"),
)
"""Keys of [dynamics] for springs, dampers, friction and stops of the hinge."""
DOUBT: Final = "a second run with a smaller tolerance, which tells the error, cannot be followed"
"""Why the error of a simulated motion may be unknown."""
_START_KEYS: Final = ("phi_0", "S1_0", "R1_0", "v1_0", "omega1_0")
"""Keys of [dynamics] for the state of body 1 at the first instant."""
_KEYS_OF_ARGUMENTS: Final = {
    "body1": "R1_0",
    "body1.v": "v1_0",
    "body1.omega": "omega1_0",
}
"""Keys of [dynamics] by the arguments of `simulate` in errors."""


def read_functions_of_state(table: Table, keys: tuple[str, ...], names: tuple[str, ...] = _HINGE_NAMES) -> Any:
    """Return the values under `keys`: a list of floats, or, if any depends on t or `names`, a callable of (t, *names)
    that returns a tuple of all.
    """
    constants = {**table.constants, **dict.fromkeys(names, 0.0)}
    expressions = []
    for key in keys:
        value = table.values.get(key)
        with table.naming(key):
            expressions.append(
                parse_expression(key, value, constants, names)
                if isinstance(value, str)
                else number(table.number(key))
            )
    if any(expression.names for expression in expressions):
        return TimeFunctions(expressions, names).values
    return [float(expression) for expression in expressions]


def read_hinge_torque(table: Table, key: str, names: tuple[str, str] = _HINGE_NAMES) -> Any:
    """Return the torque under a key of a Table, about the hinge axis or in the plane: a float, or, for an expression
    in t and the names, a callable of (t, psi, psid).
    """
    torque = read_functions_of_state(table, (key,), names)
    return (lambda t, psi, psid: torque(t, psi, psid)[0]) if callable(torque) else torque[0]


def _read_load(table: Table, key: str, component_count: int) -> Any:
    """Return the force or torque on a body under a key of a Table: a list of `component_count` floats, or, for
    expressions, a callable of (t, now) that returns an array of shape (N, component_count); `now` is the motion at t.
    """
    if component_count == 1:
        torque = read_hinge_torque(table, key)
        return (lambda t, now: torque(t, now.psi, now.psid)) if callable(torque) else torque
    entries = table.entries(key, component_count, "t, psi and psid")
    components = read_functions_of_state(entries, tuple(entries.values))

    def load(t: Float64Array, now: MotionAtInstants) -> Float64Array:
        return np.stack(np.broadcast_arrays(*components(t, now.psi, now.psid), t)[:-1], axis=-1)

    return load if callable(components) else components


def read_stops(table: Table, key: str) -> Any:
    """Return the stops under a key of a Table: a tuple of two angles [rad], or True if the value is true, which means
    the limits of the pair.
    """
    return table.values[key] is True or tuple(table.numbers(key, 2))


def read_until(table: Table, key: str) -> Any:
    """Return the expression in t, psi and psid that passes 0 at the event, as a callable of (t, now)."""
    value = read_hinge_torque(table, key)
    if not callable(value):
        table.fail(key, "an expression in t, psi and psid, which passes 0 at the event")
    return lambda t, now: value(t, now.psi, now.psid)


def end_notes(ended_by_event: bool, t: Float64Array) -> tuple[str, ...]:
    """Return a sentence if `until` ended the motion, at the last of the instants t."""
    return (f"until ends the motion at t = {instant_text(t[-1])} s",) if ended_by_event else ()


def read_break_instants(table: Table, key: str) -> list[Any]:
    """Return the list of instants [s], of any length, under a key of a Table."""
    value = table.values[key]
    return table.numbers(key, len(value) if isinstance(value, list) else 1)


def _dynamics_key_readers(dimension: int) -> dict[str, Key]:
    """Return the keys of the table [dynamics] in 2 or 3 dimensions, and their readers."""
    vector, turn = numbers_key(dimension), Table.number if dimension == 2 else numbers_key(3)
    force, torque = (
        partial(_read_load, component_count=dimension),
        partial(_read_load, component_count=1 if dimension == 2 else 3),
    )
    return {
        **({"phi_0": Table.number} if dimension == 2 else {"S1_0": Table.rotation}),
        **{"R1_0": vector, "v1_0": vector, "omega1_0": turn, "psi_0": Table.number, "psid_0": Table.number},
        **{
            "hinge_torque": read_hinge_torque,
            "stops": read_stops,
            **dict.fromkeys(HINGE_LOAD_KEYS, Table.number),
        },
        **{"force1": force, "torque1": torque, "force2": force, "torque2": torque, "gravity": vector},
        **{
            "tol": Table.number,
            "max_steps": Table.number,
            "breaks": read_break_instants,
            "until": read_until,
            "base": lambda table, key: table.choice(key, (*BASES, PRESCRIBED)),
        },
    }


DYNAMICS_KEYS: Final = tuple(_dynamics_key_readers(3))
"""Keys that the table [dynamics] of a pair in space may have."""


_BESIDE_GIVEN_PSI: Final = (  # keys of [dynamics] that a given psi leaves
    *("stiffness", "rest", "damping", "friction", "friction_rate"),
    *("stops", "stop_stiffness", "stop_damping", "gravity"),
)


def gives_psi(motion: Table) -> bool:
    """Return whether the Table [motion] gives psi, by an expression, a log or a rate; [dynamics] then has loads."""
    return not {"psi", "file", "psi_dot"}.isdisjoint(motion.values)


class DynamicsSetup(NamedTuple):
    """Values of the table [dynamics] of a scene."""

    #: "free", "pinned", "fixed" or "prescribed"
    base: str
    #: motion of body 1 at the first instant; None if the base is prescribed
    body1: BodyMotion | None
    #: arguments of a `HingeLoad` by name, except its motor
    hinge: dict[str, Any]
    #: the other arguments of `simulate` by name, as far as the table has them
    others: dict[str, Any]
    #: the keys of the table
    keys: tuple[str, ...]

    @property
    def simulates(self) -> bool:
        """Whether psi is simulated, not given by [motion]."""
        return self.base != PRESCRIBED or "base" in self.keys


def read_dynamics_setup(table: Table, pair: HingePair | PlanarPair, motion: Table) -> DynamicsSetup:
    """Return the DynamicsSetup of the Table [dynamics] for a pair, without simulating it. Beside a psi that [motion]
    gives, the base is prescribed.
    """
    planar = isinstance(pair, PlanarPair)
    if gives_psi(motion):
        for key in table.values:
            if key in DYNAMICS_KEYS and key not in _BESIDE_GIVEN_PSI:
                wanted = f"{', '.join(_BESIDE_GIVEN_PSI)} alone, since [motion] gives psi"
                table.fail(key, f"{wanted}: `hingepair forces` gives the torque of the motor")
    others = table.read(_dynamics_key_readers(2 if planar else 3))
    base = others.pop("base", PRESCRIBED if gives_psi(motion) else BASES[0])
    start: dict[str, Any] = {key: others.pop(key) for key in _START_KEYS if key in others}
    hinge: dict[str, Any] = {key: others.pop(key) for key in (*HINGE_LOAD_KEYS, "stops") if key in others}
    if hinge.get("stops") is True:
        hinge["stops"] = getattr(pair, "limits", None)
        if hinge["stops"] is None:
            table.fail("stops", "[lower, upper], or true of a pair that has limits")
    if base == PRESCRIBED:
        for key in start:
            table.fail(
                key,
                f"no such key together with base = {PRESCRIBED!r}: [motion] prescribes body 1",
            )
    body1 = None if base == PRESCRIBED else _read_body1_start(table, start, planar)
    for letter in _HINGE_NAMES:
        if letter in table.constants:
            meaning = "psi and psid are the hinge angle and its rate in expressions of [dynamics]"
            NamedSource(table.file, "constants").refuse(letter, f"another name: {meaning}", repr(letter))
    return DynamicsSetup(base, body1, hinge, others, tuple(table.values))


def read_simulated_motion(table: Table, motion: Table, time: Table, pair: HingePair | PlanarPair) -> PairMotion:
    """Simulate the motion of a pair that the Tables [dynamics] (`table`), [motion] and [time] define, and return it
    as a PairMotion.
    """
    kind, body1, hinge, arguments, _ = read_dynamics_setup(table, pair, motion)
    for name in ("body1", "body2") if kind in {"free", "pinned"} else ("body2",):
        if getattr(pair, name) is None:
            instead = ", or base = 'fixed' in [dynamics]" if name == "body1" else ""
            expected = f"mass properties, as in [pair.{name}] mass = 2.0{instead}"
            NamedSource(table.file, "pair").refuse(name, expected, "nothing")
    base: Any = kind
    if kind == PRESCRIBED:
        base = _prescribed_body1(motion, pair)
    else:
        motion.check_keys(("constants",))
    t = read_instants_array(time)
    angles = arguments.pop("psi_0", 0.0), arguments.pop("psid_0", 0.0)
    try:
        with table.naming(**_KEYS_OF_ARGUMENTS), warnings_of_scenes():
            torque = HingeLoad(motor=arguments.pop("hinge_torque", 0.0), **hinge)
            simulated = simulate(pair, t, body1, *angles, hinge_torque=torque, base=base, **arguments)
    except SimulationError as error:
        table.refuse("", "a motion that can be followed", f"none past t = {error.t:.6g}: {error.why}")

    errors = {"rad of psi": estimate_or_nan(lambda: simulated.psi_error_estimate)}
    if kind in {"free", "pinned"}:
        errors = {"rad of body 1": estimate_or_nan(lambda: simulated.error_estimate), **errors}
    how = f"simulated in {simulated.steps} steps, base {kind}"
    return PairMotion(
        t=simulated.t,
        source=_known_motion(simulated),
        origin="simulated from what acts",
        how=how,
        errors=errors,
        doubt=DOUBT,
        notes=(
            *impact_sentences(simulated.impacts, {"psi": "rad"}),
            *end_notes(simulated.ended_by_event, simulated.t),
        ),
        simulated=simulated,
        stops=stop_range(torque),
    )


def with_hinge_loads(motion: PairMotion, setup: DynamicsSetup, table: Table) -> PairMotion:
    """Return a motion whose psi is given with the loads and the gravity of the Table [dynamics], read as `setup`."""
    with table.naming(**_KEYS_OF_ARGUMENTS):
        load = HingeLoad(**setup.hinge)
    fall = setup.others.get("gravity")
    fall = None if fall is None else (*fall, 0.0)[:3]
    return replace(motion, hinge_load=load, fall=fall, stops=stop_range(load))


@contextlib.contextmanager
def warnings_of_scenes() -> Iterator[None]:
    """Silence in a block the warnings of simulations that the notes of a scene repeat."""
    with warnings.catch_warnings():
        for said in (".* (leaves its|passes the) ", ".* is taken for ", ".* is it in seconds"):
            warnings.filterwarnings("ignore", said, DynamicsWarning)
        yield


def estimate_or_nan(estimate: Callable[[], float]) -> LazyValue:
    """Return an estimate of an error, NaN if the second run of the simulation, which tells it, fails."""

    def value() -> float:
        try:
            return float(estimate())
        except SimulationError:  # with a smaller tolerance it has an end of its own
            return math.nan

    return LazyValue(value)


def _known_motion(simulated: SimulatedMotion | SimulatedPlanarMotion) -> MotionByBody1 | MotionByCoordinates:
    """Return a simulated motion with its derivatives as a MotionByBody1, in the plane as a MotionByCoordinates."""
    hinge = simulated.psi, simulated.psid, simulated.psidd
    if isinstance(simulated, SimulatedMotion):
        return MotionByBody1(simulated.body1, hinge)
    R, v, omega, a, alpha = motion_arrays("body1", simulated.body1, "R", "v", "omega", "a", "alpha").values()
    rows = zip((R, v, a), (simulated.phi, omega[:, 2], alpha[:, 2]), hinge, strict=True)
    return MotionByCoordinates(
        len(simulated.t), tuple((*vector.T[:2], angle, psi) for vector, angle, psi in rows), None
    )


def _read_body1_start(table: Table, start_values: dict[str, Any], planar: bool) -> BodyMotion:
    """Return the motion of body 1 at the first instant, in space; at rest at the origin but for `start_values`."""
    R, v = ((*start_values.get(key, (0, 0, 0)), 0)[:3] for key in ("R1_0", "v1_0"))
    if planar:
        S: Any = rotation_exp((0, 0, start_values.get("phi_0", 0.0)))
        return BodyMotion(R=R, S=S, v=v, omega=(0, 0, start_values.get("omega1_0", 0.0)))
    with table.naming(S="S1_0"):
        return BodyMotion(
            R=R, S=start_values.get("S1_0", np.eye(3)), v=v, omega=start_values.get("omega1_0", (0, 0, 0))
        )


def _prescribed_body1(motion: Table, pair: HingePair | PlanarPair) -> Callable[[Float64Array], BodyMotion]:
    """Return a callable of an array t that returns the BodyMotion of body 1, with accelerations, from the coordinates
    in the Table [motion]; for a PlanarPair these are x, y, phi.
    """
    names = (PLANE if isinstance(pair, PlanarPair) else SPACE).coordinates
    functions, sequence = read_coordinate_functions(motion, names[:-1])

    def moved(t: Float64Array) -> BodyMotion:
        rows = tuple((*row, 0.0) for row in functions.derivatives(t, ACCELERATION))
        return MotionByCoordinates(len(t), rows, sequence).in_space(pair).body1

    return moved
