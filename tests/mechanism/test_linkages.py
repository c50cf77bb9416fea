"""Closed mechanisms: all joints from the coordinates, efforts of the coordinates, and forces in the loops."""

import mpmath
import numpy as np
import pytest

import hingepair as hp
from support.linkages import AT, bar, four_bar, open_four_bar
from support.near import TOL

U = 2.0**-53
Z = (0, 0, 1)
GRAVITY = (0, -9.81, 0)
TURN = np.linspace(0.01, 6.29, 97)[:, None]


OPEN, FOUR_BAR = open_four_bar(), four_bar()


def rocker_angle(crank: float) -> float:
    """The law of cosines in the triangle of the rocker's foot and both ends of the coupler (Freudenstein)."""
    x, y = mpmath.mpf("0.3") * mpmath.cos(crank) - 1, mpmath.mpf("0.3") * mpmath.sin(crank)
    square = x * x + y * y
    cosine = (square + mpmath.mpf("0.49") - mpmath.mpf("0.81")) / (2 * mpmath.mpf("0.7") * mpmath.sqrt(square))
    return mpmath.atan2(y, x) - mpmath.acos(cosine)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_rocker_of_a_four_bar_is_that_of_the_law_of_cosines(backend: str) -> None:
    with mpmath.workdps(40):
        exact = np.array([[mpmath.diff(rocker_angle, s, k) for k in range(3)] for s in TURN[:, 0]])
    angle, rate, change = (np.float64(column) for column in exact.T)
    q, qd, qdd = FOUR_BAR.all_coordinates(TURN, np.full_like(TURN, 2.0), np.full_like(TURN, 3.0), backend=backend)
    assert np.abs(np.sin((q[:, 2] - angle) / 2)).max() < 32 * U
    assert np.abs(qd[:, 2] - 2 * rate).max() < 200 * U
    assert np.abs(qdd[:, 2] - (4 * change + 3 * rate)).max() < 2000 * U  # rates of 4 and transmission of 0.3


def slider_crank(coordinate: str) -> hp.Mechanism:
    joints = [
        bar("crank", (0, 0, 0), 0.3), bar("rod", (0.3, 0, 0), 0.9),
        hp.Slider((0, 0, 0), (0, 0, 0), (1, 0, 0), name="piston", body2=hp.Body(2, inertia=(1, 1, 1))),
    ]  # fmt: skip
    robot = hp.Mechanism(joints, parents=[0, 1, 0]).with_frame("pin", "rod", R=(0.9, 0, 0))
    return robot.closed(
        hp.Loop("pin", "piston"), coordinates=coordinate, at={"crank": 0.5, "rod": -0.7, "piston": 1.1}
    )


def test_a_slider_crank_has_the_stroke_of_the_textbook() -> None:
    engine = slider_crank("crank")
    stroke = 0.3 * np.cos(TURN[:, 0]) + np.sqrt(0.81 - 0.09 * np.sin(TURN[:, 0]) ** 2)
    assert np.abs(engine.all_coordinates(TURN)[:, 2] - stroke).max() < 16 * U

    # Driven by the piston, it reaches from dead point to dead point, and no further.
    pump = slider_crank("piston")
    x = np.linspace(0.6, 1.2, 51)[1:-1, None]
    crank = np.arccos((x[:, 0] ** 2 + 0.09 - 0.81) / (0.6 * x[:, 0]))
    assert np.abs(pump.all_coordinates(x)[:, 0] - crank).max() < 128 * U  # near the dead points
    with pytest.warns(hp.DynamicsWarning, match=r"at 2 of 3 samples, first at piston = 0.59: pin-piston cannot be"):
        assert np.isnan(pump.all_coordinates([[0.59], [0.9], [1.21]])).any(axis=1).tolist() == [True, False, True]


