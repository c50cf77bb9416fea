"""Linearization of the motion about a state: natural frequencies and damping ratios of small motions."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, DynamicsWarning, quoted
from hingepair.mechanism.bodies.body_motion import AT_REST, BodyMotion
from hingepair.mechanism.bodies.hinge_load import HingeLoad, HingeTorque, stop_range
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.motion.given import check_rest, loads_by_joint
from hingepair.motion.loads import ON_BASE, has_callable
from hingepair.motion.pairs import BASES, in_words_of_pairs, pair_as_robot
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import check_choice, finite_number, read_only, vectors
from hingepair.tables.sheets import ruled_table

_STEP: Final = 1e-4  # of differences of order 4 [rad, m, rad/s, m/s]
_DRIFT: Final = 1e-6  # of the largest pole: double poles at 0 come out as the root of rounding errors
_MAX_CHANGE = 0.3  # rad: of an angle in one iteration towards an equilibrium


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
    #: world axes, with a pinned base phi and omega1
    names: tuple[str, ...]
    #: coordinates [rad, m]; shape (..., dof)
    q: Array
    #: motion of body 1, or of the base; None for a base at rest at the origin
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
    pair: HingePair,
    body1: BodyMotion | None,
    psi_0: float,
    psid_0: float = 0.0,
    *,
    hinge_torque: HingeTorque = 0.0,
    force1: ArrayLike = 0,
    torque1: ArrayLike = 0,
    force2: ArrayLike = 0,
    torque2: ArrayLike = 0,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    base: str = "free",
    t: float = 0.0,
    equilibrium: bool = False,
    backend: str = "auto",
) -> Linearization:
    """Linearize the motion of a pair under loads about the state (body1, psi_0, psid_0) at the instant t, or with
    `equilibrium` about the stable equilibrium near this state; or the motion of a robot about one state or many (T11)
    by `hp.linearize(robot, q, qd, tau)`, whose arguments are below.

    Arguments that `simulate` has too mean the same here, at one instant. A pair is a robot of one joint. Derivatives
    are exact up to rounding; those of a callable hinge torque are finite differences of order 4.

    Of a robot, `t`, `gravity` and `backend` are as for pairs. The others are

    - `q`: coordinates, shape (..., dof) [rad for hinges, m for sliders].
    - `qd`: first time derivatives of q; 0 by default.
    - `tau`: torques of hinges [N m] and forces of sliders [N]; by default those that make qdd = 0, of a free base
      while it falls as force1 and torque1 let it.
    - `loads`: `HingeLoad`s by joint, which add to tau, as for `simulate`. Dry friction without `friction_rate` is no
      load of a joint at rest here, which it holds.
    - `wrenches`: loads on links, which keep their values in world axes, as for `inverse_dynamics`.
    - `force1`, `torque1`: force and torque on a free base, as for `forward_dynamics`.
    - `base`: as for `simulate`; by default that of the robot.
    - `base_motion`: motion of the base, as for `forward_dynamics`.
    - `equilibrium`: as for pairs, about one state; tau is then 0 by default.

    Args:
        pair: a pair whose moving bodies have mass properties: body 2, and also body 1 if `base` is "free" or
            "pinned".
        body1: motion of body 1 as a BodyMotion: R and S; v and omega are zero by default.
        psi_0: hinge angle [rad]; with `equilibrium`, the angle at which the search for the equilibrium starts.
        psid_0: hinge rate [rad/s]; 0 by default.
        hinge_torque: torque at the hinge [N m], as for `simulate`; 0 by default. A HingeLoad with dry friction needs
            a friction_rate if the hinge is at rest: friction without friction_rate holds the hinge, and the motion
            cannot be linearized.
        force1: force on body 1 at R1, world axes [N]; 0 by default.
        torque1: torque on body 1, world axes [N m]; 0 by default.
        force2: force on body 2 at R2, world axes [N]; 0 by default.
        torque2: torque on body 2, world axes [N m]; 0 by default.
        gravity: acceleration of free fall, world axes [m/s^2]; (0, 0, -9.81) by default.
        base: what holds body 1: "free" (the default), "pinned" or "fixed".
        t: instant at which loads are evaluated [s]; 0 by default.
        equilibrium: whether to linearize about the stable equilibrium near the given state, which must then be a
            state of rest on a fixed base. By default (False) the motion is linearized about the given state.
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
    check_choice("base", base, BASES)
    robot, given = pair_as_robot(pair, base, body1, hinge_torque, forces, gravity)
    with in_words_of_pairs(base):
        small = linearize_robot(robot, *start, **given, t=t, equilibrium=equilibrium, backend=backend)
    names = tuple("psid" if name == "psi_dot" else name for name in small.names)
    return replace(small, names=names, B=small.B[:, -1])


