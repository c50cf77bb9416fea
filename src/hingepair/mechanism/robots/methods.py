"""Methods of a robot: kinematics of its frames, Jacobians, dynamics, energy and momentum."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, Literal, NamedTuple, Unpack, overload

from numpy.typing import ArrayLike

from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, ShapeError, choices, nearest, quoted
from hingepair.inverse_kinematics.results import InverseKinematics, InverseKinematicsPath
from hingepair.mechanism.linkages import LoopWrench, follow_path, loop_wrenches, transmission
from hingepair.mechanism.options import (
    BOUNDS_OPTIONS,
    DEFAULT_GRAVITY,
    ROLLOUT_OPTIONS,
    SEARCH_DEFAULTS,
    FurtherOptions,
    Method,
    Options,
    SearchOptions,
    with_options,
)
from hingepair.mechanism.requests import (
    ALL_COORDINATES,
    MOTION_LEVELS,
    ROBOT_TASKS,
    ROWS,
    ask,
    coordinate_rows,
)
from hingepair.mechanism.robots.conventions import StateConventions
from hingepair.mechanism.robots.inverse_kinematics import PreparedInverseKinematics, read_query, read_solutions
from hingepair.mechanism.robots.rollout import PreparedRollout, Rollout, roll_out
from hingepair.mechanism.robots.subject import RobotSubject
from hingepair.mechanism.states import (
    Energy,
    JointWrenches,
    MechanismAccelerations,
    MechanismDerivatives,
    MechanismForces,
    MechanismState,
    Momentum,
)
from hingepair.mechanism.struts import function_force
from hingepair.mechanism.tree import Tree
from hingepair.numeric.arrays import Float64Array, FloatArray, Frozen, check_choice, finite_number, set_frozen
from hingepair.plans.arguments import Coordinates, renamed_out
from hingepair.plans.prepared import Prepared
from hingepair.rollouts.tracks import Feedback
from hingepair.tables.sheets import Shown


class StrutState(NamedTuple):
    """A strut at every sample."""

    length: FloatArray  # between its points [m]
    rate: FloatArray  # of its length [m/s]
    force: FloatArray  # [N]; positive pushes the points apart


def answers(task: str) -> Callable[[Method], Method]:
    """Show the options of a task in the signature of the method that answers it."""
    return with_options(*ROBOT_TASKS[task].options)


_JACOBIANS: Final = {"world": "jacobian", "frame": "jacobian_in_frame"}  # tasks by the argument `axes`


class MechanismMethods(StateConventions, Frozen, Shown):
    """Methods of a robot: kinematics, dynamics, energy and momentum; `Mechanism` derives from this class, and
    describes the arguments that they share.
    """

    __slots__ = ("_kept",)

    _tree: Tree  # record of the robot
    base: str  # "fixed": the base is held, or moves as given; "free": forces move the base
    _kept: RobotSubject

    @property
    def _subject(self) -> RobotSubject:
        """What computes the robot, made once."""
        try:
            return self._kept
        except AttributeError:
            set_frozen(self, _kept=RobotSubject(self._tree, self.base))
            return self._kept

    # ---- kinematics

    @answers("pose")
    def forward_kinematics(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        **options: Unpack[FurtherOptions],
    ) -> MechanismState:
        """Compute the motion of frames (E2, E5, E7-E9). Arguments not listed: see `Mechanism`.

        Args:
            qd: time derivatives of q, which add velocities.
            qdd: second time derivatives of q, which add accelerations.
            outputs: names out of R, S, d, v, omega, a and alpha. By default, all for which the coordinates suffice.

        Returns:
            The MechanismState `state`: `state.R` of all frames, shape (..., frames, 3), and `state["panda_hand"].R`
            of one. With `frames="panda_hand"`, `state.R` is that of this frame, (..., 3).

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> state = robot.forward_kinematics(np.zeros((5, 6)), frames=("tool0", "wrist_1_link"))
        >>> state.R.shape, state["tool0"].S.shape
        ((5, 2, 3), (5, 3, 3))
        """
        given = coordinate_rows(q, qd, qdd)
        return ask(self._subject, MOTION_LEVELS[len(given) - 1], given, options)

    @answers("jacobian")
    def jacobian(
        self,
        q: Coordinates,
        frames: str | Iterable[str] | None = None,
        *,
        axes: str = "world",
        **options: Unpack[Options],
    ) -> FloatArray:
        """Compute the Jacobian J of a frame, (v, omega) = J @ qd if the base is at rest, shape (..., 6, dof); for a
        free base, (v, omega) = J @ (v1, omega1, qd), shape (..., 6, 6 + dof) (E2, E8).

        v is the velocity of the frame's origin. v1 and omega1, of the base, are in world axes. Arguments not listed:
        see `Mechanism`; of `base_motion`, S is used.

        Args:
            frames: one name; or a tuple, for an axis of frames before the last two.
            axes: of v and omega: "world" (Pinocchio's LOCAL_WORLD_ALIGNED) or "frame" (LOCAL).

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> robot.jacobian(np.zeros(6), "tool0").shape
        (6, 6)
        >>> robot.jacobian(np.zeros((5, 6)), frames=("tool0", "wrist_1_link"), axes="frame").shape
        (5, 2, 6, 6)
        """
        check_choice("axes", axes, tuple(_JACOBIANS))
        return ask(self._subject, _JACOBIANS[axes], (q,), {"frames": frames, **options})

    @answers("jacobian_rate")
    def jacobian_rate(
        self,
        q: Coordinates,
        qd: Coordinates,
        frames: str | Iterable[str] | None = None,
        *,
        axes: str = "world",
        **options: Unpack[Options],
    ) -> FloatArray:
        """Compute the time derivative of `jacobian`, of the same shape. Of `base_motion`, S and omega are used.

        Raises:
            ArgumentError: the program has too many operations.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot, q, qd = hp.load_robot("ur5_robot"), np.zeros(6), np.ones(6)
        >>> np.allclose(robot.jacobian_rate(q, qd, "tool0") @ qd, robot.acceleration_bias(q, qd, "tool0"))
        True
        """
        check_choice("axes", axes, tuple(_JACOBIANS))
        return ask(self._subject, f"{_JACOBIANS[axes]}_rate", (q, qd), {"frames": frames, **options})

    @answers("acceleration_bias")
    def acceleration_bias(
        self,
        q: Coordinates,
        qd: Coordinates,
        frames: str | Iterable[str] | None = None,
        **options: Unpack[Options],
    ) -> FloatArray:
        """Compute the bias in (a, alpha) = J @ qdd + bias of frames, with J of `jacobian`, world axes, shape (...,
        6) or (..., frames, 6); for a free base in (a, alpha) = J @ (a1, alpha1, qdd) + bias (E9).

        Arguments: see `Mechanism`. Of `base_motion`, S and omega are used, and a and alpha unless the base is free.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").acceleration_bias(np.zeros(6), np.zeros(6), "tool0").tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        """
        return ask(self._subject, "acceleration_bias", (q, qd), {"frames": frames, **options})

    @with_options(**SEARCH_DEFAULTS)
    def inverse_kinematics(
        self,
        R: Any = None,
        S: Any = None,
        *,
        select: str = "any",
        solutions: int | None = None,
        **options: Unpack[SearchOptions],
    ) -> InverseKinematics:
        """Compute coordinates q at which frames have wanted poses, for one target or many.

        A target that cannot be reached gives the closest pose found, with `ok` False; a target that is not finite
        gives NaN. A target gives the same bits in any batch. Joints that do not move the frames stay at `prefer`, at
        q0, or in the middle of their limits. Limits of mimic joints are not looked at, only those of the joints they
        follow.

        Args:
            R: wanted positions of the frame's origin [m], shape (..., 3); a BodyMotion or the state of a frame, whose
                R and S are taken; or None. Targets of several frames: a dict of these by the frame's name, and so for
                S and `direction`.
            S: wanted rotation matrices from frame axes to world axes, shape (..., 3, 3). By default, any attitude.
            frame: name of a link, a joint or an added frame; by default the only one of `robot.tips`.
            direction: in place of S, wanted directions of an axis of the frame, shape (..., 3); any length. The turn
                about it is free.
            axis: the axis of the frame that has the direction, in frame axes, shape (3,); a dict by frame.
            relative_to: name of a frame from whose origin and in whose axes the targets are given; a dict by frame.
            centre_of_mass: wanted positions of the centre of mass [m]; shape (..., 3).
            coordinates: values at which joints stand and stay, by joint, within the limits [rad or m]; shape (...)
                each, and one number for a path.
            q0: coordinates of the first start; those beyond a limit are put on it. By default, all starts are random.
            base: what a free base does: "hold" keeps it where `base_motion` says; "solve" finds its pose, base_R and
                base_S, beside q, from there on.
            limits: whether the coordinates stay within `robot.position_limits`; or limits, shape (dof, 2).
            prefer: coordinates that are approached as far as that does not move the frames; or "middle", those in the
                middle of the limits.
            select: "any": the first solution found; "nearest": of those from all starts, the one with the least sum
                of squares of q - q0, which takes some twenty times longer.
            solutions: number of distinct solutions to return, those nearest to q0 first, or to `prefer`, or to the
                middle of the limits. The results have an axis for them.
            position_tolerance: greatest distance from R [m] of a solution. Solutions are exact to about 1e-15 times
                the size of the robot where its Jacobian is regular.
            angle_tolerance: greatest angle [rad] of a solution.
            base_motion: pose of the base, by default at the origin; where base="solve", the one that it starts at.
            seed: seed of the random starts.
            workers: number of threads; -1 for one thread per core.

        Raises:
            ArgumentError: `frame` is not given although `robot.tips` has several names, or "nearest" is asked for
                without q0.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> q = np.random.default_rng(1).uniform(-3, 3, (100, 6))
        >>> wanted = robot.forward_kinematics(q)["tool0"]
        >>> found = robot.inverse_kinematics(wanted.R, wanted.S, frame="tool0")
        >>> found.q.shape, bool(found.ok.all())
        ((100, 6), True)
        """
        count = read_solutions(solutions, select, options.get("q0"))
        query = read_query(self._tree, self._subject.constants, R, S, "inverse_kinematics", **options)
        return query.solve(count, select == "nearest")

    @with_options(**SEARCH_DEFAULTS)
    def inverse_kinematics_path(
        self,
        R: Any = None,
        S: Any = None,
        *,
        max_change: float = 0.5,
        **options: Unpack[SearchOptions],
    ) -> InverseKinematicsPath:
        """Compute coordinates along paths of targets, each from the sample before.

        The last axis of the targets' samples is the path; axes before it are paths of their own. All solutions found
        of the first target are followed, and of those that last longest the one that moves least is taken. `jumps`
        marks the samples to which none could be followed. A redundant arm whose path jumps is tried again with other
        postures; it may still jump where it stands at a limit or a singular pose, which another `q0` may avoid. A
        sample out of reach gives the closest pose next to the one before. Arguments not listed: see
        `inverse_kinematics`.

        Args:
            R: wanted positions, with an axis of samples: (..., samples, 3).
            q0: coordinates near which the paths start, shape (..., dof) without the axis of samples. By default, they
                start where they have the fewest jumps.
            prefer: coordinates that are approached along the path, as far as it is followed without a jump.
            max_change: greatest change of a coordinate from sample to sample that is no jump [rad or m].
            workers: number of threads, which share the paths; -1 for one thread per core.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> angle = np.linspace(0, 2 * np.pi, 200)
        >>> R = np.stack([0.4 + 0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.3 + 0 * angle], axis=-1)
        >>> found = robot.inverse_kinematics_path(R, frame="tool0", direction=(0, 0, -1))
        >>> found.q.shape, bool(found.ok.all()), int(found.jumps.sum())
        ((200, 6), True, 0)
        """
        query = read_query(self._tree, self._subject.constants, R, S, "inverse_kinematics_path", **options)
        if not finite_number("max_change", max_change) > 0:
            raise ArgumentError("max_change", "a positive number", max_change)
        return query.follow(max_change)

    @with_options(*BOUNDS_OPTIONS)
    def error_bounds(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        **options: Unpack[FurtherOptions],
    ) -> dict[str, Float64Array]:
        """Compute rigorous bounds on the rounding errors of results at every sample.

        The error is the difference from the exact result of the equations for the given arguments and the robot's
        numbers as they are stored; an attitude stands for the rotation next to it. The bounds hold for all backends
        if sines are as accurate as the page on accuracy says. Arguments not listed: see `Mechanism`.

        Args:
            outputs: names of results of the robot's methods but `forward_dynamics`, such as R, jacobian, tau,
                mass_matrix or kinetic; of momentum angular_about_origin and angular_about_centre. By default those of
                `forward_kinematics` for which the coordinates suffice.

        Returns:
            Bounds by output name on the largest error of a component, in its unit; shape (..., frames) for outputs of
            `forward_kinematics`, else (...). Infinite where an argument is not finite or the computation overflows.

        Raises:
            ArgumentError: an output needs an argument that is not given.

        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> bool(robot.error_bounds([0.1] * 6, frames="tool0")["R"].max() < 1e-14)
        True
        """
        return self._subject.error_bounds(dict(zip(ROWS, coordinate_rows(q, qd, qdd), strict=False)), options)

    # ---- dynamics

    @answers("inverse_dynamics")
    def inverse_dynamics(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[Options]
    ) -> MechanismForces:
        """Compute the torques and forces of the joints, and on the base, that a motion requires (T1-T3). Arguments
        not listed: see `Mechanism`.

        Args:
            base_motion: motion of the base, of which S, omega, a and alpha are used.
            joint_loads: as at `Mechanism`; dry friction of a joint at rest counts as 0.
            outputs: names out of tau, force1 and torque1; by default all.

        Returns:
            The MechanismForces, which act beside gravity and `wrenches`. force1 and torque1 act on the base at R1; a
            support exerts them where the base is not free, and the mass of the base then does not count.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> robot.inverse_dynamics(np.zeros(6), np.zeros(6), np.zeros(6)).tau.shape
        (6,)
        """
        return ask(self._subject, "inverse_dynamics", (q, qd, qdd), options)

    @answers("forward_dynamics")
    def forward_dynamics(
        self, q: Coordinates, qd: Coordinates, tau: Coordinates, **options: Unpack[FurtherOptions]
    ) -> MechanismAccelerations:
        """Compute the accelerations of the robot under given torques and forces (T5, T6). Arguments not listed: see
        `Mechanism`.

        Args:
            force1: force on a free base at R1, world axes [N]; shape (..., 3).
            torque1: torque on a free base about R1, world axes [N m]; shape (..., 3).
            base_motion: motion of the base, of which S and omega are used, and a and alpha unless the base is free.
            joint_loads: as at `Mechanism`; at a joint at rest, dry friction takes up the effort of all else up to its
                own size, and the body that carries the joint is taken as at rest.
            outputs: names out of qdd, and for a free base a1 and alpha1; by default all.

        Returns:
            The MechanismAccelerations; NaN where the mass matrix is singular, with a DynamicsWarning that names a
            joint whose motion no inertia resists.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> robot.forward_dynamics(np.zeros(6), np.zeros(6), np.zeros(6)).qdd.shape
        (6,)
        """
        return ask(self._subject, "forward_dynamics", (q, qd, tau), options)

    @answers("joint_wrenches")
    def joint_wrenches(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[Options]
    ) -> JointWrenches:
        """Compute what each joint's carrying body exerts on the joint's body during a motion, at the joint's point
        (T1-T3). Arguments not listed: see `inverse_dynamics`.

        Args:
            outputs: names out of force and torque, by default both.

        Returns:
            The JointWrenches `w`, world axes: `w.force` [N] and `w.torque` [N m] of all joints, mimic joints
            included, shape (..., joints, 3), and `w["panda_joint4"]`, those of one. The component along the axis is
            what the motor gives, less what its rotor's inertia takes.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> robot.joint_wrenches(np.zeros(6), np.zeros(6), np.zeros(6))["wrist_3_joint"].force.shape
        (3,)
        """
        return ask(self._subject, "joint_wrenches", (q, qd, qdd), options)

    @answers("torque_regressor")
    def torque_regressor(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[Options]
    ) -> FloatArray:
        """Compute the regressor Y in tau = Y @ p + armature * qdd (T13), shape (..., dof, 10 * bodies), where p are
        the robot's `inertial_parameters`; for a free base in (force1, torque1, tau) = Y @ p + (0, 0, armature * qdd),
        shape (..., 6 + dof, 10 * bodies).

        Each body has ten columns, those of Pinocchio's `computeJointTorqueRegressor`; of a free base, force1 and
        torque1 are here in world axes, there in the axes of the base. Masses have no influence. Arguments: see
        `inverse_dynamics`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot, q = hp.load_robot("ur5_robot"), np.full(6, 0.3)
        >>> Y = robot.torque_regressor(q, q, q)
        >>> Y.shape, np.allclose(Y @ robot.inertial_parameters, robot.inverse_dynamics(q, q, q).tau)
        ((6, 60), True)
        """
        return ask(self._subject, "torque_regressor", (q, qd, qdd), options)

    @answers("inverse_dynamics_derivatives")
    def inverse_dynamics_derivatives(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[Options]
    ) -> MechanismDerivatives:
        """Compute the derivatives of the torques of `inverse_dynamics` by q, qd and qdd, exactly up to rounding.

        Wrenches keep their values in world axes. A free base adds six rows, those of force1 and torque1, and six
        columns: by displacements of R1 and rotations of the base, by v1 and omega1, by a1 and alpha1; world axes, and
        omega1 and alpha1 stay as they are while the base rotates. Second derivatives are exact, too, by
        `jax.hessian` of a prepared call. Arguments not listed: see `inverse_dynamics`.

        Args:
            joint_loads: as at `Mechanism`; derivatives of dry friction are 0.
            outputs: names out of tau_q, tau_qd and tau_qdd; by default all.

        Returns:
            The MechanismDerivatives: (..., dof, dof), a row for each torque, a column for each coordinate; of a free
            base (..., 6 + dof, 6 + dof). tau_qdd is the mass matrix.

        Raises:
            ArgumentError: the program has too many operations.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> d = robot.inverse_dynamics_derivatives(np.zeros(6), np.zeros(6), np.zeros(6))
        >>> d.tau_q.shape, np.allclose(d.tau_qdd, robot.mass_matrix(np.zeros(6)))
        ((6, 6), True)
        """
        return ask(self._subject, "inverse_dynamics_derivatives", (q, qd, qdd), options)

    @answers("forward_dynamics_derivatives")
    def forward_dynamics_derivatives(
        self, q: Coordinates, qd: Coordinates, tau: Coordinates, **options: Unpack[FurtherOptions]
    ) -> MechanismDerivatives:
        """Compute the derivatives of the accelerations of `forward_dynamics` by q, qd and tau, exactly up to rounding
        (T11).

        A free base adds rows of a1 and alpha1, and columns as in `inverse_dynamics_derivatives`, those of qdd_tau by
        force1 and torque1. Arguments not listed: see `forward_dynamics`.

        Args:
            joint_loads: as at `Mechanism`; derivatives of dry friction are 0.
            outputs: names out of qdd_q, qdd_qd and qdd_tau, the inverse mass matrix; by default all.

        Returns:
            The MechanismDerivatives: (..., dof, dof), a row for each acceleration; NaN where the mass matrix is
            singular.

        Raises:
            ArgumentError: the program has too many operations.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> robot.forward_dynamics_derivatives(np.zeros(6), np.zeros(6), np.zeros(6)).qdd_tau.shape
        (6, 6)
        """
        return ask(self._subject, "forward_dynamics_derivatives", (q, qd, tau), options)

    @with_options(*ROLLOUT_OPTIONS)
    def rollout(
        self,
        q0: Coordinates,
        qd0: Coordinates,
        tau: ArrayLike | Feedback,
        dt: float | None = None,
        *,
        method: str = "semi_implicit",
        steps: int | None = None,
        every: int = 1,
        effort_limits: ArrayLike | None = None,
        **options: Unpack[Options],
    ) -> Rollout:
        """Step motions of the robot in time: forward dynamics (T5, T6) and a step of constant length, one compiled
        program for many motions.

        What acts may change from step to step: such an argument has an axis of steps in front of those of one sample,
        and is held over each step. An argument of one sample holds for all steps. Arguments not listed: see
        `Mechanism`.

        Args:
            q0: coordinates at the start, in one of the forms of q.
            qd0: their time derivatives.
            tau: torques of hinges [N m] and forces of sliders [N]: a number, or shape (dof,) or (..., steps, dof); or
                a `Feedback`, which "rk4" evaluates in every stage.
            dt: length of a step [s].
            method: "semi_implicit" (Euler, of order 1, keeps the energy of an oscillation bounded) or "rk4" (the
                classical method of order 4, four times as long).
            steps: number of steps; needed where no argument has an axis of steps.
            every: record every so many steps.
            effort_limits: largest efforts, such as `robot.effort_limits`, to which efforts are clipped; forms of tau.
            wrenches: as at `Mechanism`, of shape (3,) or (..., steps, 3) each.
            joint_loads: as at `Mechanism`. Dry friction stops a joint within a step at most, so that the joint then
                rests. With "semi_implicit", dampers act with the rate at the end of the step, which is stable for any
                damping.
            base_motion: the start of a free base; its R, S, v and omega are used. Of any other base, which is at
                rest, R and S.

        Returns:
            The Rollout `r`: `r.q` and `r.qd`, shape (..., steps // every + 1, dof), the start first, and their
            instants `r.t`. With a free base also R1, S1, v1 and omega1, and `r.base_motion` for other methods, as in
            `robot.energy(r.q, r.qd, base_motion=r.base_motion)`. The attitude is turned by the exponential of omega1.
            Where the mass matrix is singular, and at dead points of linkages, motions become NaN, and a
            DynamicsWarning says so.

        Raises:
            ArgumentError: the program has too many operations.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> tau = np.zeros((100, 50, 6))  # 100 motions, 50 steps
        >>> robot.rollout(np.zeros(6), np.zeros(6), tau, 1e-3).q.shape
        (100, 51, 6)
        """
        return roll_out(self._subject, q0, qd0, tau, dt, method, steps, every, effort_limits, options)

    @answers("q_all")
    def all_coordinates(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        **options: Unpack[Options],
    ) -> Any:
        """Compute the coordinates of all joints of a closed mechanism, an array (..., joints); with qd and qdd, a
        tuple of these and their derivatives.

        The order is that of `names` before the loops were closed. Samples that cannot be closed are NaN. Arguments:
        see `Mechanism`.
        """
        given = coordinate_rows(q, qd, qdd)
        outputs = ALL_COORDINATES[: len(given)]
        found = ask(self._subject, outputs[-1], given, options)
        return found if len(given) == 1 else tuple(found[name] for name in outputs)

    def follow(self, q: Coordinates, guess: Mapping[str, float] | None = None) -> Float64Array:
        """Compute all joints of a closed mechanism along a path, each sample from the one before, shape (samples,
        joints). It reaches what a straight line from the assembly does not.

        Samples are NaN from where the path cannot be followed. Arguments: see `Mechanism`.

        Args:
            q: coordinates along the path; shape (samples, dof).
            guess: coordinates by joint near which the path begins, such as those of another assembly; by default
                where the mechanism was assembled.
        """
        rows = self._tree.rows("q", q)
        if rows.ndim != 2:
            raise ShapeError("q", f"shape (samples, {rows.shape[-1]}), a path", str(rows.shape))
        return follow_path(self._tree, rows, guess)

    @answers("tree_tau")
    def loop_wrenches(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[Options]
    ) -> dict[str, LoopWrench]:
        """Compute what the body of each loop's first frame exerts on that of the second during a motion, world axes.

        Redundant conditions leave components open, which no rigid body determines: they are NaN. Arguments: see
        `inverse_dynamics`; efforts `tau` act at the coordinates.

        Returns:
            By the loop's name, force [N] and torque about the frame's origin [N m], shape (..., 3).
        """
        closure = self._tree.loops()
        run: Any = {"backend": options.get("backend", "auto")}
        base: Any = {"base_motion": options.get("base_motion"), **run}
        efforts = ask(self._subject, "tree_tau", (q, qd, qdd), options)
        jacobian, units = (
            ask(self._subject, "loop_jacobian", (q,), run),
            ask(self._subject, "loop_wrenches", (q,), base),
        )
        return loop_wrenches(closure, efforts, jacobian, units)

    def transmission(self, q: Coordinates, *, backend: str = "auto") -> FloatArray:
        """Compute the smallest over the largest singular value of the loops' Jacobian by the joints that follow,
        in which lengths count in sizes of the mechanism.

        Its shape is (...). It is 0 at a dead point, where the coordinates do not move the others. Arguments: see
        `Mechanism`.
        """
        closure = self._tree.loops()
        return transmission(closure, ask(self._subject, "loop_jacobian", (q,), {"backend": backend}))

    @answers("struts")
    def struts(
        self, q: Coordinates, qd: Coordinates | None = None, **options: Unpack[Options]
    ) -> dict[str, StrutState]:
        """Compute the lengths of all struts [m], their rates [m/s] and forces [N], by name. Arguments not listed: see
        `Mechanism`.

        Args:
            qd: time derivatives of q; by default 0.
        """
        rates = (0.0,) * len(self._subject.constants.names) if qd is None else qd
        found, states = ask(self._subject, "struts", (q, rates), options), {}
        for k, strut in enumerate(self._tree.struts):
            length, rate, force = (column[..., k] for column in found.arrays().values())
            if strut.function is not None:
                force = force + function_force(strut, length, rate)
            states[strut.name] = StrutState(length, rate, force)
        return states

    @answers("mass_matrix")
    def mass_matrix(self, q: Coordinates, **options: Unpack[Options]) -> FloatArray:
        """Compute the mass matrix M in M @ qdd + bias = tau (T4), shape (..., dof, dof); for a free base in M @ (a1,
        alpha1, qdd) + bias = (force1, torque1, tau), world axes, shape (..., 6 + dof, 6 + dof). `bias_forces` is the
        bias.

        Arguments: see `Mechanism`. Of `base_motion`, S is used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> M = hp.load_robot("ur5_robot").mass_matrix(np.zeros(6))
        >>> M.shape, bool((M == M.T).all())
        ((6, 6), True)
        """
        return ask(self._subject, "mass_matrix", (q,), options)

    @answers("bias_forces")
    def bias_forces(self, q: Coordinates, qd: Coordinates, **options: Unpack[Options]) -> FloatArray:
        """Compute the generalized forces at zero acceleration, the bias in tau = M @ qdd + bias (T1-T3), shape (...,
        dof); for a free base (force1, torque1, tau), shape (..., 6 + dof).

        They contain the Coriolis, centrifugal and gravity terms, and those of a base acceleration that `base_motion`
        prescribes. Arguments: see `Mechanism`. Of `base_motion`, S and omega are used, and a and alpha unless the
        base is free.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> robot.bias_forces(np.zeros(6), np.zeros(6)).shape
        (6,)
        """
        return ask(self._subject, "bias_forces", (q, qd), options)

    @answers("gravity_forces")
    def gravity_forces(self, q: Coordinates, **options: Unpack[Options]) -> FloatArray:
        """Compute the generalized forces that hold the robot at rest against gravity (T1-T3), shape (..., dof); for a
        free base (force1, torque1, tau), shape (..., 6 + dof).

        Arguments: see `Mechanism`. Of `base_motion`, S is used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").gravity_forces(np.zeros(6)).shape
        (6,)
        """
        return ask(self._subject, "gravity_forces", (q,), options)

    @answers("centre_of_mass")
    def centre_of_mass(self, q: Coordinates, **options: Unpack[Options]) -> FloatArray:
        """Compute the robot's centre of mass, world axes [m]; shape (..., 3). The base counts only if it is free. NaN
        if nothing has mass.

        Arguments: see `Mechanism`. Of `base_motion`, R and S are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").centre_of_mass(np.zeros(6)).shape
        (3,)
        """
        return ask(self._subject, "centre_of_mass", (q,), options)

    @answers("centre_of_mass_jacobian")
    def centre_of_mass_jacobian(self, q: Coordinates, **options: Unpack[Options]) -> FloatArray:
        """Compute the Jacobian J of the centre of mass, whose velocity is J @ qd if the base is at rest, shape (...,
        3, dof); for a free base J @ (v1, omega1, qd), world axes, shape (..., 3, 6 + dof).

        Arguments: see `Mechanism`. Of `base_motion`, S is used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").centre_of_mass_jacobian(np.zeros(6)).shape
        (3, 6)
        """
        return ask(self._subject, "centre_of_mass_jacobian", (q,), options)

    @answers("centroidal_momentum_matrix")
    def centroidal_momentum_matrix(self, q: Coordinates, **options: Unpack[Options]) -> FloatArray:
        """Compute the matrix A of the momentum about the centre of mass, (linear, angular) = A @ qd if the base is at
        rest, shape (..., 6, dof) (T12); for a free base A @ (v1, omega1, qd), world axes, shape (..., 6, 6 + dof).

        What counts is as in `momentum`. Arguments: see `Mechanism`. Of `base_motion`, S is used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot, q, qd = hp.load_robot("ur5_robot"), np.zeros(6), np.ones(6)
        >>> h = robot.momentum(q, qd, about="centre")
        >>> np.allclose(robot.centroidal_momentum_matrix(q) @ qd, [*h.linear, *h.angular])
        True
        """
        return ask(self._subject, "centroidal_momentum_matrix", (q,), options)

    @answers("centroidal_momentum_matrix_rate")
    def centroidal_momentum_matrix_rate(
        self, q: Coordinates, qd: Coordinates, **options: Unpack[Options]
    ) -> FloatArray:
        """Compute the time derivative of `centroidal_momentum_matrix`, of the same shape. Of `base_motion`, S and
        omega are used.

        Raises:
            ArgumentError: the program has too many operations.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").centroidal_momentum_matrix_rate(np.zeros(6), np.ones(6)).shape
        (6, 6)
        """
        return ask(self._subject, "centroidal_momentum_matrix_rate", (q, qd), options)

    @answers("energy")
    def energy(self, q: Coordinates, qd: Coordinates, **options: Unpack[Options]) -> Energy:
        """Compute the kinetic energy and the potential energy in uniform gravity [J] (T7); the latter is 0 for a mass
        at the world's origin.

        The base counts only if it is free. The rotors of the motors (`armature`) count in the kinetic energy.
        Arguments: see `Mechanism`. Of `base_motion`, R, S, v and omega are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> float(hp.load_robot("ur5_robot").energy(np.zeros(6), np.zeros(6)).kinetic)
        0.0
        """
        return ask(self._subject, "energy", (q, qd), options)

    @answers("momentum")
    def momentum(
        self, q: Coordinates, qd: Coordinates, *, about: str = "origin", **options: Unpack[Options]
    ) -> Momentum:
        """Compute the linear and the angular momentum of the robot, world axes (T8).

        The base counts only if it is free. The motors' rotors, which `energy` counts, do not: their energy follows
        from `armature`, inertia times the square of the gear ratio, but their momentum from inertia times the ratio,
        which is not known. Arguments not listed: see `Mechanism`. Of `base_motion`, R, S, v and omega are used.

        Args:
            about: "origin" of the world, or "centre" of mass: the point of the angular momentum.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").momentum(np.zeros(6), np.ones(6), about="centre").angular.shape
        (3,)
        """
        check_choice("about", about, ("origin", "centre"))
        angular = f"angular_about_{about}"
        if "out" in options:
            options["out"] = renamed_out(options["out"], {"angular": angular})
        return ask(self._subject, f"momentum_about_{about}", (q, qd), options)

    @overload
    def prepare(self, given: Literal["rollout"], **options: Any) -> PreparedRollout: ...

    @overload
    def prepare(self, given: Literal["inverse_kinematics"], **options: Any) -> PreparedInverseKinematics: ...

    @overload
    def prepare(self, given: str | Iterable[str], **options: Any) -> Prepared: ...

    def prepare(
        self,
        given: str | Iterable[str],
        *,
        frames: str | Iterable[str] | None = None,
        outputs: Iterable[str] | None = None,
        gravity: ArrayLike = DEFAULT_GRAVITY,
        wrenches: str | Iterable[str] = (),
        joint_loads: bool | None = None,
        workers: int = 1,
        backend: str = "auto",
        **options: Any,
    ) -> Any:
        """Return a function that computes given outputs, planned and compiled once, for loops over single states or
        small batches, and for arrays of JAX and PyTorch. Arguments not listed: see `Mechanism`.

        Args:
            given: names of the arguments in the order of a call, out of q, qd, qdd, tau; R1, S1, v1, omega1, a1,
                alpha1, the motion of the base; force1 and torque1, loads on a free base. Or a word for them: "pose",
                "velocity" or "acceleration" of frames, for q, qd and qdd as far as needed; "jacobian_in_frame"; or
                the name of a method such as "jacobian", "jacobian_rate", "inverse_dynamics", "mass_matrix" or
                "inverse_dynamics_derivatives", for its first arguments; or "rollout", for q0, qd0 and tau; or
                "inverse_kinematics", for R, S and q0 of one target.

                What is not given of the base is zero, S1 the identity; but a1 and alpha1 of a free base are results
                of forward dynamics.
            outputs: names of the outputs: those of the method; of a tuple of names those of methods for which they
                suffice, derivatives such as "jacobian_rate" and "tau_q" among them. By default all of the method; of
                a tuple those of `forward_dynamics` where it holds efforts, else those of `forward_kinematics`.
            wrenches: names of links or other frames on which wrenches act in dynamics. Behind the other arguments,
                the call then takes force_0 and torque_0 of the first, and so on, as `inverse_dynamics` does.
            backend: "auto" and "compiled" compile during this call, "numpy" never does.
            **options: for "rollout", dt and the other options of the method `rollout`; for "inverse_kinematics"
                options of that method, such as `prefer`, `limits` and `base`.

        Returns:
            A `Prepared`, whose calls return what the method returns, or, with outputs of several methods, one result
            with all of them as attributes. A `PreparedRollout` of "rollout"; a `PreparedInverseKinematics`, which
            steps from q0 to the target of a call, of "inverse_kinematics".

        Raises:
            ArgumentError: a name is unknown, or an output needs an argument that is not given.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> step = hp.load_robot("ur5_robot").prepare("inverse_dynamics", outputs=("tau",))
        >>> step(np.zeros(6), np.zeros(6), np.zeros(6)).tau.shape
        (6,)
        """
        if given == "rollout":
            shared = {"frames": frames, "outputs": outputs, "gravity": gravity, "wrenches": wrenches or None}
            shared |= {"joint_loads": joint_loads, "workers": workers}
            options |= {name: value for name, value in shared.items() if value is not None}
            inspect.signature(self.rollout).bind("q0", "qd0", "tau", **options)  # a TypeError as of any call
            return PreparedRollout(
                functools.partial(self.rollout, **options), len(self._subject.constants.names), self.base
            )
        if given == "inverse_kinematics":
            return PreparedInverseKinematics(self._tree, self._subject.constants, frames, outputs, options)
        for name, value in options.items():
            known = ("outputs", "frames", "gravity", "wrenches", "joint_loads", "workers", "backend")
            raise ArgumentError(name, f"{choices(known)}{nearest(name, known)} for {given!r}", quoted(value))
        return self._subject.prepare(
            self.prepare, given, outputs, execution_of(backend, workers), gravity=gravity,
            frames=frames, wrenches=wrenches, joint_loads=joint_loads,
        )  # fmt: skip