@pytest.mark.parametrize(("method", "dt"), [("semi_implicit", 1e-2), ("semi_implicit", 1e-3), ("rk4", 1e-2)])
def test_a_rollout_ends_at_a_dead_point(method: str, dt: float) -> None:
    pump = slider_crank("piston")
    ends = {(0, 0, 0): 0.6861, (0, -9.81, 0): 0.4366, (-30, 0, 0): 0.1783, (3, 5, 0): 0.3759}  # as hp.simulate finds
    for gravity, end in ends.items():
        with pytest.warns(hp.DynamicsWarning, match="dead point"):
            motion = pump.rollout([[0.9]], [[0.5]], 0, dt, steps=int(1 / dt), method=method, gravity=gravity)
        lost = np.isnan(motion.q[0]).argmax() * dt
        assert end - 4 * dt < lost < end + 5 * dt
    turns = FOUR_BAR.rollout([[0.3]], [[1.0]], 0, 0.1, steps=300, method=method, gravity=(0, 0, 0))
    assert np.isfinite(turns.q).all()


def test_a_parallelogram_passes_its_change_points() -> None:
    bars = [bar("crank", (0, 0, 0), 0.5), bar("coupler", (0.5, 0, 0), 1.0), bar("rocker", (1, 0, 0), 0.5)]
    robot = hp.Mechanism(bars, parents=[0, 1, 0]).with_frame("a", "coupler", R=(1, 0, 0))
    robot = robot.with_frame("b", "rocker", R=(0.5, 0, 0))
    at = {"crank": 0.3, "coupler": -0.3, "rocker": 0.3}
    lift = robot.closed(hp.Loop("a", "b"), coordinates="crank", at=at)
    q = np.concatenate([np.pi + side * np.logspace(-6, 0, 40) for side in (-1, 1)])[:, None]
    position, rate, change = lift.all_coordinates(q, 0 * q + 2, 0 * q + 3)
    assert np.abs(position[:, 2] - q[:, 0]).max() < 4 * U * np.pi
    assert np.abs(rate - (2, -2, 2)).max() < 4 * U
    assert np.abs(change - (3, -3, 3)).max() < 4 * U
    with pytest.warns(hp.DynamicsWarning, match="dead point"):
        assert np.isnan(lift.all_coordinates([np.pi])[2])


def tilted(vector: tuple[float, ...]) -> np.ndarray:
    return hp.rotation_exp((0.3, 0.5, -0.2)) @ np.array(vector)


@pytest.mark.parametrize(("kind", "redundant"), [("ball", 1), ("hinge", 3)])
def test_redundant_conditions_of_a_plane_that_lies_anyhow_are_counted(kind: str, redundant: int) -> None:
    bars = [
        hp.HingePair(tilted(u1), (0, 0, 0), tilted(Z), name=name)
        for name, u1 in (("crank", (0, 0, 0)), ("coupler", (0.3, 0, 0)), ("rocker", (1, 0, 0)))
    ]
    robot = hp.Mechanism(bars, parents=[0, 1, 0]).with_frame("a", "coupler", R=tilted((0.9, 0, 0)))
    robot = robot.with_frame("b", "rocker", R=tilted((0.7, 0, 0)))
    loop = hp.Loop("a", "b", kind=kind, axis=tilted(Z) if kind == "hinge" else None)
    closed = robot.closed(loop, coordinates="crank", at=AT)
    assert f"redundant: {redundant}" in str(closed)
    plain = FOUR_BAR.all_coordinates(TURN, TURN, TURN)
    for found, wanted in zip(closed.all_coordinates(TURN, TURN, TURN), plain, strict=True):
        assert np.abs(found - wanted).max() < 5000 * U * np.abs(wanted).max()


