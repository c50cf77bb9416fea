"""Euler angles (E4, E10): the 24 sequences, each as the equations of one canonical sequence with its axes renamed.

Angles stand in the order of the sequence's letters, as SciPy writes them: upper case turns about the body's own
axes (intrinsic), lower case about the world's (extrinsic). "XYZ" is E10.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair import equations as eq
from hingepair.arrays import FloatArray, broadcast_shape, check_choice, result_dtype, vectors
from hingepair.blocks import Values, angle_terms, components_of, compute, evaluate
from hingepair.errors import ArgumentError, GimbalLockError
from hingepair.rotations import check_rotation

LOCK = 1e-12
"""Nearer gimbal lock than this (abs(cos phi_y) or abs(sin phi_y)), fewer than four digits of the rates are left."""

_INTRINSIC = tuple(
    "".join(letters) for letters in itertools.product("XYZ", repeat=3) if letters[0] != letters[1] != letters[2]
)
SEQUENCES = (*_INTRINSIC, *(name.lower() for name in _INTRINSIC))

AnglesAndLock: TypeAlias = tuple[FloatArray, NDArray[np.bool_]]

_UNITS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Sequence:
    """One Euler sequence as a renaming of Sx Sy Sz or Sx Sy Sx.

    An extrinsic sequence is the intrinsic one with letters and angles reversed. Renaming the axes keeps the
    equations, but for the sign of every angle where the renaming changes the handedness.

    Attributes:
        name: the three letters.
        proper: the first axis comes back as the third (Sx Sy Sx).
        backward: the angles are taken in reverse order.
        place: for world axis i, its canonical axis.
        sign: of the canonical angles, +1 or -1.
    """

    name: str
    proper: bool
    backward: bool
    place: tuple[int, int, int]
    sign: int

    def angles(self, phi: eq.Vector) -> eq.Vector:
        """The canonical angles (or their rates) of angles (or rates) in the order of the letters, and back."""
        x, y, z = phi
        if self.backward:
            x, z = z, x
        return (x, y, z) if self.sign > 0 else (-x, -y, -z)

    def attitude(self, trig: tuple[Any, ...]) -> eq.Matrix:
        """S of the sines and cosines of the canonical angles (E10)."""
        S = eq.proper_euler_attitude(trig) if self.proper else eq.tait_bryan_attitude(trig)
        return _nine(S[3 * i + j] for i in self.place for j in self.place)

    def axes(self, trig: tuple[Any, ...]) -> tuple[Any, ...]:
        """The columns of the canonical J (E4)."""
        return eq.proper_euler_axes(trig) if self.proper else eq.tait_bryan_axes(trig)

    def angular_velocity(self, axes: tuple[Any, ...], phid: eq.Vector) -> eq.Vector:
        """Omega = J phi' (E4), of the canonical columns of J and the rates in the order of the letters."""
        return self.vector(eq.angular_velocity1(axes, self.angles(phid)))

    def angular_acceleration(self, axes: tuple[Any, ...], phid: eq.Vector, phidd: eq.Vector) -> eq.Vector:
        """Alpha = J phi'' + J' phi' (E4 differentiated), likewise."""
        return self.vector(eq.angular_acceleration1(axes, self.angles(phid), self.angles(phidd)))

    def vector(self, canonical: eq.Vector) -> eq.Vector:
        """An angular velocity or acceleration in world axes, from canonical axes."""
        x, y, z = (canonical[i] for i in self.place)
        return (x, y, z) if self.sign > 0 else (-x, -y, -z)


def find_sequence(name: str) -> Sequence:
    """The sequence of this name.

    Raises:
        ArgumentError: no such sequence.

    >>> find_sequence("zyx").backward
    True
    """
    if not isinstance(name, str):
        raise ArgumentError("sequence", "three letters such as 'XYZ' or 'zyx'", name)
    return _sequence(name)


@functools.cache
def _sequence(name: str) -> Sequence:
    check_choice("sequence", name, SEQUENCES)
    letters = name.upper()[::-1] if name.islower() else name
    axes = ["XYZ".index(letter) for letter in letters]
    proper = axes[0] == axes[2]
    if proper:
        axes[2] = 3 - axes[0] - axes[1]
    sign = 1 if (axes[1] - axes[0]) % 3 == 1 else -1
    place = (axes.index(0), axes.index(1), axes.index(2))
    return Sequence(name, proper, name.islower(), place, sign)


