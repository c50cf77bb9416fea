"""Comparison of the outputs of pairs and robots with those of Pinocchio, and of simulated loads with its `rnea`.

The outputs of both sides are arrays by name, with N samples on the first axis. What is along the velocities of a
robot is in the order (force1, torque1, tau) of a free base, or tau.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.building.pairs import tree_of_pair
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.accuracy import euler_rate_sizes, unit_roundoff
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.pairs.subject import check_pair, check_single_pair, read_rows
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import Float64Array, one_constant
from hingepair.plans.arguments import Coordinates
from hingepair.plans.pairs import PLANE, POINT_ENDINGS, SPACE
from hingepair.validation.loops import Linkage
from hingepair.validation.pinocchio_twin import (
    LETTERS,
    Twin,
    frame_motions,
    import_pinocchio,
    robot_twin,
    tree_twin,
    urdf_twin,
    with_base,
)
from hingepair.validation.report import MAX_LOAD_RATIO, Comparison, CrossValidation
from hingepair.validation.scales import Scales

Outputs = dict[str, Float64Array]

_ON_BASE = {"force1": slice(3), "torque1": slice(3, 6)}  # among the forces along the velocities of a free base
_LEAST_INSTANTS = 8  # of a motion whose rates are compared with slopes
_RATE_SHARE = 1e-3  # of the largest rate; a rate that is off by less is not told from errors of a simulation


def cross_validate(
    pair: HingePair | PlanarPair | Mechanism,
    q: Any,
    qd: Any = None,
    qdd: Any = None,
    psidd: ArrayLike | None = None,
    *,
    sequence: str = "XYZ",
    frames: str | Iterable[str] | None = None,
    base_motion: BodyMotion | None = None,
    gravity: ArrayLike = DEFAULT_GRAVITY,
) -> CrossValidation:
    """Compare the outputs that hingepair computes for a pair or a robot with those that Pinocchio computes.

    The two computations share no code. For a pair, Pinocchio also computes the attitude and the angular velocity of
    body 1 from the Euler angles, with a chain of three revolute joints in the order of the Euler sequence. R2, S2 and
    d = R2 - R1 are compared, with qd also v2 and omega2, with qdd also a2 and alpha2, and the motion of points, which
    are frames there. Pinocchio computes d as the position of body 2 for R1 = 0, because the difference of R2 and R1
    would contain the rounding errors of both.

    A robot that was read from a URDF is compared with the model that Pinocchio itself makes of the same text. A robot
    that came from pairs or from a Pinocchio model, has a payload, or was read with `snap` is compared with a model
    that is built from the robot, which shows errors of the computations but not of the reading. The report says which
    (`.compared_with`).

    For a robot, the motion and the Jacobians of links (see `frames`) and the mass matrix are compared. If qd is
    given, energies and momenta are compared too, and if qdd is given, forces and torques. Forward dynamics is checked
    by its residual: Pinocchio's inverse dynamics computes the forces that hingepair's accelerations require, and
    these forces are compared with the applied forces. Samples at which the mass matrix is singular are left out of
    this comparison.

    Args:
        pair: a `HingePair`, a `PlanarPair` or a `Mechanism` (robot). A planar pair is compared in the plane, with the
            angle phi2 in place of S2.
        q: coordinates. For a pair (x, y, z, phi_x, phi_y, phi_z, psi) [m, rad], shape (..., 7) or a tuple of seven
            coordinates; for a planar pair (x, y, phi, psi) [m, rad], shape (..., 4) or a tuple of four. For a robot,
            an array of shape (..., dof), a table whose columns have the joints' names, or a dict with a number or an
            array for each joint's name. Or, of a `HingePair`, body1, a BodyMotion, before psi, psid and psidd. Its S
            must be a rotation to within rounding errors, as `project_to_rotation` returns it, because Pinocchio
            stores attitudes as quaternions.
        qd: first time derivatives of q, in the same form as q.
        qdd: second time derivatives of q, in the same form as q.
        psidd: second time derivative of psi [rad/s^2], after body1, psi and psid.
        sequence: Euler sequence of body 1 of a `HingePair`; "XYZ" unless given.
        frames: for a robot, names of the links, joints or other frames whose motion and Jacobians are compared. By
            default, the motion of all links and the Jacobians of all links without children are compared.
        base_motion: for a robot, BodyMotion of its base; by default the base rests at the origin.
        gravity: for a robot, acceleration of free fall, world axes [m/s^2]; shape (3,); (0, 0, -9.81) by default.

    Returns:
        A `CrossValidation` (hingepair.validation.report). It has `.ok` (True if all compared outputs agree; False if
        one does not, or if no sample could be compared), `.verdict` (text of one line), `.to_json()` (the report as
        JSON text), `.skipped` (number of samples that were left out because an input is not finite) and `.rows`.
        `print` shows the report as a table. `.rows` is a tuple with a row for each output, with these attributes:

        - `.output`: name of the output;
        - `.max_error`: largest error, in the unit of the output;
        - `.max_ratio`: largest ratio of the error to u * scale, where u is the unit roundoff (2^-53 for float64), and
          the scale is the size of the terms that are added to form the output;
        - `.bound`: the largest ratio at which the output counts as agreeing;
        - `.worst_sample`: index of the sample with the largest ratio, as a tuple;
        - `.worst_part`: name of the link or joint with the largest ratio, for a robot only;
        - `.samples`: number of compared samples.

    Raises:
        ArgumentError: an argument cannot be used by `forward_kinematics` of the pair or robot, or has no meaning for
            it, such as `gravity` for a pair.
        MissingDependencyError: Pinocchio is not installed.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
    >>> hp.cross_validate(pair, np.linspace(0, 3, 70).reshape(10, 7)).ok
    True
    >>> hp.cross_validate(pair, hp.BodyMotion.from_rotvec(R=(1, 2, 3), rotvec=(0.1, 0.2, 0.3)), 0.5).ok
    True
    """
    of_robots = {
        "frames": frames,
        "base_motion": base_motion,
        "gravity": None if gravity is DEFAULT_GRAVITY else gravity,
    }
    by_body1 = isinstance(q, BodyMotion)
    in_space = not isinstance(pair, Mechanism | PlanarPair)
    if by_body1 and not in_space:
        raise ArgumentError("q", "coordinates, unless of a HingePair", quoted(q))
    meaningless = {} if isinstance(pair, Mechanism) else of_robots
    meaningless |= {} if by_body1 else {"psidd": psidd}
    meaningless |= {} if in_space and not by_body1 else {"sequence": None if sequence == "XYZ" else sequence}
    for name, value in meaningless.items():
        if value is not None:
            raise ArgumentError(name, "nothing, since it has no meaning here", quoted(value))
    if in_space:
        check_pair(pair)
    with np.errstate(all="ignore"):  # scales may overflow
        if isinstance(pair, Mechanism):
            coordinates = {name: value for name, value in (("q", q), ("qd", qd), ("qdd", qdd)) if value is not None}
            return _compare_robot(pair, coordinates, frames, base_motion, gravity)
        return _compare_pair(pair, (q, qd, qdd, psidd), sequence)


class _Samples(NamedTuple):
    """Coordinates of joints and motion of the base at N samples; one that is not finite is NaN in all arrays."""

    shape: tuple[int, ...]  # leading shape, of N elements
    joints: list[Float64Array]  # q and, as far as given, qd and qdd; (N, dof) each
    base: BodyMotion  # with as many derivatives
    finite: NDArray[np.bool_]

    @classmethod
    def of(cls, base: Mapping[str, Any], joints: Sequence[Any], shape: tuple[int, ...]) -> _Samples:
        """Return samples of the parts of the base's motion by letter, and of coordinates with their derivatives."""
        moved = {name: _rows(value, shape, 2 if name == "S" else 1) for name, value in base.items()}
        rows = [_rows(value, shape, 1) for value in joints]
        own = [np.isfinite(one).all(axis=tuple(range(1, one.ndim))) for one in (*moved.values(), *rows)]
        finite = np.logical_and.reduce(own)
        for array in (*moved.values(), *rows):
            array[~finite] = np.nan
        return cls(shape, rows, BodyMotion(**moved), finite)

    @classmethod
    def of_robot(cls, base: BodyMotion | None, joints: Sequence[Float64Array], shape: tuple[int, ...]) -> _Samples:
        """Return samples of coordinates with their derivatives; a base rests as far as its motion is not given."""
        at_rest = {name: np.eye(3) if name == "S" else np.zeros(3) for name in LETTERS[: 2 * len(joints)]}
        given = {name: getattr(base, name, None) for name in at_rest}
        rows = [one.reshape(*shape, one.shape[-1]) for one in joints]
        return cls.of(at_rest | {name: one for name, one in given.items() if one is not None}, rows, shape)

    @property
    def skipped(self) -> int:
        return int((~self.finite).sum())

    def states(self, twin: Twin) -> list[Float64Array]:
        """Return Pinocchio's q, v (if there are rates) and a (if there are accelerations); shape (N, ...) each."""
        convert: tuple[Any, ...] = (twin.configuration, twin.velocity, twin.acceleration)
        return [convert[k](*self.joints[: k + 1], self.base) for k in range(len(self.joints))]

    def frames(self, twin: Twin, numbers: Sequence[int]) -> Outputs:
        """Return the motion of frames by Pinocchio, and d, the position for a base at the origin; (N, frames, ...).
        Positions from a base far away would contain its rounding errors.
        """
        states = self.states(twin)
        at_origin = states[0].copy()
        at_origin[:, :3] = 0
        found = {"d": frame_motions(twin.model, twin.data, numbers, [at_origin])["R"]}
        return found | frame_motions(twin.model, twin.data, numbers, states)