@pytest.mark.parametrize("kind", ["weld", "distance"])
def test_a_weld_and_a_distance_close_as_a_ball_does(kind: str) -> None:
    plain, closed = FOUR_BAR, four_bar(kind)
    names = [name for name in closed.opened().names if name != "knee"]
    for found, wanted in zip(
        closed.all_coordinates(TURN, TURN, TURN), plain.all_coordinates(TURN, TURN, TURN), strict=True
    ):
        columns = [closed.opened().names.index(name) for name in names]
        assert np.abs(found[:, columns] - wanted[:, : len(names)]).max() < 1000 * U * np.abs(wanted).max()


def test_forces_in_the_loop_leave_no_effort_at_joints_that_follow() -> None:
    q, qd, qdd = TURN, np.full_like(TURN, 2.0), np.full_like(TURN, 0.5)
    everything = FOUR_BAR.all_coordinates(q, qd, qdd)
    wrench = FOUR_BAR.loop_wrenches(q, qd, qdd, gravity=GRAVITY)["a-b"]
    assert np.isnan(wrench.force[:, 2]).all()  # out of the plane, all three bars could share a force
    force = np.nan_to_num(wrench.force)
    state = OPEN.forward_kinematics(everything[0], frames=("a", "b", "coupler", "rocker"))
    pushes = {
        link: (sign * force, np.cross(state[end].R - state[link].R, sign * force))
        for link, end, sign in (("coupler", "a", -1), ("rocker", "b", 1))
    }
    tau = OPEN.inverse_dynamics(*everything, gravity=GRAVITY, wrenches=pushes).tau
    assert np.abs(tau[:, 1:]).max() < 64 * U * np.abs(force).max()
    crank = FOUR_BAR.inverse_dynamics(q, qd, qdd, gravity=GRAVITY).tau
    assert np.abs(tau[:, :1] - crank).max() < 64 * U * np.abs(force).max()


def test_the_power_of_the_crank_is_the_change_of_energy() -> None:
    motion = hp.simulate(FOUR_BAR, np.linspace(0, 2, 41), [0.3], [1.0], gravity=GRAVITY)
    energy = FOUR_BAR.energy(motion.q, motion.qd, gravity=GRAVITY)
    assert np.ptp(energy.kinetic + energy.potential) < TOL * np.ptp(energy.kinetic)
    steps = FOUR_BAR.rollout([[0.3]], [[1.0]], np.zeros((1, 2000, 1)), 1e-3, method="rk4", gravity=GRAVITY)
    assert abs(steps.q[0, -1, 0] - motion.q[-1, 0]) < 1e-9  # steps of 1 ms by a method of order 4


def test_derivatives_go_through_the_loop() -> None:
    q, qd, qdd = TURN[:20], np.full((20, 1), 2.0), np.full((20, 1), 0.5)
    call = FOUR_BAR.prepare("inverse_dynamics", outputs=("tau",), gravity=GRAVITY)
    slope = call.jacobian((q, qd, qdd), wrt=("q",))["tau"]["q"][..., 0]
    h = 1e-5
    ahead, behind = (call(q + side * h, qd, qdd).tau for side in (1, -1))
    assert np.abs((ahead - behind) / (2 * h) - slope).max() < 10 * h * h * np.abs(slope).max()
    jacobian = FOUR_BAR.jacobian(q, "a")
    points = [FOUR_BAR.forward_kinematics(q + side * h, frames="a")["a"].R for side in (1, -1)]
    assert np.abs((points[0] - points[1]) / (2 * h) - jacobian[:, :3, 0]).max() < h * h


