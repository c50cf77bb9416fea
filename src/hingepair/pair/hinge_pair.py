"""The pair: two bodies, where the hinge sits in each, and its axis."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.evaluation.backend import choose
from hingepair.numeric.arrays import FloatArray, number_not_below_0, one_constant
from hingepair.pair import dynamics
from hingepair.pair import forward_kinematics as kinematics
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import Constants, pair_constants
from hingepair.pair.dynamics import Accelerations, Energy, Forces, HingeWrench, Momentum
from hingepair.pair.evaluate import Out, Outputs
from hingepair.pair.states import PairState

if TYPE_CHECKING:
    from hingepair.pair import constraints, jacobians, residuals, sensitivities
    from hingepair.pair.body import Body
    from hingepair.pair.planar_pair import PlanarPair


class _MethodOf:
    """A method that is a function of the same name in another module, imported when it is first asked for."""

    def __init__(self, module: str) -> None:
        self.module = module

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, pair: HingePair | None, owner: type) -> Any:
        function = getattr(import_module(f"hingepair.{self.module}"), self.name)
        setattr(HingePair, self.name, function)
        return getattr(owner if pair is None else pair, self.name)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class HingePair:
    """Two rigid bodies joined by a hinge: R1 + S1 u1 = R2 + S2 u2 (E1), turning apart about n only (E2).

    Values are copied in and read-only; `dataclasses.replace(pair, u1=...)` gives a pair with another u1. u1, u2, n
    and home may carry leading axes that broadcast against the samples: then each sample has a pair of its own.

    Args:
        u1: hinge point from body 1's reference point, body-1 axes [m]; shape (3,) or (..., 3).
        u2: hinge point from body 2's reference point, body-2 axes [m]; shape (3,) or (..., 3).
        n: hinge axis, body-1 axes; any non-zero length; kept at unit length.
        home: rotation of body 2 relative to body 1 at psi = 0 (C in E5); identity unless given; shape (3, 3).
        name: what the pair is called in exports and messages.
        limits: least and greatest hinge angle, for exports [rad]; shape (2,); forward_kinematics takes any angle.
        body1: mass properties and shapes of body 1, for exports.
        body2: those of body 2.
        torque_limit: the largest torque of the hinge's motor, for exports [N m]; URDF calls it effort.
        rate_limit: the largest hinge rate, for exports [rad/s]; URDF calls it velocity.
        constants: for `dataclasses.replace`: what the pair before was made of, n as it was given there included, so
            that what is not replaced keeps its last bits.

    Raises:
        ArgumentError: a value is not finite or has the wrong shape; names the argument.
        AxisError: n is zero.
        RotationError: home is further from a rotation than 1e-9.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 2))
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
    limits: tuple[float, float] | None
    body1: Body | None
    body2: Body | None
    torque_limit: float | None
    rate_limit: float | None
    constants: Constants

    def __init__(
        self,
        u1: ArrayLike,
        u2: ArrayLike,
        n: ArrayLike,
        home: ArrayLike | None = None,
        name: str = "hinge_pair",
        limits: ArrayLike | None = None,
        body1: Body | None = None,
        body2: Body | None = None,
        torque_limit: float | None = None,
        rate_limit: float | None = None,
        *,
        constants: Constants | None = None,
    ) -> None:
        if not isinstance(name, str) or not name.strip():
            raise ArgumentError("name", "a text that is not empty", quoted(name))
        axis = constants.axis if constants is not None and n is constants.arrays["n"] else n
        own = pair_constants(u1, u2, n if axis is None else axis, home)
        rotation = own.arrays["home"]
        most = {"torque_limit": torque_limit, "rate_limit": rate_limit}
        values_of = {
            **{key: own.arrays[key] for key in ("u1", "u2", "n")},
            "home": rotation.reshape(*rotation.shape[:-1], 3, 3),
            "name": name,
            "limits": _checked_limits(limits),
            "body1": _checked_body("body1", body1),
            "body2": _checked_body("body2", body2),
            **{key: None if value is None else number_not_below_0(key, value) for key, value in most.items()},
            "constants": own,
        }
        for key, value in values_of.items():
            object.__setattr__(self, key, value)

    def __reduce__(self) -> tuple[Any, ...]:
        given = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "constants"}
        return partial(type(self), **given | {"n": self.constants.axis}), ()

    def __repr__(self) -> str:
        parts = (f"{key}={getattr(self, key).tolist()}" for key in ("u1", "u2", "n", "home"))
        given = ((key, getattr(self, key)) for key in ("limits", "torque_limit", "rate_limit", "body1", "body2"))
        extras = "".join(f", {key}={value!r}" for key, value in given if value is not None)
        return f"HingePair({', '.join(parts)}, name={self.name!r}{extras})"

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

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> state = pair.forward_kinematics(np.zeros((5, 7)), np.ones((5, 7)))
        >>> state.v2[0]
        array([ 1.,  4., -1.])
        """
        how = choose(backend, workers)
        return kinematics.from_coordinates(self.constants, q, qd, qdd, outputs, out, sequence, how)

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

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.forward_kinematics_from_body1(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).R2
        array([2., 0., 0.])
        """
        how = choose(backend, workers)
        return kinematics.from_body1(self.constants, body1, psi, psid, psidd, outputs, out, how)

    def mass_matrix(self, body1: BodyMotion, psi: ArrayLike) -> FloatArray:
        """The mass matrix M of M (a1, alpha1, psi'') + bias = (force1, torque1, hinge_torque) (D6).

        Args:
            body1: the motion of body 1; of it, S is used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1.

        Returns:
            M, symmetric, in world axes and about R1 [kg, kg m, kg m^2]; shape (..., 7, 7).

        Raises:
            ArgumentError: an argument cannot be used, or a body of the pair has no mass properties; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=hp.Body(mass=2), body2=hp.Body(mass=3))
        >>> pair.mass_matrix(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).diagonal().round(12).tolist()
        [5.0, 5.0, 5.0, 0.05, 12.05, 12.05, 3.03]
        """
        return dynamics.mass_matrix(self.constants, (self.body1, self.body2), body1, psi)

    def inverse_dynamics(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        psidd: ArrayLike,
        gravity: ArrayLike = dynamics.GRAVITY,
    ) -> Forces:
        """What must act on body 1 and at the hinge for the pair to move as it does (D1-D5).

        Args:
            body1: the motion of body 1; of it, S, omega, a and alpha are used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1.
            psid: its time derivative [rad/s]; likewise.
            psidd: its second time derivative [rad/s^2]; likewise.
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).

        Returns:
            force1, torque1 about R1, and hinge_torque.

        Raises:
            ArgumentError: an argument cannot be used, or a body of the pair has no mass properties; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body1=hp.Body(mass=2), body2=hp.Body(mass=3))
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0), a=(0, 0, 0), alpha=(0, 0, 0))
        >>> forces = pair.inverse_dynamics(still, psi=0.0, psid=0.0, psidd=0.0)
        >>> forces.force1.round(9).tolist(), forces.hinge_torque.round(9).tolist()
        ([0.0, 0.0, 49.05], -29.43)
        """
        bodies = (self.body1, self.body2)
        return dynamics.inverse_dynamics(self.constants, bodies, body1, psi, psid, psidd, gravity)

    def forward_dynamics(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        *,
        force1: ArrayLike = 0,
        torque1: ArrayLike = 0,
        hinge_torque: ArrayLike = 0.0,
        force2: ArrayLike = 0,
        torque2: ArrayLike = 0,
        gravity: ArrayLike = dynamics.GRAVITY,
    ) -> Accelerations:
        """How the pair moves under what acts on it (D6).

        Args:
            body1: the motion of body 1; of it, S and omega are used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1.
            psid: its time derivative [rad/s]; likewise.
            force1: on body 1 at R1, world axes [N]; shape (..., 3), or the number 0.
            torque1: on body 1, world axes [N m]; likewise.
            hinge_torque: of body 1 on body 2 about the hinge axis [N m]; shape (...,).
            force2: on body 2 at R2, world axes [N]; as force1.
            torque2: on body 2, world axes [N m]; likewise.
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).

        Returns:
            a1, alpha1 and psidd.

        Raises:
            ArgumentError: an argument cannot be used, a body of the pair has no mass properties, or those leave a
                motion without resistance; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body1=hp.Body(mass=2), body2=hp.Body(mass=3))
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> found = pair.forward_dynamics(still, psi=0.3, psid=0.0)  # nothing acts but gravity: both bodies fall
        >>> found.a1.round(9).tolist(), abs(round(float(found.psidd), 9))
        ([0.0, 0.0, -9.81], 0.0)
        """
        loads = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
        bodies = (self.body1, self.body2)
        return dynamics.forward_dynamics(self.constants, bodies, body1, psi, psid, loads, hinge_torque, gravity)

    def hinge_wrench(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        psidd: ArrayLike,
        gravity: ArrayLike = dynamics.GRAVITY,
    ) -> HingeWrench:
        """What body 1 exerts on body 2 at the hinge point (D3, D4); body 2 alone needs mass properties.

        Args:
            body1: the motion of body 1; of it, S, omega, a and alpha are used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1.
            psid: its time derivative [rad/s]; likewise.
            psidd: its second time derivative [rad/s^2]; likewise.
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).

        Returns:
            force, torque about the hinge point, and the torque's two parts: hinge_torque, bearing_torque.

        Raises:
            ArgumentError: an argument cannot be used, or body 2 has no mass properties; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body2=hp.Body(mass=3))
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0), a=(0, 0, 0), alpha=(0, 0, 0))
        >>> pair.hinge_wrench(still, psi=0.0, psid=0.0, psidd=0.0).force.round(9).tolist()
        [0.0, 0.0, 29.43]
        """
        bodies = (self.body1, self.body2)
        return dynamics.hinge_wrench(self.constants, bodies, body1, psi, psid, psidd, gravity)

    def energy(
        self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike, gravity: ArrayLike = dynamics.GRAVITY
    ) -> Energy:
        """Kinetic and potential energy of the pair (D7).

        Args:
            body1: the motion of body 1; of it, R, S, v and omega are used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1.
            psid: its time derivative [rad/s]; likewise.
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).

        Returns:
            kinetic and potential.

        Raises:
            ArgumentError: an argument cannot be used, or a body of the pair has no mass properties; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=hp.Body(mass=2), body2=hp.Body(mass=3))
        >>> body1 = hp.BodyMotion(R=(0, 0, 2), S=np.eye(3), v=(1, 0, 0), omega=(0, 0, 0))
        >>> [round(float(part), 9) for part in pair.energy(body1, psi=0.0, psid=0.0)]
        [2.5, 98.1]
        """
        return dynamics.energy(self.constants, (self.body1, self.body2), body1, psi, psid, gravity)

    def momentum(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> Momentum:
        """Linear momentum of the pair, and angular momentum about the world's origin (D8).

        Args:
            body1: the motion of body 1; of it, R, S, v and omega are used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1.
            psid: its time derivative [rad/s]; likewise.

        Returns:
            linear and angular.

        Raises:
            ArgumentError: an argument cannot be used, or a body of the pair has no mass properties; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=hp.Body(mass=2), body2=hp.Body(mass=3))
        >>> body1 = hp.BodyMotion(R=(0, 0, 2), S=np.eye(3), v=(1, 0, 0), omega=(0, 0, 0))
        >>> pair.momentum(body1, psi=0.0, psid=0.0).linear.tolist()
        [5.0, 0.0, 0.0]
        """
        return dynamics.momentum(self.constants, (self.body1, self.body2), body1, psi, psid)

    # Not loaded by `import hingepair`; a type checker sees the functions themselves.
    if TYPE_CHECKING:
        residuals = residuals.residuals
        jacobian = jacobians.jacobian
        acceleration_bias = jacobians.acceleration_bias
        coordinate_jacobian = jacobians.coordinate_jacobian
        coordinate_jacobian_rate = jacobians.coordinate_jacobian_rate
        sensitivities = sensitivities.sensitivities
        constraint_jacobian = constraints.constraint_jacobian
        constraint_bias = constraints.constraint_bias
    else:
        residuals = _MethodOf("pair.residuals")
        jacobian = _MethodOf("pair.jacobians")
        acceleration_bias = _MethodOf("pair.jacobians")
        coordinate_jacobian = _MethodOf("pair.jacobians")
        coordinate_jacobian_rate = _MethodOf("pair.jacobians")
        sensitivities = _MethodOf("pair.sensitivities")
        constraint_jacobian = _MethodOf("pair.constraints")
        constraint_bias = _MethodOf("pair.constraints")


def _checked_limits(limits: ArrayLike | None) -> tuple[float, float] | None:
    if limits is None:
        return None
    both = one_constant("limits", limits, 2)
    if not both[0] < both[1]:
        raise ArgumentError("limits", "(lower, upper) with lower < upper", limits)
    return float(both[0]), float(both[1])


def _checked_body(name: str, body: Body | None) -> Body | None:
    if body is None:
        return None
    from hingepair.pair.body import Body

    if not isinstance(body, Body):
        raise ArgumentError(name, "a Body", quoted(body))
    return body


def check_pair(pair: object) -> None:
    """Refuse what is no pair.

    Raises:
        ArgumentError: names the argument `pair`.
    """
    if not all(hasattr(pair, name) for name in ("u1", "u2", "n", "home", "forward_kinematics")):
        raise ArgumentError("pair", "a HingePair", quoted(pair))


def check_one(pair: HingePair | PlanarPair) -> None:
    """Refuse a pair that differs from sample to sample.

    Raises:
        ShapeError: u1, u2, n or home have leading axes.
    """
    if not pair.constants.single:
        expected = f"one pair, such as {type(pair).__name__}(u1[i], ...)"
        raise ShapeError("pair", expected, f"pairs of shape {pair.constants.shape}")
