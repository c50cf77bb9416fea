"""Small motions about a state: how a pair answers to small changes, its natural frequencies and its damping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.dynamics.bases import PairMotion
from hingepair.dynamics.collocation import Array
from hingepair.dynamics.loads import Base, Load, Loads
from hingepair.dynamics.simulate import in_space, start_of
from hingepair.dynamics.switches import HingeSwitches
from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import finite_number, read_only
from hingepair.numeric.tables import ruled_table
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.dynamics import GRAVITY
from hingepair.pair.hinge_load import HingeLoad, HingeTorque, is_named
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PLANAR_GRAVITY, PlanarPair

_NUDGE: Final = 1e-5  # of the size of each component: for differences of order 4
_STILL_POLE: Final = 1e-5  # of the largest pole: smaller ones are drifts of the whole pair, which nothing pulls back
_MAX_ROUNDS, _MAX_TURN = 200, 0.3  # of the search for an equilibrium; radians a round
_FOUND: Final = 1e-13  # rad: a smaller step ends the search

_VECTORS: Final = ("R", "P", "L", "phi")
_NAMES: Final = (*(f"{letter}_{axis}" for letter in _VECTORS for axis in "xyz"), "psi", "psid")


@dataclass(frozen=True, eq=False, repr=False)
class Linearization:
    """Small motions of a pair: x' = A x + B (hinge_torque), x small changes of the state; `print` it.

    Attributes:
        A: derivatives of the rates by the state; shape (k, k).
        B: derivatives of the rates by a torque at the hinge; shape (k,).
        names: what the state consists of: psi and psid; of a base that is free or pinned, before them the common
            centre of mass R (or R1, which a pin holds), momentum P, angular momentum L about it (R1), and small turns
            phi of body 1, all along world axes.
        psi: hinge angle [rad].
        body1: body 1 there; None of a base that moves as given.
        rates: the rates of the state there; 0 at an equilibrium; shape (k,).
        poles: eigenvalues of A that are not 0 [1/s], complex ones by the half with positive imaginary part; sorted.
        natural_frequencies: their sizes [rad/s].
        damping_ratios: of each: 0 without damping, 1 and above (real poles: 1) no swing, below 0 it grows.
    """

    A: Array
    B: Array
    names: tuple[str, ...]
    psi: float
    body1: BodyMotion | None
    rates: Array
    poles: NDArray[np.complex128]

    @property
    def natural_frequencies(self) -> Array:
        """The sizes of the poles [rad/s]."""
        return np.abs(self.poles)

    @property
    def damping_ratios(self) -> Array:
        """The cosines of the angles between the poles and the negative real axis."""
        return np.asarray(-self.poles.real / np.abs(self.poles), np.float64)

    def __str__(self) -> str:
        rows = [
            (f"{pole:.6g}", f"{size:.6g}", f"{size / (2 * np.pi):.6g}", f"{ratio:.4g}")
            for pole, size, ratio in zip(self.poles, self.natural_frequencies, self.damping_ratios, strict=True)
        ]
        head = f"small motions about psi = {self.psi:.6g} rad"
        table = ruled_table([("pole [1/s]", "natural frequency [rad/s]", "[Hz]", "damping ratio"), *rows])
        return "\n".join([head, *table])

    __repr__ = __str__


def linearize(
    pair: HingePair | PlanarPair,
    body1: BodyMotion | None,
    psi_0: float,
    psid_0: float = 0.0,
    *,
    hinge_torque: HingeTorque = 0.0,
    force1: Load = 0,
    torque1: Load = 0,
    force2: Load = 0,
    torque2: Load = 0,
    gravity: ArrayLike | None = None,
    base: Base = "free",
    t: float = 0.0,
    equilibrium: bool = False,
    backend: str = "auto",
) -> Linearization:
    """Compute how small changes of a state grow, swing and fade: natural frequencies and damping ratios.

    The arguments are those of `simulate`, at one instant. Derivatives are differences of order 4.

    Args:
        pair: a pair whose bodies have mass properties.
        body1: the state of body 1; None beside a base that moves.
        psi_0: hinge angle [rad].
        psid_0: hinge rate [rad/s].
        hinge_torque: at the hinge; friction that sticks has no linearization at rest: give it a friction_rate.
        force1: on body 1 at R1.
        torque1: on body 1.
        force2: on body 2 at R2.
        torque2: on body 2.
        gravity: acceleration of free fall.
        base: what holds body 1.
        t: instant at which loads and a moving base are asked [s].
        equilibrium: go from the state given, at rest, to where the loads pull it and keep it, and linearize there.
        backend: as for `forward_kinematics`.

    Raises:
        ArgumentError: an argument cannot be used, or there is no equilibrium near; names it.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> rod = hp.Body(mass=2, inertia=(0.01, 1, 1))
    >>> pair = hp.HingePair(u1=(0, 0, 0), u2=(-1, 0, 0), n=(0, 1, 0), body2=rod)
    >>> held, damper = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), hp.HingeLoad(damping=0.6)
    >>> small = hp.linearize(pair, held, 1.0, hinge_torque=damper, base="fixed", equilibrium=True)
    >>> round(small.psi, 6), small.natural_frequencies.round(4), small.damping_ratios.round(4)
    (1.570796, array([2.5573]), array([0.0391]))
    """
    space = in_space(pair)
    flat = space is not pair
    if gravity is None:
        gravity = PLANAR_GRAVITY if flat else GRAVITY
    forces = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
    if not callable(hinge_torque):
        hinge_torque = finite_number("hinge_torque", hinge_torque)
    load = hinge_torque if is_named(hinge_torque) else HingeLoad(motor=hinge_torque)
    start = start_of(base, body1, flat, finite_number("psi_0", psi_0), finite_number("psid_0", psid_0))
    if equilibrium and (start[2].any() or start[3].any() or start[5]):
        raise ArgumentError("psid_0, body1", "a state at rest, from which an equilibrium is sought", quoted(body1))
    motion = PairMotion(space, base, flat, start, Loads(forces, load, gravity, flat=flat), execution_of(backend, 1))
    HingeSwitches(motion, 0.0, 0.0, None)  # sets the side of each kink
    if motion.held:
        expected = "what has a linearization: friction that sticks (without friction_rate) or a stop holds the hinge"
        raise ArgumentError("hinge_torque", expected, quoted(hinge_torque))
    instant, state = finite_number("t", t), motion.state
    if equilibrium:
        state = _equilibrium(motion, instant, state, flat=flat)
    A, rates = _derivatives(motion, instant, state, np.arange(len(state)))
    B = np.zeros(len(state))
    B[-1] = motion.hinge_response(instant, state)
    poles = np.linalg.eigvals(A)
    poles = poles[(np.abs(poles) > _STILL_POLE * np.abs(poles).max(initial=0.0)) & (poles.imag >= 0)]
    now = motion.moving(np.full(1, instant), state[None])
    at = None if callable(base) else BodyMotion(R=now.R1[0], S=now.S1[0], v=now.v1[0], omega=now.omega1[0])
    return Linearization(
        read_only(A),
        read_only(B),
        _NAMES[-len(state) :],
        float(state[motion.angle]),
        at,
        read_only(rates),
        read_only(poles[np.argsort(np.abs(poles))].astype(np.complex128)),
    )


def _derivatives(motion: PairMotion, t: float, state: Array, columns: NDArray[np.intp]) -> tuple[Array, Array]:
    """Compute the derivatives of the rates of a state by some of its components, (k, m), and the rates, (k,)."""
    nudges = np.zeros((len(columns), len(state)))
    nudges[np.arange(len(columns)), columns] = (_NUDGE * motion.sizes)[columns]
    states = np.concatenate([state + share * nudges for share in (-2, -1, 1, 2)] + [state[None]])
    rates = motion.rates(np.full(len(states), t), states)
    before2, before, after, after2 = rates[:-1].reshape(4, len(columns), -1)
    slopes = (8 * (after - before) - (after2 - before2)) / (12 * nudges[np.arange(len(columns)), columns])[:, None]
    return slopes.T, rates[-1]


def _equilibrium(motion: PairMotion, t: float, state: Array, *, flat: bool) -> Array:
    """Return the state at rest to which the loads pull, from a state at rest, by Newton's method.

    Raises:
        ArgumentError: there is none near.
    """
    turns = {1: [], 13: [11] if flat else [9, 10, 11]}[len(state) - 1]
    free = np.array([*turns, motion.angle])
    for _ in range(_MAX_ROUNDS):
        slopes, rates = _derivatives(motion, t, state, free)
        moving = np.flatnonzero(motion.speeds)
        pull = rates[moving] / motion.sizes[moving]
        own = rates[[*(column - 3 for column in turns), motion.angle + 1]]  # torques on what each coordinate turns
        change = np.linalg.lstsq(slopes[moving] / motion.sizes[moving, None], -pull, rcond=1e-9)[0]
        size = float(np.abs(change).max())
        if size <= _FOUND and np.abs(pull).max() <= 1e-9 * max(1.0, float(np.abs(slopes[moving]).max())):
            return state
        if own @ change < 0 or not size:  # towards where the loads would push it away from
            change, size = own, float(np.abs(own).max())
        state = state.copy()
        state[free] += change * min(1.0, _MAX_TURN / size)
        state = motion.renew(state)
    raise ArgumentError(
        "equilibrium", "a state near to which the loads pull the pair", f"none from psi_0 = {state[-2]:g}"
    )