def _rows(value: Any, shape: tuple[int, ...], rank: int) -> Float64Array:
    """Return a copy of an array, or of a tuple of components, as N samples of the leading shape; (N, ...)."""
    array = np.stack(np.broadcast_arrays(*value), axis=-1) if isinstance(value, tuple) else np.asarray(value)
    own = array.shape[array.ndim - rank :]
    return np.array(np.broadcast_to(array, (*shape, *own)), dtype=np.float64).reshape(math.prod(shape), *own)


def _frame_scales(scales: Scales, frames: Iterable[Frame]) -> Outputs:
    """Return the error scales of the motion of frames by name; shape (N, frames, 1 or 1, 1) each."""
    motions = [scales.motion(frame) for frame in frames]
    found = {name: np.stack([one[name] for one in motions], axis=1)[..., None] for name in motions[0]}
    return found | {"S": found["S"][..., None]}


# ---- pairs


def _compare_pair(pair: HingePair | PlanarPair, given: tuple[Any, ...], sequence: str) -> CrossValidation:
    """Return the report on a pair, given coordinates, which Pinocchio turns into the motion of body 1, or that motion
    itself with psi and, as far as known, its derivatives.
    """
    planar, by_body1 = isinstance(pair, PlanarPair), isinstance(given[0], BodyMotion)
    levels = sum(one is not None for one in given) - by_body1
    space: HingePair = pair.to_spatial() if isinstance(pair, PlanarPair) else pair
    check_single_pair(space)
    tree = tree_of_pair(space)
    twin = tree_twin(tree, is_free=True, has_free_flyer=True)
    frames = {name: tree.known_frame("frames", name) for name in ("body2", *space.points1, *space.points2)}
    letters = ("R", "S", "d", "v", "omega", "a", "alpha")[: 1 + 2 * levels]
    # The name of each output, by frame and letter.
    outputs = {("body2", letter): letter if letter == "d" else f"{letter}2" for letter in letters}
    outputs |= {(name, letter): name + POINT_ENDINGS[letter] for name in [*frames][1:] for letter in "Rva"[:levels]}
    if planar:
        outputs["body2", "S"] = "phi2"
    options: dict[str, Any] = {"outputs": (*outputs.values(),)}
    if by_body1 and isinstance(pair, HingePair):
        ours = pair.forward_kinematics_from_body1(*given, **options).arrays()
        shape = ours["R2"].shape[:-1]
        angles = [np.asarray(one)[..., None] for one in given[1 : 1 + levels]]
        samples = _Samples.of({letter: getattr(given[0], letter) for letter in LETTERS[: 2 * levels]}, angles, shape)
        of_scales = samples.base
    else:
        options |= {} if planar else {"sequence": sequence}
        ours = pair.forward_kinematics(*given[:3], **options).arrays()
        shape = ours["R2"].shape[:-1]
        rows = [_rows(one, shape, 1) for one in read_rows(PLANE if planar else SPACE, *given[:3]).values.values()]
        rows = [np.insert(one, (2, 2, 2), 0.0, axis=1) if planar else one for one in rows]
        samples = _Samples.of(_body1_by_pinocchio(rows, sequence), [one[:, 6:] for one in rows], (len(rows[0]),))
        samples = samples._replace(shape=shape)
        # The rates of Euler angles may be larger than what they add up to.
        sizes = euler_rate_sizes(*(one[:, 3:6] for one in rows[1:])) if levels > 1 else ()
        along = (size[:, None] * np.eye(3)[0] for size in sizes if size is not None)
        of_scales = replace(samples.base, **dict(zip(("omega", "alpha"), along, strict=False)))
    motion = samples.frames(twin, [twin.model.getFrameId(name) for name in frames])
    scales = _frame_scales(Scales(tree, samples.joints, of_scales), frames.values())
    u, compared = unit_roundoff(ours["R2"].dtype), []
    places = {frame: place for place, frame in enumerate(frames)}
    for (frame, letter), name in outputs.items():
        place = places[frame]
        own, theirs, size = ours[name], motion[letter][:, place], scales[letter][:, place]
        if name == "phi2":  # an attitude does not tell whole turns
            phi2 = np.asarray(own, np.float64).reshape(-1, 1)
            off = np.arctan2(theirs[:, 1, :1], theirs[:, 0, :1]) - phi2
            theirs, size = phi2 + np.arctan2(np.sin(off), np.cos(off)), 1 + np.abs(phi2) + np.abs(samples.joints[0])
        elif planar:
            theirs = theirs[:, 2:] if letter in {"omega", "alpha"} else theirs[:, :2]
        compared.append(Comparison.of(name, own, theirs, size, u, shape))
    subject = "in the plane" if planar else "attitude given" if by_body1 else f"Euler sequence {sequence}"
    return CrossValidation(pair.name, shape, samples.skipped, u, (*compared,), subject)


