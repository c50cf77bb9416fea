"""Linearization of the motion about a state: natural frequencies and damping ratios of small motions."""

from __future__ import annotations

import functools
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.mechanism.bodies.hinge_load import HingeLoad, HingeTorque, stop_range
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.motion.equations_of_motion import REST
from hingepair.motion.given import EffortArgument, GivenMotion, LoadArgument, loads_by_joint, robot_loads
from hingepair.motion.loads import ON_BASE, MotionAtInstants, has_callable
from hingepair.motion.pairs import BaseArgument, in_words_of_pairs, pair_as_robot
from hingepair.motion.simulate import BaseMotion, base_of
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, read_only, vectors
from hingepair.rollouts.tracks import Feedback
from hingepair.rotations.matrices import rotation_exp
from hingepair.tables.sheets import ruled_table

_STEP: Final = 1e-4  # of differences of order 4 [rad, m, rad/s, m/s]
_DRIFT: Final = 1e-6  # of the largest pole: double poles at 0 come out as the root of rounding errors
_MAX_CHANGE = 0.3  # rad: of an angle in one iteration towards an equilibrium
_OUT_OF_PLANE: Final = (2, 3, 4)  # of R1 and phi
_PINNED: Final = (0, 1, 2)


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
    - `force1`, `torque1`: force and torque on a free base, as for `forward_dynamics`. These, `tau` and `wrenches` may
      also be callables of (t, now), as for `simulate`, about one state.
    - `base`: as for `simulate`; by default that of the robot.
    - `base_motion`: motion of the base, as for `forward_dynamics`, or a callable, as for `simulate`.
    - `equilibrium`: as for pairs, about one state; tau is then 0 by default.
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
    forces = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
    start = [finite_number("psi_0", psi_0)], [finite_number("psid_0", psid_0)], 0.0
    _, robot, given = pair_as_robot(pair, base, body1, hinge_torque, forces, gravity)
    with in_words_of_pairs(base):
        small = linearize_robot(
            robot, *start, **given, t=t, equilibrium=equilibrium, backend=backend,
            left_out=_OUT_OF_PLANE if isinstance(pair, PlanarPair) else (),
        )  # fmt: skip
    names = tuple("psid" if name == "psi_dot" else name for name in small.names)
    return replace(small, names=names, B=small.B[:, -1])


def linearize_robot(
    robot: Mechanism,
    q: ArrayLike,
    qd: ArrayLike | None = None,
    tau: EffortArgument | None = None,
    *,
    loads: Mapping[str, HingeTorque] | None = None,
    joint_loads: bool | None = None,
    t: float = 0.0,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    wrenches: Mapping[str, tuple[LoadArgument, LoadArgument]] | None = None,
    force1: LoadArgument = 0,
    torque1: LoadArgument = 0,
    base: str | None = None,
    base_motion: BaseMotion = None,
    equilibrium: bool = False,
    workers: int = 1,
    backend: str = "auto",
    left_out: Collection[int] = (),
) -> Linearization:
    """Linearize the motion of a robot; `linearize` says what the arguments are. `left_out` are numbers of components
    of R1 and phi in which nothing moves.
    """
    if loads is not None and joint_loads is not None:
        raise ArgumentError("joint_loads", "None beside loads", quoted(joint_loads))
    zeros, instant = np.zeros(robot.dof), finite_number("t", t)
    given_rates = zeros if qd is None else vectors("qd", qd, robot.dof)
    q, qd = (np.asarray(x, np.float64) for x in np.broadcast_arrays(vectors("q", q, robot.dof), given_rates))
    motion: Any = base_motion
    if base is not None or callable(base_motion):
        kind, motion = base_of(robot, base, base_motion)
        if kind in ("free", "pinned"):
            robot = robot.with_base("free")
        left_out = (*_PINNED, *left_out) if kind == "pinned" else left_out
    moves_as_given = isinstance(motion, GivenMotion)
    if moves_as_given:
        motion = BodyMotion(**{name[:-1]: rows[0] for name, rows in motion.at(np.array([instant])).items()})
    options: dict[str, Any] = {"gravity": gravity, "workers": workers, "backend": backend}
    options["joint_loads"] = joint_loads if loads is None else False
    given: dict[str, Any] = {"wrenches": wrenches, "force1": force1, "torque1": torque1}
    given["tau"] = zeros if tau is None and equilibrium else tau
    states = _States(robot, loads_by_joint(robot, loads), given, instant, options, left_out)
    if equilibrium:
        rates = (qd, *(getattr(motion, letter, None) for letter in ("v", "omega")))
        if q.ndim > 1 or any(rate is not None and np.any(rate) for rate in rates):
            raise ArgumentError(
                "qd, base_motion", "one state at rest, from which an equilibrium is sought", quoted(qd)
            )
        q, motion = _find_equilibrium(states, q, motion)
    small = states.small_motion(q, qd, motion)
    parts = [("R1", "phi"), ("v1", "omega1")] if robot.base == "free" else [(), ()]
    names = [
        [f"{letter}_{axis}" for letter in letters for axis in "xyz"] + [name + ending for name in robot.names]
        for letters, ending in zip(parts, ("", "_dot"), strict=True)
    ]
    kept = tuple(both[k] for both in names for k in small.kept)
    return Linearization(
        read_only(small.A), read_only(small.B), read_only(small.rates), kept, q, None if moves_as_given else motion
    )


