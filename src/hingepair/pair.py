"""The pair: two bodies, where the hinge sits in each, and its axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair import constraints, jacobian, kinematics, residuals
from hingepair.arrays import FloatArray, broadcast_shape, constant, read_only
from hingepair.backend import choose
from hingepair.blocks import components_of, numbers
from hingepair.errors import ArgumentError
from hingepair.evaluate import Constants, Out, Outputs
from hingepair.lengths import unit_axis
from hingepair.motion import BodyMotion
from hingepair.residual_report import Residuals
from hingepair.rotations import check_rotation
from hingepair.state import PairState


@dataclass(frozen=True, slots=True, eq=False, init=False)
class HingePair:
    """Two rigid bodies joined by a hinge: R1 + S1 u1 = R2 + S2 u2 (E1), turning apart about n only (E2).

    Values are copied in and read-only. u1, u2, n and home may carry leading axes that broadcast against the
    samples: then each sample has a pair of its own.

    Args:
        u1: hinge point from body 1's reference point, body-1 axes [m]; shape (3,) or (..., 3).
        u2: hinge point from body 2's reference point, body-2 axes [m]; shape (3,) or (..., 3).
        n: hinge axis, body-1 axes; any non-zero length; kept at unit length.
        home: rotation of body 2 relative to body 1 at psi = 0 (C in E5); identity unless given; shape (3, 3).
        name: what the pair is called in exports and messages.

    Raises:
        ArgumentError: a value is not finite or has the wrong shape; names the argument.
        AxisError: n is zero.
        RotationError: home is further from a rotation than 1e-9.

    >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 2))
    >>> pair.n
    array([0., 0., 1.])
    >>> pair.forward_kinematics((0, 0, 0, 0, 0, 0, np.pi)).R2.round(12) + 0.0
    array([0., 0., 0.])
    """

    u1: NDArray[np.float64]
    u2: NDArray[np.float64]
    n: NDArray[np.float64]
    home: NDArray[np.float64]
    name: str
    _constants: Constants

    def __init__(
        self, u1: ArrayLike, u2: ArrayLike, n: ArrayLike, home: ArrayLike | None = None, name: str = "hinge_pair"
    ) -> None:
        if not isinstance(name, str) or not name.strip():
            raise ArgumentError("name", "a text that is not empty", repr(name))
        rotation = constant("home", np.eye(3) if home is None else home, 3, 3)
        check_rotation("home", rotation)
        vectors = {"u1": constant("u1", u1, 3), "u2": constant("u2", u2, 3), "n": read_only(unit_axis("n", n))}
        shapes = {**{key: v.shape[:-1] for key, v in vectors.items()}, "home": rotation.shape[:-2]}
        values = {key: numbers(components_of(vector)) for key, vector in vectors.items()}
        if not np.array_equal(rotation, np.broadcast_to(np.eye(3), rotation.shape)):
            values["home"] = numbers(components_of(rotation, 2))
        arrays = {**vectors, "home": rotation.reshape(*rotation.shape[:-2], 9)}
        constants = Constants(values, arrays, broadcast_shape(shapes))
        for key, value in {**vectors, "home": rotation, "name": name, "_constants": constants}.items():
            object.__setattr__(self, key, value)

    def __repr__(self) -> str:
        parts = (f"{key}={getattr(self, key).tolist()}" for key in ("u1", "u2", "n", "home"))
        return f"HingePair({', '.join(parts)}, name={self.name!r})"

    def forward_kinematics(
        self,
        q: ArrayLike | tuple[Any, ...],
        qd: ArrayLike | tuple[Any, ...] | None = None,
        qdd: ArrayLike | tuple[Any, ...] | None = None,
        *,
        outputs: Outputs = None,
        out: Out = None,
        sequence: str = "XYZ",
        workers: int = 1,
        backend: str = "auto",
    ) -> PairState:
        """Body 2 from the seven coordinates q = (x, y, z, phi_x, phi_y, phi_z, psi) (E1-E10).

        The level follows the inputs: q alone gives the pose, qd adds velocities, qdd accelerations.

        Args:
            q: coordinates [m, rad]; one array of shape (..., 7), or a tuple of seven that broadcast, in which
                scalars are known constants.
            qd: their time derivatives, in the same form.
            qdd: their second time derivatives, in the same form.
            outputs: names out of R2, S2, d, v2, omega2, a2, alpha2, R1, S1, v1, omega1, a1, alpha1: exactly these
                are computed. Unless given, all of body 2 that the inputs allow.
            out: arrays by output name, written in place; of the samples' shape and the dtype computed in.
            sequence: the Euler sequence of body 1, one of 24 as SciPy writes them; phi_x, phi_y and phi_z are the
                angles of its first, second and third letter.
            workers: threads; -1 for one on every core.
            backend: "numpy", "numba" (compiled), or "auto": compiled where it pays (README, "Speed").

        Returns:
            The state. float32 where all arrays given are float32, else float64.

        Raises:
            ArgumentError: an argument cannot be used; names it.

        >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> state = pair.forward_kinematics(np.zeros((5, 7)), np.ones((5, 7)))
        >>> state.v2[0]
        array([ 1.,  4., -1.])
        """
        how = choose(backend, workers)
        return kinematics.from_coordinates(self._constants, q, qd, qdd, outputs, out, sequence, how)

    def forward_kinematics_from_body1(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike | None = None,
        psidd: ArrayLike | None = None,
        *,
        outputs: Outputs = None,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> PairState:
        """Body 2 from the motion of body 1 and the hinge angle (E1, E2, E5-E9): no Euler angles.

        Args:
            body1: the motion of body 1, with as many derivatives as the outputs need.
            psi: hinge angle, right hand about n [rad]; shape (...,), broadcasts against body1.
            psid: its time derivative [rad/s].
            psidd: its second time derivative [rad/s^2].
            outputs: as for forward_kinematics.
            out: as for forward_kinematics.
            workers: as for forward_kinematics.
            backend: as for forward_kinematics.

        Returns:
            The state; its level follows psi, psid, psidd.

        Raises:
            ArgumentError: an argument cannot be used, or body1 lacks what an output needs; names it.

        >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.forward_kinematics_from_body1(BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).R2
        array([2., 0., 0.])
        """
        how = choose(backend, workers)
        return kinematics.from_body1(self._constants, body1, psi, psid, psidd, outputs, out, how)

    def residuals(
        self, body1: BodyMotion, body2: BodyMotion, tolerances: Mapping[str, float] | None = None
    ) -> Residuals:
        """How far any two motions, measured ones included, are from this hinge (E1, E2 and their derivatives).

        Args:
            body1: the motion of body 1.
            body2: the motion of body 2. Rates are judged where both have omega (and v), accelerations where both
                also have alpha (and a).
            tolerances: largest size that passes, by residual: gap [m], tilt [rad], gap_rate [m/s], tilt_rate
                [rad/s], gap_acceleration [m/s^2], tilt_acceleration [rad/s^2]. Those not named: what round-off
                explains, 32 u times a scale that is printed.

        Returns:
            The residuals, psi with its derivatives, `.ok`, `.verdict`; str() is a table. Samples that are not finite
            are left out and counted.

        Raises:
            ArgumentError: an argument cannot be used; names it.

        >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body1, body2 = BodyMotion(R=(0, 0, 0), S=np.eye(3)), BodyMotion(R=(2, 0.001, 0), S=np.eye(3))
        >>> pair.residuals(body1, body2).verdict
        'FAILED: gap'
        >>> pair.residuals(body1, body2, tolerances={"gap": 0.01}).ok
        True
        """
        return residuals.residuals(self._constants, self.name, body1, body2, tolerances)

    def jacobian(self, body1: BodyMotion, psi: ArrayLike) -> FloatArray:
        """Body 2's velocity by the velocities of the equations: (v2, omega2) = Jac @ (v1, omega1, psi') (E8, E2).

        Args:
            body1: the motion of body 1; of it, S is used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1.

        Returns:
            Jac, world axes; shape (..., 6, 7).

        Raises:
            ArgumentError: an argument cannot be used; names it.

        >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.jacobian(BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0) @ (0, 0, 0, 0, 0, 1, 2)
        array([0., 4., 0., 0., 0., 3.])
        """
        return jacobian.jacobian(self._constants, body1, psi)

    def acceleration_bias(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> FloatArray:
        """What velocities alone add to body 2's acceleration: (a2, alpha2) = Jac @ (a1, alpha1, psi'') + bias (E9).

        Args:
            body1: the motion of body 1; of it, S and omega are used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1.
            psid: hinge rate [rad/s]; likewise.

        Returns:
            The bias, world axes; shape (..., 6).

        Raises:
            ArgumentError: an argument cannot be used, or body1 has no omega; names it.

        >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body1 = BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> pair.acceleration_bias(body1, 0.0, 2.0)
        array([-4.,  0.,  0.,  0.,  0.,  0.])
        """
        return jacobian.acceleration_bias(self._constants, body1, psi, psid)

    def coordinate_jacobian(self, q: ArrayLike | tuple[Any, ...], *, sequence: str = "XYZ") -> FloatArray:
        """Body 2's velocity by the rates of the seven coordinates: (v2, omega2) = Jq @ qd (E8, E2, E4).

        Args:
            q: coordinates [m, rad], in either form that forward_kinematics takes.
            sequence: the Euler sequence of body 1.

        Returns:
            Jq, world axes; shape (..., 6, 7).

        >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.coordinate_jacobian(np.zeros(7)) @ (0, 0, 0, 0, 0, 1, 2)
        array([0., 4., 0., 0., 0., 3.])
        """
        return jacobian.coordinate_jacobian(self._constants, q, sequence)

    def coordinate_jacobian_rate(
        self, q: ArrayLike | tuple[Any, ...], qd: ArrayLike | tuple[Any, ...], *, sequence: str = "XYZ"
    ) -> FloatArray:
        """The time derivative of coordinate_jacobian: (a2, alpha2) = Jq @ qdd + Jq' @ qd (E9).

        Args:
            q: coordinates [m, rad], in either form that forward_kinematics takes.
            qd: their time derivatives.
            sequence: the Euler sequence of body 1.

        Returns:
            Jq', world axes; shape (..., 6, 7).

        >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> qd = np.array((0, 0, 0, 0, 0, 0, 2.0))
        >>> pair.coordinate_jacobian_rate(np.zeros(7), qd) @ qd
        array([-4.,  0.,  0.,  0.,  0.,  0.])
        """
        return jacobian.coordinate_jacobian_rate(self._constants, q, qd, sequence)

    def constraint_jacobian(self, body1: BodyMotion, body2: BodyMotion) -> FloatArray:
        """The constraints' 5 x 12 Jacobian G, for solvers of differential-algebraic equations (E1, E2).

        The constraints are gap (E1, world axes) and tilt, the components of S1 n x S2 C^-1 n along S1 e1 and S1 e2,
        where e1 is the axis of body 1 furthest from n, made perpendicular to it, and e2 = n x e1. G is their exact
        derivative, on the constraint and off it: (gap', tilt') = G @ (v1, omega1, v2, omega2).

        Args:
            body1: the motion of body 1; of it, S is used.
            body2: the motion of body 2; likewise.

        Returns:
            G, world axes; shape (..., 5, 12).

        >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body = BodyMotion(R=(0, 0, 0), S=np.eye(3))
        >>> (pair.constraint_jacobian(body, body) @ (0, 0, 0, 0, 0, 1, 0, 4, 0, 0, 0, 3)).tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0]
        """
        return constraints.constraint_jacobian(self._constants, body1, body2)

    def constraint_bias(self, body1: BodyMotion, body2: BodyMotion) -> FloatArray:
        """What velocities alone add to the constraints' second derivative (E1, E2).

        (gap'', tilt'') = G @ (a1, alpha1, a2, alpha2) + bias, and zero for motions of the pair.

        Args:
            body1: the motion of body 1; of it, S and omega are used.
            body2: the motion of body 2; likewise.

        Returns:
            The bias, world axes; shape (..., 5).

        >>> pair = HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body1 = BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> body2 = BodyMotion(R=(2, 0, 0), S=np.eye(3), omega=(0, 0, 2))
        >>> pair.constraint_bias(body1, body2).tolist()
        [-4.0, 0.0, 0.0, 0.0, 0.0]
        """
        return constraints.constraint_bias(self._constants, body1, body2)


def check_pair(pair: object) -> None:
    """Refuse what is no pair.

    Raises:
        ArgumentError: names the argument `pair`.
    """
    if not all(hasattr(pair, name) for name in ("u1", "u2", "n", "home", "forward_kinematics")):
        raise ArgumentError("pair", "a HingePair", pair)