def _body1_by_pinocchio(rows: list[Float64Array], sequence: str) -> Outputs:
    """Compute the motion of body 1 from q and, as far as given, its derivatives, shape (N, 7) each: its attitude is
    that of the last link of a chain of three joints, in reverse order for an extrinsic sequence.
    """
    pin = import_pinocchio("cross_validate")
    order = -1 if sequence.islower() else 1
    model, joint, identity = pin.Model(), 0, pin.SE3.Identity()
    for letter in sequence.upper()[::order]:
        joint = model.addJoint(joint, getattr(pin, f"JointModelR{letter}")(), identity, f"R{letter}{joint}")
    frame = model.addFrame(pin.Frame("body1", joint, identity, pin.FrameType.OP_FRAME))
    angles = [np.ascontiguousarray(c[:, 3:6][:, ::order]) for c in rows]
    motion = frame_motions(model, model.createData(), [frame], angles)
    translations = zip(("R", "v", "a"), (c[:, :3] for c in rows), strict=False)
    return {name: array[:, 0] for name, array in motion.items()} | dict(translations)


# ---- robots


class _Case(NamedTuple):
    """A robot at N samples as both computations have it."""

    robot: Mechanism  # a tree without struts
    twin: Twin
    samples: _Samples
    gravity: Float64Array
    # from the velocities of base and coordinates to those of base and joints; (N, 6 + joints, 6 + dof)
    velocities: Float64Array

    def scales(self, condition: Any = 1.0) -> Scales:
        """Return the scales of errors, which the velocities of joints that follow others exceed by a condition."""
        tree, samples = tree_of(self.robot), self.samples
        return Scales(tree, samples.joints, samples.base, self.gravity, self.velocities * condition)

    def columns(self) -> Float64Array:
        """Return the matrices from the velocities to Pinocchio's v; shape (N, nv, 6 + dof)."""
        return self.twin.columns(np.asarray(self.samples.base.S)) @ self.velocities

    def frame_numbers(self, names: Iterable[str]) -> list[int]:
        """Return the numbers of frames in Pinocchio's model; a name that a link shares with a joint is the link's."""
        body, links = import_pinocchio("cross_validate").FrameType.BODY, tree_of(self.robot).links
        numbers = {(frame.name, frame.type == body): number for number, frame in enumerate(self.twin.model.frames)}
        for name in names:
            if (name, name in links) not in numbers:
                raise ArgumentError("frames", "a frame that Pinocchio's model has, too", quoted(name))
        return [numbers[name, name in links] for name in names]

    def jacobians(self, names: Sequence[str]) -> Float64Array:
        """Return the Jacobians of frames by Pinocchio; shape (N, frames, 6, 6 + dof)."""
        pin, model, data = import_pinocchio("cross_validate"), self.twin.model, self.twin.data
        q, numbers = self.samples.states(self.twin)[0], self.frame_numbers(names)
        found = np.empty((len(q), len(numbers), 6, model.nv))
        for i, state in enumerate(q):
            pin.computeJointJacobians(model, data, state)
            pin.updateFramePlacements(model, data)
            for k, number in enumerate(numbers):
                found[i, k] = pin.getFrameJacobian(model, data, number, pin.LOCAL_WORLD_ALIGNED)
        return found @ self.columns()[:, None]

    def masses(self) -> Outputs:
        """Return the mass matrix and, if there are rates, energies and momenta by Pinocchio."""
        pin, model, data = import_pinocchio("cross_validate"), self.twin.model, self.twin.data
        found: dict[str, list[Any]] = {}
        model.gravity = pin.Motion(self.gravity, np.zeros(3))
        for columns, q, *rates in zip(self.columns(), *self.samples.states(self.twin), strict=True):
            upper = np.triu(pin.crba(model, data, q))
            matrix = upper + np.triu(upper, 1).T
            outputs = {"mass_matrix": columns.T @ matrix @ columns}
            if rates:
                # Not by computeKineticEnergy, which in Pinocchio 4.1 leaves out the rotors of oblique hinges.
                outputs["kinetic"] = 0.5 * float(rates[0] @ matrix @ rates[0])
                outputs["potential"] = pin.computePotentialEnergy(model, data, q)
            if rates and sum(inertia.mass for inertia in model.inertias):
                momentum = pin.computeCentroidalMomentum(model, data, q, rates[0])
                about_origin = momentum.angular + np.cross(data.com[0], momentum.linear)
                outputs |= {"linear": momentum.linear, "angular": about_origin}
            for name, value in outputs.items():
                found.setdefault(name, []).append(value)
        return {name: np.array(values) for name, values in found.items()}

    def forces(self) -> Float64Array:
        """Return the forces along the velocities that the motion requires by Pinocchio; shape (N, 6 + dof)."""
        pin, model, data = import_pinocchio("cross_validate"), self.twin.model, self.twin.data
        model.gravity = pin.Motion(self.gravity, np.zeros(3))
        states = zip(*self.samples.states(self.twin), strict=True)
        required = np.array([pin.rnea(model, data, *state) for state in states]).reshape(-1, 1, model.nv)
        return np.asarray(required @ self.columns())[:, 0]