linearize.register(Mechanism, cast(Any, linearize_robot))


class _Efforts(NamedTuple):
    """Efforts of HingeLoads, and their derivatives by the coordinate and by the rate of each joint; (..., dof)."""

    values: Array
    by_q: Array
    by_qd: Array


class _SmallMotion(NamedTuple):
    """Linearized motion: rates of the state, and their derivatives, as in `Linearization`."""

    A: Array
    B: Array
    rates: Array
    kept: NDArray[np.intp]  # numbers of its velocities among all of the robot

    def without(self, numbers: Collection[int]) -> _SmallMotion:
        """Return the motion without some of all velocities, in which nothing moves."""
        index = np.flatnonzero(~np.isin(self.kept, [*numbers]))
        rows = np.concatenate((index, len(self.kept) + index))
        return _SmallMotion(
            self.A[..., rows[:, None], rows], self.B[..., rows, :], self.rates[..., rows], self.kept[index]
        )


class _States(NamedTuple):
    """Motion of a robot about any states, under given loads.

    Attributes:
        robot: the robot.
        joint_loads: HingeLoad of each joint.
        given: wrenches, force1, torque1 and tau as users give them; tau None: what makes q'' = 0.
        t: instant [s].
        options: options of the robot's methods.
        left_out: numbers of components of R1 and phi in which nothing moves.
    """

    robot: Mechanism
    joint_loads: Mapping[str, HingeLoad]
    given: Mapping[str, Any]
    t: float
    options: Mapping[str, Any]
    left_out: Collection[int]

    @property
    def free(self) -> bool:
        """Whether forces move the base."""
        return bool(self.robot.base == "free")

    @property
    def pinned(self) -> bool:
        """Whether a force keeps R1 where it is."""
        return {*_PINNED} <= {*self.left_out}

    def small_motion(self, q: Array, qd: Array, motion: BodyMotion | None, *, stops: bool = True) -> _SmallMotion:
        """Return the linearized motion about states; `stops`: refuse those at rigid stops."""
        efforts = self._efforts(q, qd, stops)
        tau, on_base, wrenches, slopes = self._loads_at(q, qd, motion)
        options = {**self.options, "wrenches": wrenches}
        if tau is None:
            still = self._held_stiff(q, qd, motion, on_base, options) if self.free else motion
            tau = self.robot.inverse_dynamics(
                q, qd, np.zeros_like(q), outputs=("tau",), base_motion=still, **options
            ).tau  # fmt: skip
        else:
            tau = tau + efforts.values
        options["base_motion"] = motion
        small = _small_motion(self.robot, q, qd, tau, on_base, options)
        n = len(small.kept)
        if self.pinned:
            reaction = -np.linalg.solve(small.B[..., n : n + 3, :3], small.rates[..., n : n + 3, None])[..., 0]
            on_base["force1"] = on_base["force1"] + reaction
            small = _small_motion(self.robot, q, qd, tau, on_base, options)
        by_tau, A = small.B[..., 6 * self.free :], small.A + (0 if slopes is None else small.B @ slopes)
        A[..., 6 * self.free : n] += by_tau * efforts.by_q[..., None, :]
        A[..., n + 6 * self.free :] += by_tau * efforts.by_qd[..., None, :]
        small = small._replace(A=A)
        if self.pinned:  # a change of the state changes a1, and the force on R1 changes it back
            share = small.B[..., :3] @ np.linalg.inv(small.B[..., n : n + 3, :3])
            small = small._replace(A=A - share @ A[..., n : n + 3, :], B=small.B - share @ small.B[..., n : n + 3, :])
        return small.without(self.left_out)

    def _loads_at(self, q: Array, qd: Array, motion: BodyMotion | None) -> tuple[Any, dict[str, Any], Any, Any]:
        """Return tau, the loads on the base and the wrenches; and where any is a callable, the derivatives of the
        generalized forces by the state, (velocities, 2 velocities), by differences of order 4.
        """
        tau, wrenches = self.given["tau"], self.given["wrenches"]
        on_base = {name: self.given[name] for name in ON_BASE if self.free or np.any(self.given[name] != 0)}
        loads = [tau, *on_base.values(), *(load for pair in (wrenches or {}).values() for load in pair)]
        if not any(callable(load) or isinstance(load, Feedback) for load in loads):
            if tau is not None:
                tau = np.zeros(q.shape) + tau if isinstance(tau, float | int) else vectors("tau", tau, self.robot.dof)
            return tau, on_base, wrenches, None
        if q.ndim > 1:
            raise ArgumentError("q", "one state beside loads that are callables", f"shape {q.shape}")
        given = {name: self.given[name] for name in ON_BASE}
        acting = robot_loads(self.robot, 0.0 if tau is None else tau, None, wrenches, given, self.options["gravity"])
        size = 6 + self.robot.dof
        columns = np.arange(2 * size).reshape(2, size)[:, 0 if self.free else 6 :].ravel()
        steps = np.concatenate([k * _STEP * np.eye(2 * size)[columns] for k in (-2, -1, 1, 2)])
        now = _beside(q, qd, REST if motion is None else motion, np.concatenate([np.zeros((1, 2 * size)), steps]))
        t = np.full(len(now.q), self.t)
        base, links = acting.on_bodies(t, now)
        forces = np.concatenate([base, acting.efforts.at(t, now), links.reshape(len(t), -1)], axis=1)
        two_before, before, after, two_after = forces[1:].reshape(4, len(columns), -1)
        slopes = ((8 * (after - before) - (two_after - two_before)) / (12 * _STEP)).T
        along: list[Any] = [np.eye(size)[:, 0 if self.free else 6 :]]
        along += [self.robot.jacobian(q, link, base_motion=motion) for link in acting.wrenches]
        on_base = {name: base[0, 3 * k : 3 * k + 3] for k, name in enumerate(ON_BASE) if name in on_base}
        found = {link: (one[:3], one[3:]) for link, one in zip(acting.wrenches, links[0], strict=True)}
        return None if tau is None else forces[0, 6:size], on_base, found, np.concatenate(along).T @ slopes

    def _held_stiff(self, q: Array, qd: Array, motion: BodyMotion | None, on_base: Any, options: Any) -> BodyMotion:
        """Return the motion of a base that forces move while all joints are stiff: M a = f - h of its rows (T4)."""
        motion, zero = REST if motion is None else motion, np.zeros(3)
        v, omega = (zero if rate is None else rate for rate in (motion.v, motion.omega))
        still = motion_of_rotations(R=motion.R, S=motion.S, v=v, omega=omega, a=zero, alpha=zero)
        h = self.robot.inverse_dynamics(q, qd, np.zeros_like(q), base_motion=still, **options)
        run = {name: options[name] for name in ("workers", "backend")}
        moving = [k for k in range(6) if k not in self.left_out]
        M = self.robot.mass_matrix(q, base_motion=still, **run)[..., moving, :][..., moving]
        force, torque = (np.asarray(on_base[name], np.float64) + zero for name in ON_BASE)
        rest = np.concatenate(np.broadcast_arrays(force - h.force1, torque - h.torque1), axis=-1)
        a = np.zeros(rest.shape)
        a[..., moving] = np.linalg.solve(M, rest[..., moving, None])[..., 0]
        return motion_of_rotations(R=motion.R, S=motion.S, v=v, omega=omega, a=a[..., :3], alpha=a[..., 3:])

    def _efforts(self, q: Array, qd: Array, stops: bool) -> _Efforts:
        """Return the efforts of all HingeLoads and their derivatives."""
        found = _Efforts(*(np.zeros(q.shape) for _ in range(3)))
        for k, (name, load) in enumerate(self.joint_loads.items()):
            if load != HingeLoad():
                label = f"loads[{name!r}]"
                for whole, part in zip(
                    found, _efforts(label, load, self.t, q[..., k], qd[..., k], stops), strict=True
                ):
                    whole[..., k] = part
        return found


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
    return _SmallMotion(A, B, rates, np.arange(n))