def linearize_robot(
    robot: Mechanism,
    q: ArrayLike,
    qd: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    loads: Mapping[str, HingeTorque] | None = None,
    t: float = 0.0,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    wrenches: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    force1: ArrayLike = 0,
    torque1: ArrayLike = 0,
    base: str | None = None,
    base_motion: BodyMotion | None = None,
    equilibrium: bool = False,
    backend: str = "auto",
) -> Linearization:
    """Linearize the motion of a robot; `linearize` says what the arguments are."""
    given: dict[str, Any] = {"tau": tau, "force1": force1, "torque1": torque1}
    of_links = {f"wrenches[{link!r}]": part for link, pair in (wrenches or {}).items() for part in pair}
    for name, load in {**given, **of_links}.items():
        if callable(load):
            raise ArgumentError(name, "constants; the derivatives of a function are added to A", quoted(load))
    zeros = np.zeros(robot.dof)
    rates = zeros if qd is None else vectors("qd", qd, robot.dof)
    q, qd = (np.asarray(x, np.float64) for x in np.broadcast_arrays(vectors("q", q, robot.dof), rates))
    if base is not None:
        check_choice("base", base, BASES)
        robot = robot.with_base("fixed" if base == "fixed" else "free")
        if base_motion is not None:
            check_rest("base_motion", base, base_motion)
    if tau is not None:
        tau = np.zeros(q.shape) + tau if isinstance(tau, float | int) else vectors("tau", tau, robot.dof)
    given["tau"] = zeros if tau is None and equilibrium else tau
    options = {"gravity": gravity, "backend": backend, "wrenches": wrenches, "base_motion": base_motion}
    options["joint_loads"] = None if loads is None else False
    states = _States(robot, loads_by_joint(robot, loads), given, finite_number("t", t), options, base == "pinned")
    if equilibrium:
        if robot.base != "fixed" or q.ndim > 1 or np.any(qd):
            raise ArgumentError(
                "base, qd", "one state at rest on a fixed base, near which an equilibrium is sought", quoted(qd)
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DynamicsWarning)  # of steps that are taken back
            q = _find_equilibrium(states, q)
    A, B, changes = map(read_only, states.small_motion(q, qd))
    parts = [("R1", "phi"), ("v1", "omega1")] if robot.base == "free" else [(), ()]
    names: list[str] = []
    for letters, ending in zip(parts, ("", "_dot"), strict=True):
        own = [f"{letter}_{axis}" for letter in letters for axis in "xyz"] + [one + ending for one in robot.names]
        names += own[3 * states.pinned :]
    return Linearization(A, B, changes, tuple(names), q, base_motion)


linearize.register(Mechanism, cast(Any, linearize_robot))


_SmallMotion: TypeAlias = tuple[Array, Array, Array]  # A, B and rates, as in `Linearization`