def _compare_robot(
    robot: Mechanism,
    given: Mapping[str, Coordinates],
    frames: str | Iterable[str] | None,
    base_motion: BodyMotion | None,
    gravity: ArrayLike,
) -> CrossValidation:
    """Return the report on a robot, given q and, as far as known, qd and qdd."""
    tree, fall = tree_of(robot).single(), one_constant("gravity", gravity, 3)
    names = (frames,) if isinstance(frames, str) else tuple(tree.links if frames is None else frames)
    known = {name: tree.known_frame("frames", name) for name in names}
    tips = robot.tips if frames is None else names
    ours, shape, u = _outputs_by_equations(robot, given, names, tips, base_motion, fall)
    linkage = Linkage(robot, given, shape)
    samples = _Samples.of_robot(base_motion, linkage.coordinates, shape)
    twin, compared_with, other_names = urdf_twin(linkage.plain)
    report = CrossValidation(
        robot.name, shape, samples.skipped, u, (), f"{robot.base} base, {len(known)} frames", compared_with
    )
    if other_names:  # nothing else can be compared
        return replace(report, rows=(Comparison("names", np.inf, np.inf, (), 1, worst_part=other_names[0]),))
    if not samples.finite.size:
        return report
    case = _Case(linkage.plain, twin, samples, fall, with_base(linkage.velocities()))
    rows, notes = _robot_rows(case, linkage, ours, known, tips, u)
    return replace(report, rows=rows, notes=notes)


