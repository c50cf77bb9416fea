"""The pair of two bodies that are joined by a hinge."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import execution_of
from hingepair.engine.outputs import Out
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import FloatArray, number_not_below_0, one_constant
from hingepair.numeric.dask_arrays import apply_to_chunks, holds_dask
from hingepair.numeric.tables import Sheet, Shown, sheet_of
from hingepair.pair import accuracy, dynamics, residuals, tolerances
from hingepair.pair import computations as kinematics
from hingepair.pair.body import Body
from hingepair.pair.body_motion import MOTION_SHAPES, BodyMotion, motion_inputs
from hingepair.pair.computations import COORDINATES, POSE_SENSITIVITIES, VELOCITY_SENSITIVITIES
from hingepair.pair.constants import Constants, check_single_pair, pair_constants
from hingepair.pair.derivatives import Sensitivities
from hingepair.pair.dynamics import DEFAULT_GRAVITY, Accelerations, Energy, Forces, HingeWrench, Momentum
from hingepair.pair.prepare import prepare
from hingepair.pair.residuals import Residuals
from hingepair.pair.states import PairState
from hingepair.pair.tolerances import PoseCovariance
from hingepair.plans.arguments import Coordinates, Outputs, renamed_out
from hingepair.plans.plan import SPATIAL_MOTION_KIND
from hingepair.plans.prepared import Prepared
from hingepair.rotations.sequences import find_sequence

Returned = TypeVar("Returned")

_MOVED: Final = ("S", "omega", "a", "alpha")
_PLACED: Final = ("R", "S", "v", "omega")
WRENCH_OUTPUTS: Final = {"force": "hinge_force", "torque": "hinge_moment"}
"""Outputs by the attributes of a HingeWrench."""
_DASK_SHAPES: Final = {
    **SPATIAL_MOTION_KIND.shapes,
    **dict.fromkeys(("body1", "body2"), MOTION_SHAPES),
}
"""Shape of one sample of each argument that may be a Dask array."""


@dataclass(frozen=True, slots=True, eq=False, init=False)
class HingePair(Shown):
    """Two rigid bodies joined by a hinge, R1 + S1 u1 = R2 + S2 u2 (E1), which turn relative to each other about the
    hinge axis n only (E2).

    Values are copied and read-only; `dataclasses.replace(pair, u1=...)` returns a pair with another u1. u1, u2, n and
    home may have leading axes, which broadcast against those of the samples: each sample has its own pair. The
    argument `body1` of methods is the motion of body 1, a `BodyMotion`; the attribute `body1` its mass properties, a
    `Body`.

    Args:
        u1: hinge point from body 1's reference point, body-1 axes [m]; shape (3,) or (..., 3).
        u2: hinge point from body 2's reference point, body-2 axes [m]; shape (3,) or (..., 3).
        n: hinge axis, body-1 axes, of any non-zero length, stored at unit length; shape (3,) or (..., 3). The hinge
            angle psi is that of body 2 about n, right-handed.
        home: attitude of body 2 relative to body 1 at psi = 0, from body-2 axes to body-1 axes (C in E5); shape (3,
            3) or (..., 3, 3); by default the identity.
        name: name of the pair in exports and messages.
        limits: smallest and largest hinge angle [rad], for exports and `HingeLoad(stops=pair.limits)`; shape (2,). No
            method enforces them.
        body1: mass properties and shapes of body 1, for dynamics, exports and pictures.
        body2: mass properties and shapes of body 2.
        torque_limit: largest torque of the motor [N m], for exports; URDF calls it effort.
        rate_limit: largest hinge rate [rad/s], for exports; URDF calls it velocity.
        constants: an internal argument that `dataclasses.replace` passes, so that what is not replaced stays the same
            to the last bit.

    Raises:
        ArgumentError: a value cannot be used, here as in all methods; the error names the argument.
        AxisError: n is zero or not finite.
        RotationError: an element of C C^T is off the identity by more than 2e-9, or det C is negative.

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
        """Return the printed table: geometry, limits and masses."""
        names = ("u1", "u2", "n", "home", "limits", "torque_limit", "rate_limit")
        masses = (("mass1", self.body1 and self.body1.mass), ("mass2", self.body2 and self.body2.mass))
        return sheet_of(self.name, [*((name, getattr(self, name)) for name in names), *masses])

    def _lazily(self, method: Callable[..., Returned], **arguments: Any) -> Returned:
        """Return lazy Dask arrays of the results of a method."""
        check_single_pair(self, " if the arguments are Dask arrays")
        return apply_to_chunks(
            method,
            arguments,
            _DASK_SHAPES,
            COORDINATES[SPATIAL_MOTION_KIND].table_columns,
        )

    def massive(self) -> HingePair:
        """Return the pair in space with the same dynamics: this one."""
        return self

    def with_masses(self) -> Constants:
        """Return the constants with those of the pair as a tree."""
        return dynamics.tree_constants(self.constants, (self.body1, self.body2))

    def forward_kinematics(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        *,
        outputs: Outputs = None,
        out: Out = None,
        sequence: str = "XYZ",
        workers: int = 1,
        backend: str = "auto",
    ) -> PairState:
        """Compute the motion of body 2 from the seven coordinates (E1-E10).

        Args:
            q: (x, y, z, phi_x, phi_y, phi_z, psi): position of body 1's reference point [m], its Euler angles and the
                hinge angle [rad]. One array (..., 7); a tuple of seven numbers or arrays that broadcast, in which a
                number is the same for all samples, which saves time; a dict by name; or a table with these columns.
            qd: time derivatives of q, which add velocities.
            qdd: second time derivatives of q, which add accelerations.
            outputs: names out of R2, S2, d, v2, omega2, a2, alpha2, R1, S1, v1, omega1, a1, alpha1. By default, those
                of body 2 for which the coordinates suffice.
            out: arrays by output name, into which the results are written; where there is one output, also one array.
            sequence: Euler sequence of body 1, one of the 24 that SciPy knows: upper case intrinsic, lower case
                extrinsic. phi_x, phi_y and phi_z are the angles of its first, second and third letter.
            workers: number of threads; -1 for one thread per core.
            backend: "numpy"; "compiled", machine code that the first call compiles (0.1 s, or milliseconds where it
                is on disk); or "auto", which compiles for arrays, and for coordinates one by one where NumPy would
                take milliseconds longer, and falls back on NumPy with a warning.

        Returns:
            The PairState, in float32 if all arrays given are float32, else in float64.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> state = pair.forward_kinematics(np.zeros((5, 7)), np.ones((5, 7)))
        >>> state.v2[0]
        array([ 1.,  4., -1.])
        """
        state: PairState = kinematics.from_coordinates(
            SPATIAL_MOTION_KIND, self.constants, q, qd, qdd, outputs, out, sequence, backend, workers
        )
        return state

    def prepare(
        self,
        given: str | Iterable[str],
        *,
        outputs: Iterable[str] | None = None,
        sequence: str = "XYZ",
        gravity: ArrayLike = DEFAULT_GRAVITY,
        workers: int = 1,
        backend: str = "auto",
    ) -> Prepared:
        """Return a function that computes given outputs, planned and compiled once, for loops over single states or
        small batches.

        Args:
            given: names of the arguments in the order of a call, or a word for them:

                - "pose" for ("q",), "velocity" for ("q", "qd"), "acceleration" for ("q", "qd", "qdd");
                - the name of another method: "mass_matrix" for ("S1", "psi"), "inverse_dynamics" for ("S1", "omega1",
                  "a1", "alpha1", "psi", "psid", "psidd"), "forward_dynamics" for ("S1", "omega1", "psi", "psid",
                  "force1", "torque1", "hinge_torque"), and so on.

                Exactly one of q, S1, quat_xyzw and quat_wxyz is among the names. Others are qd, qdd, R1, v1, omega1,
                a1, alpha1, psi, psid and psidd; R2, S2, v2, omega2, a2 and alpha2, for outputs that depend on both
                motions; and the loads force1, torque1, hinge_torque, force2 and torque2, for forward dynamics.
            outputs: names of the outputs:

                - those of `forward_kinematics`, jacobian, acceleration_bias, coordinate_jacobian,
                  coordinate_jacobian_rate and mass_matrix; without q, R2 needs R1, v2 needs v1, and a2 needs a1;
                - the attributes of `Sensitivities`, and with S2 the arrays of `Residuals`, constraint_jacobian and
                  constraint_bias;
                - force1, torque1, hinge_torque, hinge_force, hinge_moment, bearing_torque, kinetic, potential, linear
                  and angular; with a load a1, alpha1 and psidd.

                By default those of the method; of a tuple of names those of `forward_kinematics`, or with a load a1,
                alpha1 and psidd.
            sequence: Euler sequence of body 1, as for `forward_kinematics`.
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
            workers: number of threads; -1 for one thread per core.
            backend: "auto" and "compiled" compile during this call, "numpy" never does.

        Returns:
            A `Prepared`, whose calls return a `PairState`: `state.R2`, and all outputs as `state["gap"]`.

        Raises:
            ArgumentError: a name is unknown, or an output needs an argument or the mass of a body that is not given.

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
        """Compute the motion of body 2 from that of body 1 and the hinge angle, without Euler angles (E1, E2, E5-E9).

        Args:
            body1: the motion of body 1.
            psi: hinge angle, right-handed about n [rad]; shape (...,); broadcasts against body1.
            psid: its time derivative [rad/s], which adds velocities.
            psidd: its second time derivative [rad/s^2], which adds accelerations.
            outputs: as for `forward_kinematics`. Only what these outputs need must be given.
            out: arrays by output name, into which the results are written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Raises:
            ArgumentError: an output needs an input that is not given.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.forward_kinematics_from_body1(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).R2
        array([2., 0., 0.])
        """
        state: PairState = kinematics.from_body1(
            self.constants, body1, psi, psid, psidd, outputs, out, backend, workers
        )
        return state

    def error_bounds(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        outputs: Outputs = None,
        *,
        sequence: str = "XYZ",
    ) -> dict[str, NDArray[np.float64]]:
        """Compute rigorous bounds on the rounding errors of `forward_kinematics` at every sample.

        The error is the largest difference of a component from the exact result of the equations for the given
        numbers, among them n before it is scaled to unit length. The bounds hold for all backends if sines and
        cosines are accurate to 1.5 units in the last place; actual errors are usually below a third of them.

        Args:
            q: coordinates, as for `forward_kinematics`.
            qd: time derivatives of q.
            qdd: second time derivatives of q.
            outputs: as for `forward_kinematics`.
            sequence: as for `forward_kinematics`.

        Returns:
            Bounds by output name, in its unit; shape (...,). Infinite where an intermediate result overflows or an
            input is not finite.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> bounds = pair.error_bounds((np.array([0.0, 1e9]), 0, 0, 0.3, 0.4, 0.5, 0.6))  # here, and far away
        >>> [f"{bound:.0e}" for bound in bounds["R2"]], [f"{bound:.0e}" for bound in bounds["d"]]
        (['2e-15', '6e-08'], ['2e-15', '2e-15'])
        """
        if holds_dask(q, qd, qdd):
            return self._lazily(self.error_bounds, q=q, qd=qd, qdd=qdd, outputs=outputs, sequence=sequence)
        given = kinematics.coordinate_rows(q, qd, qdd)
        find_sequence(sequence)
        return accuracy.error_bounds(SPATIAL_MOTION_KIND, self.constants, given, len(given) - 1, outputs, sequence)

    def error_bounds_from_body1(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike | None = None,
        psidd: ArrayLike | None = None,
        outputs: Outputs = None,
    ) -> dict[str, NDArray[np.float64]]:
        """Compute rigorous bounds on the rounding errors of `forward_kinematics_from_body1`, as `error_bounds` does;
        errors that body1 already has, such as from quaternions, are not included.

        Args:
            body1: the motion of body 1.
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            psidd: acceleration of the hinge angle [rad/s^2]; shape (...,).
            outputs: as for `forward_kinematics`.

        Returns:
            Bounds by output name, in its unit; shape (...,). Infinite where an intermediate result overflows or an
            input is not finite.

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
        given = kinematics.body1_inputs(body1, psi, psid, psidd)
        level = ("psid" in given) + ("psidd" in given)
        return accuracy.error_bounds(SPATIAL_MOTION_KIND, self.constants, given, level, outputs)

    def mass_matrix(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        *,
        out: FloatArray | None = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> FloatArray:
        """Compute the mass matrix M in M @ (a1, alpha1, psi'') + bias = (force1, torque1, hinge_torque) (T4).

        Args:
            body1: the motion of body 1, of which S is used.
            psi: hinge angle [rad]; shape (...,).
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Returns:
            M, symmetric; shape (..., 7, 7) [kg, kg m, kg m^2]. force1 and torque1 are those of `inverse_dynamics`.

        Raises:
            ArgumentError: a body of the pair has no mass properties.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
        >>> pair.mass_matrix(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).diagonal().round(12).tolist()
        [4.0, 4.0, 4.0, 2.0, 10.0, 10.0, 3.0]
        """
        given = {**motion_inputs("body1", body1, ("S",)), "psi": psi}
        matrix: FloatArray = dynamics.ask(self, "mass_matrix", given, out=out, workers=workers, backend=backend)
        return matrix

    def inverse_dynamics(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        psidd: ArrayLike,
        *,
        gravity: ArrayLike = DEFAULT_GRAVITY,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Forces:
        """Compute the force and torque on body 1 and the hinge torque that a motion requires (T1-T3).

        Args:
            body1: the motion of body 1, of which S, omega, a and alpha are used.
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            psidd: acceleration of the hinge angle [rad/s^2]; shape (...,).
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
            out: arrays by output name, into which the results are written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Returns:
            The Forces, which act beside gravity.

        Raises:
            ArgumentError: a body of the pair has no mass properties.

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
        given = {**motion_inputs("body1", body1, _MOVED), **hinge}
        found = dynamics.ask(
            self, "inverse_dynamics", given, gravity=gravity, out=out, workers=workers, backend=backend
        )
        return Forces(found["force1"], found["torque1"], found["hinge_torque"])

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
        gravity: ArrayLike = DEFAULT_GRAVITY,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Accelerations:
        """Compute the accelerations of the pair under gravity and the forces and torques on both bodies (T5, T6).

        Args:
            body1: the motion of body 1, of which S and omega are used.
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            force1: force on body 1 at R1, world axes [N]; shape (..., 3).
            torque1: torque on body 1 about R1, world axes [N m]; shape (..., 3).
            hinge_torque: torque of body 1 on body 2 about the hinge axis [N m]; shape (...,).
            force2: force on body 2 at R2, world axes [N]; shape (..., 3).
            torque2: torque on body 2 about R2, world axes [N m]; shape (..., 3).
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
            out: arrays by output name, into which the results are written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Returns:
            The Accelerations; NaN, with a DynamicsWarning, where the mass matrix is singular, such as where body 2
            has no inertia about the hinge axis.

        Raises:
            ArgumentError: a body of the pair has no mass properties.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body1=body, body2=body)
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> accelerations = pair.forward_dynamics(still, psi=0.3, psid=0.0)  # only gravity acts: both bodies fall
        >>> accelerations.a1.round(9).tolist(), abs(round(float(accelerations.psidd), 9))
        ([0.0, 0.0, -9.81], 0.0)
        """
        loads = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
        hinge = {"psi": psi, "psid": psid, "hinge_torque": hinge_torque}
        given = {**motion_inputs("body1", body1, ("S", "omega")), **hinge, **loads}
        found = dynamics.ask(
            self, "forward_dynamics", given, gravity=gravity, out=out, workers=workers, backend=backend
        )
        dynamics.warn_where_singular(found["psidd"], self)
        return Accelerations(found["a1"], found["alpha1"], found["psidd"])

    def hinge_wrench(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        psidd: ArrayLike,
        *,
        gravity: ArrayLike = DEFAULT_GRAVITY,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> HingeWrench:
        """Compute the force and torque that body 1 exerts on body 2 at the hinge point (T3).

        Args:
            body1: the motion of body 1, of which S, omega, a and alpha are used.
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            psidd: acceleration of the hinge angle [rad/s^2]; shape (...,).
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
            out: arrays by attribute of the result, which are written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Raises:
            ArgumentError: body 2 has no mass properties.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body2=body)
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0), a=(0, 0, 0), alpha=(0, 0, 0))
        >>> pair.hinge_wrench(still, psi=0.0, psid=0.0, psidd=0.0).force.round(9).tolist()
        [0.0, 0.0, 19.62]
        """
        hinge = {"psi": psi, "psid": psid, "psidd": psidd}
        given = {**motion_inputs("body1", body1, _MOVED), **hinge}
        found = dynamics.ask(
            self,
            "hinge_wrench",
            given,
            gravity=gravity,
            out=renamed_out(out, WRENCH_OUTPUTS),
            workers=workers,
            backend=backend,
        )
        return HingeWrench(*(found[name] for name in found.outputs))

    def energy(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        *,
        gravity: ArrayLike = DEFAULT_GRAVITY,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Energy:
        """Compute the kinetic and potential energy of the pair in uniform gravity (T7); that of body 2 alone if body
        1 has no mass properties.

        Args:
            body1: the motion of body 1, of which R, S, v and omega are used.
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
            out: arrays by output name, into which the results are written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Raises:
            ArgumentError: body 2 has no mass properties.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
        >>> body1 = hp.BodyMotion(R=(0, 0, 2), S=np.eye(3), v=(1, 0, 0), omega=(0, 0, 0))
        >>> [round(float(part), 9) for part in pair.energy(body1, psi=0.0, psid=0.0)]
        [2.0, 78.48]
        """
        given = {**motion_inputs("body1", body1, _PLACED), "psi": psi, "psid": psid}
        found = dynamics.ask(self, "energy", given, gravity=gravity, out=out, workers=workers, backend=backend)
        return Energy(found["kinetic"], found["potential"])

    def momentum(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        *,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Momentum:
        """Compute the momentum of the pair: linear, and angular about the world's origin (T8).

        Args:
            body1: the motion of body 1, of which R, S, v and omega are used.
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            out: arrays by output name, into which the results are written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Raises:
            ArgumentError: a body of the pair has no mass properties.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
        >>> body1 = hp.BodyMotion(R=(0, 0, 2), S=np.eye(3), v=(1, 0, 0), omega=(0, 0, 0))
        >>> pair.momentum(body1, psi=0.0, psid=0.0).linear.tolist()
        [4.0, 0.0, 0.0]
        """
        given = {**motion_inputs("body1", body1, _PLACED), "psi": psi, "psid": psid}
        found = dynamics.ask(self, "momentum", given, out=out, workers=workers, backend=backend)
        return Momentum(found["linear"], found["angular"])

    def residuals(
        self,
        body1: BodyMotion,
        body2: BodyMotion,
        tolerances: Mapping[str, float] | None = None,
        t: ArrayLike | None = None,
    ) -> Residuals:
        """Compute by how much two motions violate the hinge constraints E1 and E2 and their time derivatives.

        Args:
            body1: the motion of body 1.
            body2: the motion of body 2. Rates need omega of both motions, that of the gap also v; accelerations
                alpha, and a.
            tolerances: largest size by residual: gap [m], tilt [rad], gap_rate [m/s], tilt_rate [rad/s],
                gap_acceleration [m/s^2], tilt_acceleration [rad/s^2]. The size is the norm at a sample; that of tilt
                the angle between the hinge axes, in [0, pi]. By default 32 u times a scale, which covers rounding; u
                is 2^-53 in double precision.
            t: instants of the samples, numbers [s] or datetime64, by which the worst ones are named.

        Returns:
            The `Residuals`; `.ok` says whether all are within their tolerances, `print` gives a table. Residuals that
            are not finite at a sample are not compared there. Of Dask arrays, a `LazyResiduals`: `.compute()` returns
            the `Residuals` in memory, `.compute_summary()` those of motions larger than memory.

        Raises:
            ArgumentError: a tolerance is given for a residual that needs velocities or accelerations which the
                motions do not have.

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
        """Return the arrays of a report of `residuals`, for chunks of Dask arrays."""
        return residuals.residual_arrays(self.constants, body1, body2, tolerances)

    def jacobian(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        *,
        out: FloatArray | None = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> FloatArray:
        """Compute the Jacobian J in (v2, omega2) = J @ (v1, omega1, psi'), world axes; shape (..., 6, 7) (E8, E2).

        `coordinate_jacobian` is that by the rates of the coordinates.

        Args:
            body1: the motion of body 1, of which S is used.
            psi: hinge angle [rad]; shape (...,).
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.jacobian(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0) @ (0, 0, 0, 0, 0, 1, 2)
        array([0., 4., 0., 0., 0., 3.])
        """
        found: FloatArray = dynamics.ask(
            self, "jacobian", kinematics.body1_inputs(body1, psi), out=out, workers=workers, backend=backend
        )
        return found

    def acceleration_bias(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike,
        *,
        out: FloatArray | None = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> FloatArray:
        """Compute the bias in (a2, alpha2) = J @ (a1, alpha1, psi'') + bias, with J of `jacobian` (E9).

        Args:
            body1: the motion of body 1, of which S and omega are used.
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Returns:
            The bias, world axes: a2 [m/s^2], then alpha2 [rad/s^2]; shape (..., 6).

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body1 = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> pair.acceleration_bias(body1, 0.0, 2.0)
        array([-4.,  0.,  0.,  0.,  0.,  0.])
        """
        found: FloatArray = dynamics.ask(
            self,
            "acceleration_bias",
            kinematics.body1_inputs(body1, psi, psid),
            out=out,
            workers=workers,
            backend=backend,
        )
        return found

    def coordinate_jacobian(
        self,
        q: Coordinates,
        *,
        sequence: str = "XYZ",
        out: FloatArray | None = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> FloatArray:
        """Compute the Jacobian J in (v2, omega2) = J @ qd, world axes; shape (..., 6, 7) (E8, E2, E4).

        Args:
            q: coordinates, as for `forward_kinematics`.
            sequence: as for `forward_kinematics`.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.coordinate_jacobian(np.zeros(7)) @ (0, 0, 0, 0, 0, 1, 2)
        array([0., 4., 0., 0., 0., 3.])
        """
        find_sequence(sequence)
        given = kinematics.coordinate_rows(q, None, None)
        found: FloatArray = dynamics.ask(
            self, "coordinate_jacobian", given, out=out, workers=workers, backend=backend, sequence=sequence
        )
        return found

    def coordinate_jacobian_rate(
        self,
        q: Coordinates,
        qd: Coordinates,
        *,
        sequence: str = "XYZ",
        out: FloatArray | None = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> FloatArray:
        """Compute the time derivative J' of `coordinate_jacobian`, in (a2, alpha2) = J @ qdd + J' @ qd; shape (...,
        6, 7) (E9).

        Args:
            q: coordinates, as for `forward_kinematics`.
            qd: time derivatives of q, in the same forms.
            sequence: as for `forward_kinematics`.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> qd = np.array((0, 0, 0, 0, 0, 0, 2.0))
        >>> pair.coordinate_jacobian_rate(np.zeros(7), qd) @ qd
        array([-4.,  0.,  0.,  0.,  0.,  0.])
        """
        find_sequence(sequence)
        given = kinematics.coordinate_rows(q, qd, None)
        found: FloatArray = dynamics.ask(
            self, "coordinate_jacobian_rate", given, out=out, workers=workers, backend=backend, sequence=sequence
        )
        return found

    def sensitivities(
        self,
        body1: BodyMotion,
        psi: ArrayLike,
        psid: ArrayLike | None = None,
        *,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Sensitivities:
        """Compute the derivatives of d, S2, v2 and omega2 with respect to u1, u2, n and psi (E2, E5-E8).

        R2 has the derivatives of d, because R1 is given.

        Args:
            body1: the motion of body 1, of which S is used, and omega if psid is given.
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; without it, the derivatives of v2 and omega2 are None.
            out: arrays by output name, into which the results are written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.sensitivities(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).d_by_psi + 0.0
        array([0., 1., 0.])
        """
        given = kinematics.body1_inputs(body1, psi, psid)
        names = POSE_SENSITIVITIES if psid is None else (*POSE_SENSITIVITIES, *VELOCITY_SENSITIVITIES)
        found = dynamics.ask(self, "sensitivities", given, out=out, workers=workers, backend=backend, outputs=names)
        return Sensitivities(**found.arrays())

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
        """Compute the covariance of R2 and of body 2's attitude that tolerances of the geometry cause, to first order
        (E5, E7).

        `hingepair.sample_pairs` draws random pairs with the same tolerances, which show whether first order suffices.

        Args:
            body1: the motion of body 1, of which S is used.
            psi: hinge angle [rad]; shape (...,).
            u1_std: standard deviation of each component of u1, body-1 axes [m]: a number, or shape (3,).
            u2_std: the same of u2, body-2 axes.
            axis_std: standard deviation of each of two tilt angles of the hinge axis, about directions across it
                [rad].
            home_std: standard deviation of each component of the rotation vector r by which home deviates, exp(r) @
                home, body-1 axes [rad]: a number, or shape (3,).
            covariance: in place of these, the covariance of the components of u1, u2, n and r, in this order; shape
                (12, 12), such as `HingeFit.covariance`.

        Raises:
            ArgumentError: a covariance and standard deviations are both given, or neither.

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

    def constraint_jacobian(
        self,
        body1: BodyMotion,
        body2: BodyMotion,
        *,
        out: FloatArray | None = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> FloatArray:
        """Compute the Jacobian G of the hinge constraints, (gap', tilt') = G @ (v1, omega1, v2, omega2) (E1, E2).

        Solvers of differential-algebraic equations need G; it is exact even if a motion violates the constraints. gap
        is R1 + S1 u1 - R2 - S2 u2, world axes [m]. tilt has two components, (h1 x h2) . (S1 e1) and (h1 x h2) . (S1
        e2), with the hinge axis as it is fixed in body 1 and in body 2, h1 = S1 n and h2 = S2 C^-1 n, where C is
        `home`. e1 is the coordinate axis of body 1 along which n has its smallest component, made perpendicular to n
        and of unit length; e2 is n x e1.

        Args:
            body1: the motion of body 1, of which S is used.
            body2: the motion of body 2, of which S is used.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Returns:
            G: three rows of gap', two of tilt'; shape (..., 5, 12).

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
        >>> (pair.constraint_jacobian(body, body) @ (0, 0, 0, 0, 0, 1, 0, 4, 0, 0, 0, 3)).tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0]
        """
        given = {**motion_inputs("body1", body1), **motion_inputs("body2", body2)}
        found: FloatArray = dynamics.ask(
            self, "constraint_jacobian", given, out=out, workers=workers, backend=backend
        )
        return found

    def constraint_bias(
        self,
        body1: BodyMotion,
        body2: BodyMotion,
        *,
        out: FloatArray | None = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> FloatArray:
        """Compute the bias in (gap'', tilt'') = G @ (a1, alpha1, a2, alpha2) + bias, with G of `constraint_jacobian`
        (E1, E2).

        Args:
            body1: the motion of body 1, of which S and omega are used.
            body2: the motion of body 2, of which S and omega are used.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: as for `forward_kinematics`.

        Returns:
            The bias: three components of gap'' [m/s^2], two of tilt'' [1/s^2]; shape (..., 5).

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body1 = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> body2 = hp.BodyMotion(R=(2, 0, 0), S=np.eye(3), omega=(0, 0, 2))
        >>> pair.constraint_bias(body1, body2).tolist()
        [-4.0, 0.0, 0.0, 0.0, 0.0]
        """
        given = {**motion_inputs("body1", body1), **motion_inputs("body2", body2)}
        found: FloatArray = dynamics.ask(self, "constraint_bias", given, out=out, workers=workers, backend=backend)
        return found


def _checked_limits(limits: ArrayLike | None) -> tuple[float, float] | None:
    """Return the argument `limits` as floats (lower, upper)."""
    if limits is None:
        return None
    both = one_constant("limits", limits, 2)
    if not both[0] <= both[1]:
        raise ArgumentError("limits", "(lower, upper) with lower <= upper", limits)
    return float(both[0]), float(both[1])


def checked_mass_properties(name: str, body: Body | None) -> Body | None:
    """Return a body, or None, unchanged."""
    if body is None:
        return None
    if not isinstance(body, Body):
        raise ArgumentError(name, "a Body", quoted(body))
    return body