_NOT_SMOOTH: Final = "a load with a linearization: friction that sticks (without friction_rate) or a stop holds it"


def _efforts(label: str, load: HingeLoad, t: float, q: Array, qd: Array, stops: bool) -> _Efforts:
    """Return the effort of a HingeLoad at one joint in any number of states, and its derivatives; `stops`: refuse
    states at rigid stops.
    """
    x, rate = q.ravel(), qd.ravel()
    lower, upper = stop_range(load, rigid=True)
    at_stop = stops and bool(((x <= lower) | (x >= upper)).any())
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


def _beside(q: Array, qd: Array, motion: BodyMotion, changes: Array) -> MotionAtInstants:
    """Return the motion beside a state; `changes` of R1, phi, q, v1, omega1 and qd, (m, 12 + 2 dof)."""
    n = len(q)
    R, turn, at, v, omega, rates = np.split(changes, (3, 6, 6 + n, 9 + n, 12 + n), axis=1)
    S = np.asarray(rotation_exp(turn) @ motion.S, np.float64)
    given = ((motion.R, R), (motion.v, v), (motion.omega, omega))
    R1, v1, omega1 = (change if part is None else np.asarray(part, np.float64) + change for part, change in given)
    return MotionAtInstants(q + at, qd + rates, R1, S, v1, omega1)


