"""The pair of two bodies that are joined by a hinge."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, quoted, warn_of_dynamics
from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.options import (
    DEFAULT_GRAVITY,
    EULER_OPTIONS,
    GRAVITY_OPTIONS,
    OUT_OPTIONS,
    Options,
    with_options,
)
from hingepair.mechanism.pairs import residuals
from hingepair.mechanism.pairs.geometry import Points, checked_record, spatial_arrays
from hingepair.mechanism.pairs.residuals import Residuals
from hingepair.mechanism.pairs.subject import PairSubject, body1_inputs
from hingepair.mechanism.pairs.tolerances import (
    TOLERANCE_DEFAULTS,
    PoseCovariance,
    ToleranceOptions,
    propagate_covariance,
)
from hingepair.mechanism.requests import MOTION_LEVELS, ROWS, ask, coordinate_rows
from hingepair.mechanism.states import (
    Accelerations,
    Energy,
    Forces,
    HingeWrench,
    Momentum,
    PairState,
)
from hingepair.numeric.arrays import (
    FloatArray,
    Frozen,
    call_text,
    is_zero,
    number_not_below_0,
    one_constant,
    set_frozen,
)
from hingepair.plans.arguments import Coordinates, Outputs
from hingepair.plans.pairs import SPACE
from hingepair.plans.prepared import Prepared
from hingepair.tables.sheets import Sheet, Shown, sheet_of
from hingepair.tables.suspicions import suspicions

if TYPE_CHECKING:
    from hingepair import Mechanism


@dataclass(frozen=True, slots=True, eq=False, init=False)
class HingePair(Frozen, Shown):
    """Two rigid bodies joined by a hinge, R1 + S1 u1 = R2 + S2 u2 (E1), which turn relative to each other about the
    hinge axis n only (E2).

    Values are copied and read-only; `dataclasses.replace(pair, u1=...)` returns a pair with another u1. u1, u2, n and
    home may have leading axes, which broadcast against those of the samples: each sample has its own pair.

    The methods share these arguments:

    - q, qd, qdd: coordinates (x, y, z, phi_x, phi_y, phi_z, psi), that is, the position of body 1's reference point
      [m], its Euler angles and the hinge angle [rad], and their first and second time derivatives. Each is one array
      (..., 7); a tuple of seven numbers, the same for all samples, which saves time, and arrays that broadcast; a
      dict by name; or a table with these columns.
    - sequence: Euler sequence of body 1, one of the 24 that SciPy knows: upper case intrinsic, lower case extrinsic.
      phi_x, phi_y and phi_z are the angles of its first, second and third letter.
    - body1, body2: motions of the bodies, a `BodyMotion` each; as body1, None is a body at rest at the origin. (The
      attributes of these names are a `Body` each.)
    - psi, psid, psidd: hinge angle, right-handed about n [rad], and its first and second time derivative; shape
      (...,), which broadcasts against body1.
    - outputs: names out of R2, S2, d, v2, omega2, a2, alpha2, R1, S1, v1, omega1, a1, alpha1, and of points, such as
      tip, tip_v and tip_a. By default, those of body 2 for which the other arguments suffice.
    - gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
    - out: array into which the result is written; of methods with several outputs, arrays by output name.
    - workers: number of threads; -1 for one thread per core.
    - backend: "numpy"; "compiled", machine code that the first call compiles (0.1 s, or milliseconds where it is on
      disk); or "auto", which compiles for arrays, and for coordinates one by one where NumPy would take milliseconds
      longer.

    Results are float32 if all arrays given are float32, else float64. Methods that need the mass of a body raise an
    ArgumentError if the pair has no mass properties of it.

    Args:
        u1: hinge point from body 1's reference point, body-1 axes [m]; shape (3,) or (..., 3).
        u2: hinge point from body 2's reference point, body-2 axes [m]; shape (3,) or (..., 3).
        n: hinge axis, body-1 axes, of any non-zero length, stored at unit length; shape (3,) or (..., 3).
        home: attitude of body 2 relative to body 1 at psi = 0, from body-2 axes to body-1 axes (C in E5); shape (3,
            3) or (..., 3, 3); by default the identity.
        name: name of the pair in exports and messages.
        limits: smallest and largest hinge angle [rad], for exports and `HingeLoad(stops=pair.limits)`; shape (2,). No
            method enforces them. A DynamicsWarning says if they look like degrees.
        body1: mass properties and shapes of body 1, for dynamics, exports and pictures.
        body2: mass properties and shapes of body 2.
        torque_limit: largest torque of the motor [N m], for exports; URDF calls it effort.
        rate_limit: largest hinge rate [rad/s], for exports; URDF calls it velocity.
        points1: further points of body 1 by name, from its reference point, body-1 axes [m]; shape (3,) or (..., 3)
            each. They have no mass. A point called tip is an output of kinematics, with its velocity tip_v and its
            acceleration tip_a; exports write it, and it is a frame of a `Mechanism`.
        points2: further points of body 2, body-2 axes.

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
    points1: Points
    points2: Points
    _subject: PairSubject

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
        points1: Mapping[str, ArrayLike] | None = None,
        points2: Mapping[str, ArrayLike] | None = None,
        *,
        _subject: PairSubject | None = None,  # dataclasses.replace passes it: n keeps its last bits
    ) -> None:
        record = checked_record(3, name, body1, body2, points1, points2)
        axis = _subject.axis if _subject is not None and n is _subject.arrays["n"] else n
        arrays, given_axis = spatial_arrays(u1, u2, n if axis is None else axis, home)
        points = record["points1"], record["points2"]
        checked = checked_limits(limits)
        # Files of robots have limits of some turns; degrees are whole numbers, up to a turn.
        if checked and _subject is None and any(45 <= abs(x) <= 360 and x.is_integer() for x in checked):
            for sentence in suspicions("written angles", "limits", checked):
                warn_of_dynamics(sentence)
        most = {"torque_limit": torque_limit, "rate_limit": rate_limit}
        set_frozen(
            self,
            **arrays,
            **record,
            limits=checked,
            **{key: None if value is None else number_not_below_0(key, value) for key, value in most.items()},
            _subject=PairSubject(record["name"], SPACE, arrays, given_axis, points, (body1, body2)),
        )

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "_subject"}
        points = {key: dict(arguments[key]) for key in ("points1", "points2")}
        return partial(type(self), **arguments | points | {"n": self._subject.axis}), ()

    def __repr__(self) -> str:
        limits = ("limits", "torque_limit", "rate_limit")
        return call_text(self, "u1", "u2", "n", "home", "name", *limits, "body1", "body2", "points1", "points2")

    def _sheet(self) -> Sheet:
        """Return the printed table: geometry, limits and masses."""
        return pair_sheet(self, ("u1", "u2", "n", "home", "limits", "torque_limit", "rate_limit"))

    @with_options(*EULER_OPTIONS)
    def forward_kinematics(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        **options: Unpack[Options],
    ) -> PairState:
        """Compute the motion of body 2 from the seven coordinates (E1-E10); qd adds velocities, qdd accelerations.

        Arguments: see `HingePair`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> state = pair.forward_kinematics(np.zeros((5, 7)), np.ones((5, 7)))
        >>> state.v2[0]
        array([ 1.,  4., -1.])
        """
        given = coordinate_rows(q, qd, qdd)
        return ask(self._subject, MOTION_LEVELS[len(given) - 1], given, options)

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
        small batches. Arguments not listed: see `HingePair`.

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

                - those of `forward_kinematics`, jacobian, acceleration_bias and mass_matrix; without q, R2 needs R1,
                  v2 needs v1, and a2 needs a1;
                - with S2 the arrays of `Residuals`;
                - force1, torque1, hinge_torque, hinge_force, hinge_moment, bearing_torque, kinetic, potential, linear
                  and angular; with a load a1, alpha1 and psidd.

                By default those of the method; of a tuple of names those of `forward_kinematics`, or with a load a1,
                alpha1 and psidd.
            backend: "auto" and "compiled" compile during this call, "numpy" never does.

        Returns:
            A `Prepared`, whose calls return a `PairState`: `state.R2`, and all outputs as `state["gap"]`; of a word
            what the method returns, unless that is an array.

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
        how = execution_of(backend, workers)
        return self._subject.prepare(self.prepare, given, outputs, how, gravity=gravity, sequence=sequence)

    @with_options("outputs", *OUT_OPTIONS)
    def forward_kinematics_from_body1(
        self,
        body1: BodyMotion | None,
        psi: ArrayLike,
        psid: ArrayLike | None = None,
        psidd: ArrayLike | None = None,
        **options: Unpack[Options],
    ) -> PairState:
        """Compute the motion of body 2 from that of body 1 and the hinge angle, without Euler angles (E1, E2, E5-E9);
        psid adds velocities, psidd accelerations.

        Arguments: see `HingePair`. Only what the outputs need must be given.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.forward_kinematics_from_body1(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).R2
        array([2., 0., 0.])
        """
        given = body1_inputs(body1, psi, psid, psidd)
        return ask(self._subject, "from_body1", tuple(given.values()), options, tuple(given))

    def error_bounds(
        self,
        q: Coordinates | BodyMotion,
        qd: Any = None,
        qdd: Any = None,
        psidd: ArrayLike | None = None,
        *,
        outputs: Outputs = None,
        sequence: str = "XYZ",
    ) -> dict[str, NDArray[np.float64]]:
        """Compute rigorous bounds on the rounding errors of `forward_kinematics` or, of the arguments (body1, psi,
        psid, psidd), of `forward_kinematics_from_body1`, at every sample.

        The error is the largest difference of a component from the exact result of the equations for the given
        numbers, among them n before it is scaled to unit length. Errors that body1 already has, such as from
        quaternions, are not included. The bounds hold for all backends if sines and cosines are accurate to 1.5 units
        in the last place; actual errors are usually below a third of them. Arguments: see `HingePair`.

        Returns:
            Bounds by output name, in its unit, in NumPy whatever the arguments are; shape (...,). Infinite where an
            intermediate result overflows or an input is not finite.

        Raises:
            ShapeError: the pair has leading axes.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> bounds = pair.error_bounds((np.array([0.0, 1e9]), 0, 0, 0.3, 0.4, 0.5, 0.6))  # here, and far away
        >>> [f"{bound:.0e}" for bound in bounds["R2"]], [f"{bound:.0e}" for bound in bounds["d"]]
        (['1e-15', '6e-08'], ['1e-15', '1e-15'])
        >>> f"{pair.error_bounds(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.5)['R2']:.0e}"
        '3e-16'
        """
        if isinstance(q, BodyMotion):
            if sequence != "XYZ":
                raise ArgumentError("sequence", "nothing, since there are no Euler angles", quoted(sequence))
            return self._subject.error_bounds(body1_inputs(q, qd, qdd, psidd), outputs)
        if psidd is not None:
            raise ArgumentError("psidd", "nothing, since the first argument is no BodyMotion", quoted(psidd))
        given = dict(zip(ROWS, coordinate_rows(q, qd, qdd), strict=False))
        return self._subject.error_bounds(given, outputs, sequence)

    def with_strut(self, point1: str, point2: str, name: str, **strut: Any) -> Mechanism:
        """Return the robot of this joint alone, on a fixed base, with a strut between two of its points: a spring, a
        damper, a gas spring. The joint has the name of the pair.

        Args:
            point1: name of the point, out of points1 and points2, at which the strut begins.
            point2: where it ends, on the other body.
            name: name of the strut.
            strut: its force, free_length, limits and so on, as for `Mechanism.with_strut`.

        >>> import hingepair as hp
        >>> points = {"points1": {"foot": (0.3, 0, -0.2)}, "points2": {"eye": (0.5, 0, 0)}}
        >>> lid = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 1, 0), name="lid", **points)
        >>> hatch = lid.with_strut("foot", "eye", "gas", force=hp.GasSpring(300, 400, 0.2), free_length=0.48)
        >>> round(float(hatch.struts({"lid": -0.2})["gas"].length), 4)
        0.3546
        """
        from hingepair import Mechanism  # made of pairs: only a caller of this method needs what lies above

        return Mechanism([self]).with_strut(point1, point2, name, **strut)

    @with_options(*OUT_OPTIONS)
    def mass_matrix(self, body1: BodyMotion | None, psi: ArrayLike, **options: Unpack[Options]) -> FloatArray:
        """Compute the mass matrix M in M @ (a1, alpha1, psi'') + bias = (force1, torque1, hinge_torque) (T4).

        It is symmetric; shape (..., 7, 7) [kg, kg m, kg m^2]. force1 and torque1 are those of `inverse_dynamics`.
        Arguments: see `HingePair`; of body1, S is used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
        >>> pair.mass_matrix(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0).diagonal().round(12).tolist()
        [4.0, 4.0, 4.0, 2.0, 10.0, 10.0, 3.0]
        """
        return self._subject.ask_of_body1("mass_matrix", body1, options, psi=psi)

    @with_options(*GRAVITY_OPTIONS)
    def inverse_dynamics(
        self,
        body1: BodyMotion | None,
        psi: ArrayLike,
        psid: ArrayLike,
        psidd: ArrayLike,
        **options: Unpack[Options],
    ) -> Forces:
        """Compute the force and torque on body 1 and the hinge torque that a motion requires beside gravity (T1-T3).

        Arguments: see `HingePair`; of body1, S, omega, a and alpha are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body1=body, body2=body)
        >>> still = hp.BodyMotion.at_rest()
        >>> forces = pair.inverse_dynamics(still, psi=0.0, psid=0.0, psidd=0.0)
        >>> forces.force1.round(9).tolist(), forces.hinge_torque.round(9).tolist()
        ([0.0, 0.0, 39.24], -19.62)
        """
        hinge = {"psi": psi, "psid": psid, "psidd": psidd}
        return self._subject.ask_of_body1("inverse_dynamics", body1, options, **hinge)

    @with_options(*GRAVITY_OPTIONS)
    def forward_dynamics(
        self,
        body1: BodyMotion | None,
        psi: ArrayLike,
        psid: ArrayLike,
        *,
        force1: ArrayLike = 0,
        torque1: ArrayLike = 0,
        hinge_torque: ArrayLike = 0.0,
        force2: ArrayLike = 0,
        torque2: ArrayLike = 0,
        **options: Unpack[Options],
    ) -> Accelerations:
        """Compute the accelerations of the pair under gravity and the forces and torques on both bodies (T5, T6).
        Arguments not listed: see `HingePair`; of body1, S and omega are used.

        Args:
            force1: force on body 1 at R1, world axes [N]; shape (..., 3).
            torque1: torque on body 1 about R1, world axes [N m]; shape (..., 3).
            hinge_torque: torque of body 1 on body 2 about the hinge axis [N m]; shape (...,).
            force2: force on body 2 at R2, world axes [N]; shape (..., 3).
            torque2: torque on body 2 about R2, world axes [N m]; shape (..., 3).

        Returns:
            The Accelerations; NaN, with a DynamicsWarning, where the mass matrix is singular, such as where body 2
            has no inertia about the hinge axis.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body1=body, body2=body)
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> accelerations = pair.forward_dynamics(still, psi=0.3, psid=0.0)  # only gravity acts: both bodies fall
        >>> accelerations.a1.round(9).tolist(), abs(round(float(accelerations.psidd), 9))
        ([0.0, 0.0, -9.81], 0.0)
        """
        hinge = {"psi": psi, "psid": psid, "hinge_torque": hinge_torque}
        loads = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
        loads = {name: load for name, load in loads.items() if not is_zero(load)}
        return self._subject.ask_of_body1("forward_dynamics", body1, options, **hinge, **loads)

    @with_options(*GRAVITY_OPTIONS)
    def hinge_wrench(
        self,
        body1: BodyMotion | None,
        psi: ArrayLike,
        psid: ArrayLike,
        psidd: ArrayLike,
        **options: Unpack[Options],
    ) -> HingeWrench:
        """Compute the force and torque that body 1 exerts on body 2 at the hinge point (T3); body 1 needs no mass.

        Arguments: see `HingePair`; of body1, S, omega, a and alpha are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body2=body)
        >>> still = hp.BodyMotion.at_rest()
        >>> pair.hinge_wrench(still, psi=0.0, psid=0.0, psidd=0.0).force.round(9).tolist()
        [0.0, 0.0, 19.62]
        """
        hinge = {"psi": psi, "psid": psid, "psidd": psidd}
        return self._subject.ask_of_body1("hinge_wrench", body1, options, **hinge)

    @with_options(*GRAVITY_OPTIONS)
    def energy(self, body1: BodyMotion | None, psi: ArrayLike, psid: ArrayLike, **options: Unpack[Options]) -> Energy:
        """Compute the kinetic and potential energy of the pair in uniform gravity (T7); that of body 2 alone if body
        1 has no mass properties.

        Arguments: see `HingePair`; of body1, R, S, v and omega are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
        >>> body1 = hp.BodyMotion(R=(0, 0, 2), S=np.eye(3), v=(1, 0, 0), omega=(0, 0, 0))
        >>> [round(float(part), 9) for part in pair.energy(body1, psi=0.0, psid=0.0)]
        [2.0, 78.48]
        """
        return self._subject.ask_of_body1("energy", body1, options, psi=psi, psid=psid)

    @with_options(*OUT_OPTIONS)
    def momentum(
        self, body1: BodyMotion | None, psi: ArrayLike, psid: ArrayLike, **options: Unpack[Options]
    ) -> Momentum:
        """Compute the momentum of the pair: linear, and angular about the world's origin (T8).

        Arguments: see `HingePair`; of body1, R, S, v and omega are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> body = hp.Body(mass=2, inertia=(1, 1, 1))
        >>> pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
        >>> body1 = hp.BodyMotion(R=(0, 0, 2), S=np.eye(3), v=(1, 0, 0), omega=(0, 0, 0))
        >>> pair.momentum(body1, psi=0.0, psid=0.0).linear.tolist()
        [4.0, 0.0, 0.0]
        """
        return self._subject.ask_of_body1("momentum", body1, options, psi=psi, psid=psid)

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
            The `Residuals`; `.ok` says whether all are within their tolerances, `print` gives a table. Residuals
            that are not finite at a sample are not compared there.

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
        return residuals.residuals(self._subject, body1, body2, tolerances, t)

    @with_options(*OUT_OPTIONS)
    def jacobian(self, body1: BodyMotion | None, psi: ArrayLike, **options: Unpack[Options]) -> FloatArray:
        """Compute the Jacobian J in (v2, omega2) = J @ (v1, omega1, psi'), world axes; shape (..., 6, 7) (E8, E2).

        Arguments: see `HingePair`; of body1, S is used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> pair.jacobian(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0) @ (0, 0, 0, 0, 0, 1, 2)
        array([0., 4., 0., 0., 0., 3.])
        """
        return self._subject.ask_of_body1("jacobian", body1, options, psi=psi)

    @with_options(*OUT_OPTIONS)
    def acceleration_bias(
        self, body1: BodyMotion | None, psi: ArrayLike, psid: ArrayLike, **options: Unpack[Options]
    ) -> FloatArray:
        """Compute the bias in (a2, alpha2) = J @ (a1, alpha1, psi'') + bias, with J of `jacobian`, world axes: a2
        [m/s^2], then alpha2 [rad/s^2]; shape (..., 6) (E9).

        Arguments: see `HingePair`; of body1, S and omega are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
        >>> body1 = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
        >>> pair.acceleration_bias(body1, 0.0, 2.0)
        array([-4.,  0.,  0.,  0.,  0.,  0.])
        """
        return self._subject.ask_of_body1("acceleration_bias", body1, options, psi=psi, psid=psid)

    @with_options(**TOLERANCE_DEFAULTS)
    def propagate_covariance(
        self, body1: BodyMotion | None, psi: ArrayLike, **options: Unpack[ToleranceOptions]
    ) -> PoseCovariance:
        """Compute the covariance of R2, of body 2's attitude and of points that tolerances of the geometry cause, to
        first order (E5, E7).

        `hingepair.sample_pairs` draws random pairs with the same tolerances, which show whether first order suffices.

        Args:
            body1: the motion of body 1, of which S is used.
            psi: hinge angle [rad]; shape (...,).
            u1: limits of each component of u1 as on drawings, body-1 axes: "+-0.2 mm", whose standard deviation is a
                third of the limit; or three of these.
            u2: the same of u2, body-2 axes.
            axis: limit of the tilt of the hinge axis in any direction across it, "+-0.1 deg", as that of u1.
            home: limits of each component of the rotation vector r by which home deviates, exp(r) @ home, body-1
                axes, as those of u1.
            u1_std: in place of u1, the standard deviation of each component [m]: a number, or shape (3,).
            u2_std: the same of u2.
            axis_std: standard deviation of each of two tilt angles of the hinge axis, about directions across it
                [rad].
            home_std: standard deviation of each component of r [rad]: a number, or shape (3,).
            covariance: in place of these, the covariance of the components of u1, u2, n and r, in this order; shape
                (12, 12), such as `HingeFit.covariance`.
            points: tolerances of points of the bodies by name, {"handle": "+-0.5 mm"}: limits in body axes as those
                of u1, or standard deviations, a number or three [m].

        Returns:
            The PoseCovariance; of a point, `found["handle"]` is the PointCovariance of its position.

        Raises:
            ArgumentError: no tolerance is given, or two for one dimension.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(0.5, 0, 0), u2=(-0.5, 0, 0), n=(0, 0, 1))
        >>> still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
        >>> pair.propagate_covariance(still, 1.0, u1_std=0.001, axis_std=0.002).R2_std.round(6)
        array([0.001   , 0.001   , 0.001385])
        >>> (1000 * pair.propagate_covariance(still, 1.0, u1="+-0.3 mm").R2_std).round(6)
        array([0.1, 0.1, 0.1])
        """
        return propagate_covariance(self._subject, body1, psi, options)


def pair_sheet(pair: Any, names: Iterable[str]) -> Sheet:
    """Return the printed table of a pair: attributes, masses and points."""
    masses = (("mass1", pair.body1 and pair.body1.mass), ("mass2", pair.body2 and pair.body2.mass))
    points = (*pair.points1.items(), *pair.points2.items())
    return sheet_of(pair.name, [*((name, getattr(pair, name)) for name in names), *masses, *points])


def checked_limits(limits: ArrayLike | None) -> tuple[float, float] | None:
    """Return the argument `limits` as floats (lower, upper) in this order, or None."""
    if limits is None:
        return None
    both = one_constant("limits", limits, 2)
    if not both[0] <= both[1]:
        raise ArgumentError("limits", "(lower, upper) with lower <= upper", limits)
    return float(both[0]), float(both[1])