def euler_to_matrix(phi: ArrayLike, sequence: str = "XYZ") -> FloatArray:
    """Rotation matrices of Euler angles (E10), to 6 u in every component.

    Args:
        phi: angles in the order of the sequence's letters [rad]; shape (..., 3).
        sequence: one of 24; upper case intrinsic, lower case extrinsic.

    Returns:
        S, body to world; shape (..., 3, 3).

    Raises:
        ArgumentError: phi or sequence cannot be used.

    >>> euler_to_matrix((0, 0, np.pi / 2)).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    order = find_sequence(sequence)
    angles = vectors("phi", phi, 3)

    def attitude(values: Values) -> eq.Matrix:
        return order.attitude(angle_terms(order.angles(values["phi"])))

    return evaluate(attitude, {"phi": components_of(angles)}, (3, 3), result_dtype((angles,)))


@overload
def matrix_to_euler(S: ArrayLike, sequence: str = "XYZ", *, with_lock: Literal[False] = False) -> FloatArray: ...


@overload
def matrix_to_euler(S: ArrayLike, sequence: str = "XYZ", *, with_lock: Literal[True]) -> AnglesAndLock: ...


def matrix_to_euler(S: ArrayLike, sequence: str = "XYZ", *, with_lock: bool = False) -> FloatArray | AnglesAndLock:
    """Euler angles of rotation matrices (E10 solved for phi).

    The middle angle lies in [-pi/2, pi/2], or in [0, pi] where the first axis comes back; the others in [-pi, pi].
    The angles give S back to 6 u, at gimbal lock too, where only a sum or difference of the outer two is defined.

    Args:
        S: body to world; shape (..., 3, 3).
        sequence: one of 24; upper case intrinsic, lower case extrinsic.
        with_lock: also return where gimbal lock is, by the measure of `euler_rates`.

    Returns:
        Angles in the order of the letters [rad]; shape (..., 3). With `with_lock`: (angles, locked); shape (...,).

    Raises:
        RotationError: a finite S is no rotation.

    >>> phi, locked = matrix_to_euler([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], with_lock=True)
    >>> phi.round(6) + 0.0, bool(locked)
    (array([0.      , 1.570796, 0.      ]), True)
    """
    order = find_sequence(sequence)
    matrix = vectors("S", S, 3, 3)
    check_rotation("S", matrix)
    back = [order.place.index(i) for i in range(3)]

    def angles(values: Values) -> Values:
        canonical = _nine(values["S"][3 * i + j] for i in back for j in back)
        phi = order.angles(_canonical_angles(order, canonical))
        opening = (canonical[3], canonical[6]) if order.proper else (canonical[5], canonical[8])
        return {"phi": phi, "lock": np.hypot(*opening)}

    dtype, shape = result_dtype((matrix,)), matrix.shape[:-2]
    out = {"phi": np.empty((*shape, 3), dtype), "lock": np.empty(shape, dtype)}
    compute(angles, {"S": components_of(matrix, 2)}, out, shape, dtype)
    return (out["phi"], np.asarray(out["lock"] < LOCK)) if with_lock else out["phi"]


def euler_rate_matrix(phi: ArrayLike, sequence: str = "XYZ") -> FloatArray:
    """The matrix J of omega = J phi' (E4), omega in world axes.

    Args:
        phi: angles in the order of the sequence's letters [rad]; shape (..., 3).
        sequence: one of 24; upper case intrinsic, lower case extrinsic.

    Returns:
        J; shape (..., 3, 3).

    >>> euler_rate_matrix((0, 0, 0)).round(12) + 0.0
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 1.]])
    """
    order = find_sequence(sequence)
    angles = vectors("phi", phi, 3)

    def rate_matrix(values: Values) -> eq.Matrix:
        axes = order.axes(angle_terms(order.angles(values["phi"])))
        x, y, z = (order.angular_velocity(axes, unit) for unit in _UNITS)
        return eq.transpose((*x, *y, *z))

    return evaluate(rate_matrix, {"phi": components_of(angles)}, (3, 3), result_dtype((angles,)))


def euler_rates(phi: ArrayLike, omega: ArrayLike, sequence: str = "XYZ", *, at_lock: str = "raise") -> FloatArray:
    """Euler-angle rates of an angular velocity: phi' = J^-1 omega (E4).

    Args:
        phi: angles in the order of the sequence's letters [rad]; shape (..., 3).
        omega: angular velocity, world axes [rad/s]; shape (..., 3).
        sequence: one of 24; upper case intrinsic, lower case extrinsic.
        at_lock: at gimbal lock (cos phi_y, or sin phi_y where the first axis comes back, below 1e-12), "raise", or
            give the "least_squares" rates: the smallest phi' whose J phi' is nearest to omega.

    Returns:
        phi'; shape (..., 3).

    Raises:
        GimbalLockError: J has no inverse at some sample, and at_lock is "raise".

    >>> euler_rates((0, np.pi / 2, 0), (1, 0, 0), at_lock="least_squares").round(6) + 0.0
    array([0.5, 0. , 0.5])
    """
    check_choice("at_lock", at_lock, ("raise", "least_squares"))
    order = find_sequence(sequence)
    angles, velocity = vectors("phi", phi, 3), vectors("omega", omega, 3)
    shape = broadcast_shape({"phi": angles.shape[:-1], "omega": velocity.shape[:-1]})
    dtype = result_dtype((angles, velocity))
    out = {"phid": np.empty((*shape, 3), dtype), "lock": np.empty(shape, dtype)}

    def rates(values: Values) -> Values:
        trig = angle_terms(order.angles(values["phi"]))
        phid = order.angles(_canonical_rates(order, trig, values["omega"]))
        return {"phid": phid, "lock": trig[2] if order.proper else trig[3]}

    compute(rates, {"phi": components_of(angles), "omega": components_of(velocity)}, out, shape, dtype)
    locked = np.abs(out["lock"]) < LOCK
    if locked.any():
        if at_lock == "raise":
            first = np.unravel_index(int(np.argmax(locked)), shape)
            where = f" at sample {tuple(map(int, first))}" if shape else ""
            raise GimbalLockError(
                "phi", "angles away from gimbal lock, or at_lock='least_squares'", f"lock of {sequence}{where}"
            )
        J = euler_rate_matrix(np.broadcast_to(angles, (*shape, 3))[locked], sequence).astype(np.float64)
        given = np.broadcast_to(velocity, (*shape, 3))[locked]
        out["phid"][locked] = (np.linalg.pinv(J, rcond=1e-9) @ given[..., None])[..., 0]
    return out["phid"]


def _canonical_rates(order: Sequence, trig: tuple[Any, ...], omega: eq.Vector) -> eq.Vector:
    """J^-1 omega in canonical angles: the part along b gives phi_y', the rest phi_z', then phi_x'."""
    by, bz, cx, _, _ = order.axes(trig)
    x, y, z = (omega[order.place.index(i)] for i in range(3))
    if order.sign < 0:
        x, y, z = -x, -y, -z
    second = by * y + bz * z
    across = by * z - bz * y
    third = -np.divide(across, trig[2]) if order.proper else np.divide(across, trig[3])
    return x - cx * third, second, third


def _canonical_angles(order: Sequence, S: eq.Matrix) -> eq.Vector:
    """Angles of Sx Sy Sz or Sx Sy Sx: the outer first angle, then the others with it turned back out of S.

    Of the two first angles of Sx Sy Sx, half a turn apart, the sign of the sequence picks the one that makes the
    middle angle positive in the order of the letters.
    """
    opposite, adjacent = (order.sign * S[3], -order.sign * S[6]) if order.proper else (-S[5], S[8])
    first = np.arctan2(opposite, adjacent + 0.0)  # of zeros of any sign: 0
    s, c = np.sin(first), np.cos(first)
    level = c * S[3] + s * S[6], c * S[4] + s * S[7], c * S[5] + s * S[8]
    if order.proper:
        return first, np.arctan2(s * S[3] - c * S[6], S[0]), np.arctan2(-level[2], level[1])
    return first, np.arctan2(S[2], c * S[8] - s * S[5]), np.arctan2(level[0], level[1])


def _nine(entries: Any) -> eq.Matrix:
    a, b, c, d, e, f, g, h, i = entries
    return a, b, c, d, e, f, g, h, i
