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
from hingepair.pair.body_motion import SAMPLE_SHAPE_BY_MOTION_ATTRIBUTE, BodyMotion, motion_inputs
from hingepair.pair.computations import COORDINATES, POSE_SENSITIVITIES, VELOCITY_SENSITIVITIES
from hingepair.pair.constants import Constants, check_single_pair, pair_constants
from hingepair.pair.derivatives import Sensitivities
from hingepair.pair.dynamics import DEFAULT_GRAVITY_VECTOR, Accelerations, Energy, Forces, HingeWrench, Momentum
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
    **dict.fromkeys(("body1", "body2"), SAMPLE_SHAPE_BY_MOTION_ATTRIBUTE),
}
"""Shape of one sample of each argument that may be a Dask array."""


@dataclass(frozen=True, slots=True, eq=False, init=False)
class HingePair(Shown):
    """Two rigid bodies joined by a hinge: R1 + S1 u1 = R2 + S2 u2 (E1). They turn relative to each other about the
    hinge axis n only (E2).

    The values are copied, and the attributes are read-only. `dataclasses.replace(pair, u1=...)` returns a pair with
    another u1. u1, u2, n and home may have leading axes, which broadcast against the axes of the samples; each sample
    is then computed with its own values. In the methods, the argument `body1` is the motion of body 1, a
    `BodyMotion`; the attribute `body1`, a `Body`, holds mass properties. All methods raise an ArgumentError, which
    names the argument, if an argument cannot be used.

    Args:
        u1: vector from body 1's reference point to the hinge point, body-1 axes [m]; shape (3,) or (..., 3).
        u2: vector from body 2's reference point to the hinge point, body-2 axes [m]; shape (3,) or (..., 3).
        n: hinge axis, body-1 axes; shape (3,) or (..., 3). A vector of any non-zero length is scaled to unit length.
            The hinge angle psi is positive for a right-handed rotation of body 2 about n.
        home: attitude of body 2 relative to body 1 at psi = 0: the rotation matrix from body-2 axes to body-1 axes (C
            in E5); shape (3, 3) or (..., 3, 3). By default, it is the identity: the axes of both bodies are parallel
            at psi = 0.
        name: name of the pair in exports and messages.
        limits: smallest and largest hinge angle [rad], for exports; shape (2,). By default, there are no limits.
            `forward_kinematics` accepts any angle, and `simulate` does not stop the hinge at the limits unless its
            `hinge_torque` has stops there: `HingeLoad(stops=pair.limits)`.
        body1: mass properties and shapes of body 1, a `Body`, for dynamics, exports and pictures. Without it, methods
            that need the mass of body 1 raise an ArgumentError.
        body2: mass properties and shapes of body 2, a `Body`, for dynamics, exports and pictures. Without it, methods
            that need the mass of body 2 raise an ArgumentError.
        torque_limit: largest torque of the hinge's motor [N m], for exports; by default, no limit. URDF calls it
            effort.
        rate_limit: largest hinge rate [rad/s], for exports; by default, no limit. URDF calls it velocity.
        constants: an internal argument that `dataclasses.replace` passes. With it, values that are not replaced stay
            the same to the last bit.

    Raises:
        ArgumentError: a value is not finite or has the wrong shape.
        AxisError: n is zero or not finite.
        RotationError: home is not a rotation matrix: an element of C C^T, with the matrix C = home, differs from the
            same element of the identity by more than 2e-9, or the determinant of C is negative.

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
        """Return the pair as a Sheet, the table that is printed: geometry, limits and masses."""
        names = ("u1", "u2", "n", "home", "limits", "torque_limit", "rate_limit")
        masses = (("mass1", self.body1 and self.body1.mass), ("mass2", self.body2 and self.body2.mass))
        return sheet_of(self.name, [*((name, getattr(self, name)) for name in names), *masses])

    def _lazily(self, method: Callable[..., Returned], **arguments: Any) -> Returned:
        """Return the result of the function `method` with lazy Dask arrays in it; nothing is computed. The arguments
        of `method` are keyword arguments, some of which contain Dask arrays.
        """
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
        """Compute the PairState of body 2 from the seven coordinates q = (x, y, z, phi_x, phi_y, phi_z, psi)
        (E1-E10). qd and qdd add velocities and accelerations.

        By default, the inputs determine the outputs: q gives position and attitude, qd adds velocities, and qdd adds
        accelerations.

        Args:
            q: coordinates [m, rad]: the position of body 1's reference point, the Euler angles of body 1, and the
                hinge angle. q is one array of shape (..., 7), or a tuple of seven numbers or arrays that broadcast. A
                number in the tuple is the same for all samples, which saves computing time.
            qd: time derivatives of q [m/s, rad/s]: an array (..., 7) or a tuple of seven, like q.
            qdd: second time derivatives of q [m/s^2, rad/s^2]: an array (..., 7) or a tuple of seven, like q.
            outputs: tuple of the names of the outputs to compute, such as ("R2", "v2"), out of R2, S2, d, v2, omega2,
                a2, alpha2, R1, S1, v1, omega1, a1, alpha1. By default, all outputs of body 2 that the inputs allow.
            out: dict whose keys are names of outputs and whose values are arrays, into which the results are written.
                Each array must have the shape of its output and the dtype of the results.
            sequence: Euler sequence of body 1, one of the 24 sequences that SciPy knows. Upper-case sequences such as
                "XYZ" are intrinsic, and lower-case sequences are extrinsic. phi_x, phi_y and phi_z are the angles of
                the first, second and third letter.
            workers: number of threads; -1 for one thread per core.
            backend: "numpy" computes with NumPy, "compiled" with machine code that the first call compiles (0.1 s,
                or milliseconds where it is on disk). "auto" (default) uses machine code where q, qd and qdd are
                arrays, and for coordinates one by one where NumPy would take milliseconds longer. If compiling fails,
                "compiled" raises an error, and "auto" warns and computes with NumPy.

        Returns:
            The PairState. Outputs that are not computed, such as v2 without qd, are None. The dtype is float32 if all
            arrays among the inputs are float32, and float64 otherwise.

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
        gravity: ArrayLike = DEFAULT_GRAVITY_VECTOR,
        workers: int = 1,
        backend: str = "auto",
    ) -> Prepared:
        """Return a Prepared object, a function that computes the results named in `outputs` and is compiled only
        once. It is meant for loops over single states or small batches.

        Args:
            given: names of the inputs as a tuple, in the order in which each call passes them, or a word that stands
                for such a tuple:

                - "pose" stands for ("q",), "velocity" for ("q", "qd"), and "acceleration" for ("q", "qd", "qdd");
                - "inverse_dynamics" stands for ("S1", "omega1", "a1", "alpha1", "psi", "psid", "psidd");
                - "forward_dynamics" stands for ("S1", "omega1", "psi", "psid", "force1", "torque1", "hinge_torque").

                A tuple can hold q, qd, qdd, R1, S1, quat_xyzw, quat_wxyz, v1, omega1, a1, alpha1, psi, psid and
                psidd. For outputs that depend on the motions of both bodies, such as gap, a tuple can also hold R2,
                S2, v2, omega2, a2 and alpha2. For forward dynamics, a tuple can also hold the loads force1, torque1,
                hinge_torque, force2 and torque2 of `forward_dynamics`. Exactly one of the names must be q, S1,
                quat_xyzw or quat_wxyz, which give the attitude of body 1. quat_xyzw and quat_wxyz are quaternions
                from body-1 axes to world axes; the letters are the order of the components.
            outputs: names of the outputs to compute, out of:

                - the outputs of `forward_kinematics`;
                - jacobian, acceleration_bias, coordinate_jacobian, coordinate_jacobian_rate and mass_matrix, the
                  results of the methods with these names;
                - the attributes of `Sensitivities` (d_by_u1, ...);
                - if S2 is an input, the arrays of `Residuals` (gap, tilt, psi, ...), and the results of the methods
                  constraint_jacobian and constraint_bias;
                - force1, torque1 and hinge_torque (`inverse_dynamics`), bearing_torque (`hinge_wrench`), kinetic and
                  potential (`energy`), linear and angular (`momentum`);
                - if a load is an input, the accelerations a1, alpha1 and psidd (`forward_dynamics`).

                If `outputs` is not given, `given` determines the outputs. If a load is an input, they are a1, alpha1
                and psidd. For the word "inverse_dynamics", they are force1, torque1 and hinge_torque. In all other
                cases, they are R2, S2 and d; with qd or psid also v2 and omega2; with qdd or psidd also a2 and
                alpha2. Unless q is an input, R2 needs R1, v2 needs v1, and a2 needs a1. This also
                holds for the default outputs: `given` = ("S1", "psi") alone raises an ArgumentError, because the
                default output R2 needs R1; outputs=("S2", "d") works.
            sequence: Euler sequence of body 1, as for `forward_kinematics`.
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,). By default (0, 0, -9.81).
            workers: number of threads; -1 for one thread per core.
            backend: "auto" (default) and "compiled" compile during this call; "numpy" never compiles. If compiling
                fails, "compiled" raises an error, and "auto" warns and computes with NumPy.

        Returns:
            A `Prepared` object. A call takes the inputs in the order of `given`. Their shapes are (..., 7) for q, qd
            and qdd; (..., 4) for quaternions; (..., 3, 3) for S1 and S2; (...,) for psi, psid, psidd and
            hinge_torque; and (..., 3) for all others. The inputs broadcast against each other. The optional argument
            `out` of a call is a dict whose keys are names of outputs and whose values are arrays, into which the
            results are written. A call returns a `PairState`. Each output can be read by its name, such as
            `state["gap"]`. The outputs of `forward_kinematics`, jacobian, acceleration_bias, coordinate_jacobian,
            coordinate_jacobian_rate, force1, torque1, hinge_torque and psidd are also attributes of the PairState,
            such as `state.R2`. The attributes `source` and `llvm` of the Prepared object are the generated Python
            code and the generated LLVM code, as text.

        Raises:
            ArgumentError: a name is unknown, or an output needs an input or the mass of a body that is not given. The
                error names what is unknown or missing.

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
        """Compute the PairState of body 2 from the BodyMotion of body 1 and the hinge angle, without Euler angles
        (E1, E2, E5-E9). psid and psidd add velocities and accelerations.

        By default, R2, S2 and d are computed, with psid also v2 and omega2, and with psidd also a2 and alpha2.
        Velocities need v and omega of body1, and accelerations also a and alpha of body1. psidd needs psid.

        Args:
            body1: the motion of body 1.
            psi: hinge angle, right-handed about n [rad]; shape (...,); broadcasts against body1.
            psid: time derivative of psi [rad/s]; shape (...,).
            psidd: second time derivative of psi [rad/s^2]; shape (...,).
            outputs: names of the outputs to compute, as for `forward_kinematics`. Only inputs that these outputs need
                must be given.
            out: dict of arrays into which the results are written, as for `forward_kinematics`.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The PairState. Outputs that are not computed, such as v2 without psid, are None.

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
        """Compute bounds on the error that rounding can cause in each output of `forward_kinematics`. Return a dict
        whose keys are the names of the outputs. Its values are arrays (...,): one bound for each sample, which holds
        for every component of the output.

        The error is the difference from the exact result of the equations for the given inputs, which are taken as
        exact: q, qd, qdd, u1, u2, home, and n before it is scaled to unit length. The bounds are rigorous for
        the backends "numpy" and "compiled" if sines and cosines are accurate to 1.5 units in the last place. Actual
        errors are usually at most a third of the bounds. They can be closer to the bounds if only a few operations
        cause rounding errors.

        Args:
            q: coordinates [m, rad], as for `forward_kinematics`.
            qd: time derivatives of q [m/s, rad/s], as for `forward_kinematics`.
            qdd: second time derivatives of q [m/s^2, rad/s^2], as for `forward_kinematics`.
            outputs: names of the outputs, as for `forward_kinematics`.
            sequence: Euler sequence of body 1, as for `forward_kinematics`.

        Returns:
            A dict whose keys are the names of the outputs, such as "R2". Each value is an array of bounds in the unit
            of the output; shape (...,). A bound is infinite if an intermediate result overflows, or if an input is
            NaN or infinite.

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
        """Compute bounds on the error that rounding can cause in each output of `forward_kinematics_from_body1`.
        Return a dict whose keys are the names of the outputs. Its values are arrays (...,): one bound for each
        sample, which holds for every component of the output.

        The error is the difference from the exact result of the equations for the given inputs, which are taken as
        exact. The bounds do not include rounding errors that body1 already contains, for instance from a conversion
        of quaternions to S. `error_bounds` says under which condition the bounds are rigorous.

        Args:
            body1: the motion of body 1, as for `forward_kinematics_from_body1`.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1.
            psid: time derivative of psi [rad/s]; shape (...,).
            psidd: second time derivative of psi [rad/s^2]; shape (...,).
            outputs: names of the outputs, as for `forward_kinematics`.

        Returns:
            A dict whose keys are the names of the outputs, such as "R2". Each value is an array of bounds in the unit
            of the output; shape (...,). A bound is infinite if an intermediate result overflows, or if an input is
            NaN or infinite.

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
        """Compute the mass matrix M in M @ (a1, alpha1, psi'') + bias = (force1, torque1, hinge_torque), shape (...,
        7, 7) (T4).

        bias is the value of (force1, torque1, hinge_torque) for a1 = 0, alpha1 = 0 and psi'' = 0; velocities and
        gravity cause it.

        Args:
            body1: the motion of body 1; only S is used.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            M, a symmetric matrix; shape (..., 7, 7). Its elements are masses [kg], first moments of mass [kg m] and
            moments of inertia [kg m^2]. a1, alpha1, force1 and torque1 are in world axes, force1 acts at R1, and
            torque1 is about R1.

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
        gravity: ArrayLike = DEFAULT_GRAVITY_VECTOR,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Forces:
        """Compute the Forces that a motion requires: force and torque on body 1, and the torque about the hinge axis
        (T1-T3).

        Args:
            body1: the motion of body 1; S, omega, a and alpha are used.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1, as do psid and psidd.
            psid: time derivative of psi [rad/s]; shape (...,).
            psidd: second time derivative of psi [rad/s^2]; shape (...,).
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,). By default (0, 0, -9.81).
            out: dict whose keys are attributes of the result and whose values are arrays, which are written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The Forces. Its attributes force1 [N] and torque1 [N m] are the force at R1 and the torque about R1 that
            must act on body 1; world axes, shape (..., 3). Its attribute hinge_torque [N m] is the torque that body 1
            must exert on body 2 about the hinge axis; shape (...,). Gravity acts in addition to these forces.

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
        gravity: ArrayLike = DEFAULT_GRAVITY_VECTOR,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Accelerations:
        """Compute the Accelerations of body 1 and of the hinge angle under gravity and under the forces and torques
        on both bodies (T5, T6).

        The arrays broadcast against each other. By default, all forces and torques are 0.

        Args:
            body1: the motion of body 1; only S and omega are used.
            psi: hinge angle [rad]; shape (...,).
            psid: time derivative of psi [rad/s]; shape (...,).
            force1: force on body 1 at R1, world axes [N]; shape (..., 3).
            torque1: torque on body 1 about R1, world axes [N m]; shape (..., 3).
            hinge_torque: torque that body 1 exerts on body 2 about the hinge axis [N m]; shape (...,).
            force2: force on body 2 at R2, world axes [N]; shape (..., 3).
            torque2: torque on body 2 about R2, world axes [N m]; shape (..., 3).
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,). By default (0, 0, -9.81).
            out: dict whose keys are attributes of the result and whose values are arrays, which are written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The Accelerations, with the attributes a1 [m/s^2] and alpha1 [rad/s^2] of body 1, world axes, shape
            (..., 3), and psidd [rad/s^2], shape (...,). Where the mass matrix is singular, for instance because body
            2 has no inertia about the hinge axis, they are NaN, and a DynamicsWarning says so.

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
        gravity: ArrayLike = DEFAULT_GRAVITY_VECTOR,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> HingeWrench:
        """Compute the HingeWrench: the force and torque that body 1 exerts on body 2 at the hinge point (T3).

        Args:
            body1: the motion of body 1; S, omega, a and alpha are used.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1, as do psid and psidd.
            psid: time derivative of psi [rad/s]; shape (...,).
            psidd: second time derivative of psi [rad/s^2]; shape (...,).
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,). By default (0, 0, -9.81).
            out: dict whose keys are attributes of the result and whose values are arrays, which are written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The HingeWrench. Its attributes force [N] and torque [N m] are in world axes, shape (..., 3). The torque
            is about the hinge point. Two more attributes are the parts of the torque: hinge_torque, the component
            along the hinge axis, shape (...,), and bearing_torque, the vector perpendicular to the axis, world axes,
            shape (..., 3).

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
        gravity: ArrayLike = DEFAULT_GRAVITY_VECTOR,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Energy:
        """Compute the kinetic and potential Energy of the pair in uniform gravity (T7). If body 1 has no mass
        properties, return the energy of body 2 alone.

        Args:
            body1: the motion of body 1; R, S, v and omega are used.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1.
            psid: time derivative of psi [rad/s]; shape (...,).
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,). By default (0, 0, -9.81).
            out: dict whose keys are attributes of the result and whose values are arrays, which are written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The Energy, with the attributes kinetic and potential [J], shape (...,). The potential energy is
            that of gravity alone. The potential energy of a mass at the world's origin is zero.

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
        """Compute the Momentum of the pair: linear, and angular about the world's origin (T8).

        Args:
            body1: the motion of body 1; R, S, v and omega are used.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1.
            psid: time derivative of psi [rad/s]; shape (...,).
            out: dict whose keys are attributes of the result and whose values are arrays, which are written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The Momentum, with the attributes linear [kg m/s] and angular [kg m^2/s], world axes, shape (..., 3).

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
        """Compute the Residuals of two BodyMotions: by how much the motions violate the hinge constraints E1 and E2
        and the time derivatives of these constraints. The residuals are compared with `tolerances`, a dict whose keys
        are names of residuals; the default tolerances cover rounding errors. For Dask arrays, return LazyResiduals.

        Args:
            body1: the motion of body 1.
            body2: the motion of body 2. tilt_rate is computed if both motions have omega, and gap_rate if they also
                have v. tilt_acceleration is computed if both motions have omega and alpha, and gap_acceleration if
                they also have v and a.
            tolerances: largest allowed size of each residual, a dict with some of the keys gap [m], tilt [rad],
                gap_rate [m/s], tilt_rate [rad/s], gap_acceleration [m/s^2] and tilt_acceleration [rad/s^2]. The size
                of the gap is the distance between the hinge points of both bodies. The size of the tilt is the angle
                between the hinge axes of both bodies, in [0, pi]. The size of any other residual is the norm of its
                array at the sample. Residuals without a key have the default tolerance, which covers rounding errors:
                32 u times a scale. u is the unit roundoff, 2^-53 in double precision. The printed Residuals show the
                formula of the scale.
            t: instants of the samples, numbers [s] or datetime64; broadcasts against the samples. The printed
                Residuals show the instant of the worst sample of each residual.

        Returns:
            The `Residuals`. `.ok` is True if all residuals are within their tolerances, and `.verdict` says so in one
            line of text. `str()` gives a table, and `.to_json()` a JSON text. `.rows` is a tuple with a
            `ResidualCheck` for each residual. The residuals at every sample are arrays such as `.gap` (..., 3) [m],
            the vector R1 + S1 u1 - R2 - S2 u2 in world axes, and `.tilt_angle` (...,) [rad]. `.psi` (...,) [rad] is
            the hinge angle; if the hinge axes of the two bodies differ, it is the hinge angle after the smallest
            rotation of body 2 that aligns them. A residual that is not finite at a sample is not compared there;
            `.ok` is False if there is a residual that is compared at no sample. `.skipped` is the number of samples
            at which at least one residual is not finite.

            If the motions hold Dask arrays, the result is a `LazyResiduals`. Its arrays, such as `.gap`, are Dask
            arrays. Its `.ratio` (...,) is, at each sample, the largest of the quotients residual / tolerance; NaN if
            no residual is finite. Its `.compute()` returns the `Residuals` in memory. For motions larger than memory,
            its `.compute_summary()` returns `Residuals` whose arrays stay Dask arrays.

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
        """Compute the arrays of a report of `residuals`, among them the sizes and tolerances of each residual, and
        return them as a dict.
        """
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
        """Compute the Jacobian Jac in (v2, omega2) = Jac @ (v1, omega1, psi'), shape (..., 6, 7) (E8, E2).

        `coordinate_jacobian` computes the matrix that multiplies qd, the time derivatives of the seven coordinates.

        Args:
            body1: the motion of body 1; only S is used.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The Jacobian Jac, for velocities in world axes; shape (..., 6, 7).

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
        """Compute the part of body 2's acceleration that velocities cause, shape (..., 6). This part is `bias` in
        (a2, alpha2) = Jac @ (a1, alpha1, psi'') + bias (E9).

        Jac is the matrix that `jacobian` returns. (a2, alpha2) is a vector of 6 components, and
        (a1, alpha1, psi'') is a vector of 7. a1 and alpha1 are the linear and angular acceleration of body 1.

        Args:
            body1: the motion of body 1; only S and omega are used.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1.
            psid: time derivative of psi [rad/s]; shape (...,).
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The bias, world axes: three components of a2 [m/s^2], then three of alpha2 [rad/s^2]; shape (..., 6).

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
        """Compute the Jacobian Jq in (v2, omega2) = Jq @ qd, shape (..., 6, 7). qd is the vector of the time
        derivatives of the seven coordinates q (E8, E2, E4).

        Args:
            q: coordinates [m, rad], as for `forward_kinematics`.
            sequence: Euler sequence of body 1, as for `forward_kinematics`.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The Jacobian Jq; shape (..., 6, 7). Its first three rows give v2, and its last three rows give omega2, in
            world axes.

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
        """Compute the time derivative Jq' of the Jacobian Jq that `coordinate_jacobian` returns, shape (..., 6, 7)
        (E9). The accelerations are (a2, alpha2) = Jq @ qdd + Jq' @ qd.

        Args:
            q: coordinates [m, rad], as for `forward_kinematics`.
            qd: time derivatives of q [m/s, rad/s], as for `forward_kinematics`.
            sequence: Euler sequence of body 1, as for `forward_kinematics`.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The time derivative Jq'; shape (..., 6, 7). Its first three rows contribute to a2, and its last three rows
            contribute to alpha2, in world axes.

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
        """Compute the Sensitivities: the derivatives of d = R2 - R1, S2, v2 and omega2 with respect to u1, u2, n and
        psi (E2, E5-E8). Without psid, the derivatives of v2 and omega2 are None.

        R2 has the same derivatives as d, because R1 is given.

        Args:
            body1: the motion of body 1; only S is used, and omega if psid is given.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1.
            psid: time derivative of psi [rad/s]; shape (...,).
            out: arrays by output name, into which the results are written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The Sensitivities. Each derivative is an attribute. The components of d, v2 and omega2 are in world axes,
            those of u1 and n in body-1 axes, and those of u2 in body-2 axes. For example, d_by_u1 has shape
            (..., 3, 3). The element [..., i, j] is the derivative of d[i] with respect to u1[j]. Derivatives with
            respect to psi do not have the last axis: S2_by_n has shape (..., 3, 3, 3), and S2_by_psi has shape
            (..., 3, 3). The page of `Sensitivities` lists all of them with their units.

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
        """Compute the PoseCovariance: the covariance of R2 and of body 2's attitude that tolerances of u1, u2, n and
        home cause, to first order (E5, E7). Give the tolerances as standard deviations or as one covariance (12, 12).

        `hingepair.sample_pairs` draws random pairs with the same tolerances. A comparison of the poses of these pairs
        with the covariance shows whether the first-order result is accurate enough.

        Args:
            body1: the motion of body 1; only S is used.
            psi: hinge angle [rad]; shape (...,); broadcasts against body1.
            u1_std: standard deviation of each component of u1, body-1 axes [m]: a number, or shape (3,).
            u2_std: standard deviation of each component of u2, body-2 axes [m]: a number, or shape (3,).
            axis_std: standard deviation of each of two tilt angles of the hinge axis [rad]. The tilts are about two
                directions that are perpendicular to n and to each other.
            home_std: standard deviation of each component of the rotation vector r by which home deviates, body-1
                axes [rad]: a number, or shape (3,). The actual home is exp(r) @ home, where exp(r) is the rotation
                matrix of r.
            covariance: covariance matrix of twelve numbers in this order: the components of u1 (body-1 axes) [m], of
                u2 (body-2 axes) [m], of n (body-1 axes), and of the rotation vector r as for home_std (body-1 axes)
                [rad]; shape (12, 12), such as `HingeFit.covariance`. Give either a covariance or standard deviations,
                not both.

        Returns:
            The PoseCovariance. Its attributes are the standard deviations R2_std [m] and attitude_std [rad], shape
            (..., 3), and the covariances R2 [m^2] and attitude [rad^2], shape (..., 3, 3), in world axes. The error
            of the attitude is the rotation vector, in world axes, from the nominal to the actual attitude of body 2.
            The method contributions() returns the variances that each tolerance alone causes, as a dict of arrays
            (..., 6): the variances of the three components of R2 [m^2], then of the three components of the
            attitude's error [rad^2]. The keys are "u1_x" to "u2_z", "axis" (all components of n together), and
            "home_x" to "home_z". The correlations of different keys are ignored.

        Raises:
            ArgumentError: an argument cannot be used, a covariance and standard deviations are both given, or all
                standard deviations are 0 and no covariance is given.

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
        """Compute the Jacobian G of the five hinge constraints, shape (..., 5, 12). The time derivatives of the
        constraints are (gap', tilt') = G @ (v1, omega1, v2, omega2) (E1, E2).

        Solvers of differential-algebraic equations need G. The five constraints are gap = 0 and tilt = 0. gap is the
        vector R1 + S1 u1 - R2 - S2 u2, with three components in world axes [m]. tilt has two dimensionless
        components. Let h1 = S1 n and h2 = S2 C^-1 n be the directions of the hinge axis as fixed in
        body 1 and as fixed in body 2, in world axes, where C is `home`. The components of tilt are (h1 x h2) . (S1
        e1) and (h1 x h2) . (S1 e2). e1 and e2 are fixed in body 1 and form an orthonormal basis with n. e1 is a
        coordinate axis of body 1, projected onto the plane perpendicular to n and scaled to unit length. This
        coordinate axis is the one along which n has the component of smallest magnitude; if there are several, it is
        the first of them. e2 is n x e1. The Jacobian is exact even if a motion violates the constraints.

        Args:
            body1: the motion of body 1; only S is used.
            body2: the motion of body 2; only S is used.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The Jacobian G; shape (..., 5, 12). The first three rows of G give gap', and the last two rows give tilt'.
            v1, omega1, v2 and omega2 are in world axes.

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
        """Compute the part of the constraints' second time derivatives that velocities cause, shape (..., 5). This
        part is `bias` in (gap'', tilt'') = G @ (a1, alpha1, a2, alpha2) + bias (E1, E2).

        gap is the vector from the hinge point of body 2 to the hinge point of body 1, and tilt has two dimensionless
        components. `constraint_jacobian` defines gap and tilt, and returns G. If a motion satisfies the constraints
        at all times, gap'' and tilt'' are zero, but the bias is in general not zero.

        Args:
            body1: the motion of body 1; only S and omega are used.
            body2: the motion of body 2; only S and omega are used.
            out: array into which the result is written.
            workers: number of threads; -1 for one thread per core.
            backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

        Returns:
            The bias: three components for gap'' in world axes [m/s^2], then two for tilt'' [1/s^2]; shape (..., 5).

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
    """Return the argument `limits`, the limits of the hinge angle [rad], as floats (lower, upper), or None if it is
    None.
    """
    if limits is None:
        return None
    both = one_constant("limits", limits, 2)
    if not both[0] <= both[1]:
        raise ArgumentError("limits", "(lower, upper) with lower <= upper", limits)
    return float(both[0]), float(both[1])


def checked_mass_properties(name: str, body: Body | None) -> Body | None:
    """Return the argument `body` unchanged if it is a Body or None."""
    if body is None:
        return None
    if not isinstance(body, Body):
        raise ArgumentError(name, "a Body", quoted(body))
    return body