@pytest.mark.slow
def test_a_four_bar_drives_the_next() -> None:
    bars = [
        bar("crank", (0, 0, 0), 0.3), bar("coupler", (0.3, 0, 0), 0.9), bar("rocker", (1, 0, 0), 0.7),
        bar("rod", (0.4, 0, 0), 0.9), bar("wheel", (2, 0, 0), 0.5),
    ]  # fmt: skip
    robot = hp.Mechanism(bars, parents=[0, 1, 0, 3, 0]).with_frame("a", "coupler", R=(0.9, 0, 0))
    robot = robot.with_frame("b", "rocker", R=(0.7, 0, 0)).with_frame("c", "rod", R=(0.9, 0, 0))
    robot = robot.with_frame("d", "wheel", R=(0.5, 0, 0))
    at = {**AT, "rod": -2.1, "wheel": 2.0}
    train = robot.closed(hp.Loop("c", "d"), hp.Loop("a", "b"), coordinates="crank", at=at)
    q, qd, qdd = train.all_coordinates(TURN, 0 * TURN + 2, 0 * TURN + 3)
    for found, wanted in zip((q, qd, qdd), FOUR_BAR.all_coordinates(TURN, 0 * TURN + 2, 0 * TURN + 3), strict=True):
        assert np.abs(found[:, :3] - wanted).max() < 500 * U * np.abs(wanted).max()
    state = robot.forward_kinematics(q, qd, qdd, frames=("c", "d"))
    for name in ("R", "v", "a"):
        gap = getattr(state["c"], name) - getattr(state["d"], name)
        assert np.abs(gap).max() < 2000 * U
    # The second loop alone, driven by the rocker, is the same function of it.
    second = hp.Mechanism(bars[2:], parents=[0, 1, 0]).with_frame("c", "rod", R=(0.9, 0, 0))
    second = second.with_frame("d", "wheel", R=(0.5, 0, 0))
    second = second.closed(hp.Loop("c", "d"), coordinates="rocker", at={n: at[n] for n in ("rocker", "rod", "wheel")})
    assert np.abs(second.all_coordinates(q[:, 2:3]) - q[:, 2:]).max() < 64 * U


def test_a_sample_has_the_same_joints_in_any_batch() -> None:
    whole = FOUR_BAR.all_coordinates(TURN, backend="compiled")
    order = np.random.default_rng(1).permutation(len(TURN))
    assert np.array_equal(FOUR_BAR.all_coordinates(TURN[order], backend="compiled"), whole[order])
    turns = FOUR_BAR.all_coordinates(TURN + 20 * np.pi)
    assert np.abs(np.sin((turns - whole) / 2)).max() < 2 * U * 20 * np.pi  # the rounding of TURN


@pytest.mark.slow
def test_a_five_bar_has_two_coordinates() -> None:
    bars = [
        bar("l1", (0, 0, 0), 0.5),
        bar("l2", (0.5, 0, 0), 0.8),
        bar("r1", (0.6, 0, 0), 0.5),
        bar("r2", (0.5, 0, 0), 0.8),
    ]
    robot = hp.Mechanism(bars, parents=[0, 1, 0, 3]).with_frame("a", "l2", R=(0.8, 0, 0))
    robot = robot.with_frame("b", "r2", R=(0.8, 0, 0))
    at = {"l1": 2.2, "l2": -1.5, "r1": 0.9, "r2": 1.4}
    five = robot.closed(hp.Loop("a", "b"), coordinates=("l1", "r1"), at=at)
    q = np.random.default_rng(0).uniform((1.2, 0.2), (2.8, 1.8), (500, 2))
    state = robot.forward_kinematics(five.all_coordinates(q), frames=("a", "b"))
    assert np.abs(state["a"].R - state["b"].R).max() < 16 * U
    assert robot.closed(hp.Loop("a", "b"), at=at).dof == 2
    # Anywhere else it is closed in this assembly, or not at all: the forearms keep their orientation.
    anywhere = np.random.default_rng(1).uniform(-np.pi, np.pi, (2000, 2))
    with pytest.warns(hp.DynamicsWarning, match="a-b cannot be closed"):
        everything = five.all_coordinates(anywhere)
    left, right = everything[:, :2].sum(axis=1), everything[:, 2:].sum(axis=1)
    closed = np.isfinite(left)
    assert 0.3 < closed.mean() < 1
    assert (np.sin(left - right)[closed] < 0).all()  # as at the assembly
    found = five.inverse_kinematics(state["a"].R, frame="a", q0=q + 0.05)
    assert found.ok.all()
    qd = np.random.default_rng(2).uniform(-1, 1, (500, 2))
    kinetic = np.einsum("ni,nij,nj->n", qd, five.mass_matrix(q), qd) / 2
    assert np.abs(kinetic - five.energy(q, qd).kinetic).max() < 500 * U * kinetic.max()
    assert np.abs(five.forward_dynamics(q, qd, five.inverse_dynamics(q, qd, qd).tau).qdd - qd).max() < 256 * U
    anywhere = five.inverse_kinematics(state["a"].R[:20], frame="a")  # from random starts, some of which stay open
    assert anywhere.ok.all()
    reached = five.forward_kinematics(found.q, frames="a")["a"].R
    assert np.abs(reached - state["a"].R).max() < 1e-9  # m, the tolerance of the search