def _find_equilibrium(states: _States, q: Array, motion: BodyMotion | None) -> tuple[Array, BodyMotion | None]:
    """Return q and the motion of the base at the stable equilibrium near a state at rest, by Newton's method."""
    start, offset = q, 6 * states.free
    for name, load in states.joint_loads.items():
        if load.sticking_friction:
            raise ArgumentError(f"loads[{name!r}]", _NOT_SMOOTH, quoted(load))
    ranges = [stop_range(load, rigid=True) for load in states.joint_loads.values()]
    lower, upper = np.array(ranges).reshape(-1, 2).T
    for _ in range(200):
        q = np.clip(q, lower, upper)
        small = states.small_motion(q, np.zeros_like(q), motion, stops=False)
        n, coordinates = len(small.kept), np.flatnonzero(small.kept >= offset // 2)  # phi and q
        accelerations, matrix = small.rates[n:], small.A[n:, coordinates]
        # Forces along the coordinates, of which those of a drift of the whole robot vanish.
        forces = np.linalg.lstsq(small.B[n:], accelerations, rcond=1e-12)[0]
        pressed = ((q == upper) & (forces[offset:] > 0)) | ((q == lower) & (forces[offset:] < 0))
        if pressed.any():
            name = states.robot.names[int(np.argmax(pressed))]
            expected = "a load with an equilibrium between the stops"
            raise ArgumentError(f"loads[{name!r}]", expected, "a stop that holds")
        forces = forces[small.kept[coordinates]]
        # Newton's step, by least squares where the whole robot may drift.
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
            q, motion = _moved(states, q, motion, small.kept[coordinates], change * min(1.0, _MAX_CHANGE / size))
            continue
        # Away by twice the distance of the unstable equilibrium, and by a hundredth of a radian at least.
        far = min(max(2 * size, 0.01), _MAX_CHANGE) / np.abs(change).max()
        q, motion = _moved(states, q, motion, small.kept[coordinates], change * far)
    raise ArgumentError("equilibrium", "a stable equilibrium near the state", f"none near {start.tolist()}")


def _moved(
    states: _States, q: Array, motion: BodyMotion | None, numbers: NDArray[np.intp], change: Array
) -> tuple[Array, BodyMotion | None]:
    """Return q and the motion of the base after changes of coordinates."""
    offset = 6 * states.free
    changes = np.zeros(offset + len(q))
    changes[numbers] = change
    if offset:
        base = REST if motion is None else motion
        rates = {letter: getattr(base, letter) for letter in ("v", "omega", "a", "alpha")}
        motion = motion_of_rotations(R=base.R, S=rotation_exp(changes[3:6]) @ np.asarray(base.S), **rates)
    return q + changes[offset:], motion


def _growing_direction(A: Array) -> Array | None:
    """Return the direction of the state in which small motions grow fastest, or None if none grow."""
    poles, directions = np.linalg.eig(A)
    fastest = int(np.argmax(poles.real))
    if poles[fastest].real <= 1e-4 * np.abs(poles).max(initial=0.0):  # double zeros are drifts of the whole pair
        return None
    return np.asarray(directions[:, fastest].real, np.float64)
