"""The pair: two bodies, where the hinge sits in each, and its axis."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import execution_of
from hingepair.engine.calls import Out
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import FloatArray, number_not_below_0, one_constant
from hingepair.numeric.dask_arrays import apply_to_chunks, holds_dask
from hingepair.numeric.tables import Sheet, Shown, sheet_of
from hingepair.pair import accuracy, derivatives, dynamics, residuals, tolerances
from hingepair.pair import forward_kinematics as kinematics
from hingepair.pair.body import Body
from hingepair.pair.body_motion import MOTION_SAMPLE_SHAPES, BodyMotion
from hingepair.pair.constants import Constants, check_single_pair, pair_constants
from hingepair.pair.derivatives import Sensitivities
from hingepair.pair.dynamics import Accelerations, Energy, Forces, HingeWrench, Momentum
from hingepair.pair.forward_kinematics import CoordinateInput, Outputs
from hingepair.pair.prepare import Prepared, prepare
from hingepair.pair.residuals import Residuals
from hingepair.pair.states import PairState
from hingepair.pair.tolerances import PoseCovariance
from hingepair.plans.plan import SPATIAL_MOTION

Returned = TypeVar("Returned")

SAMPLE_SHAPE_BY_ARGUMENT: Final = {**SPATIAL_MOTION.shapes, **dict.fromkeys(("body1", "body2"), MOTION_SAMPLE_SHAPES)}
"""Shape of one sample of each argument that may be a Dask array."""


@dataclass(frozen=True, slots=True, eq=False, init=False)
class HingePair(Shown):
    """Two rigid bodies joined by a hinge: R1 + S1 u1 = R2 + S2 u2 (E1), turning apart about n only (E2).

    Values are copied in and read-only; `dataclasses.replace(pair, u1=...)` gives a pair with another u1. u1, u2, n
    and home may carry leading axes that broadcast against the samples: then each sample has a pair of its own.
    `body1`, wherever a method takes it, is the motion of body 1. An argument that cannot be used raises an
    ArgumentError, which names it.

    Args:
        u1: hinge point from body 1's reference point, body-1 axes [m]; shape (3,) or (..., 3).
        u2: hinge point from body 2's reference point, body-2 axes [m]; shape (3,) or (..., 3).
        n: hinge axis, body-1 axes; any non-zero length; kept at unit length.
        home: rotation of body 2 relative to body 1 at psi = 0 (C in E5); identity unless given; shape (3, 3).
        name: what the pair is called in exports and messages.
        limits: least and greatest hinge angle, for exports [rad]; shape (2,). forward_kinematics takes any angle. In
            `simulate` the limits do not stop the motion; `HingeLoad(stops=pair.limits)` does.
        body1: mass properties and shapes of body 1, for dynamics, exports and pictures.
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
        new_constants = pair_constants(u1, u2, n if axis is None else axis, home)
        rotation = new_constants.arrays["home"]
        most = {"torque_limit": torque_limit, "rate_limit": rate_limit}
        values_of = {
            **{key: new_constants.arrays[key] for key in ("u1", "u2", "n")},
            "home": rotation.reshape(*rotation.shape[:-1], 3, 3),
            "name": name,
            "limits": _checked_limits(limits),
            "body1": checked_mass_properties("body1", body1),
            "body2": checked_mass_properties("body2", body2),
            **{key: None if value is None else number_not_below_0(key, value) for key, value in most.items()},
            "constants": new_constants,
        }
        for key, value in values_of.items():
            object.__setattr__(self, key, value)

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "constants"}
        return partial(type(self), **arguments | {"n": self.constants.axis}), ()

    def __repr__(self) -> str:
        parts = (f"{key}={getattr(self, key).tolist()}" for key in ("u1", "u2", "n", "home"))
        options = ((key, getattr(self, key)) for key in ("limits", "torque_limit", "rate_limit", "body1", "body2"))
        extras = "".join(f", {key}={value!r}" for key, value in options if value is not None)
        return f"HingePair({', '.join(parts)}, name={self.name!r}{extras})"

    def _sheet(self) -> Sheet:
        names = ("u1", "u2", "n", "home", "limits", "torque_limit", "rate_limit")
        masses = (("mass1", self.body1 and self.body1.mass), ("mass2", self.body2 and self.body2.mass))
        return sheet_of(self.name, [*((name, getattr(self, name)) for name in names), *masses])

    @property
    def _bodies(self) -> tuple[Body | None, Body | None]:
        return self.body1, self.body2

    def _lazily(self, method: Callable[..., Returned], **arguments: Any) -> Returned:
        """Return what a method gives for arguments among which there are Dask arrays; nothing is computed."""
        check_single_pair(self, " beside Dask arrays")
        return apply_to_chunks(method, arguments, SAMPLE_SHAPE_BY_ARGUMENT, kinematics.spatial_columns)

    def forward_kinematics(
        self,
        q: CoordinateInput,
        qd: CoordinateInput | None = None,
        qdd: CoordinateInput | None = None,
        *,
        outputs: Outputs = None,
        out: Out = None,
        sequence: str = "XYZ",
        workers: int = 1,
        backend: str = "auto",
    ) -> PairState:
        """Compute the PairState of body 2 from the seven coordinates q = (x, y, z, phi_x, phi_y, phi_z, psi)
        (E1-E10).

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
            backend: "numpy", "compiled", or "auto": compiled where it pays.

        Returns:
            The state; what the inputs do not give (v2 without qd) is None. float32 where all arrays given are
            float32, else float64.

        Raises:
            ArgumentError: an argument cannot be used; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> state = pair.forward_kinematics(np.zeros((5, 7)), np.ones((5, 7)))
        >>> state.v2[0]
        array([ 1.,  4., -1.])
        """
        if holds_dask(q, qd, qdd):
            options = {"outputs": outputs, "out": out, "sequence": sequence, "workers": workers, "backend": backend}
            return self._lazily(self.forward_kinematics, q=q, qd=qd, qdd=qdd, **options)
        execution = execution_of(backend, workers)
        state: PairState = kinematics.from_coordinates(
            SPATIAL_MOTION, self.constants, q, qd, qdd, outputs, out, sequence, execution
        )
        return state

    def prepare(
        self,
        given: str | Iterable[str],
        *,
        outputs: Iterable[str] | None = None,
        sequence: str = "XYZ",
        gravity: ArrayLike = dynamics.GRAVITY,
        workers: int = 1,
        backend: str = "auto",
    ) -> Prepared:
        """Return a Prepared call, planned, checked and compiled once, for loops over single states or small batches.

        Args:
            given: what each call will bring, and its order: "pose" is ("q",), "velocity" ("q", "qd"), "acceleration"
                ("q", "qd", "qdd"); or names with one attitude of body 1, out of q, qd, qdd, R1, S1, quat_xyzw,
                quat_wxyz, v1, omega1, a1, alpha1, psi, psid, psidd; for residuals R2, S2, v2, omega2, a2, alpha2 too.
                Of dynamics, "inverse_dynamics" is ("S1", "omega1", "a1", "alpha1", "psi", "psid", "psidd"), and
                "forward_dynamics" ("S1", "omega1", "psi", "psid", "force1", "torque1", "hinge_torque"); with force1,
                torque1, hinge_torque, force2 or torque2 among the names, accelerations follow from what acts.
            outputs: what to compute: the names that forward_kinematics knows; jacobian, acceleration_bias,
                coordinate_jacobian, coordinate_jacobian_rate; those of `sensitivities` (d_by_u1, ...) and, where body
                2 is given, of `residuals` and constraints (gap, tilt, psi, constraint_jacobian, ...); of dynamics
                force1, torque1, hinge_torque, bearing_torque, mass_matrix, kinetic, potential, linear, angular, and
                under loads a1, alpha1, psidd. Unless given, all of body 2 that the level allows, or what the
                method of that name gives.
            sequence: the Euler sequence of body 1.
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
            workers: threads; -1 for one on every core.
            backend: "auto" and "compiled" compile here and now; "numpy" never does.

        Returns:
            A callable of the arrays in the order of `given`, and `out=`, that gives a `PairState`; all broadcast.
            What has no attribute of its own is `state["gap"]`. `.source` is the Python code that was generated,
            `.llvm` the LLVM code.

        Raises:
            ArgumentError: an unknown name, or an output that needs more than is given; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> fk = pair.prepare("velocity", outputs=("R2", "omega2"))
        >>> fk(np.zeros(7), np.ones(7)).omega2
        array([1., 1., 2.])
        >>> at = pair.prepare(("quat_xyzw", "psi"), outputs=("S2", "jacobian"))
        >>> at(np.array([0.0, 0.0, 0.0, 1.0]), 0.0).jacobian @ (0, 0, 0, 0, 0, 1, 2)
        array([0., 4., 0., 0., 0., 3.])
        """
        return prepare(self, given, outputs, sequence, gravity, execution_of(backend, workers))

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
        """Compute the PairState of body 2 from the motion of body 1 and the hinge angle, without Euler angles (E1,
        E2, E5-E9).

        The level follows psi, psid, psidd [rad, rad/s, rad/s^2]: shape (...,), right hand about n; they broadcast
        against body1, which has as many derivatives as the outputs need. All else is as for `forward_kinematics`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.forward_kinematics_from_body1(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).R2
        array([2., 0., 0.])
        """
        if holds_dask(body1, psi, psid, psidd):
            motion = {"body1": body1, "psi": psi, "psid": psid, "psidd": psidd}
            options = {"outputs": outputs, "out": out, "workers": workers, "backend": backend}
            return self._lazily(self.forward_kinematics_from_body1, **motion, **options)
        execution = execution_of(backend, workers)
        state: PairState = kinematics.from_body1(self.constants, body1, psi, psid, psidd, outputs, out, execution)
        return state

    def error_bounds(
        self,
        q: CoordinateInput,
        qd: CoordinateInput | None = None,
        qdd: CoordinateInput | None = None,
        outputs: Outputs = None,
        *,
        sequence: str = "XYZ",
    ) -> dict[str, NDArray[np.float64]]:
        """Compute the largest error that rounding can cause in each output of forward_kinematics, at every sample;
        arrays by output.

        Exact is what the equations say of the coordinates and of u1, u2, n (of any length) and home, all as they were
        given. The bounds are rigorous, of either backend, as far as sines and cosines are right to 1.5 units in the
        last place. Actual errors are a third of them at most, but for motion with few roundings.

        Arguments are those of `forward_kinematics`.

        Returns:
            By output, the bound on the error of its largest component, in the output's unit; shape (...,). Infinite
            where numbers overflow, or are none.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> bounds = pair.error_bounds((np.array([0.0, 1e9]), 0, 0, 0.3, 0.4, 0.5, 0.6))  # here, and far away
        >>> [f"{bound:.0e}" for bound in bounds["R2"]], [f"{bound:.0e}" for bound in bounds["d"]]
        (['2e-15', '6e-08'], ['2e-15', '2e-15'])
        """
        if holds_dask(q, qd, qdd):
            return self._lazily(self.error_bounds, q=q, qd=qd, qdd=qdd, outputs=outputs, sequence=sequence)
        return accuracy.error_bounds(SPATIAL_MOTION, self.constants, q, qd, qdd, outputs, sequence)

    def error_bounds_from_body1(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike | None = None,
        psidd: ArrayLike | None = None,
        outputs: Outputs = None,
    ) -> dict[str, NDArray[np.float64]]:
        """Compute the largest error that rounding can cause in each output of forward_kinematics_from_body1; arrays
        by output.

        As `error_bounds`, of the arguments of `forward_kinematics_from_body1`. Exact is what E1, E2 and E5 to E9 say
        of this motion as it stands in body1: what was rounded before, in making S from a quaternion, say, is not
        counted.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> f"{pair.error_bounds_from_body1(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.5)['R2']:.0e}"
        '5e-16'
        """
        if holds_dask(body1, psi, psid, psidd):
            return self._lazily(
                self.error_bounds_from_body1, body1=body1, psi=psi, psid=psid, psidd=psidd, outputs=outputs
            )
        return accuracy.error_bounds_from_body1(self.constants, body1, psi, psid, psidd, outputs)

    def mass_matrix(self, body1: BodyMotion, psi: ArrayLike) -> FloatArray:
        """Compute the mass matrix M of M (a1, alpha1, psi'') + bias = (force1, torque1, hinge_torque) (D6).

        S of body1 is used; psi [rad], shape (...,), broadcasts against it. M is symmetric, in world axes and about
        R1 [kg, kg m, kg m^2]; shape (..., 7, 7).

        Raises:
            ArgumentError: an argument cannot be used, or a body of the pair has no mass properties; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
        >>> pair.mass_matrix(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).diagonal().round(12).tolist()
        [4.0, 4.0, 4.0, 2.0, 10.0, 10.0, 3.0]
        """
        if holds_dask(body1, psi):
            return self._lazily(self.mass_matrix, body1=body1, psi=psi)
        (matrix,) = dynamics.compute_quantity(
            dynamics.MASS_MATRIX_QUANTITY, self.constants, self._bodies, body1, psi=psi
        )
        return matrix

    def inverse_dynamics(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        psidd: ArrayLike,
        gravity: ArrayLike = dynamics.GRAVITY,
    ) -> Forces:
        """Compute the Forces: those on body 1 and the torque at the hinge that move the pair as given (D1-D5).

        Args:
            body1: the motion of body 1, of which S, omega, a and alpha are used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1; likewise the next two.
            psid: its time derivative [rad/s].
            psidd: its second time derivative [rad/s^2].
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).

        Returns:
            force1 [N], torque1 about R1 and hinge_torque [N m].

        Raises:
            ArgumentError: an argument cannot be used, or a body of the pair has no mass properties; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body1=body, body2=body)
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0), a=(0, 0, 0), alpha=(0, 0, 0))
        >>> forces = pair.inverse_dynamics(still, psi=0.0, psid=0.0, psidd=0.0)
        >>> forces.force1.round(9).tolist(), forces.hinge_torque.round(9).tolist()
        ([0.0, 0.0, 39.24], -19.62)
        """
        hinge = {"psi": psi, "psid": psid, "psidd": psidd}
        if holds_dask(body1, hinge):
            return self._lazily(self.inverse_dynamics, body1=body1, **hinge, gravity=gravity)
        return Forces(
            *dynamics.compute_quantity(
                dynamics.FORCES_QUANTITY, self.constants, self._bodies, body1, gravity, **hinge
            )
        )

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
        """Compute the Accelerations of the pair under its loads (D6).

        Args:
            body1: the motion of body 1, of which S and omega are used.
            psi: hinge angle [rad]; shape (...,), broadcasts against body1; likewise all that follows.
            psid: its time derivative [rad/s].
            force1: on body 1 at R1, world axes [N]; shape (..., 3), or the number 0; likewise the other forces and
                torques.
            torque1: on body 1, world axes [N m].
            hinge_torque: of body 1 on body 2 about the hinge axis [N m]; shape (...,).
            force2: on body 2 at R2, world axes [N].
            torque2: on body 2, world axes [N m].
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).

        Returns:
            a1 [m/s^2], alpha1 and psidd [rad/s^2].

        Raises:
            ArgumentError: also where a body of the pair has no mass properties, or those leave a motion without
                resistance.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body1=body, body2=body)
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> found = pair.forward_dynamics(still, psi=0.3, psid=0.0)  # nothing acts but gravity: both bodies fall
        >>> found.a1.round(9).tolist(), abs(round(float(found.psidd), 9))
        ([0.0, 0.0, -9.81], 0.0)
        """
        loads = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
        hinge = {"psi": psi, "psid": psid, "hinge_torque": hinge_torque}
        if holds_dask(body1, loads, hinge):
            return self._lazily(self.forward_dynamics, body1=body1, **hinge, **loads, gravity=gravity)
        outputs = dynamics.compute_quantity(
            dynamics.ACCELERATIONS_QUANTITY, self.constants, self._bodies, body1, gravity=gravity, **loads, **hinge
        )
        return dynamics.make_accelerations(self._bodies, outputs)

    def hinge_wrench(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        psidd: ArrayLike,
        gravity: ArrayLike = dynamics.GRAVITY,
    ) -> HingeWrench:
        """Compute the HingeWrench of body 1 on body 2 at the hinge point (D3, D4). Body 2 alone needs mass
        properties.

        Arguments are those of `inverse_dynamics`. The result has the force [N], the torque about the hinge
        point [N m] and the two parts of the torque, hinge_torque and bearing_torque.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body2=body)
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0), a=(0, 0, 0), alpha=(0, 0, 0))
        >>> pair.hinge_wrench(still, psi=0.0, psid=0.0, psidd=0.0).force.round(9).tolist()
        [0.0, 0.0, 19.62]
        """
        hinge = {"psi": psi, "psid": psid, "psidd": psidd}
        if holds_dask(body1, hinge):
            return self._lazily(self.hinge_wrench, body1=body1, **hinge, gravity=gravity)
        outputs = dynamics.compute_quantity(
            dynamics.HINGE_WRENCH_QUANTITY, self.constants, self._bodies, body1, gravity, **hinge
        )
        return HingeWrench(*outputs)

    def energy(
        self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike, gravity: ArrayLike = dynamics.GRAVITY
    ) -> Energy:
        """Compute the kinetic and potential Energy of the pair (D7); body 1 counts where it has mass properties.

        R, S, v and omega of body1 are used; psi [rad] and psid [rad/s], shape (...,), broadcast against it; gravity
        as for `inverse_dynamics`. The result has the attributes kinetic and
        potential [J].

        Raises:
            ArgumentError: an argument cannot be used, or body 2 has no mass properties; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
        >>> body1 = hp.BodyMotion(R=(0, 0, 2), S=np.eye(3), v=(1, 0, 0), omega=(0, 0, 0))
        >>> [round(float(part), 9) for part in pair.energy(body1, psi=0.0, psid=0.0)]
        [2.0, 78.48]
        """
        hinge = {"psi": psi, "psid": psid}
        if holds_dask(body1, hinge):
            return self._lazily(self.energy, body1=body1, **hinge, gravity=gravity)
        return Energy(
            *dynamics.compute_quantity(
                dynamics.ENERGY_QUANTITY, self.constants, self._bodies, body1, gravity, **hinge
            )
        )

    def momentum(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> Momentum:
        """Compute the Momentum of the pair: linear, and angular about the world's origin (D8).

        Arguments are those of `energy`. The result has the attributes linear [kg m/s] and angular
        [kg m^2/s].

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
        >>> body1 = hp.BodyMotion(R=(0, 0, 2), S=np.eye(3), v=(1, 0, 0), omega=(0, 0, 0))
        >>> pair.momentum(body1, psi=0.0, psid=0.0).linear.tolist()
        [4.0, 0.0, 0.0]
        """
        hinge = {"psi": psi, "psid": psid}
        if holds_dask(body1, hinge):
            return self._lazily(self.momentum, body1=body1, **hinge)
        return Momentum(
            *dynamics.compute_quantity(dynamics.MOMENTUM_QUANTITY, self.constants, self._bodies, body1, **hinge)
        )

    def residuals(
        self,
        body1: BodyMotion,
        body2: BodyMotion,
        tolerances: Mapping[str, float] | None = None,
        t: ArrayLike | None = None,
    ) -> Residuals:
        """Compute the Residuals of two motions: how far they violate this hinge, beside tolerances (E1, E2 and their
        derivatives).

        Args:
            body1: the motion of body 1.
            body2: the motion of body 2. Rates are judged where both have omega (and v), accelerations where both
                also have alpha (and a).
            tolerances: largest size that passes, by residual: gap [m], tilt [rad], gap_rate [m/s], tilt_rate
                [rad/s], gap_acceleration [m/s^2], tilt_acceleration [rad/s^2]. Those not named: what round-off
                explains, 32 u times a scale that is printed. `tilt` is judged by the angle between the axes,
                `.tilt_angle`, and not by `.tilt`: its components are sines, about 0 for an axis flipped by pi.
            t: instants of the samples, numbers or datetime64, so that the report says when; broadcasts against them.

        Returns:
            The `Residuals`: `.ok`, `.verdict`, str() a table, `.to_json()`, `.rows`; and the arrays that it lists,
            `.gap` (..., 3) m, `.tilt_angle` (...,) rad, `.psi` (...,) rad and others. Samples that are not finite are
            left out and counted. Of Dask arrays a `LazyResiduals`: these arrays, lazy, and `.ratio` (...,), the
            largest residual / tolerance of each sample. Its `.compute()` returns the `Residuals` in memory, and
            `.compute_summary()` those whose arrays stay Dask arrays, for motions larger than memory.

        Raises:
            ArgumentError: also where a tolerance is of rates that the motions lack.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body1, body2 = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), hp.BodyMotion(R=(2, 0.001, 0), S=np.eye(3))
        >>> pair.residuals(body1, body2).verdict
        'FAILED: gap'
        >>> pair.residuals(body1, body2, tolerances={"gap": 0.01}).ok
        True
        """
        if holds_dask(body1, body2):
            arrays = self._lazily(self._residual_arrays, body1=body1, body2=body2, tolerances=tolerances)
            lazy: Any = residuals.lazy_residuals(arrays, self.name, body1, body2, tolerances, t)
            return lazy  # type: ignore[no-any-return]
        return residuals.residuals(self.constants, self.name, body1, body2, tolerances, t)

    def _residual_arrays(
        self, body1: BodyMotion, body2: BodyMotion, tolerances: Mapping[str, float] | None
    ) -> dict[str, NDArray[Any]]:
        return residuals.residual_arrays(self.constants, body1, body2, tolerances)

    def jacobian(self, body1: BodyMotion, psi: ArrayLike) -> FloatArray:
        """Compute Jac of (v2, omega2) = Jac @ (v1, omega1, psi') from body1 and psi (E8, E2).

        S of body1 is used; psi [rad], shape (...,), broadcasts against it. Jac is in world axes; shape (..., 6, 7).
        By the rates of q it is `coordinate_jacobian(q)`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.jacobian(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0) @ (0, 0, 0, 0, 0, 1, 2)
        array([0., 4., 0., 0., 0., 3.])
        """
        if holds_dask(body1, psi):
            return self._lazily(self.jacobian, body1=body1, psi=psi)
        return derivatives.jacobian(self.constants, body1, psi)

    def acceleration_bias(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> FloatArray:
        """Compute the velocity part of body 2's acceleration: (a2, alpha2) = Jac @ (a1, alpha1, psi'') + bias (E9).

        S and omega of body1 are used; psi [rad] and psid [rad/s], shape (...,), broadcast against it. The bias is in
        world axes; shape (..., 6).

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body1 = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> pair.acceleration_bias(body1, 0.0, 2.0)
        array([-4.,  0.,  0.,  0.,  0.,  0.])
        """
        if holds_dask(body1, psi, psid):
            return self._lazily(self.acceleration_bias, body1=body1, psi=psi, psid=psid)
        return derivatives.acceleration_bias(self.constants, body1, psi, psid)

    def coordinate_jacobian(self, q: CoordinateInput, *, sequence: str = "XYZ") -> FloatArray:
        """Compute Jq of (v2, omega2) = Jq @ qd, qd the rates of the seven coordinates (E8, E2, E4).

        The coordinates and the sequence are those of `forward_kinematics`. Jq is in world axes; shape (..., 6, 7).

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.coordinate_jacobian(np.zeros(7)) @ (0, 0, 0, 0, 0, 1, 2)
        array([0., 4., 0., 0., 0., 3.])
        """
        if holds_dask(q):
            return self._lazily(self.coordinate_jacobian, q=q, sequence=sequence)
        return derivatives.coordinate_jacobian(self.constants, q, sequence)

    def coordinate_jacobian_rate(
        self, q: CoordinateInput, qd: CoordinateInput, *, sequence: str = "XYZ"
    ) -> FloatArray:
        """Compute the time derivative of coordinate_jacobian: (a2, alpha2) = Jq @ qdd + Jq' @ qd (E9).

        The coordinates and the sequence are those of `forward_kinematics`. Jq' is in world axes; shape (..., 6, 7).

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> qd = np.array((0, 0, 0, 0, 0, 0, 2.0))
        >>> pair.coordinate_jacobian_rate(np.zeros(7), qd) @ qd
        array([-4.,  0.,  0.,  0.,  0.,  0.])
        """
        if holds_dask(q, qd):
            return self._lazily(self.coordinate_jacobian_rate, q=q, qd=qd, sequence=sequence)
        return derivatives.coordinate_jacobian_rate(self.constants, q, qd, sequence)

    def sensitivities(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike | None = None) -> Sensitivities:
        """Compute the Sensitivities: derivatives of (d, S2, v2, omega2) by u1, u2, n and psi (E2, E5-E8); those of R2
        are those of d.

        S of body1 is used, and with psid omega; psi [rad] and psid [rad/s], shape (...,), broadcast against it.
        Without psid, v2 and omega2 have none. The `Sensitivities` say the shape and unit of each, such as `.d_by_u1`
        (..., 3, 3); the last axis is the component of what is varied.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.sensitivities(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).d_by_psi + 0.0
        array([0., 1., 0.])
        """
        if holds_dask(body1, psi, psid):
            return self._lazily(self.sensitivities, body1=body1, psi=psi, psid=psid)
        return derivatives.sensitivities(self.constants, body1, psi, psid)

    def propagate_covariance(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        *,
        u1_std: ArrayLike = 0.0,
        u2_std: ArrayLike = 0.0,
        axis_std: float = 0.0,
        home_std: ArrayLike = 0.0,
        covariance: ArrayLike | None = None,
    ) -> PoseCovariance:
        """Compute the PoseCovariance that tolerances of the geometry cause in R2 and body 2's attitude, to first
        order (E5, E7).

        S of body1 is used; psi [rad], shape (...,), broadcasts against it. The standard deviations, or the
        covariance of a fit, are those of `hingepair.sample_pairs`, which shows how far the first order holds.

        Returns:
            The `PoseCovariance`: `.R2_std` (..., 3) m, `.attitude_std` (..., 3) rad, the covariances `.R2` and
            `.attitude` (..., 3, 3), and `.contributions()`: the variances by the dimension that causes them.

        Raises:
            ArgumentError: an argument cannot be used, or nothing scatters; names it.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(0.5, 0, 0), u2=(-0.5, 0, 0), n=(0, 0, 1))
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
        >>> pair.propagate_covariance(still, 1.0, u1_std=0.001, axis_std=0.002).R2_std.round(6)
        array([0.001   , 0.001   , 0.001385])
        """
        std = {"u1_std": u1_std, "u2_std": u2_std, "axis_std": axis_std, "home_std": home_std}
        if holds_dask(body1, psi):
            return self._lazily(self.propagate_covariance, body1=body1, psi=psi, covariance=covariance, **std)
        return tolerances.propagate_covariance(self.constants, body1, psi, covariance, **std)

    def constraint_jacobian(self, body1: BodyMotion, body2: BodyMotion) -> FloatArray:
        """Compute the 5 x 12 Jacobian G of the hinge constraints, for solvers of differential-algebraic equations
        (E1, E2).

        The constraints are gap (E1, world axes) and tilt, the components of S1 n x S2 C^-1 n along S1 e1 and S1 e2,
        where e1 is the axis of body 1 furthest from n, made perpendicular to it, and e2 = n x e1. G is their exact
        derivative, on the constraint and off it: (gap', tilt') = G @ (v1, omega1, v2, omega2), world axes; shape
        (..., 5, 12). Of both bodies, S is used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
        >>> (pair.constraint_jacobian(body, body) @ (0, 0, 0, 0, 0, 1, 0, 4, 0, 0, 0, 3)).tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0]
        """
        if holds_dask(body1, body2):
            return self._lazily(self.constraint_jacobian, body1=body1, body2=body2)
        return derivatives.constraint_jacobian(self.constants, body1, body2)

    def constraint_bias(self, body1: BodyMotion, body2: BodyMotion) -> FloatArray:
        """Compute the velocity part of the constraints' second derivative (E1, E2), an array of shape (..., 5).

        (gap'', tilt'') = G @ (a1, alpha1, a2, alpha2) + bias, world axes, shape (..., 5); zero for motions of the
        pair. Of both bodies, S and omega are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body1 = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> body2 = hp.BodyMotion(R=(2, 0, 0), S=np.eye(3), omega=(0, 0, 2))
        >>> pair.constraint_bias(body1, body2).tolist()
        [-4.0, 0.0, 0.0, 0.0, 0.0]
        """
        if holds_dask(body1, body2):
            return self._lazily(self.constraint_bias, body1=body1, body2=body2)
        return derivatives.constraint_bias(self.constants, body1, body2)


def _checked_limits(limits: ArrayLike | None) -> tuple[float, float] | None:
    """Return the limits of the hinge angle [rad] as (lower, upper), or None for None; refuse limits out of order."""
    if limits is None:
        return None
    both = one_constant("limits", limits, 2)
    if not both[0] < both[1]:
        raise ArgumentError("limits", "(lower, upper) with lower < upper", limits)
    return float(both[0]), float(both[1])


def checked_mass_properties(name: str, body: Body | None) -> Body | None:
    """Return the Body, or None for None; raise ArgumentError for anything else."""
    if body is None:
        return None
    if not isinstance(body, Body):
        raise ArgumentError(name, "a Body", quoted(body))
    return body