def test_a_path_is_followed_from_sample_to_sample() -> None:
    q = np.linspace(0.3, 15, 200)[:, None]
    assert np.abs(FOUR_BAR.follow(q) - FOUR_BAR.all_coordinates(q)).max() < 64 * U
    lost = FOUR_BAR.follow([[0.3], [0.4], [np.nan], [0.5]])
    assert np.isnan(lost).any(axis=1).tolist() == [False, False, True, True]


def test_a_path_may_begin_at_another_assembly() -> None:
    other = {"crank": 0.3, "coupler": -0.8, "rocker": -1.9}
    mirrored = OPEN.closed(hp.Loop("a", "b"), coordinates="crank", at=other)
    q = np.linspace(0.3, 1, 5)[:, None]
    assert np.abs(FOUR_BAR.follow(q, guess=other) - mirrored.all_coordinates(q)).max() < 32 * U
    assert np.abs(mirrored.all_coordinates(q)[:, 2] - FOUR_BAR.all_coordinates(q)[:, 2]).min() > 1


def test_bars_in_line_are_assembled_next_to_it() -> None:
    closed = OPEN.closed(hp.Loop("a", "b"), coordinates="crank")  # at 0 no step closes the gap along the bars
    assert np.abs(closed.all_coordinates(TURN) - FOUR_BAR.all_coordinates(TURN)).max() < 64 * U


def test_float32_and_many_turns_are_judged_by_their_rounding() -> None:
    exact = FOUR_BAR.all_coordinates(TURN)
    assert np.abs(FOUR_BAR.all_coordinates(TURN.astype(np.float32)) - exact).max() < 64 * 2**-24
    for turns in (1e3, 1e6):
        angle = 2 * np.pi * turns
        off = FOUR_BAR.all_coordinates(TURN + angle)[:, 2] - exact[:, 2]
        assert np.abs(off).max() < 4 * U * angle
    long = open_four_bar(0.8, 0.5, 0.6).closed(hp.Loop("a", "b"), at={"crank": 0.3, "coupler": 0.8, "rocker": 2.2})
    with pytest.warns(hp.DynamicsWarning, match=r"at 1 of 2 samples, first at crank = 2: a-b cannot be closed"):
        assert np.isnan(long.all_coordinates(np.array([[2], [0.3]], np.float32))).any(axis=1).tolist() == [
            True,
            False,
        ]


@pytest.mark.parametrize("lengths", [(1.02, 1.42, 1.4), (0.88, 0.93, 0.84), (1.25, 1.25, 0.87), (0.27, 0.9, 0.71)])
def test_a_four_bar_is_closed_wherever_its_bars_reach(lengths: tuple[float, float, float]) -> None:
    crank, coupler, rocker = lengths
    linkage = open_four_bar(*lengths).closed(hp.Loop("a", "b"), at={"crank": 0.3, "coupler": 0.8, "rocker": 2.2})
    q = np.linspace(-np.pi, np.pi, 4001)
    far = np.sqrt(crank**2 + 1 - 2 * crank * np.cos(q))  # from the end of the crank to the foot of the rocker
    reached = (far < coupler + rocker - 1e-3) & (far > abs(coupler - rocker) + 1e-3)  # m from the dead points
    reached &= np.cumsum(~reached) == (~reached)[: np.searchsorted(q, 0.3)].sum()  # from where it is assembled
    everything = linkage.all_coordinates(q[reached, None])
    assert np.isfinite(everything).all()
    assert np.abs(np.diff(np.sin(everything), axis=0)).max() < 0.2  # no sample is of another assembly