class _States(NamedTuple):
    """Motion of a robot about any states, under given loads."""

    robot: Mechanism
    joint_loads: Mapping[str, HingeLoad]
    given: Mapping[str, Any]  # force1, torque1 and tau; tau None: what makes q'' = 0
    t: float  # [s]
    options: Mapping[str, Any]  # of the robot's methods
    pinned: bool  # whether a force keeps R1 of a free base where it is

    def small_motion(self, q: Array, qd: Array, *, stops: bool = True) -> _SmallMotion:
        """Return the linearized motion about states; `stops`: refuse those at rigid stops."""
        first = 6 * (self.robot.base == "free")  # joint among the velocities
        n = first + self.robot.dof
        efforts, by_q, by_qd = self._efforts(q, qd, stops)
        stiff = self.given["tau"] is None
        tau = efforts if stiff else self.given["tau"] + efforts
        on_base = {name: self.given[name] for name in ON_BASE if first or np.any(np.asarray(self.given[name]) != 0)}
        A, B, rates = self._constant_loads(q, qd, tau, on_base)
        # What holds the point R1, and the joints: accelerations are linear in loads.
        held = np.array([*range(3 * self.pinned), *range(first, n if stiff else first)], int)
        if held.size:
            rows = n + held
            needed = np.linalg.solve(B[..., rows[:, None], held], -rates[..., rows, None])[..., 0]
            if self.pinned:
                on_base["force1"] = on_base["force1"] + needed[..., :3]
            tau = tau + needed[..., 3 * self.pinned :] if stiff else tau
            A, B, rates = self._constant_loads(q, qd, tau, on_base)
        A[..., first:n] += B[..., first:] * by_q[..., None, :]
        A[..., n + first :] += B[..., first:] * by_qd[..., None, :]
        if self.pinned:  # a change of the state changes a1, and the force on R1 changes it back
            share = B[..., :3] @ np.linalg.inv(B[..., n : n + 3, :3])
            kept = np.array([*range(3, n), *range(n + 3, 2 * n)])
            A, B = A - share @ A[..., n : n + 3, :], B - share @ B[..., n : n + 3, :]
            A, B, rates = A[..., kept[:, None], kept], B[..., kept, :], rates[..., kept]
        return A, B, rates

    def _constant_loads(self, q: Array, qd: Array, tau: Array, on_base: Mapping[str, Any]) -> _SmallMotion:
        """Return the linearized motion under constant loads, by exact derivatives (T11)."""
        a = self.robot.forward_dynamics(q, qd, tau, **on_base, **self.options)
        d = self.robot.forward_dynamics_derivatives(q, qd, tau, **on_base, **self.options)
        n, lead = d.qdd_q.shape[-1], a.qdd.shape[:-1]
        A = np.zeros((*lead, 2 * n, 2 * n))
        A[..., :n, n:], A[..., n:, :n], A[..., n:, n:] = np.eye(n), d.qdd_q, d.qdd_qd
        B = np.asarray(np.concatenate((np.zeros_like(d.qdd_tau), d.qdd_tau), axis=-2), np.float64)
        parts: list[Any] = [qd, a.qdd]
        if self.robot.base == "free":
            base = self.options["base_motion"] or AT_REST
            v1, omega1 = (np.zeros(3) if one is None else np.asarray(one) for one in (base.v, base.omega))
            A[..., 3:6, 3:6] = np.cross(omega1[..., None, :], np.eye(3)).swapaxes(-1, -2)  # phi' = omega1 x phi + ...
            parts = [v1, omega1, qd, a.a1, a.alpha1, a.qdd]
        parts = [np.broadcast_to(part, (*lead, np.shape(part)[-1])) for part in parts]
        return A, B, np.asarray(np.concatenate(parts, axis=-1), np.float64)

    def _efforts(self, q: Array, qd: Array, stops: bool) -> Array:
        """Return the efforts of all HingeLoads and their derivatives by q and by qd, (3, ..., dof)."""
        found = np.zeros((3, *q.shape))
        for k, (name, load) in enumerate(self.joint_loads.items()):
            if load != HingeLoad():
                found[..., k] = _efforts(f"loads[{name!r}]", load, self.t, q[..., k], qd[..., k], stops)
        return found