def _outputs_by_equations(
    robot: Mechanism,
    given: Mapping[str, Coordinates],
    frames: tuple[str, ...],
    tips: tuple[str, ...],
    base_motion: BodyMotion | None,
    gravity: Float64Array,
) -> tuple[Outputs, tuple[int, ...], float]:
    """Compute the compared outputs by the equations, (N, ...) each; return them, the leading shape of the N samples,
    and the unit roundoff.
    """
    q, *rates = given.values()
    base: dict[str, Any] = {"base_motion": base_motion}
    fall: dict[str, Any] = {"gravity": gravity, **base}
    outputs: dict[str, tuple[Any, int]] = {}  # values, and the number of axes of one sample
    if frames:
        state = robot.forward_kinematics(q, *rates, frames=frames, **base)
        outputs |= {name: (getattr(state, name), 3 if name == "S" else 2) for name in state.outputs}
        outputs["jacobian"] = robot.jacobian(q, tips, **base), 3
    outputs["mass_matrix"] = robot.mass_matrix(q, **base), 2
    if rates:
        energy, momentum = robot.energy(q, rates[0], **fall), robot.momentum(q, rates[0], **base)
        outputs |= {"kinetic": (energy.kinetic, 0), "potential": (energy.potential, 0)}
        outputs |= {"linear": (momentum.linear, 1), "angular": (momentum.angular, 1)}
    if len(rates) > 1:
        forces = robot.inverse_dynamics(q, *rates, joint_loads=False, **fall)
        loads: dict[str, Any] = {name: forces[name] for name in _ON_BASE} if robot.base == "free" else {}
        moved = robot.forward_dynamics(q, rates[0], forces.tau, joint_loads=False, **loads, **fall)
        outputs |= {name: (one[name], 1) for one in (forces, moved) for name in one.outputs}
    shape = np.broadcast_shapes(*(np.shape(value)[: np.ndim(value) - rank] for value, rank in outputs.values()))
    u = max(unit_roundoff(np.asarray(value).dtype) for value, _ in outputs.values())
    return {name: _rows(value, shape, rank) for name, (value, rank) in outputs.items()}, shape, u