def test_springs_and_dampers_act_at_joints_that_follow() -> None:
    loads = {"rocker": hp.HingeLoad(stiffness=50.0, rest=1.5), "crank": hp.HingeLoad(stiffness=3.0)}
    motion = hp.simulate(FOUR_BAR, np.linspace(0, 1, 11), [0.3], [1.0], gravity=GRAVITY, loads=loads)
    energy = FOUR_BAR.energy(motion.q, motion.qd, gravity=GRAVITY)
    q = FOUR_BAR.all_coordinates(motion.q)
    total = energy.kinetic + energy.potential + 25 * (q[:, 2] - 1.5) ** 2 + 1.5 * q[:, 0] ** 2
    assert np.ptp(total) < TOL * np.ptp(energy.kinetic)
    damped = hp.simulate(FOUR_BAR, [0, 1], [0.3], [1.0], loads={"coupler": hp.HingeLoad(damping=9.0)})
    assert (np.diff(FOUR_BAR.energy(damped.q, damped.qd, gravity=(0, 0, 0)).kinetic) < -0.01).all()  # J


def excavator() -> tuple[hp.Mechanism, hp.Mechanism]:
    y = (0, 1, 0)
    joints = [bar("boom", (0, 0, 1), 4, y), bar("stick", (4, 0, 0), 2, y), bar("bucket", (2, 0, 0), 1, y)]
    arm = hp.Mechanism(joints)
    points = {
        "foot1": ("base", (0.4, 0, 0.3)), "eye1": ("boom", (1.8, 0, 0.4)), "foot2": ("boom", (1.6, 0, 0.7)),
        "eye2": ("stick", (-0.5, 0, 0.3)), "foot3": ("stick", (0.3, 0, 0.5)), "eye3": ("bucket", (0.2, 0, 0.35)),
    }  # fmt: skip
    for name, (link, R) in points.items():
        arm = arm.with_frame(name, link, R=R)
    for k in "123":
        arm = arm.with_strut(f"foot{k}", f"eye{k}", f"cylinder{k}")
    return arm, arm.closed(
        coordinates=("cylinder1", "cylinder2", "cylinder3"), at={"boom": -0.4, "stick": 1.2, "bucket": 0.6}
    )


def test_cylinders_drive_an_excavator_by_their_lengths() -> None:
    arm, driven = excavator()
    rng = np.random.default_rng(0)
    angles = np.array([-0.4, 1.2, 0.6]) + rng.uniform(-0.25, 0.25, (200, 3))
    lengths = np.stack([arm.struts(angles)[name].length for name in driven.names], axis=-1)
    assert np.abs(driven.all_coordinates(lengths) - angles).max() < 512 * U
    qd, qdd = rng.uniform(-1, 1, (2, 200, 3))
    force = driven.inverse_dynamics(lengths, qd, qdd).tau
    everything = driven.all_coordinates(lengths, qd, qdd)
    power = (arm.inverse_dynamics(*everything).tau * everything[1]).sum(axis=-1)
    assert np.abs((force * qd).sum(axis=-1) - power).max() < 1000 * U * np.abs(power).max()
    accelerations = driven.forward_dynamics(lengths, qd, force).qdd
    assert np.abs(accelerations - qdd).max() < 1e-11  # rounding of forces that are far larger than those of qdd
