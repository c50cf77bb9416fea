"""Methods of a robot: kinematics of its frames, Jacobians, dynamics, energy and momentum."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, Literal, NamedTuple, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from hingepair.engine.backend import execution_of
from hingepair.engine.loops import OperationCounts
from hingepair.engine.outputs import Out
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.inverse_kinematics.results import InverseKinematics, InverseKinematicsPath
from hingepair.mechanism import conventions
from hingepair.mechanism.accuracy import error_bounds
from hingepair.mechanism.bodies.body import warn_of_dynamics
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.computations import (
    ALL_OUTPUTS,
    FORCED_OUTPUTS,
    OF_BODIES,
    OF_FRAMES,
    ONE_FRAME,
    Loads,
    RobotComputation,
    checked_given,
    read_wrenches,
    result_class,
)
from hingepair.mechanism.constants import RobotConstants, load_numbers, robot_constants
from hingepair.mechanism.inverse_kinematics import (
    PreparedInverseKinematics,
    read_max_change,
    read_query,
    read_solutions,
)
from hingepair.mechanism.linkages import follow_path
from hingepair.mechanism.loop_forces import LoopWrench, loop_wrenches, open_samples, transmission
from hingepair.mechanism.options import (
    DEFAULT_GRAVITY,
    SEARCH_DEFAULTS,
    BaseOptions,
    DynamicsOptions,
    ForwardOptions,
    FrameOptions,
    LoopOptions,
    RunOptions,
    SearchOptions,
    WeightOptions,
    Wrenches,
    WrenchOptions,
    with_options,
)
from hingepair.mechanism.requests import (
    ALL_COORDINATES,
    FREE_BASE_OUTPUTS,
    MOTION_LEVELS,
    ROBOT_TASKS,
    Request,
    Task,
    Watch,
    ask,
    coordinate_rows,
    motion_level,
    read_gravity,
)
from hingepair.mechanism.rollout import PreparedRollout, Rollout, rolled_out
from hingepair.mechanism.states import (
    Energy,
    JointWrenches,
    MechanismAccelerations,
    MechanismDerivatives,
    MechanismForces,
    MechanismState,
    Momentum,
)
from hingepair.mechanism.strut_functions import function_force, with_function_wrenches
from hingepair.mechanism.tree import Tree, loads_note
from hingepair.numeric.arrays import Float64Array, FloatArray, Frozen, check_choice, is_zero, set_frozen
from hingepair.plans.arguments import Coordinates, renamed_out, requested_outputs
from hingepair.plans.computation import Cache
from hingepair.plans.derivatives import Derivative
from hingepair.plans.prepared import Prepared
from hingepair.plans.trees import COORDINATES, FRAME_OUTPUTS, input_shapes
from hingepair.rollouts.tracks import Feedback
from hingepair.tables.sheets import Shown


class StrutState(NamedTuple):
    """A strut at every sample."""

    length: FloatArray  # between its points [m]
    rate: FloatArray  # of its length [m/s]
    force: FloatArray  # [N]; positive pushes the points apart


_JACOBIANS: Final = {"world": "jacobian", "frame": "jacobian_in_frame"}  # tasks by the argument `axes`
_SOLVED: Final = ROBOT_TASKS["forward_dynamics"].outputs  # NaN where nothing resists


class MechanismMethods(Frozen, Shown):
    """Methods of a robot: kinematics, dynamics, energy and momentum; `Mechanism` derives from this class, and
    describes the arguments that they share.
    """

    __slots__ = ("_cached_constants",)

    _tree: Tree  # record of the robot
    base: str  # "fixed": the base is held, or moves as given; "free": forces move the base
    _cached_constants: RobotConstants

    @property
    def _constants(self) -> RobotConstants:
        """Constants of the robot's programs, made once."""
        try:
            constants = self._cached_constants
        except AttributeError:
            constants = robot_constants(self._tree, self.base == "free")
            set_frozen(self, _cached_constants=constants)
        return constants

    @property
    def _whole_constants(self) -> RobotConstants:
        """The constants without masses shifted to parent bodies (T9), for the wrenches of joints."""
        kept = self._constants.cache.others
        if "whole" not in kept:
            kept["whole"] = robot_constants(self._tree, self.base == "free", whole=True)
        return kept["whole"]

    # ---- kinematics

    @with_options()
    def forward_kinematics(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        **options: Unpack[FrameOptions],
    ) -> MechanismState:
        """Compute the motion of frames (E2, E5, E7-E9). Arguments not listed: see `Mechanism`.

        Args:
            qd: time derivatives of q, which add velocities.
            qdd: second time derivatives of q, which add accelerations.
            outputs: names out of R, S, d, v, omega, a and alpha. By default, all for which the coordinates suffice.
            out: arrays by output name, into which the results are written: (..., frames, 3, 3) of S, (..., frames, 3)
                of others.

        Returns:
            The MechanismState `state`: `state.R` of all frames, shape (..., frames, 3), and `state["panda_hand"].R`
            of one.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> state = robot.forward_kinematics(np.zeros((5, 6)), frames=("tool0", "wrist_1_link"))
        >>> state.R.shape, state["tool0"].S.shape
        ((5, 2, 3), (5, 3, 3))
        """
        given = coordinate_rows(q, qd, qdd)
        return ask(self, MOTION_LEVELS[len(given) - 1], given, options)

    @with_options()
    def jacobian(
        self,
        q: Coordinates,
        frames: str | Iterable[str] | None = None,
        *,
        axes: str = "world",
        **options: Unpack[BaseOptions],
    ) -> FloatArray:
        """Compute the Jacobian J of a frame, (v, omega) = J @ qd if the base is at rest, shape (..., 6, dof); for a
        free base, (v, omega) = J @ (v1, omega1, qd), shape (..., 6, 6 + dof) (E2, E8).

        v is the velocity of the frame's origin. v1 and omega1, of the base, are in world axes. Arguments not listed:
        see `Mechanism`; of `base_motion`, S is used.

        Args:
            frames: one frame; or several, for an axis of frames before the last two.
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
        return ask(self, _JACOBIANS[axes], (q,), {"frames": frames, **options})

    @with_options()
    def jacobian_rate(
        self,
        q: Coordinates,
        qd: Coordinates,
        frames: str | Iterable[str] | None = None,
        *,
        axes: str = "world",
        **options: Unpack[BaseOptions],
    ) -> FloatArray:
        """Compute the time derivative of `jacobian`, of the same shape. Of `base_motion`, S and omega are used.

        Raises:
            ArgumentError: the robot has too many joints.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot, q, qd = hp.load_robot("ur5_robot"), np.zeros(6), np.ones(6)
        >>> np.allclose(robot.jacobian_rate(q, qd, "tool0") @ qd, robot.acceleration_bias(q, qd, "tool0"))
        True
        """
        check_choice("axes", axes, tuple(_JACOBIANS))
        return ask(self, f"{_JACOBIANS[axes]}_rate", (q, qd), {"frames": frames, **options})

    @with_options()
    def acceleration_bias(
        self,
        q: Coordinates,
        qd: Coordinates,
        frames: str | Iterable[str] | None = None,
        **options: Unpack[BaseOptions],
    ) -> FloatArray:
        """Compute the bias in (a, alpha) = J @ qdd + bias of one frame, with J of `jacobian`, world axes, shape (...,
        6); for a free base in (a, alpha) = J @ (a1, alpha1, qdd) + bias (E9).

        Arguments: see `Mechanism`. Of `base_motion`, S and omega are used, and a and alpha unless the base is free.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").acceleration_bias(np.zeros(6), np.zeros(6), "tool0").tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        """
        return ask(self, "acceleration_bias", (q, qd), {"frames": frames, **options})

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
            coordinates: wanted coordinates by joint [rad or m]; shape (...) each.
            q0: coordinates of the first start; those beyond a limit are put on it. By default, all starts are random.
            held: name or names of joints that stay at q0.
            base: what a free base does: "hold" keeps it where `base_motion` says; "solve" finds its pose, base_R and
                base_S, beside q, from there on.
            limits: whether the coordinates stay within `robot.position_limits`; or limits, shape (dof, 2).
            prefer: coordinates that are approached as far as that does not move the frames; or "middle", those in the
                middle of the limits.
            select: "any": the first solution found; "nearest": of those from all starts, the one with the least sum
                of squares of q - q0, which takes some twenty times longer.
            solutions: number of distinct solutions to return, those nearest to q0 first, or to `prefer`, or to the
                middle of the limits. The results have an axis for them.
            weights: what a metre and a radian of the errors count where both cannot vanish, a pair; a dict by frame.
                By default, the stretched length of the chain counts as much as a radian.
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
        query = read_query(self._tree, self._constants, R, S, "inverse_kinematics", **options)
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
        query = read_query(self._tree, self._constants, R, S, "inverse_kinematics_path", **options)
        return query.follow(read_max_change(max_change))

    def error_bounds(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        *,
        frames: str | Iterable[str] | None = None,
        outputs: Iterable[str] | None = None,
        base_motion: BodyMotion | None = None,
        gravity: ArrayLike = DEFAULT_GRAVITY,
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
        coordinates = {name: value for name, value in (("q", q), ("qd", qd), ("qdd", qdd)) if value is not None}
        without = (*ROBOT_TASKS["joint_wrenches"].outputs, *_SOLVED)
        accepted = tuple(name for name in self._available(ALL_OUTPUTS) if name not in without)
        asked = requested_outputs(outputs, None, accepted, ROBOT_TASKS[motion_level(coordinates)].outputs)
        bounds: dict[str, Float64Array] = {}
        for group in ({*asked} - {*OF_BODIES}, {*OF_BODIES}):
            names = tuple(name for name in asked if name in group)
            if not names:
                continue
            computation = self._computation(names, self._frames(frames))
            self._check_needed_inputs(computation, coordinates, names)
            if computation.needs_masses:
                self._check_masses()
            values = computation.read(coordinates, base_motion, {})
            bounds |= error_bounds(computation, values, read_gravity(gravity, DEFAULT_GRAVITY))
        return {name: bounds[name] for name in asked}

    # ---- dynamics

    @with_options()
    def inverse_dynamics(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[DynamicsOptions]
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
        return ask(self, "inverse_dynamics", (q, qd, qdd), options)

    @with_options()
    def forward_dynamics(
        self, q: Coordinates, qd: Coordinates, tau: Coordinates, **options: Unpack[ForwardOptions]
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
        return ask(self, "forward_dynamics", (q, qd, tau), options)

    @with_options()
    def joint_wrenches(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[WrenchOptions]
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
        if self._tree.closure is not None:
            raise ArgumentError(
                "robot", "one without loops; loop_wrenches has what closes them", "a closed mechanism"
            )
        return ask(self, "joint_wrenches", (q, qd, qdd), options)

    @with_options()
    def torque_regressor(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[WeightOptions]
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
        return ask(self, "torque_regressor", (q, qd, qdd), options)

    @with_options()
    def inverse_dynamics_derivatives(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[DynamicsOptions]
    ) -> MechanismDerivatives:
        """Compute the derivatives of the torques of `inverse_dynamics` by q, qd and qdd, exactly up to rounding.

        Wrenches keep their values in world axes. A free base adds six rows, those of force1 and torque1, and six
        columns: by displacements of R1 and rotations of the base, by v1 and omega1, by a1 and alpha1; world axes, and
        omega1 and alpha1 stay as they are while the base rotates. Second derivatives are central differences of
        these: `jax.hessian` of a robot compiles for minutes. Arguments not listed: see `inverse_dynamics`.

        Args:
            joint_loads: as at `Mechanism`; derivatives of dry friction are 0.
            outputs: names out of tau_q, tau_qd and tau_qdd; by default all.

        Returns:
            The MechanismDerivatives: (..., dof, dof), a row for each torque, a column for each coordinate; of a free
            base (..., 6 + dof, 6 + dof). tau_qdd is the mass matrix.

        Raises:
            ArgumentError: the robot has too many joints.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> d = robot.inverse_dynamics_derivatives(np.zeros(6), np.zeros(6), np.zeros(6))
        >>> d.tau_q.shape, np.allclose(d.tau_qdd, robot.mass_matrix(np.zeros(6)))
        ((6, 6), True)
        """
        return ask(self, "inverse_dynamics_derivatives", (q, qd, qdd), options)

    @with_options()
    def forward_dynamics_derivatives(
        self, q: Coordinates, qd: Coordinates, tau: Coordinates, **options: Unpack[ForwardOptions]
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
            ArgumentError: the robot has too many joints.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> robot.forward_dynamics_derivatives(np.zeros(6), np.zeros(6), np.zeros(6)).qdd_tau.shape
        (6, 6)
        """
        return ask(self, "forward_dynamics_derivatives", (q, qd, tau), options)

    def rollout(
        self,
        q0: Coordinates,
        qd0: Coordinates,
        tau: ArrayLike | Feedback,
        dt: float,
        *,
        method: str = "semi_implicit",
        steps: int | None = None,
        every: int = 1,
        effort_limits: bool | ArrayLike = False,
        gravity: ArrayLike = DEFAULT_GRAVITY,
        wrenches: Wrenches = None,
        joint_loads: bool | None = None,
        base_motion: BodyMotion | None = None,
        out: Out = None,
        workers: int = 1,
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
            effort_limits: True clips the efforts to `robot.effort_limits`; or largest efforts in the forms of tau.
            wrenches: as at `Mechanism`, of shape (3,) or (..., steps, 3) each.
            joint_loads: as at `Mechanism`. Dry friction stops a joint within a step at most, so that the joint then
                rests. With "semi_implicit", dampers act with the rate at the end of the step, which is stable for any
                damping.
            base_motion: the start of a free base; its R, S, v and omega are used. Of any other base the motion as
                given, S, omega, a and alpha: one sample; or shape (..., steps), held over each step; or for "rk4"
                (..., 2 steps + 1), at starts, middles and ends of steps.

        Returns:
            The Rollout `r`: `r.q` and `r.qd`, shape (..., steps // every + 1, dof), the start first, and their
            instants `r.t`. With a free base also R1, S1, v1 and omega1, and `r.base_motion` for other methods, as in
            `robot.energy(r.q, r.qd, base_motion=r.base_motion)`. The attitude is turned by the exponential of omega1.
            Where the mass matrix is singular, motions become NaN, and a DynamicsWarning says so.

        Raises:
            ArgumentError: the robot has too many joints.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot")
        >>> tau = np.zeros((100, 50, 6))  # 100 motions, 50 steps
        >>> robot.rollout(np.zeros(6), np.zeros(6), tau, 1e-3).q.shape
        (100, 51, 6)
        """
        limit: Any = None if effort_limits is False else effort_limits
        uneven = next((joint.name for joint in self._tree.coordinates if joint.effort_range), None)
        if effort_limits is True and uneven is not None:
            expected = f"numbers, since the bounds of {uneven!r} differ (`effort_bounds`)"
            raise ArgumentError("effort_limits", expected, effort_limits)
        if effort_limits is True:
            limit = np.array([joint.effort_limit for joint in self._tree.coordinates])
        loads, links = read_wrenches(wrenches, self._tree)
        self._warn_of_masses()
        computation = self._computation(("qdd",), links, len(links), self._loaded(joint_loads))
        result = rolled_out(
            computation, q0, qd0, tau, dt, method=method, steps=steps, every=every, limit=limit,
            gravity=read_gravity(gravity, DEFAULT_GRAVITY), loads=loads, base_motion=base_motion, out=out,
            execution=execution_of("auto", workers),
        )  # fmt: skip
        if self._constants.may_be_singular and np.isnan(result.q[..., -1, :]).any():
            self.forward_dynamics(q0, qd0, np.zeros(len(self._constants.names)), joint_loads=False)  # which warns
        return result

    @with_options()
    def all_coordinates(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        **options: Unpack[RunOptions],
    ) -> Any:
        """Compute the coordinates of all joints of a closed mechanism, an array (..., joints); with qd and qdd, a
        tuple of these and their derivatives.

        The order is that of `names` before the loops were closed. Samples that cannot be closed are NaN. Arguments:
        see `Mechanism`.
        """
        given = coordinate_rows(q, qd, qdd)
        outputs = ALL_COORDINATES[: len(given)]
        found = ask(self, outputs[-1], given, options)
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

    @with_options()
    def loop_wrenches(
        self, q: Coordinates, qd: Coordinates, qdd: Coordinates, **options: Unpack[LoopOptions]
    ) -> dict[str, LoopWrench]:
        """Compute what the body of each loop's first frame exerts on that of the second during a motion, world axes.

        Redundant conditions leave components open, which no rigid body determines: they are NaN. Arguments: see
        `inverse_dynamics`; efforts `tau` act at the coordinates.

        Returns:
            By the loop's name, force [N] and torque about the frame's origin [N m], shape (..., 3).
        """
        closure = self._tree.closure
        if closure is None:
            raise ArgumentError("robot", "one with loops, as robot.closed(...) returns", "a tree")
        run: Any = {"backend": options.get("backend", "auto")}
        base: Any = {"base_motion": options.get("base_motion"), **run}
        efforts = ask(self, "tree_tau", (q, qd, qdd), options)
        jacobian, units = ask(self, "loop_jacobian", (q,), run), ask(self, "loop_wrenches", (q,), base)
        return loop_wrenches(closure, efforts, jacobian, units)

    def transmission(self, q: Coordinates, *, backend: str = "auto") -> FloatArray:
        """Compute the smallest over the largest singular value of the loops' Jacobian by the joints that follow.

        Its shape is (...). It is 0 at a dead point, where the coordinates do not move the others. Arguments: see
        `Mechanism`.
        """
        closure = self._tree.closure
        if closure is None:
            raise ArgumentError("robot", "one with loops, as robot.closed(...) returns", "a tree")
        return transmission(closure, ask(self, "loop_jacobian", (q,), {"backend": backend}))

    @with_options()
    def struts(
        self, q: Coordinates, qd: Coordinates | None = None, **options: Unpack[RunOptions]
    ) -> dict[str, StrutState]:
        """Compute the lengths of all struts [m], their rates [m/s] and forces [N], by name. Arguments not listed: see
        `Mechanism`.

        Args:
            qd: time derivatives of q; by default 0.
        """
        rates = (0.0,) * len(self._constants.names) if qd is None else qd
        found, states = ask(self, "struts", (q, rates), options), {}
        for k, strut in enumerate(self._tree.struts):
            length, rate, force = (column[..., k] for column in found.arrays().values())
            if strut.function is not None:
                force = force + function_force(strut, length, rate)
            states[strut.name] = StrutState(length, rate, force)
        return states

    @with_options()
    def mass_matrix(self, q: Coordinates, **options: Unpack[BaseOptions]) -> FloatArray:
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
        return ask(self, "mass_matrix", (q,), options)

    @with_options()
    def bias_forces(self, q: Coordinates, qd: Coordinates, **options: Unpack[WeightOptions]) -> FloatArray:
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
        return ask(self, "bias_forces", (q, qd), options)

    @with_options()
    def gravity_forces(self, q: Coordinates, **options: Unpack[WeightOptions]) -> FloatArray:
        """Compute the generalized forces that hold the robot at rest against gravity (T1-T3), shape (..., dof); for a
        free base (force1, torque1, tau), shape (..., 6 + dof).

        Arguments: see `Mechanism`. Of `base_motion`, S is used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").gravity_forces(np.zeros(6)).shape
        (6,)
        """
        return ask(self, "gravity_forces", (q,), options)

    @with_options()
    def centre_of_mass(self, q: Coordinates, **options: Unpack[BaseOptions]) -> FloatArray:
        """Compute the robot's centre of mass, world axes [m]; shape (..., 3). The base counts only if it is free. NaN
        if nothing has mass.

        Arguments: see `Mechanism`. Of `base_motion`, R and S are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").centre_of_mass(np.zeros(6)).shape
        (3,)
        """
        return ask(self, "centre_of_mass", (q,), options)

    @with_options()
    def centre_of_mass_jacobian(self, q: Coordinates, **options: Unpack[BaseOptions]) -> FloatArray:
        """Compute the Jacobian J of the centre of mass, whose velocity is J @ qd if the base is at rest, shape (...,
        3, dof); for a free base J @ (v1, omega1, qd), world axes, shape (..., 3, 6 + dof).

        Arguments: see `Mechanism`. Of `base_motion`, S is used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").centre_of_mass_jacobian(np.zeros(6)).shape
        (3, 6)
        """
        return ask(self, "centre_of_mass_jacobian", (q,), options)

    @with_options()
    def centroidal_momentum_matrix(self, q: Coordinates, **options: Unpack[BaseOptions]) -> FloatArray:
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
        return ask(self, "centroidal_momentum_matrix", (q,), options)

    @with_options()
    def centroidal_momentum_matrix_rate(
        self, q: Coordinates, qd: Coordinates, **options: Unpack[BaseOptions]
    ) -> FloatArray:
        """Compute the time derivative of `centroidal_momentum_matrix`, of the same shape. Of `base_motion`, S and
        omega are used.

        Raises:
            ArgumentError: the robot has too many joints.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> hp.load_robot("ur5_robot").centroidal_momentum_matrix_rate(np.zeros(6), np.ones(6)).shape
        (6, 6)
        """
        return ask(self, "centroidal_momentum_matrix_rate", (q, qd), options)

    @with_options()
    def energy(self, q: Coordinates, qd: Coordinates, **options: Unpack[WeightOptions]) -> Energy:
        """Compute the kinetic energy and the potential energy in uniform gravity [J] (T7); the latter is 0 for a mass
        at the world's origin.

        The base counts only if it is free. The rotors of the motors (`armature`) count in the kinetic energy.
        Arguments: see `Mechanism`. Of `base_motion`, R, S, v and omega are used.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> float(hp.load_robot("ur5_robot").energy(np.zeros(6), np.zeros(6)).kinetic)
        0.0
        """
        return ask(self, "energy", (q, qd), options)

    @with_options()
    def momentum(
        self, q: Coordinates, qd: Coordinates, *, about: str = "origin", **options: Unpack[BaseOptions]
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
        return ask(self, f"momentum_about_{about}", (q, qd), options)

    # ---- conventions

    def to_pinocchio_state(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        base_motion: BodyMotion | None = None,
        *,
        cos_sin: bool = False,
    ) -> tuple[Float64Array, Float64Array | None]:
        """Return q and v as Pinocchio writes them. For a free base, q begins with R1 and the quaternion (x, y, z, w)
        of S1, and v with v1 and omega1 in the axes of the base.

        Args:
            base_motion: R, S, v and omega of a free base.
            cos_sin: hinges without limits become two numbers, cosine and sine, as in models that Pinocchio reads from
                URDF files.

        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot", base="free")
        >>> q, v = robot.to_pinocchio_state([0.1] * 6, [0.2] * 6)
        >>> q.shape, v.shape
        ((13,), (12,))
        """
        turning = conventions.continuous_columns(self._tree) if cos_sin else []
        return self._written(conventions.PINOCCHIO, q, qd, base_motion, turning)

    def to_mujoco_state(
        self, q: Coordinates, qd: Coordinates | None = None, base_motion: BodyMotion | None = None
    ) -> tuple[Float64Array, Float64Array | None]:
        """Return qpos and qvel as MuJoCo writes them, for joints in the order of `names`. For a free base, qpos
        begins with R1 and the quaternion (w, x, y, z) of S1, and qvel with v1 in world axes and omega1 in the axes of
        the base.
        """
        return self._written(conventions.MUJOCO, q, qd, base_motion, [])

    def from_pinocchio_state(self, q: ArrayLike, v: ArrayLike | None = None) -> conventions.State:
        """Return (q, qd, base_motion) of a state that Pinocchio has written; base_motion is None unless the base is
        free. Hinges without limits may be cosine and sine in Pinocchio's q.

        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot", base="free")
        >>> state = robot.from_pinocchio_state([0, 0, 1, 0, 0, 0, 1] + [0.1] * 6)
        >>> state.q.shape, state.base_motion.R.tolist()
        ((6,), [0.0, 0.0, 1.0])
        """
        turning = conventions.continuous_columns(self._tree)
        dof = len(self._constants.names)
        return conventions.read_state(conventions.PINOCCHIO, q, v, self.base == "free", dof, turning)

    def from_mujoco_state(self, qpos: ArrayLike, qvel: ArrayLike | None = None) -> conventions.State:
        """Return (q, qd, base_motion) of a state that MuJoCo has written, for joints in the order of `names`;
        base_motion is None unless the base is free.
        """
        dof = len(self._constants.names)
        return conventions.read_state(conventions.MUJOCO, qpos, qvel, self.base == "free", dof, [])

    def integrate(self, q: Coordinates, v: ArrayLike, base_motion: BodyMotion | None = None) -> conventions.State:
        """Return the configuration (q, None, base_motion) that a change v leads to: q + v; with a free base, v begins
        with the change of R1 and the rotation vector of the base, world axes: S1 becomes exp(v[3:6]) S1.

        Args:
            v: the change, shape (..., dof), with a free base (..., 6 + dof): the order of `mass_matrix`.
            base_motion: R and S of a free base.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot", base="free")
        >>> there = robot.integrate(np.zeros(6), np.full(12, 0.1))
        >>> robot.difference(np.zeros(6), there.q, base_motion1=there.base_motion).round(12).tolist()
        [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1]
        """
        free = self.base == "free"
        conventions.check_base(base_motion, free)
        return conventions.integrated(self._tree.rows("q", q), v, base_motion, free)

    def difference(
        self,
        q0: Coordinates,
        q1: Coordinates,
        base_motion0: BodyMotion | None = None,
        base_motion1: BodyMotion | None = None,
    ) -> Float64Array:
        """Return the change for which `integrate` leads from q0 to q1, and a free base from `base_motion0` to
        `base_motion1`; shape (..., dof), with a free base (..., 6 + dof), first the changes of R1 and, as a rotation
        vector, of S1, in world axes.
        """
        free = self.base == "free"
        conventions.check_base(base_motion0, free, "base_motion0")
        conventions.check_base(base_motion1, free, "base_motion1")
        rows = self._tree.rows("q0", q0), self._tree.rows("q1", q1)
        return conventions.difference(*rows, base_motion0, base_motion1, free)

    def _written(
        self,
        convention: conventions.Convention,
        q: Coordinates,
        qd: Coordinates | None,
        base_motion: BodyMotion | None,
        turning: list[int],
    ) -> tuple[Float64Array, Float64Array | None]:
        """Return q and, if qd is given, v as a package writes them, cosine and sine in the columns `turning` of q."""
        free = self.base == "free"
        conventions.check_base(base_motion, free)
        rates = None if qd is None else self._tree.rows("qd", qd)
        written = conventions.written_q(convention, self._tree.rows("q", q), base_motion, free, turning)
        if rates is None:
            return written, None
        return written, conventions.written_v(convention, rates, base_motion, free)

    def _prepared_rollout(
        self, refused: dict[str, Any], shared: dict[str, Any], options: dict[str, Any]
    ) -> PreparedRollout:
        """Return a prepared rollout; refuse what it does not take."""
        for name, value in refused.items():
            if value is not None:
                raise ArgumentError(name, "None, since a rollout records q and qd", quoted(value))
        inspect.signature(self.rollout).bind("q0", "qd0", "tau", **options)  # a TypeError as of any call
        rolled = functools.partial(self.rollout, **shared, **options)
        return PreparedRollout(rolled, len(self._constants.names), self.base == "free")

    @overload
    def prepare(self, given: Literal["rollout"], *, dt: float, **rollout: Any) -> PreparedRollout: ...

    @overload
    def prepare(  # type: ignore[overload-overlap]
        self, given: Literal["inverse_kinematics"], *, frames: str | Iterable[str] | None = None, **options: Any
    ) -> PreparedInverseKinematics: ...

    @overload
    def prepare(
        self,
        given: str | Iterable[str],
        *,
        frames: str | Iterable[str] | None = None,
        outputs: Iterable[str] | None = None,
        gravity: ArrayLike = DEFAULT_GRAVITY,
        joint_loads: bool | None = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Prepared: ...

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
        **rollout: Any,
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
            outputs: names of the outputs: those of the method; of a tuple of names those of any method for which they
                suffice, or the name of one that returns derivatives. By default all of the method; of a tuple those
                of `forward_dynamics` where it holds efforts, else those of `forward_kinematics`.
            wrenches: names of links or other frames on which wrenches act in dynamics. Behind the other arguments,
                the call then takes force_0 and torque_0 of the first, and so on, as `inverse_dynamics` does.
            backend: "auto" and "compiled" compile during this call, "numpy" never does.
            **rollout: for "rollout", dt and the other options of the method `rollout`; for "inverse_kinematics"
                options of that method, such as `prefer`, `limits` and `base`.

        Returns:
            A `Prepared`, whose calls return what the method returns; with outputs of several methods the result of
            the one that has the first, in which the others are attributes of frames' motions, or else
            `result["jacobian"]`. A `PreparedRollout` of "rollout"; a `PreparedInverseKinematics`, which steps from
            q0 to the target of a call, of "inverse_kinematics".

        Raises:
            ArgumentError: a name is unknown, or an output needs an argument that is not given.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> step = hp.load_robot("ur5_robot").prepare("inverse_dynamics", outputs=("tau",))
        >>> step(np.zeros(6), np.zeros(6), np.zeros(6)).tau.shape
        (6,)
        """
        if given == "rollout":
            shared: dict[str, Any] = {"gravity": gravity, "joint_loads": joint_loads, "workers": workers}
            return self._prepared_rollout({"frames": frames, "outputs": outputs}, shared, rollout)
        if given == "inverse_kinematics":
            return PreparedInverseKinematics(self._tree, self._constants, frames, outputs, rollout)
        if rollout:
            raise ArgumentError(next(iter(rollout)), 'an option of prepare("rollout", ...) alone', quoted(given))
        names = checked_given(given)
        loads = [name for name in names if name in ("force1", "torque1")]
        if loads and self.base != "free":
            raise ArgumentError("given", "no forces on a fixed base (base='free' is moved by them)", ", ".join(loads))
        if not isinstance(outputs, str | None):
            outputs = tuple(outputs)
        derivatives = {name for name, task in ROBOT_TASKS.items() if task.derivative}
        derived = next((one for one in (given, outputs) if isinstance(one, str) and one in derivatives), None)
        derivative: Derivative | None = None
        if derived is not None:
            output_names, _, _, derivative = self._wanted(
                ROBOT_TASKS[derived], None if outputs == derived else outputs
            )
        else:
            output_names = self._prepared_outputs(given, names, outputs)
        if self._calls_functions(output_names):
            self._tree.refuse_functions()
        framed, links = not {*output_names}.isdisjoint(OF_FRAMES), self._links(wrenches)
        if framed and links:
            raise ArgumentError("wrenches", "() where an output is of frames", quoted(wrenches))
        named = self._frames(frames, one=not {*output_names}.isdisjoint(ONE_FRAME)) if framed else links
        loaded = not {*output_names}.isdisjoint(("tau", *_SOLVED)) and self._loaded(joint_loads)
        computation = self._computation(output_names, named, len(links), loaded)
        names = checked_given(names, computation.inputs)
        if computation.needs_masses:
            self._warn_of_masses()
        if derivative is not None:
            computation.check_differentiable(derivative, names)
        prepare: Callable[..., Prepared] = self.prepare
        remade = functools.partial(
            prepare, given if isinstance(given, str) else names, frames=named if framed else None, outputs=outputs,
            gravity=gravity, wrenches=links, joint_loads=computation.request.joint_loads, workers=workers,
            backend=backend,
        )  # fmt: skip
        names = (*names, *(f"{kind}_{k}" for k in range(len(links)) for kind in ("force", "torque")))
        execution, vector = execution_of(backend, workers), read_gravity(gravity, DEFAULT_GRAVITY)
        return Prepared(computation, names, execution, vector, remade, self._watch(output_names), derivative)

    def _links(self, wrenches: Iterable[str]) -> tuple[str, ...]:
        """Return the names of links on which wrenches act in a prepared call."""
        names = (wrenches,) if isinstance(wrenches, str) else tuple(wrenches)
        read_wrenches(dict.fromkeys(names, (0, 0)), self._tree)
        return names

    # ---- how methods compute

    @property
    def _cache(self) -> Cache:
        return self._constants.cache

    @property
    def _tasks(self) -> Mapping[str, Task]:
        return ROBOT_TASKS

    def _request(self, task: Task, given: dict[str, Any], options: Mapping[str, Any], out: Any) -> Request:
        """Return the request of a method."""
        computed, default, names, derivative = self._wanted(task, options.get("outputs"), out)
        wrenches, called = options.get("wrenches"), self._calls_functions(computed)
        if called and derivative is not None:
            self._tree.refuse_functions()
        if called:
            base_motion = options.get("base_motion")
            wrenches = with_function_wrenches(self, self._tree, given["q"], given.get("qd"), base_motion, wrenches)
        loads, links = read_wrenches(wrenches, self._tree)
        accepts = task.options.__annotations__
        if "force1" in accepts:
            loads = {**loads, **self._base_loads(options.get("force1", 0), options.get("torque1", 0))}
        frames = links or self._task_frames(computed, options.get("frames"))
        loaded = "joint_loads" in accepts and self._loaded(options.get("joint_loads"))
        computation = self._computation(computed, frames, len(links), loaded)
        coordinates = {label: x for label, x in given.items() if x is not None or derivative}
        self._check_needed_inputs(computation, coordinates, computed)
        if derivative is not None:
            computation.check_differentiable(derivative, tuple(coordinates))
        if computation.needs_masses:
            self._warn_of_masses()
        moving = derivative is not None and derivative.kind == "rate"
        arguments, labels = computation.given(coordinates, options.get("base_motion"), loads, moving)
        return Request(
            computation, arguments, labels, read_gravity(options.get("gravity", DEFAULT_GRAVITY), DEFAULT_GRAVITY),
            functools.partial(self._computation, *computation.asked), derivative, self._watch(computed, plain=True),
            # What the arrays of `out` ask for can be something else the next time.
            lasts=not called and (options.get("outputs") is not None or names == default),
        )  # fmt: skip

    def _calls_functions(self, outputs: Iterable[str]) -> bool:
        """Return whether outputs depend on struts whose force is a function."""
        return self._tree.has_functions and not FORCED_OUTPUTS.isdisjoint(outputs)

    def _watch(self, outputs: Iterable[str], plain: bool = False) -> Watch | None:
        """Return what looks at the results of a call; None where nothing can be wrong with them."""
        if self._constants.may_be_singular and not {*outputs}.isdisjoint(_SOLVED):
            return self._warn_where_singular
        return self._warn_where_open if plain and self._tree.closure is not None else None

    def _wanted(
        self, task: Task, outputs: Iterable[str] | None, out: Any = None
    ) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...], Derivative | None]:
        """Return what a row of the table computes: the outputs of the tree, the names of all results by default,
        those that are asked for, and the derivative that leads to them.
        """
        if task.derivative == "matrices":
            default = tuple(f"{task.outputs[0]}_{name}" for name in task.given)
            names = requested_outputs(outputs, out, default, default)
            size = (self._constants.form.dof + 6 * (self.base == "free"),)
            by = tuple((name.partition("_")[2], size) for name in names)
            efforts = task.outputs if self.base == "free" else task.outputs[:1]
            return efforts, default, names, Derivative(task.derivative, names, by)
        default = self._available(task.outputs)
        accepted = FRAME_OUTPUTS if task.result is MechanismState else default
        names = requested_outputs(outputs, out, accepted, default)
        return names, default, names, Derivative(task.derivative, names, ()) if task.derivative else None

    def _computed(self, outputs: tuple[str, ...], **given: Any) -> Any:
        """Compute outputs from coordinates, for messages."""
        computation = self._computation(outputs)
        return computation.compute(given, execution_of("numpy", 1), DEFAULT_GRAVITY)

    def _warn_where_open(self, result: Any, arguments: Mapping[str, Any]) -> None:
        """Issue a DynamicsWarning that counts the samples at which the loops cannot be closed."""
        closure = self._tree.closure
        arrays = [result] if isinstance(result, np.ndarray) else [*result.arrays().values()]
        if closure is None or not any(np.isnan(array).any() for array in arrays):
            return
        rows = self._tree.rows("q", arguments["q"])
        all_q, gaps = (self._computed((name,), q=rows) for name in ("q_all", "loop_gaps"))
        if (message := open_samples(closure, rows, all_q, gaps)) is not None:
            warn_of_dynamics(f"{self._tree.name}: {message}")

    def _computation(
        self, outputs: tuple[str, ...], frames: tuple[str, ...] = (), loaded: int = 0, joint_loads: bool = False
    ) -> RobotComputation:
        """Return the computation of outputs, which is made once; wrenches act on the first `loaded` frames."""
        key = outputs, frames, loaded, joint_loads
        computations = self._constants.cache.computations
        found: RobotComputation | None = computations.get(key)
        if found is None:
            free, constants = self.base == "free", self._constants
            chosen = tuple(self._tree.known_frame("frames", name) for name in frames)
            if {*outputs} <= {*OF_BODIES}:
                chosen = self._tree.body_frames(free)
            if not {*outputs}.isdisjoint(ROBOT_TASKS["joint_wrenches"].outputs):
                constants = self._whole_constants
            kind = result_class(outputs, frames, constants)
            found = RobotComputation(constants, outputs, free, chosen, tuple(range(loaded)), kind, joint_loads)
            found.asked = key
            computations[key] = found
        return found

    def _available(self, outputs: tuple[str, ...]) -> tuple[str, ...]:
        """Return the outputs that exist for this base."""
        return outputs if self.base == "free" else tuple(name for name in outputs if name not in FREE_BASE_OUTPUTS)

    def _prepared_outputs(
        self, given: str | Iterable[str], names: tuple[str, ...], outputs: Iterable[str] | None
    ) -> tuple[str, ...]:
        """Return the outputs of a prepared call, of which `names` are the arguments."""
        if isinstance(given, str):
            return self._wanted(ROBOT_TASKS[given], outputs)[0]
        pushed = not {"tau", "force1", "torque1"}.isdisjoint(names)
        default = self._available(ROBOT_TASKS["forward_dynamics" if pushed else motion_level(names)].outputs)
        accepted = tuple(name for name in self._available(ALL_OUTPUTS) if name not in (*names, *OF_BODIES))
        return requested_outputs(outputs, None, accepted, default)

    def _task_frames(self, outputs: tuple[str, ...], frames: str | Iterable[str] | None) -> tuple[str, ...]:
        """Return the names of the frames whose outputs are asked for, out of the argument `frames`."""
        if {*outputs}.isdisjoint(OF_FRAMES):
            return ()
        if frames is None and len(self._tree.tips) != 1 and {*outputs}.isdisjoint(FRAME_OUTPUTS):
            expected = f"the name of a link or joint, such as {', '.join(self._tree.tips[:4])}"
            raise ArgumentError("frames", expected, None)
        return self._frames(frames, one=not {*outputs}.isdisjoint(ONE_FRAME))

    def _frames(self, frames: str | Iterable[str] | None, one: bool = False) -> tuple[str, ...]:
        """Return the names in the argument `frames`; None stands for the last links of all branches."""
        try:
            names = self._tree.tips if frames is None else (frames,) if isinstance(frames, str) else tuple(frames)
        except TypeError:
            names = ()
        if not names:
            raise ArgumentError("frames", "names of links or joints", quoted(frames))
        if one and len(names) != 1:
            raise ArgumentError("frames", "the name of one link or joint", quoted(frames))
        if len({*names}) < len(names):
            raise ArgumentError("frames", "each name once", quoted(names))
        return names

    def _check_needed_inputs(
        self, computation: RobotComputation, coordinates: Mapping[str, Any], outputs: tuple[str, ...]
    ) -> None:
        """Refuse coordinates that do not suffice for the outputs."""
        for name in COORDINATES:
            if name in computation.inputs and name not in coordinates:
                first = next(
                    one
                    for one in outputs
                    if name in input_shapes(computation.form, computation.request._replace(outputs=(one,)))
                )
                raise ArgumentError(name, f"values of the joints, since output {first} needs them", None)

    def _base_loads(self, force1: ArrayLike, torque1: ArrayLike) -> Loads:
        """Return the loads on a free base that are not the number 0."""
        loads: dict[str, tuple[Any, str]] = {}
        if type(force1) is int and type(torque1) is int and force1 == torque1 == 0:  # by default
            return loads
        for name, value in (("force1", force1), ("torque1", torque1)):
            if not is_zero(value):
                loads[name] = value, name
                if self.base != "free":
                    expected = "0: a fixed base is not moved by forces (base='free' is)"
                    raise ArgumentError(name, expected, quoted(value))
        return loads

    def _check_masses(self) -> None:
        """Refuse a body whose mass was never given, and masses that overflow."""
        for number, link in self._tree.without_mass.items():
            if number == 0 and self.base == "free":
                where = "body1 of the first pair"
            elif number > 0:
                where = f"body2 of {link!r}"
            else:
                continue
            body = where[:5]
            example = f"HingePair(..., {body}=hp.Body(mass=2.0)), or in a scene {body}.mass = 2.0 of its [[joint]]"
            raise ArgumentError(where, f"mass properties, as in {example}", None)
        if self._constants.overflows:
            expected = "masses and lengths whose products mass x length^2 stay below 1.8e308 kg m^2"
            raise ArgumentError(f"robot {self._tree.name!r}", expected, "products that overflow")

    def _warn_of_masses(self) -> None:
        """Issue a DynamicsWarning for each of the tree's notes, at the first call for a robot."""
        cache = self._constants.cache
        if not cache.warned:
            self._check_masses()
            cache.warned = True
            for note in self._tree.notes:
                warn_of_dynamics(f"{self._tree.name}: {note}")

    def _loaded(self, joint_loads: bool | None) -> bool:
        """Return whether loads of joints act; the first call that leaves them out unasked warns."""
        if joint_loads not in (None, False, True):
            raise ArgumentError("joint_loads", "True or False", quoted(joint_loads))
        cache = self._constants.cache
        if joint_loads is None and not cache.warned_of_loads:
            cache.warned_of_loads = True
            if note := loads_note(self._tree):
                warn_of_dynamics(
                    f"{self._tree.name}: {note}; joint_loads=True counts them, joint_loads=False is silent"
                )
        if joint_loads and self._tree.closure is not None:
            rubbing = [
                joint.name
                for joint in self._tree.joints
                if joint.load.friction and joint.name not in self._constants.names
            ]
            if rubbing:
                expected = "False, since dry friction acts at joints that are no coordinates of the closed mechanism"
                raise ArgumentError("joint_loads", expected, ", ".join(rubbing))
        return bool(joint_loads) and any(load_numbers(self._tree))

    def _warn_where_singular(self, result: Any, arguments: Mapping[str, Any]) -> None:
        """Issue a DynamicsWarning that names what no inertia resists, where accelerations are NaN for that."""
        q, arrays = arguments["q"], result.arrays()
        found = [array for name, array in arrays.items() if name in _SOLVED and isinstance(array, np.ndarray)]
        # Where one derivative is NaN, all are.
        found += [array[..., 0] for name, array in arrays.items() if name.startswith("qdd_")][:1]
        bad = np.asarray(np.logical_or.reduce([np.isnan(array).any(axis=-1) for array in found] or [np.False_]))
        if not bad.any():
            return
        names = ("pivots", "base_pivots") if self.base == "free" else ("pivots",)
        pivots = self._computed(names, q=q).arrays()
        constants = self._constants
        thresholds = {"pivots": constants.pivot_thresholds, "base_pivots": constants.base_pivot_thresholds}
        labels = [*(f"joint {name!r}" for name in constants.names), *["the base"] * 6]
        smallest = np.concatenate([thresholds[name] for name in names])
        values = np.concatenate([np.asarray(pivots[name]) for name in names], axis=-1)
        low = ~(np.abs(values) > smallest) & (smallest > 0) & bad[..., None]
        if low.any():
            first = low.reshape(-1, low.shape[-1])[int(np.argmax(low.any(axis=-1)))]
            count = int(low.any(axis=-1).sum())
            where = f"at {count} of {bad.size} samples" if bad.shape else "here"
            of_joints = np.flatnonzero(first[: len(constants.names)])
            which = labels[int(of_joints[-1]) if of_joints.size else -1]
            warn_of_dynamics(f"{self._tree.name}: no mass resists {which} {where}; accelerations are NaN there")


def count_operations(
    robot: MechanismMethods,
    coordinates: tuple[Coordinates, ...],
    outputs: tuple[str, ...],
    frames: tuple[str, ...] = (),
    base_motion: BodyMotion | None = None,
) -> OperationCounts:
    """Count the operations that outputs of `forward_kinematics` or `inverse_dynamics` take, of which those of
    coordinates with one value for all samples vanish or are performed once.
    """
    computation = robot._computation(outputs, frames)
    named = dict(zip(("q", "qd", "qdd"), coordinates, strict=False))
    return computation.count_operations(computation.read(named, base_motion, {}).values, DEFAULT_GRAVITY)