_NOT_SMOOTH: Final = "a load with a linearization: friction that sticks (without friction_rate) or a stop holds it"


def _efforts(label: str, load: HingeLoad, t: float, q: Array, qd: Array, stops: bool) -> Array:
    """Return the effort of a HingeLoad at one joint in any number of states, and its derivatives by q and qd, (3,
    ...); `stops`: refuse states at rigid stops.
    """
    x, rate = q.ravel(), qd.ravel()
    lower, upper = stop_range(load, rigid=True)
    at_stop = stops and bool(((x <= lower) | (x >= upper)).any())
    if at_stop or (load.sticking_friction and not rate.all()):
        raise ArgumentError(label, _NOT_SMOOTH, quoted(load))

    def at(change: Any, change_of_rate: Any) -> Any:
        """Return the load beside the states, on the branch of these."""
        return load.smooth((x, rate), np.full(x.shape, t), x + change, rate + change_of_rate) + 0 * x

    def slope(by_q: int, by_qd: int) -> Any:
        if not has_callable(load):
            return np.imag(at(1e-30j * by_q, 1e-30j * by_qd)) / 1e-30
        near = {k: at(k * _STEP * by_q, k * _STEP * by_qd) for k in (-2, -1, 1, 2)}  # it may take no complex numbers
        return (8 * (near[1] - near[-1]) - (near[2] - near[-2])) / (12 * _STEP)

    return np.stack([np.asarray(part, np.float64) for part in (at(0, 0), slope(1, 0), slope(0, 1))]).reshape(
        3, *q.shape
    )


def _find_equilibrium(states: _States, q: Array) -> Array:
    """Return q at the stable equilibrium near a state at rest, by Newton's method, whose steps go down along all
    principal directions of the stiffness.
    """
    start, last, expected = q, q, "a stable equilibrium near the state"
    for name, load in states.joint_loads.items():
        if load.sticking_friction:
            raise ArgumentError(f"loads[{name!r}]", _NOT_SMOOTH, quoted(load))
    lower, upper = np.array([stop_range(load, rigid=True) for load in states.joint_loads.values()]).reshape(-1, 2).T
    for _ in range(200):
        q = np.clip(q, lower, upper)
        A, B, rates = states.small_motion(q, np.zeros_like(q), stops=False)
        if not np.isfinite(rates).all() and np.any(q != last):  # beyond the stroke of a strut, or a dead point
            q, expected = (q + last) / 2, "a stable equilibrium near the state, before results become NaN"
            continue
        n, last = len(q), q
        forces, stiffness = np.linalg.solve(B[n:], rates[n:]), -np.linalg.solve(B[n:], A[n:, :n])
        pressed = ((q == upper) & (forces > 0)) | ((q == lower) & (forces < 0))
        if pressed.any():
            name = states.robot.names[int(np.argmax(pressed))]
            raise ArgumentError(
                f"loads[{name!r}]", "a load with an equilibrium between the stops", "a stop that holds"
            )
        sizes, ways = np.linalg.eigh((stiffness + stiffness.T) / 2)
        along, scale = forces @ ways, max(float(np.abs(sizes).max()), float(np.abs(forces).max()), 1e-300)
        change = ways @ (along / np.maximum(np.abs(sizes), 1e-9 * scale))
        size = float(np.abs(change).max())
        if size <= 1e-12 and np.abs(rates[n:]).max() <= 1e-9 * max(1.0, float(np.abs(A).max())):
            if not sizes[0] < -1e-4 * np.abs(sizes).max():
                return q
            change, size = ways[:, 0], 100 * _MAX_CHANGE  # off the unstable equilibrium, by some 0.01 rad
        q = q + change * min(1.0, _MAX_CHANGE / size) if size else q
    raise ArgumentError("equilibrium", expected, f"none near {start.tolist()}")