def _robot_rows(
    case: _Case, linkage: Linkage, ours: Outputs, frames: Mapping[str, Frame], tips: tuple[str, ...], u: float
) -> tuple[tuple[Comparison, ...], tuple[str, ...]]:
    """Return a row for each output of Pinocchio's, and notes; the case is of the linkage's tree."""
    samples, names, free = case.samples, linkage.robot.names, linkage.robot.base == "free"
    own, condition = slice(0 if free else 6, None), linkage.condition()
    scales, theirs, sizes, notes = case.scales(condition), Outputs(), Outputs(), list[str]()
    if frames:
        theirs |= samples.frames(case.twin, case.frame_numbers(frames)) | {"jacobian": case.jacobians(tips)[..., own]}
        jacobian = np.stack([scales.jacobian(frames[name]) for name in tips], axis=1)[..., own]
        sizes |= _frame_scales(scales, frames.values()) | {"jacobian": jacobian}
    theirs |= case.masses()
    theirs["mass_matrix"] = theirs["mass_matrix"][:, own, own]
    sizes |= {"mass_matrix": scales.mass_matrix()[:, own, own]} | scales.energy_and_momentum()
    if "tau" in ours:
        required, force_scales = case.forces(), scales.forces()
        for name, place in {"tau": slice(6, None), **_ON_BASE}.items():
            theirs[name], sizes[name] = required[:, place], force_scales[:, place]
        # Forward dynamics: the forces that its accelerations require.
        base = replace(samples.base, a=ours["a1"], alpha=ours["alpha1"]) if free else samples.base
        joints = [*samples.joints[:2], linkage.accelerations(ours["qdd"])]
        moved = case._replace(samples=samples._replace(joints=joints, base=base))
        ours["forward_dynamics"], theirs["forward_dynamics"] = moved.forces()[:, own], required[:, own].copy()
        sizes["forward_dynamics"] = moved.scales(condition).forces()[:, own]
        stuck = np.flatnonzero(samples.finite & ~np.isfinite(ours["forward_dynamics"]).all(axis=1))
        singular = [i for i in stuck if _is_singular(theirs["mass_matrix"][i])]
        theirs["forward_dynamics"][singular] = np.nan  # so that these samples are not compared
        if singular:
            where = f"{len(singular)} of {int(samples.finite.sum())} samples, where the mass matrix is singular"
            notes.append(f"forward_dynamics is not compared at {where}")
        if len(singular) == samples.finite.sum():
            del theirs["forward_dynamics"]
    if linkage.ends:
        ends = samples.frames(case.twin, case.frame_numbers(linkage.ends))
        for name, values in linkage.gaps(ends, scales).items():
            ours[name], theirs[name], sizes[name] = values
    if linkage.struts:
        theirs.pop("potential", None)  # of struts, which Pinocchio does not know
    if linkage.struts and "tau" in ours:
        exerted = linkage.exerted()
        theirs["tau"], sizes["tau"] = theirs["tau"] - exerted.sum(axis=0), sizes["tau"] + np.abs(exerted).sum(axis=0)
    parts = dict.fromkeys((*LETTERS, "d"), (*frames,)) | {"jacobian": tips, "tau": names}
    on_base = tuple(f"{name}_{axis}" for name in _ON_BASE for axis in "xyz") if free else ()
    parts["forward_dynamics"] = (*on_base, *names)
    rows = tuple(
        Comparison.of(
            name, ours[name], np.where(samples.finite, expected.T, np.nan).T, sizes[name], u, samples.shape,
            parts.get(name, ("",)),
        )
        for name, expected in theirs.items() if expected.size  # without joints, there is neither tau nor mass matrix
    )  # fmt: skip
    return rows, tuple(notes)


