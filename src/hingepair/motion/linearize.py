"""Linearization of the motion about a state: natural frequencies and damping ratios of small motions."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.mechanism.bodies.hinge_load import HingeLoad, HingeTorque, stop_range
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.options import DEFAULT_GRAVITY, Wrenches
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PLANAR_GRAVITY, PlanarPair
from hingepair.motion.equations_of_motion import REST
from hingepair.motion.given_loads import LoadArgument, hinge_load, loads_by_joint, pair_loads
from hingepair.motion.given_motions import GivenBase
from hingepair.motion.loads import Loads, MotionAtInstants, has_callable
from hingepair.motion.simulate import BaseArgument, initial_state, read_base, robot_of_pair, to_spatial_pair
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, read_only, vectors
from hingepair.rotations.matrices import rotation_exp
from hingepair.tables.sheets import ruled_table

_STEP: Final = 1e-4  # of differences of order 4 [rad, m, rad/s, m/s]
_DRIFT: Final = 1e-6  # of the largest pole: double poles at 0 come out as the root of rounding errors
_MAX_CHANGE = 0.3  # rad: of an angle in one iteration towards an equilibrium
_OUT_OF_PLANE: Final = ("R1_z", "phi_x", "phi_y", "v1_z", "omega1_x", "omega1_y")


@dataclass(frozen=True, eq=False, repr=False)
class Linearization:
    """Linearized motion of a pair or a robot, x' = rates + A x + B u for small changes x of the state and u of the
    loads. `print` shows the poles.
    """

    #: derivatives of the state's rates by the state; shape (..., k, k)
    A: Array
    #: derivatives of the state's rates by tau, with a free base by force1, torque1 and tau, (..., k, k/2); of a pair
    #: by the torque at the hinge, (k,)
    B: Array
    #: rates of the state; 0 at an equilibrium; shape (..., k)
    rates: Array
    #: names of the components of the state: coordinates, psi of a pair, and their rates; with a free base its
    #: displacement R1 and small rotations phi before the coordinates, v1 and omega1 before their rates, all along
    #: world axes, with a pinned base phi and omega1; of a planar pair only those in the plane
    names: tuple[str, ...]
    #: coordinates [rad, m]; shape (..., dof)
    q: Array
    #: motion of body 1, or of the base; None for a base at rest at the origin and for one that moves as given
    body1: BodyMotion | None

    @property
    def psi(self) -> float:
        """Hinge angle of a pair [rad]."""
        return float(self.q[..., 0])

    @property
    def equilibrium(self) -> bool:
        """Whether all states are equilibria; if not, the poles are those of this instant alone."""
        return bool(np.abs(self.rates).max(initial=0.0) <= 1e-9 * max(1.0, np.abs(self.A).max(initial=0.0)))

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A that are not 0 [1/s], sorted by magnitude, of each conjugate pair the one with a positive
        imaginary part; of one state.

        Raises:
            ArgumentError: there are several states.
        """
        if self.A.ndim > 2:
            raise ArgumentError("poles", "the linearization about one state", f"{self.A.shape[:-2]} of them")
        found = np.linalg.eigvals(self.A).astype(np.complex128)
        found = found[(np.abs(found) > _DRIFT * np.abs(found).max(initial=0.0)) & (found.imag >= 0)]
        # Poles of equal magnitude are sorted by their real parts, whatever rounding says.
        sizes = [float(f"{abs(pole):.9g}") for pole in found]
        return np.asarray(found[np.lexsort((found.real, sizes))])

    @property
    def natural_frequencies(self) -> Array:
        """Absolute values of the poles [rad/s]."""
        return np.abs(self.poles)

    @property
    def damping_ratios(self) -> Array:
        """Damping ratio of each pole; 0 without damping, 1 for real poles, below 0 if the motion grows."""
        poles = self.poles
        return np.asarray(-poles.real / np.abs(poles), np.float64)

    def __str__(self) -> str:
        if self.A.ndim > 2:
            return f"small motions about states of shape {self.A.shape[:-2]}: {', '.join(self.names)}"
        rows = [
            (f"{pole:.6g}", f"{size:.6g}", f"{size / (2 * np.pi):.6g}", f"{ratio:.4g}")
            for pole, size, ratio in zip(self.poles, self.natural_frequencies, self.damping_ratios, strict=True)
        ]
        coordinates = self.names[len(self.names) // 2 - len(self.q) :]
        where = ", ".join(f"{name} = {x:.6g}" for name, x in zip(coordinates, self.q, strict=False))
        head = f"small motions about {where} rad" if "psi" in self.names else f"small motions about {where}"
        if not self.equilibrium:
            fastest = int(np.argmax(np.abs(self.rates)))
            head += f", which is no equilibrium: {self.names[fastest]}' = {self.rates[fastest]:.3g}"
        table = ruled_table([("pole [1/s]", "natural frequency [rad/s]", "[Hz]", "damping ratio"), *rows])
        return "\n".join([head, *table])

    __repr__ = __str__


@functools.singledispatch
def linearize(
    pair: HingePair | PlanarPair,
    body1: BodyMotion | None,
    psi_0: float,
    psid_0: float = 0.0,
    *,
    hinge_torque: HingeTorque = 0.0,
    force1: LoadArgument = 0,
    torque1: LoadArgument = 0,
    force2: LoadArgument = 0,
    torque2: LoadArgument = 0,
    gravity: ArrayLike | None = None,
    base: BaseArgument = "free",
    t: float = 0.0,
    equilibrium: bool = False,
    backend: str = "auto",
) -> Linearization:
    """Linearize the motion of a pair under loads about the state (body1, psi_0, psid_0) at the instant t, or with
    `equilibrium` about the stable equilibrium near this state; or the motion of a robot about one state or many (T11)
    by `hp.linearize(robot, q, qd, tau)`, whose arguments are below.

    Arguments that `simulate` has too mean the same here, at one instant. A pair is a robot of one joint. Derivatives
    are exact up to rounding; those of callable loads are finite differences of order 4.

    Of a robot, `t`, `gravity` and `backend` are as for pairs. The others are

    - `q`: coordinates, shape (..., dof) [rad for hinges, m for sliders].
    - `qd`: first time derivatives of q; 0 by default.
    - `tau`: torques of hinges [N m] and forces of sliders [N]; by default those that make qdd = 0, of a free base
      while it falls as force1 and torque1 let it.
    - `loads`: `HingeLoad`s by joint, which add to tau, as for `simulate`; `joint_loads` must then be None. Dry
      friction without `friction_rate` is no load of a joint at rest here, which it holds.
    - `joint_loads`: whether springs, dampers and dry friction of the joints act, as for `inverse_dynamics`.
    - `wrenches`: loads on links, which keep their values in world axes, as for `inverse_dynamics`.
    - `force1`, `torque1`: force and torque on a free base, as for `forward_dynamics`.
    - `base_motion`: motion of the base, as for `forward_dynamics`.
    - `workers`: number of threads.

    Args:
        pair: a pair whose moving bodies have mass properties: body 2, and also body 1 if `base` is "free" or
            "pinned".
        body1: motion of body 1 as a BodyMotion: R and S; v and omega are zero by default. None if `base` is a
            callable.
        psi_0: hinge angle [rad]; with `equilibrium`, the angle at which the search for the equilibrium starts.
        psid_0: hinge rate [rad/s]; 0 by default.
        hinge_torque: torque at the hinge [N m], as for `simulate`; 0 by default. A HingeLoad with dry friction needs
            a friction_rate if the hinge is at rest: friction without friction_rate holds the hinge, and the motion
            cannot be linearized.
        force1: force on body 1 at R1, world axes [N], as for `simulate`; 0 by default.
        torque1: torque on body 1, world axes [N m], as for `simulate`; 0 by default.
        force2: force on body 2 at R2, world axes [N], as for `simulate`; 0 by default.
        torque2: torque on body 2, world axes [N m], as for `simulate`; 0 by default.
        gravity: acceleration of free fall, world axes [m/s^2]; (0, 0, -9.81) by default, for a PlanarPair (0, -9.81).
        base: what holds body 1: "free" (the default), "pinned", "fixed", or a callable, as for `simulate`.
        t: instant at which loads and a callable base are evaluated [s]; 0 by default.
        equilibrium: whether to linearize about the stable equilibrium near the given state. The given state must then
            be a state of rest. By default (False) the motion is linearized about the given state.
        backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

    Returns:
        The Linearization x' = rates + A x + B u, where x is the deviation of the state and u that of the torque at
        the hinge [N m], of a robot that of tau. `.poles` [1/s], `.natural_frequencies` [rad/s] and `.damping_ratios`
        describe the motion near an equilibrium; `.equilibrium` says whether the state is one. `.names` names the
        components of the state.

    Raises:
        ArgumentError: an argument cannot be used, a stop or friction holds the hinge, or no equilibrium is found; the
            error names the argument.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> rod = hp.Body(mass=2, inertia=(0.01, 1, 1))
    >>> pair = hp.HingePair(u1=(0, 0, 0), u2=(-1, 0, 0), n=(0, 1, 0), body2=rod)
    >>> held, damper = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), hp.HingeLoad(damping=0.6)
    >>> small = hp.linearize(pair, held, 1.0, hinge_torque=damper, base="fixed", equilibrium=True)
    >>> round(small.psi, 6), small.natural_frequencies.round(4), small.damping_ratios.round(4)
    (1.570796, array([2.5573]), array([0.0391]))
    >>> hp.linearize(hp.Mechanism([pair]), [np.pi / 2]).natural_frequencies.round(4)
    array([2.5573])
    """
    space = to_spatial_pair(pair)
    is_planar = space is not pair
    if gravity is None:
        gravity = PLANAR_GRAVITY if is_planar else DEFAULT_GRAVITY
    held, instant = read_base(base), finite_number("t", t)
    start = initial_state(held, body1, is_planar, finite_number("psi_0", psi_0), finite_number("psid_0", psid_0))
    if equilibrium and (start.v.any() or start.omega.any() or start.psid):
        raise ArgumentError("psid_0, body1", "a state at rest, from which an equilibrium is sought", quoted(body1))
    forces = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
    loads = pair_loads(forces, HingeLoad(), gravity, is_planar=is_planar)
    load = hinge_load(hinge_torque)
    robot = robot_of_pair(space, held)
    rest = {} if robot.base == "free" else {"a": np.zeros(3), "alpha": np.zeros(3)}
    motion = motion_of_rotations(R=start.R, S=start.S, v=start.v, omega=start.omega, **rest)
    if isinstance(held, GivenBase):
        given = {name[:-1]: part[0] for name, part in held.at(np.array([instant])).items()}
        motion = BodyMotion(**given)
    q, qd, label = np.array([start.psi]), np.array([start.psid]), "hinge_torque"

    def at(q: Array, motion: BodyMotion, *, search: bool = False) -> _SmallMotion:
        efforts = _efforts(label, load, instant, q, qd, allow_stops=search)
        return _pair_motion(robot, held, q, qd, motion, efforts, loads, instant, backend)

    if equilibrium:
        if load.sticking_friction:
            raise ArgumentError(label, _NOT_SMOOTH, quoted(hinge_torque))
        q, motion = _find_equilibrium(at, q, motion, load, is_planar=is_planar)
    small = at(q, motion)
    if is_planar:
        small = small.select([name not in _OUT_OF_PLANE for name in small.names])
    body1 = None if isinstance(held, GivenBase) else motion
    return small.result(q, body1, B=small.B[:, -1])


def _linearize_robot(
    robot: Mechanism,
    q: ArrayLike,
    qd: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    loads: Mapping[str, HingeTorque] | None = None,
    t: float = 0.0,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    wrenches: Wrenches = None,
    joint_loads: bool | None = None,
    force1: ArrayLike = 0,
    torque1: ArrayLike = 0,
    base_motion: BodyMotion | None = None,
    workers: int = 1,
    backend: str = "auto",
) -> Linearization:
    """Linearize the motion of a robot; `linearize` says what the arguments are."""
    zeros = np.zeros(robot.dof)
    q, qd = vectors("q", q, robot.dof), zeros if qd is None else vectors("qd", qd, robot.dof)
    if loads is not None and joint_loads is not None:
        raise ArgumentError("joint_loads", "None beside loads", quoted(joint_loads))
    options: dict[str, Any] = {"gravity": gravity, "wrenches": wrenches, "workers": workers, "backend": backend}
    options["joint_loads"] = joint_loads if loads is None else False
    on_base: dict[str, Any] = {"force1": force1, "torque1": torque1}
    q, qd = np.broadcast_arrays(np.asarray(q, np.float64), np.asarray(qd, np.float64))
    efforts = _no_efforts(q)
    instant = finite_number("t", t)
    for k, (name, load) in enumerate(zip(robot.names, loads_by_joint(robot, loads), strict=True)):
        if load != HingeLoad():
            own = _efforts(f"loads[{name!r}]", load, instant, q[..., k], qd[..., k])
            for whole, part in zip(efforts, own, strict=True):
                whole[..., k] = part
    if tau is None:
        motion = _falling(robot, q, qd, base_motion, on_base, options) if robot.base == "free" else base_motion
        total = robot.inverse_dynamics(q, qd, zeros, outputs=("tau",), base_motion=motion, **options).tau
    else:
        total = vectors("tau", tau, robot.dof) + efforts.values
    options["base_motion"] = base_motion
    small = _small_motion(robot, q, qd, np.asarray(total, np.float64), on_base, options)
    return small.add_efforts(efforts).result(q, base_motion)


linearize.register(Mechanism, cast(Any, _linearize_robot))


class _Efforts(NamedTuple):
    """Efforts of HingeLoads, and their derivatives by the coordinate and by the rate of each joint; (..., dof)."""

    values: Array
    by_q: Array
    by_qd: Array


class _SmallMotion(NamedTuple):
    """Linearized motion: names and rates of the state, and their derivatives, as in `Linearization`."""

    A: Array
    B: Array
    rates: Array
    names: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of velocities."""
        return len(self.names) // 2

    def select(self, kept: list[bool]) -> _SmallMotion:
        """Return the motion of some components of the state; the others do not move."""
        index = np.flatnonzero(kept)
        names = tuple(self.names[k] for k in index)
        return _SmallMotion(self.A[..., index[:, None], index], self.B[..., index, :], self.rates[..., index], names)

    def add_efforts(self, efforts: _Efforts) -> _SmallMotion:
        """Return the motion where efforts at the joints change with the state."""
        n, dof, A = self.size, efforts.values.shape[-1], self.A.copy()
        by_tau = self.B[..., self.B.shape[-1] - dof :]
        A[..., n - dof : n] += by_tau * efforts.by_q[..., None, :]
        A[..., 2 * n - dof :] += by_tau * efforts.by_qd[..., None, :]
        return self._replace(A=A)

    def result(self, q: Array, body1: BodyMotion | None, B: Array | None = None) -> Linearization:
        """Return what users see."""
        by_loads = self.B if B is None else B
        return Linearization(read_only(self.A), read_only(by_loads), read_only(self.rates), self.names, q, body1)


def _small_motion(
    robot: Mechanism, q: Array, qd: Array, tau: Array, on_base: Mapping[str, Any], options: Mapping[str, Any]
) -> _SmallMotion:
    """Return the linearized motion of a robot under constant loads, by its exact derivatives (T11)."""
    free, base_motion = robot.base == "free", options["base_motion"]
    a = robot.forward_dynamics(q, qd, tau, **on_base, **options)
    d = robot.forward_dynamics_derivatives(q, qd, tau, **on_base, **options)
    n, lead = d.qdd_q.shape[-1], a.qdd.shape[:-1]
    A = np.zeros((*lead, 2 * n, 2 * n))
    A[..., :n, n:], A[..., n:, :n], A[..., n:, n:] = np.eye(n), d.qdd_q, d.qdd_qd
    B = np.asarray(np.concatenate((np.zeros_like(d.qdd_tau), d.qdd_tau), axis=-2), np.float64)
    parts: list[Any] = [qd, a.qdd]
    if free:
        given = (None, None) if base_motion is None else (base_motion.v, base_motion.omega)
        v1, omega1 = (np.zeros(3) if one is None else np.asarray(one) for one in given)
        x, y, z = np.moveaxis(omega1, -1, 0)
        for (i, j), part in {(0, 1): -z, (0, 2): y, (1, 0): z, (1, 2): -x, (2, 0): -y, (2, 1): x}.items():
            A[..., 3 + i, 3 + j] = part  # phi' = omega1 x phi + change of omega1
        parts = [v1, omega1, qd, a.a1, a.alpha1, a.qdd]
    parts = [np.broadcast_to(part, (*lead, np.shape(part)[-1])) for part in parts]
    rates = np.asarray(np.concatenate(parts, axis=-1), np.float64)
    base = [f"{letter}_{axis}" for letter in ("R1", "phi") for axis in "xyz"] if free else []
    base_rates = [f"{letter}_{axis}" for letter in ("v1", "omega1") for axis in "xyz"] if free else []
    return _SmallMotion(A, B, rates, (*base, *robot.names, *base_rates, *(f"{name}_dot" for name in robot.names)))


def _falling(
    robot: Mechanism, q: Array, qd: Array, base_motion: BodyMotion | None, on_base: Mapping[str, Any], options: Any
) -> BodyMotion:
    """Return the motion of a free base whose robot is held stiff: M a = f - h, of the rows of the base (T4)."""
    motion = REST if base_motion is None else base_motion
    zero = np.zeros(3)
    known = {
        letter: zero if getattr(motion, letter) is None else getattr(motion, letter) for letter in ("v", "omega")
    }
    still = _with_rates(motion, **known, a=zero, alpha=zero)
    h = robot.inverse_dynamics(q, qd, np.zeros(robot.dof), base_motion=still, **options)
    run = {name: options[name] for name in ("workers", "backend")}
    M = robot.mass_matrix(q, base_motion=still, **run)[..., :6, :6]
    force, torque = (np.asarray(on_base[name], np.float64) + zero for name in ("force1", "torque1"))
    rest = np.concatenate(np.broadcast_arrays(force - h.force1, torque - h.torque1), axis=-1)
    a = np.linalg.solve(M, rest[..., None])[..., 0]
    return _with_rates(motion, **known, a=a[..., :3], alpha=a[..., 3:])


def _with_rates(motion: BodyMotion, **rates: Any) -> BodyMotion:
    """Return the pose of a motion with other rates."""
    return motion_of_rotations(R=motion.R, S=motion.S, **rates)


def _no_efforts(q: Array) -> _Efforts:
    return _Efforts(*(np.zeros(q.shape) for _ in range(3)))


_NOT_SMOOTH: Final = "a load with a linearization: friction that sticks (without friction_rate) or a stop holds it"


def _efforts(label: str, load: HingeLoad, t: float, q: Array, qd: Array, *, allow_stops: bool = False) -> _Efforts:
    """Return the effort of a HingeLoad at one joint in any number of states, and its derivatives."""
    x, rate = q.ravel(), qd.ravel()
    lower, upper = stop_range(load, rigid=True)
    at_stop = not allow_stops and bool(((x <= lower) | (x >= upper)).any())
    if at_stop or (load.sticking_friction and not rate.all()):
        raise ArgumentError(label, _NOT_SMOOTH, quoted(load))
    times = np.full(x.shape, t)

    def at(change: Any, change_of_rate: Any) -> Any:
        """Return the load beside the states, on the branch of these."""
        return load.smooth((x, rate), times, x + change, rate + change_of_rate) + 0 * x

    def slope(by_q: int, by_qd: int) -> Any:
        if not has_callable(load):
            return np.imag(at(1e-30j * by_q, 1e-30j * by_qd)) / 1e-30
        near = {k: at(k * _STEP * by_q, k * _STEP * by_qd) for k in (-2, -1, 1, 2)}  # it may take no complex numbers
        return (8 * (near[1] - near[-1]) - (near[2] - near[-2])) / (12 * _STEP)

    return _Efforts(*(np.asarray(part, np.float64).reshape(q.shape) for part in (at(0, 0), slope(1, 0), slope(0, 1))))


def _pair_motion(
    robot: Mechanism,
    held: str | GivenBase,
    q: Array,
    qd: Array,
    motion: BodyMotion,
    efforts: _Efforts,
    loads: Loads,
    t: float,
    backend: str,
) -> _SmallMotion:
    """Return the linearized motion of a pair as a robot of one joint, by its names for pairs."""
    moves = held in ("free", "pinned")
    base, links = loads.on_bodies(np.array([t]), _now(q, qd, motion, np.zeros((1, 14))))
    wrenches = {link: (one[:3], one[3:]) for link, one in zip(loads.wrenches, links[0], strict=True)}
    options: dict[str, Any] = {"gravity": loads.gravity, "wrenches": wrenches, "base_motion": motion}
    options |= {"joint_loads": False, "backend": backend}
    on_base: dict[str, Any] = {"force1": base[0, :3], "torque1": base[0, 3:]} if moves else {}
    small = _small_motion(robot, q, qd, efforts.values, on_base, options)
    pinned = held == "pinned"
    if pinned:  # the force that keeps R1 where it is
        n = small.size
        reaction = -np.linalg.solve(small.B[n : n + 3, :3], small.rates[n : n + 3])
        on_base["force1"] = on_base["force1"] + reaction
        small = _small_motion(robot, q, qd, efforts.values, on_base, options)
    if loads.callable_names:
        small = _with_callables(small, robot, q, qd, motion, loads, t)
    small = small.add_efforts(efforts)
    names = dict.fromkeys(small.names)
    names |= {robot.names[0]: "psi", f"{robot.names[0]}_dot": "psid"}
    small = small._replace(names=tuple(new or name for name, new in names.items()))
    return _pinned(small) if pinned else small


def _pinned(small: _SmallMotion) -> _SmallMotion:
    """Return the motion of a robot whose R1 is kept in place by a force that changes with the state."""
    n = small.size
    rows = slice(n, n + 3)  # of a1
    # A change of the state changes a1, and the force changes it back.
    share = small.B[:, :3] @ np.linalg.inv(small.B[rows, :3])
    held = small._replace(A=small.A - share @ small.A[rows], B=small.B - share @ small.B[rows])
    return held.select([not name.startswith(("R1_", "v1_")) for name in small.names])


def _with_callables(
    small: _SmallMotion, robot: Mechanism, q: Array, qd: Array, motion: BodyMotion, loads: Loads, t: float
) -> _SmallMotion:
    """Return the motion where forces on bodies are functions of the motion, by differences of these forces."""
    free = robot.base == "free"
    columns = np.arange(14) if free else np.array([6, 13])  # of R1, phi, psi, v1, omega1 and psid
    changes = np.concatenate([k * _STEP * np.eye(14)[columns] for k in (-2, -1, 1, 2)])
    now = _now(q, qd, motion, changes)
    base, links = loads.on_bodies(np.full(len(changes), t), now)
    forces = np.concatenate([base, links.reshape(len(changes), -1)], axis=1)
    two_before, before, after, two_after = forces.reshape(4, len(columns), -1)
    slopes = ((8 * (after - before) - (two_after - two_before)) / (12 * _STEP)).T
    # What forces on bodies are at the joints and the base.
    along: list[Any] = [np.eye(7)[:6] if free else np.zeros((6, 1))]
    along += [robot.jacobian(q, link, base_motion=motion) for link in loads.wrenches]
    return small._replace(A=small.A + small.B @ (np.concatenate(along).T @ slopes))


def _now(q: Array, qd: Array, motion: BodyMotion, changes: Array) -> MotionAtInstants:
    """Return the motion of a pair beside a state; `changes` (n, 14) of R1, phi, psi, v1, omega1 and psid."""
    R, turn, psi, v, omega, psid = np.split(changes, (3, 6, 7, 10, 13), axis=1)
    S = rotation_exp(turn) @ np.asarray(motion.S)
    given = (np.asarray(part, np.float64) for part in (motion.R, motion.v, motion.omega))
    R1, v1, omega1 = (part + change for part, change in zip(given, (R, v, omega), strict=True))
    return MotionAtInstants(q + psi, qd + psid, R1, S, v1, omega1)


def _find_equilibrium(
    at: Callable[..., _SmallMotion], q: Array, motion: BodyMotion, load: HingeLoad, *, is_planar: bool
) -> tuple[Array, BodyMotion]:
    """Return psi and the motion of body 1 at the stable equilibrium near a state at rest, by Newton's method."""
    start, (lower, upper) = float(q[0]), stop_range(load, rigid=True)
    for _ in range(200):
        q = np.clip(q, lower, upper)
        small = at(q, motion, search=True)
        if is_planar:
            small = small.select([name not in _OUT_OF_PLANE for name in small.names])
        n, coordinates = small.size, [k for k, name in enumerate(small.names) if name.startswith(("phi", "psi"))]
        coordinates = [k for k in coordinates if k < n]
        accelerations, matrix = small.rates[n:], small.A[n:, coordinates]
        # Forces along the coordinates, of which those of a drift of the whole pair vanish.
        forces = np.linalg.lstsq(small.B[n:], accelerations, rcond=1e-12)[0]
        forces = forces[[_FORCE_COLUMNS[small.names[k]] for k in coordinates]]
        if q[0] in (lower, upper) and forces[-1] * (1 if q[0] == upper else -1) > 0:
            raise ArgumentError("hinge_torque", "a torque with an equilibrium between the stops", "a stop that holds")
        # Newton's step, by least squares where the whole pair may drift.
        change: Any = np.linalg.lstsq(matrix, -accelerations, rcond=1e-9)[0]
        size = float(np.abs(change).max())
        # At rest, and stable?
        if size <= 1e-12 and np.abs(accelerations).max() <= 1e-9 * max(1.0, float(np.abs(matrix).max())):
            growth = _growing_direction(small.A)
            if growth is None:
                return q, motion
            change, size = growth[coordinates], 0.0  # off the unstable equilibrium
        elif forces @ change <= 0:  # towards an unstable equilibrium, or nowhere
            change = forces
        else:
            q, motion = _moved(q, motion, small.names, coordinates, change * min(1.0, _MAX_CHANGE / size))
            continue
        # Away by twice the distance of the unstable equilibrium, and by a hundredth of a radian at least.
        far = min(max(2 * size, 0.01), _MAX_CHANGE) / np.abs(change).max()
        q, motion = _moved(q, motion, small.names, coordinates, change * far)
    raise ArgumentError("equilibrium", "a stable equilibrium near the state", f"none near psi_0 = {start:g}")


# Columns of the derivatives by (force1, torque1, hinge_torque), by the coordinate along which a load acts.
_FORCE_COLUMNS: Final = {"phi_x": 3, "phi_y": 4, "phi_z": 5, "psi": -1}


def _moved(
    q: Array, motion: BodyMotion, names: tuple[str, ...], coordinates: list[int], change: Array
) -> tuple[Array, BodyMotion]:
    """Return psi and the motion of body 1 after changes of coordinates."""
    by_name = {names[k]: float(x) for k, x in zip(coordinates, change, strict=True)}
    turn = np.array([by_name.get(f"phi_{axis}", 0.0) for axis in "xyz"])
    S = rotation_exp(turn) @ np.asarray(motion.S)
    rates = {letter: getattr(motion, letter) for letter in ("v", "omega", "a", "alpha")}
    return q + by_name["psi"], motion_of_rotations(R=motion.R, S=S, **rates)


def _growing_direction(A: Array) -> Array | None:
    """Return the direction of the state in which small motions grow fastest, or None if none grow."""
    poles, directions = np.linalg.eig(A)
    fastest = int(np.argmax(poles.real))
    if poles[fastest].real <= 1e-4 * np.abs(poles).max(initial=0.0):  # double zeros are drifts of the whole pair
        return None
    return np.asarray(directions[:, fastest].real, np.float64)
