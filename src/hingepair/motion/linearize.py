"""Linearization of the motion about a state: natural frequencies and damping ratios of small motions."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, ClassVar, Final, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.motion.events import JointEvents
from hingepair.motion.linearize_robot import SmallMotion, linearize_robot
from hingepair.motion.pair_loads import BaseArgument, LoadArgument, pair_loads
from hingepair.motion.robot_motion import RobotMotion
from hingepair.motion.simulate import initial_state, pair_motion, read_base, to_spatial_pair
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, read_only
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_load import HingeTorque, stop_range
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PLANAR_GRAVITY, PlanarPair
from hingepair.pair.requests import DEFAULT_GRAVITY
from hingepair.tables.sheets import ruled_table

_STEP: Final = 1e-5  # of differences of order 4, in sizes of the state's components
_MAX_CHANGE = 0.3  # rad: of an angle in one iteration towards an equilibrium

_OUT_OF_PLANE: Final = (2, 5, 6, 7, 9, 10)  # places in the state of z of R and P, x and y of L and phi
# Components of the state of a free or pinned pair; a carried pair has the last two.
_NAMES: Final = (
    *(f"{vector}_{axis}" for vector in ("R", "P", "L", "phi") for axis in "xyz"),
    "psi",
    "psid",
)


@dataclass(frozen=True, eq=False, repr=False)
class Linearization(SmallMotion):
    """Linearized motion of a pair, x' = rates + A x + B hinge_torque for small changes x of the state. `print` shows
    the poles.
    """

    #: derivatives of the state's rates with respect to a torque at the hinge; shape (k,)
    B: Array
    #: names of the components of the state: psi and psid; for a free or pinned base, before them the common centre of
    #: mass R (for a pinned base R1), momentum P, angular momentum L about that point, and small rotations phi of body
    #: 1, all along world axes
    names: tuple[str, ...]
    #: hinge angle [rad]
    psi: float
    #: motion of body 1 at this state; None for a base that moves as given
    body1: BodyMotion | None
    #: derivatives of the state; 0 at an equilibrium; shape (k,)
    rates: Array
    #: whether the state is an equilibrium; if not, the poles are those of this instant alone
    equilibrium: bool

    _drift: ClassVar[float] = 1e-5  # A holds errors of differences

    def __str__(self) -> str:
        rows = [
            (f"{pole:.6g}", f"{size:.6g}", f"{size / (2 * np.pi):.6g}", f"{ratio:.4g}")
            for pole, size, ratio in zip(self.poles, self.natural_frequencies, self.damping_ratios, strict=True)
        ]
        head = f"small motions about psi = {self.psi:.6g} rad"
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

    Arguments that `simulate` has too mean the same here, at one instant. Derivatives are finite differences of order
    4, those of robots exact up to rounding.

    Of a robot, `t`, `gravity` and `backend` are as for pairs. The others are

    - `q`: coordinates, shape (..., dof) [rad for hinges, m for sliders].
    - `qd`: first time derivatives of q; 0 by default.
    - `tau`: torques of hinges [N m] and forces of sliders [N]; by default those that make qdd = 0.
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
        the hinge [N m]. `.poles` [1/s], `.natural_frequencies` [rad/s] and `.damping_ratios` describe the motion near
        an equilibrium; `.equilibrium` says whether the state is one. The state has 2 components if the base is
        "fixed" or a callable, and 14 if it is free or pinned; `.names` names them. Of a robot, a RobotLinearization,
        whose u are changes of tau.

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
    forces = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
    held = read_base(base)
    start = initial_state(held, body1, is_planar, finite_number("psi_0", psi_0), finite_number("psid_0", psid_0))
    if equilibrium and (start.v.any() or start.omega.any() or start.psid):
        raise ArgumentError("psid_0, body1", "a state at rest, from which an equilibrium is sought", quoted(body1))
    loads = pair_loads(forces, hinge_torque, gravity, is_planar=is_planar)
    motion = pair_motion(space, held, start, loads, backend)()
    JointEvents(motion, 0.0, 0.0, None)  # sets the side of each kink
    if motion.held.any() or (equilibrium and loads.joint_loads[0].sticking_friction):
        expected = (
            "a torque with a linearization: friction that sticks (without friction_rate) or a stop holds the hinge"
        )
        raise ArgumentError("hinge_torque", expected, quoted(hinge_torque))
    instant, state = finite_number("t", t), motion.state
    if equilibrium:
        state = _find_equilibrium(motion, instant, state, is_planar=is_planar)
    A, rates = _state_derivatives(motion, instant, state, np.arange(len(state)), is_planar=is_planar)
    B = np.zeros(len(state))
    B[-1] = motion.joint_mobility(instant, state)[0, 0]
    motion_now = motion.motion_at(np.full(1, instant), state[None])
    body1_motion = (
        None
        if callable(base)
        else BodyMotion(R=motion_now.R1[0], S=motion_now.S1[0], v=motion_now.v1[0], omega=motion_now.omega1[0])
    )
    return Linearization(
        read_only(A),
        read_only(B),
        _NAMES[-len(state) :],
        float(state[motion.q.start]),
        body1_motion,
        read_only(rates),
        bool(np.abs(rates / motion.sizes).max() <= 1e-9 * max(1.0, np.abs(A).max())),
    )


linearize.register(Mechanism, cast(Any, linearize_robot))


def _state_derivatives(
    motion: RobotMotion, t: float, state: Array, components: NDArray[np.intp], *, is_planar: bool
) -> tuple[Array, Array]:
    """Return the derivatives of the state's rates by these components of the state, (k, m), and the rates, (k,).
    Those out of the plane of a planar pair are 0.
    """
    steps = (_STEP * motion.sizes)[components]
    increments = np.zeros((len(components), len(state)))
    increments[np.arange(len(components)), components] = steps
    states = np.concatenate([state + share * increments for share in (-2, -1, 1, 2)] + [state[None]])
    rates = motion.rates(np.full(len(states), t), states)
    before2, before, after, after2 = rates[:-1].reshape(4, len(components), -1)
    derivatives = (8 * (after - before) - (after2 - before2)) / (12 * steps)[:, None]
    if is_planar and motion.has_momenta:
        derivatives[:, _OUT_OF_PLANE] = 0.0
        derivatives[np.isin(components, _OUT_OF_PLANE)] = 0.0
    return derivatives.T, rates[-1]


def _find_equilibrium(motion: RobotMotion, t: float, state: Array, *, is_planar: bool) -> Array:
    """Return the state of the stable equilibrium near a state at rest, by Newton's method. The motion is left on the
    branch of the hinge torque there.
    """
    rotations = {1: [], 13: [11] if is_planar else [9, 10, 11]}[len(state) - 1]
    coordinates = np.array([*rotations, motion.q.start])
    rate_indices = np.flatnonzero(motion.rate_mask)
    scales = motion.sizes[rate_indices]
    start = float(state[motion.q.start])
    for _ in range(200):
        # Between the rigid stops.
        lower, upper = stop_range(motion.joint_loads[0], rigid=True)
        psi = float(np.clip(state[motion.q.start], lower, upper))
        at_rigid_stop = psi in (lower, upper)
        state = state.copy()
        state[motion.q.start] = psi
        motion.side = (np.array([psi]), np.zeros(1))  # a stop acts if psi is beyond it, and only there
        # Newton's step, by least squares where the whole pair may drift.
        derivatives, rates = _state_derivatives(motion, t, state, coordinates, is_planar=is_planar)
        residual = rates[rate_indices] / scales
        torques = rates[[*(column - 3 for column in rotations), motion.q.start + 1]]  # about each coordinate
        if at_rigid_stop and torques[-1] * (1 if psi == upper else -1) > 0:
            raise ArgumentError("hinge_torque", "a torque with an equilibrium between the stops", "a stop that holds")
        matrix = derivatives[rate_indices] / scales[:, None]
        change = np.linalg.lstsq(matrix, -residual, rcond=1e-9)[0]
        size = float(np.abs(change).max())
        # At rest, and stable?
        if size <= 1e-13 and np.abs(residual).max() <= 1e-9 * max(1.0, float(np.abs(matrix).max())):
            growth = _growing_direction(motion, t, state, is_planar=is_planar)
            if growth is None:
                return state
            change, size = growth[coordinates], 0.0  # off the unstable equilibrium
        elif torques @ change <= 0:  # towards an unstable equilibrium, or nowhere
            change = torques
        else:
            state[coordinates] += change * min(1.0, _MAX_CHANGE / size)
            state = motion.restart_attitude(state)
            continue
        # Away by twice the distance of the unstable equilibrium, and by a hundredth of a radian at least.
        state[coordinates] += change * (min(max(2 * size, 0.01), _MAX_CHANGE) / np.abs(change).max())
        state = motion.restart_attitude(state)
    raise ArgumentError("equilibrium", "a stable equilibrium near the state", f"none near psi_0 = {start:g}")


def _growing_direction(motion: RobotMotion, t: float, state: Array, *, is_planar: bool) -> Array | None:
    """Return the direction of the state in which small motions grow fastest, or None if none grow."""
    A, _ = _state_derivatives(motion, t, state, np.arange(len(state)), is_planar=is_planar)
    poles, directions = np.linalg.eig(A)
    fastest = int(np.argmax(poles.real))
    # Double zeros, drifts of the whole pair, come out as roots of the rounding error of the differences.
    if poles[fastest].real <= 1e-4 * np.abs(poles).max(initial=0.0):
        return None
    return np.asarray(directions[:, fastest].real, np.float64)