def _is_singular(matrix: Float64Array) -> bool:
    """Return whether a mass matrix resists some motion by nothing but rounding errors."""
    size = np.sqrt(np.abs(np.diagonal(matrix)))
    return not size.all() or bool(np.linalg.eigvalsh(matrix / size / size[:, None])[0] < 1e-12)


# ---- simulated motions


def compare_loads(
    robot: Mechanism,
    q: Float64Array,
    qd: Float64Array,
    qdd: Float64Array,
    base_motion: BodyMotion | None,
    gravity: ArrayLike,
    loads: Mapping[str, Float64Array],
    held: str,
    *,
    is_planar: bool = False,
) -> tuple[Comparison, ...]:
    """Compare the loads of a simulated motion with the forces that it requires by Pinocchio's `rnea`.

    Args:
        robot: the robot.
        q: coordinates; shape (N, dof).
        qd: their rates.
        qdd: their second derivatives.
        base_motion: motion of the base.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
        loads: tau and its parts, such as spring, (N, dof), force1 and torque1 on the base, and wrenches on links,
            such as force_hand and torque_hand, (N, 3).
        held: what holds the base: what holds it gives further forces, which are no loads.
        is_planar: whether the motion is in the plane z = 0. What holds the base in it is no load.
    """
    # Forces do not depend on the position of the base, and a large one would round the levers.
    base = None if base_motion is None else replace(base_motion, R=np.zeros(3))
    samples, tree = _Samples.of_robot(base, (q, qd, qdd), q.shape[:1]), tree_of(robot)
    velocities = np.broadcast_to(np.eye(6 + robot.dof), (len(q), *2 * (6 + robot.dof,)))
    case = _Case(
        robot, robot_twin(robot, has_free_flyer=True), samples, one_constant("gravity", gravity, 3), velocities
    )
    required, sizes = case.forces(), case.scales().forces()
    # What acts, and the sizes of its terms, which may cancel.
    acting = np.zeros_like(required)
    for name, place in _ON_BASE.items():
        acting[:, place] = loads.get(name, 0.0)
    acting[:, 6:] = loads["tau"]
    sizes += np.abs(acting)
    sizes[:, 6:] += sum((np.abs(loads[part]) for part in TORQUE_PARTS if part in loads), 0.0)
    links = [link for link in tree.links if f"force_{link}" in loads]
    for link, jacobian in zip(links, np.swapaxes(case.jacobians(links), 0, 1), strict=True):
        on_link = np.concatenate((loads[f"force_{link}"], loads[f"torque_{link}"]), axis=1)[:, None]
        acting += (on_link @ jacobian)[:, 0]
        sizes += (np.abs(on_link) @ np.abs(jacobian))[:, 0]
    if is_planar and robot.base == "free":
        acting[:, 2:5] = required[:, 2:5]
    u, rows = unit_roundoff(np.float64), []
    for name in {"free": ("tau", *_ON_BASE), "pinned": ("tau", "torque1")}.get(held, ("tau",)):
        own = _ON_BASE.get(name, slice(6, None))
        size, parts = (sizes[:, own].max(axis=1), ("",)) if name in _ON_BASE else (sizes[:, own], robot.names)
        values = acting[:, own], required[:, own], size
        rows.append(Comparison.of(name, *values, u, samples.shape, parts, bound=MAX_LOAD_RATIO))
    return tuple(rows)


