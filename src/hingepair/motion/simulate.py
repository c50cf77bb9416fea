"""Simulation: the motion of a robot or a pair under loads, from its start to any instant, by steps of collocation."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, choices, nearest, quoted, warn_of_dynamics
from hingepair.mechanism.bodies.body_motion import AT_REST, BodyMotion, motion_arrays
from hingepair.mechanism.bodies.hinge_load import HingeTorque, stop_range
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.options import DEFAULT_GRAVITY, check_options
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.tree import loads_note
from hingepair.motion.equations_of_motion import RobotMotion, RobotPrograms
from hingepair.motion.events import UserEvent
from hingepair.motion.given import (
    EffortArgument,
    GivenMotion,
    JointCallable,
    LoadArgument,
    check_rest,
    given_base,
    given_joint,
    robot_loads,
)
from hingepair.motion.linkages import beyond_strokes
from hingepair.motion.loads import Loads, check_start
from hingepair.motion.pairs import BaseArgument, in_words_of_pairs, pair_as_robot, words_of_pairs
from hingepair.motion.run import Impact, joint_impacts, joint_range, read_options
from hingepair.motion.simulated import ON_BODY2, SimulatedMotion, SimulatedRobotMotion, Simulation
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import check_choice, finite_number, is_zero, one_constant, read_only
from hingepair.plans.arguments import Coordinates, Outputs
from hingepair.tables.instants import instants_of
from hingepair.tables.suspicions import suspicions

BASES_OF_ROBOTS: Final = ("fixed", "free", "pinned", "moving")  # what may hold the base of a robot
BaseMotion: TypeAlias = BodyMotion | Callable[[Array], BodyMotion] | None
"""Start of a base, or a callable of t that returns the motion of a moving one."""


@functools.singledispatch
def simulate(
    pair: HingePair,
    t: ArrayLike,
    body1: BodyMotion | None,
    psi_0: float,
    psid_0: float,
    *,
    hinge_torque: HingeTorque = 0.0,
    force1: LoadArgument = 0,
    torque1: LoadArgument = 0,
    force2: LoadArgument = 0,
    torque2: LoadArgument = 0,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    base: BaseArgument = "free",
    breaks: ArrayLike = (),
    until: UserEvent | None = None,
    tol: float = 1e-10,
    max_steps: int = 30_000,
    outputs: Outputs = None,
    backend: str = "auto",
) -> SimulatedMotion:
    """Simulate the motion of a pair under loads (D1-D6) at the instants t, from the state (body1, psi_0, psid_0) at
    t[0], or the motion of a robot (T1-T6) by `hp.simulate(robot, t, q0, qd0, tau=...)`, whose arguments are below.

    The method is Gauss collocation of order 16, with attitudes on the rotation group. If `base` is "free" and no
    gravity and no external load acts, momentum and angular momentum are kept to rounding. Dry friction of several
    joints is solved at once, and impacts at rigid stops are felt by all joints.

    The `limits` of the pair and the `position_limits` of a robot do not stop the motion; the `stops` of a `HingeLoad`
    do. A `DynamicsWarning` is issued if a coordinate passes a limit at which there is no stop, or passes a stop by
    more than 0.02 rad.

    Of a robot, `t`, `gravity`, `breaks`, `until`, `tol`, `max_steps` and `backend` are as for pairs. The others are

    - `q0`: coordinates at t[0] [rad, m]; shape (dof,), or a dict by joint.
    - `qd0`: rates at t[0], in the same form; 0 by default.
    - `tau`: efforts at the joints [N m, N]: a number or shape (dof,), held; a dict by joint; a callable of (t, now)
      that returns (n, dof), such as ``lambda t, now: -50 * (now.q - 0.3)``.
      There t is an array of n instants, and `now` has the attributes q and qd, (n, dof), R1, S1, v1 and omega1 of the
      base, and base_motion, a BodyMotion of these. The rate of the second joint is ``now.qd[:, 1]``.
    - `loads`: `HingeLoad`s by joint: springs, dampers, dry friction, stops, motors that depend on the joint alone.
      They add to tau; those of a joint that follows another act on its leader. For a slider, read m for rad and N for
      N m. `robot.joint_loads` are those that a URDF or MJCF describes, with stops at the limits.
    - `driven`: motions of joints that move as given, by joint: callables of times (n,) that return the coordinate and
      its first two derivatives, (n,) each; the first must not jump. Their q0 and qd0 are those of the callable; no
      tau and no HingeLoad acts on them, and their part of `loads["motor"]` of the result is the effort that the
      motion needs.
    - `wrenches`: loads on links: (force, torque) by link, world axes, the force at the link's origin [N, N m]; each
      has shape (3,), is the number 0, or a callable of (t, now) that returns (n, 3).
    - `force1`, `torque1`: force at R1 and torque on a free or pinned base, world axes [N, N m], in the same forms.
    - `base`: "fixed" where `base_motion` is, "free", "pinned" (R1 stays, the base can turn about it) or "moving". By
      default that of the robot, or "moving" if `base_motion` is a callable.
    - `base_motion`: the base at t[0]: a BodyMotion of R and S, of a free base also v and omega; at rest at the origin
      by default. Of a moving base, a callable of times (n,) that returns a BodyMotion with all derivatives.

    Args:
        pair: a pair whose bodies have mass properties. If the base is fixed or a callable, only body 2 needs them.
        t: instants, increasing; shape (N,): seconds (floats), datetime64, or nanoseconds since 1970 (integers).
            datetime64 and integer nanoseconds are converted to seconds since the first one; callables and `breaks`
            use these seconds.
        body1: motion of body 1 at t[0] as a BodyMotion: R and S; v and omega are zero by default. None: at rest at
            the origin, or moved as `base` says, if that is a callable.
        psi_0: hinge angle at t[0] [rad].
        psid_0: hinge rate at t[0] [rad/s].
        hinge_torque: torque that body 1 exerts on body 2 about the hinge axis [N m]: a number (0 by default), a
            `HingeLoad` (spring, damper, friction, stops), or a callable of arrays (t, psi, psid), each (n,), that
            returns (n,).
        force1: force on body 1 at R1, world axes [N]: shape (3,), the number 0 (the default), or a callable of
            (t, now) that returns (n, 3). There t is an array of n instants, and `now` has the attributes R1, S1, v1,
            omega1, psi and psid at these instants, such as now.R1 of shape (n, 3).
        torque1: torque on body 1, world axes [N m]; in the same form as force1.
        force2: force on body 2 at R2, world axes [N]; in the same form as force1.
        torque2: torque on body 2, world axes [N m]; in the same form as force1.
        gravity: acceleration of free fall, world axes [m/s^2]; (0, 0, -9.81) by default.
        base: what holds body 1, one of:

            - "free" (the default): nothing;
            - "pinned": R1 stays where it is at t[0], and body 1 can turn about R1, as on a ball joint;
            - "fixed": body 1 stays at its pose at t[0];
            - a callable of times (n,) that returns the BodyMotion of body 1, with v, omega, a and alpha, which must
              be the derivatives of R and S; v and omega must not jump.
        breaks: instants at which loads jump [s]; shape (M,); none by default. Steps end at these instants, and
            callables are evaluated just before and just after them. A pulse of a load whose instants are not given
            here is found if it is longer than 1/8000 of the simulated time or covers one of the instants t.
        until: event that ends the motion: a callable of (t, now), as for force1, that returns values (n,). The motion
            ends when the value passes 0, and this instant is the last one of the result. An attribute `direction` of
            the callable selects, as for SciPy's events, values that rise (1), that fall (-1), or both (0, the
            default). If an impact makes the value jump across 0, the result ends with the motion before the impact. A
            value that reaches 0 at a rigid stop, or where friction stops the hinge, counts as having passed 0, even
            if the value then stays at 0 or turns back. Everywhere else, a value that touches 0 without passing it is
            not found. For a turning point of psi, return now.psid. Return a quantity that goes below 0, such as
            1 - now.psi, instead of one that stays at 0, such as np.maximum(1 - now.psi, 0).
        tol: tolerance of each step, a number from 1e-14 to 1e-2; 1e-10 by default. The error of an angle in one step
            is at most tol [rad]. The error of a position is at most tol times the sum of the lengths of u1, u2 and
            both bodies' centre_of_mass [m], or times 1 m if all of them are zero.
        max_steps: largest number of steps tried, 30,000 by default, which take about a minute: a free swing needs
            some 20 a period, an impact some 5. A motion that needs more is a SimulationError. The second run for
            error estimates may take three times as many.
        outputs: tuple of the names of the outputs to compute, such as ("R2", "v2"), as for `forward_kinematics`. By
            default, all outputs of body 2.
        backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

    Returns:
        A `SimulatedMotion` with `.t`, `.psi`, `.psid`, `.psidd`,
        `.body1`, `.loads`, `.ended_by_event`, `.energy()`, `.momentum()`, `.energy_balance()` and the outputs of body
        2, such as `.R2`. `.error_estimate` (of the attitude of body 1) and `.psi_error_estimate` [rad] come from a
        second run with a smaller tolerance, at the first access. A DynamicsWarning says that arguments seem to be in
        the wrong units. Of a robot, a `SimulatedRobotMotion` with `.t`, `.q`, `.qd`, `.qdd`, `.tau`, `.loads`,
        `.base_motion`, `.state()`, `["frame"]`, `.reactions()`, energies and error estimates. `.tau`, (N, dof),
        is the sum of all efforts at each joint, whose parts are in `.loads`: "motor" (`tau` and motors), "spring",
        "damper", "friction" and "stop", without the impulses at rigid stops.

    Raises:
        ArgumentError: an argument cannot be used; the error names it.
        SimulationError: the simulation cannot be continued; `t` of the error is the last instant that the simulation
            reached.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> rod = hp.Body(mass=2, inertia=np.diag([0.01, 1, 1]))
    >>> pair = hp.HingePair(u1=(0, 0, 0), u2=(-1, 0, 0), n=(0, 1, 0), body2=rod)
    >>> start = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
    >>> swing = hp.simulate(pair, np.linspace(0, 2, 201), start, psi_0=0.0, psid_0=0.0, base="fixed")
    >>> round(float(swing.psi.max()), 4)  # released level, it swings to level on the other side
    3.1416

    A robot with a controller, until its second joint has turned by 0.2 rad:

    >>> bodies = [hp.HingePair(u1, (-1, 0, 0), (0, 1, 0), body2=rod) for u1 in ((0, 0, 0), (1, 0, 0))]
    >>> found = hp.simulate(
    ...     hp.Mechanism(bodies), [0, 1], q0=[0, 0], tau=lambda t, now: -50 * now.q - 5 * now.qd,
    ...     until=lambda t, now: now.q[:, 1] - 0.2,
    ... )
    >>> found.ended_by_event, round(float(found.q[-1, 1]), 6)
    (True, 0.2)
    """
    forces = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
    robot, given = pair_as_robot(pair, base, body1, hinge_torque, forces, gravity)
    start = [finite_number("psi_0", psi_0)], [finite_number("psid_0", psid_0)]
    with in_words_of_pairs(base):
        moved = simulate_robot(
            robot, t, *start, **given, breaks=breaks, until=until, tol=tol, max_steps=max_steps, backend=backend,
            of_pair=True,
        )  # fmt: skip
    psi, psid, psidd = (read_only(rows[:, 0]) for rows in (moved.q, moved.qd, moved.qdd))
    return SimulatedMotion(
        t=moved.t,
        psi=psi,
        method="collocation",
        steps=moved.steps,
        robot_motion=moved,
        body1=moved.base_motion,
        psid=psid,
        psidd=psidd,
        gravity=moved.gravity,
        base="prescribed" if moved.base == "moving" else moved.base,
        psi_range=tuple(moved.q_range[0].tolist()),
        impacts=moved.impacts,
        ended_by_event=moved.ended_by_event,
        quat_wxyz=moved.base_quat_wxyz,
        R1=moved.base_motion.R,
        pair=pair,
        state=pair.forward_kinematics_from_body1(
            moved.base_motion, psi, psid, psidd, outputs=outputs, backend=backend
        ),
    )


def simulate_robot(
    robot: Mechanism,
    t: ArrayLike,
    q0: Coordinates | None = None,
    qd0: Coordinates | None = None,
    *,
    tau: EffortArgument = 0.0,
    loads: Mapping[str, HingeTorque] | None = None,
    driven: Mapping[str, JointCallable] | None = None,
    wrenches: Mapping[str, tuple[LoadArgument, LoadArgument]] | None = None,
    force1: LoadArgument = 0,
    torque1: LoadArgument = 0,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    base: str | None = None,
    base_motion: BaseMotion = None,
    breaks: ArrayLike = (),
    until: UserEvent | None = None,
    tol: float = 1e-10,
    max_steps: int = 30_000,
    backend: str = "auto",
    of_pair: bool = False,
) -> SimulatedRobotMotion:
    """Simulate the motion of a robot; `hp.simulate` says what the arguments are. `of_pair`: loads and warnings have
    the names that they have for pairs.
    """
    tree_of(robot).single()
    if loads is None and (note := loads_note(tree_of(robot))):
        warn_of_dynamics(f"{robot.name}: {note}; loads=robot.joint_loads counts them, loads={{}} is silent")
    kind, start = base_of(robot, base, base_motion)
    if kind in ("free", "pinned") and robot.base != "free":
        robot = robot.with_base("free")
    if not robot.dof and robot.base != "free":
        raise ArgumentError("robot", "joints that move, or a base that is free or pinned", "none")
    instants = instants_of("t", t)
    options = read_options(tol, breaks, until, max_steps)
    on_base = {"force1": force1, "torque1": torque1}
    laws = beyond_strokes(robot)
    acting = robot_loads(laws, tau, loads, wrenches, on_base, gravity, ON_BODY2 if of_pair else None)
    for name, load in on_base.items():
        if robot.base != "free" and acting.vectors[name].acts:
            raise ArgumentError(name, f"0: a base that is {kind} is not moved by forces", quoted(load))
    moves = _driven(robot, driven, loads or {}, instants)
    q, qd = (_read_start(name, value, robot) for name, value in (("q0", q0), ("qd0", 0.0 if qd0 is None else qd0)))
    for k, move in moves.items():
        first = move.at(instants[:1])
        q[k], qd[k] = first["psi"][0], first["psid"][0]
    check_start(acting, q)
    if isinstance(start, GivenMotion):
        start.check(instants)
    robot.energy(q, qd)  # refuses missing masses, and warns of those that are assumed
    first_base = AT_REST if isinstance(start, GivenMotion) else start
    programs = RobotPrograms(laws, kind, first_base, acting, backend)
    make_motion = functools.partial(RobotMotion, laws, kind, start, q, qd, acting, programs, moves)
    found = Simulation(make_motion, instants, options)
    samples, q_range, impacts, passed = found.run.samples, list[Any](), list[Impact](), list[str]()
    in_degrees = _unit_doubts(robot, acting, q, qd, start)
    for k, joint in enumerate(tree_of(robot).coordinates):
        extremes, doubts = joint_range(found.run, k, joint.name, joint.position_limits, options.tol)
        q_range.append(extremes)
        impacts += joint_impacts(found.run, k, joint.name)
        passed += doubts if f"q0[{joint.name!r}]" not in in_degrees else []  # degrees pass the limits, too
    if found.run.ended_by not in ("", "until"):
        passed.append(f"the motion ends at t = {samples.t[-1]:.6g} s: {found.run.ended_by}")
    for sentence in filter(None, (*in_degrees.values(), *passed)):
        warn_of_dynamics(words_of_pairs(sentence) if of_pair else sentence)
    return SimulatedRobotMotion(
        robot=robot,
        t=read_only(samples.t),
        q=read_only(samples.motion.q),
        qd=read_only(samples.motion.qd),
        qdd=read_only(samples.qdd),
        base_motion=samples.base,
        base_quat_wxyz=read_only(samples.quats),
        loads={name: read_only(np.array(load)) for name, load in samples.loads.items()},
        wrenches=acting.wrenches_of(samples.loads),
        gravity=acting.gravity,
        base=kind,
        q_range=read_only(np.array(q_range, np.float64).reshape(-1, 2)),
        impacts=tuple(sorted(impacts, key=lambda impact: impact.t)),
        steps=samples.steps,
        ended_by_event=bool(found.run.ended_by),
        _simulation=found,
    )


def _checked_call(run: Callable[..., Any]) -> Any:
    """Return a function that calls `run`, and refuses arguments that do not fit in the name of `simulate`."""
    signature = inspect.signature(run)

    @functools.wraps(run)
    def call(*arguments: Any, **options: Any) -> Any:
        check_options("simulate", options, signature.parameters)
        try:
            signature.bind(*arguments, **options)
        except TypeError as error:
            raise TypeError(f"simulate() {error}") from None
        return run(*arguments, **options)

    return call


def _refused(pair: Any, *_: Any, **__: Any) -> Any:
    raise ArgumentError("pair", "a HingePair (a PlanarPair's is pair.to_spatial()) or a Mechanism", quoted(pair))


simulate.register(object, _refused)
simulate.register(HingePair, _checked_call(inspect.unwrap(simulate)))
simulate.register(Mechanism, _checked_call(simulate_robot))


def _unit_doubts(
    robot: Mechanism, loads: Loads, q: Array, qd: Array, start: BodyMotion | GivenMotion
) -> dict[str, str]:
    """Return sentences, by argument, on angles and rates that look like degrees. One mistake in several joints is
    one sentence.
    """
    hinges = [k for k, joint in enumerate(tree_of(robot).coordinates) if joint.unit == "rad"]
    names, omega = [robot.names[k] for k in hinges], getattr(start, "omega", None)
    stops = [np.array(stop_range(loads.joint_loads[name])) for name in names]
    found = dict[str, str]()
    for kind, form, values in (
        ("written angles", "loads[{!r}].stops", [one[np.isfinite(one)] for one in stops]),
        ("written angles", "q0[{!r}]", q[hinges]),
        ("written rates", "qd0[{!r}]", qd[hinges]),
        ("written rates", "base_motion.omega", [] if omega is None else [omega[None]]),
    ):
        labels = [form.format(name) for name in names] if "{" in form else [form]
        rows = [(own, text) for own, x in zip(labels, values, strict=False) for text in suspicions(kind, own, x)]
        for k, (label, sentence) in enumerate(rows):
            others = f" So do {len(rows) - 1} further ones." if len(rows) > 1 else ""
            found[label] = "" if k else sentence + others
    return found


def base_of(robot: Mechanism, base: str | None, base_motion: Any) -> tuple[str, Any]:
    """Return what holds the base, and its motion at the start or, of a moving base, a callable."""
    kind = ("moving" if callable(base_motion) else robot.base) if base is None else base
    check_choice("base", kind, BASES_OF_ROBOTS)
    if callable(base_motion) != (kind == "moving"):
        expected = "a callable of times that returns a BodyMotion, for base='moving' and no other"
        raise ArgumentError("base_motion", expected, quoted(base_motion))
    if callable(base_motion):
        return kind, given_base("base_motion", base_motion)
    start = AT_REST if base_motion is None else base_motion
    if not isinstance(start, BodyMotion) or start.shape != ():
        raise ArgumentError("base_motion", "one BodyMotion, the start of the base", quoted(base_motion))
    motion_arrays("base_motion", start, "S")
    check_rest("base_motion", kind, start)
    return kind, start


def _driven(
    robot: Mechanism, driven: Mapping[str, JointCallable] | None, loads: Mapping[str, Any], t: Array
) -> dict[int, GivenMotion]:
    """Return the motions of joints that move as given, by the joint's number."""
    if driven is not None and not isinstance(driven, Mapping):
        raise ArgumentError("driven", "callables by the joint's name", quoted(driven))
    moves, leaders = {}, tree_of(robot).coordinate_names.leaders
    for name, move in (driven or {}).items():
        if name not in robot.names:
            raise ArgumentError("driven", choices(robot.names) + nearest(str(name), robot.names), quoted(name))
        for loaded in {name, *(follower for follower, leader in leaders.items() if leader == name)} & {*loads}:
            raise ArgumentError(f"loads[{loaded!r}]", "no load at a joint that moves as given", quoted(loads[loaded]))
        joint = moves[robot.names.index(name)] = given_joint(f"driven[{name!r}]", move)
        joint.check(t)
    return moves


def _read_start(name: str, value: Any, robot: Mechanism) -> Array:
    """Return the checked coordinates or rates at the first instant, a new array (dof,)."""
    if value is None and robot.dof:
        raise ArgumentError(name, f"what the coordinates are at t[0], shape ({robot.dof},) or by joint", None)
    if value is None or is_zero(value):
        return np.zeros(robot.dof)
    return one_constant(name, tree_of(robot).rows(name, value), robot.dof).copy()