def compare_rates(t: Float64Array, motion: Sequence[Float64Array], names: tuple[str, ...]) -> tuple[Comparison, ...]:
    """Compare the rates of a simulated motion (q, qd, qdd), (N, dof) each, with the slopes that coordinates and
    accelerations tell from either side, if there are enough instants t [s].

    The two slopes differ by h^3 q'''' / 12, which is much more than the error of their mean. Where they differ much,
    as at impacts or at instants that are far apart, little is known of the motion between them: the largest
    difference is allowed everywhere.
    """
    if len(t) < _LEAST_INSTANTS:
        return ()
    q, qd, qdd = motion
    h, chords = np.diff(t)[:, None], np.diff(q, axis=0) / np.diff(t)[:, None]
    after = chords[1:] - h[1:] * (2 * qdd[1:-1] + qdd[2:]) / 6
    before = chords[:-1] + h[:-1] * (qdd[:-2] + 2 * qdd[1:-1]) / 6
    size = np.nanmax(np.abs(qd), initial=0) + np.nanmax(np.abs(q), initial=0) / (t[-1] - t[0])
    expected = np.full_like(qd, np.nan)
    expected[1:-1] = (after + before) / 2
    allowed = np.zeros_like(qd) + np.nanmax(np.abs(after - before), axis=0, initial=0) + _RATE_SHARE * size
    return (Comparison.of("rates", qd, expected, allowed, 1.0, t.shape, names, bound=1.0),)
