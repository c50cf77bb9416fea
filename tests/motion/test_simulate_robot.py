"""Simulated robots against SciPy with events, MuJoCo, the pair, and conservation laws."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hingepair as hp
from support.hinged import shaken
from support.near import TIGHT, TOL, U
from support.states import generator, rotations

ROD = hp.Body(1.0, centre_of_mass=(0.5, 0, 0), inertia=(0.01, 0.09, 0.09))
G = 9.81


def chain(count, base="fixed"):
    """A chain of rods of 1 m, the hinges along y."""
    first = {"body1": ROD} if base == "free" else {}
    return hp.Mechanism(
        [
            hp.HingePair(
                (float(k > 0), 0, 0), (0, 0, 0), (0, 1, 0), body2=ROD, name=f"j{k}", **(first if k == 0 else {})
            )
            for k in range(count)
        ],
        base=base,
    )


class Reference:
    """Two rods with dry friction and rigid stops, by textbook formulas and SciPy; q counts from the horizontal, down.

    Which joints stick is found by trying all ways.
    """

    def __init__(self, friction, stops, restitution, motor):
        self.friction, self.stops, self.restitution, self.motor = friction, stops, restitution, motor

    @staticmethod
    def M(q):
        a, c = 0.09 + 0.25, 0.5 * np.cos(q[1])
        return np.array([[a + 1 + a + 2 * c, a + c], [a + c, a]])

    def free_forces(self, t, q, qd):
        s = 0.5 * np.sin(q[1])
        coriolis = np.array([-s * (2 * qd[0] * qd[1] + qd[1] ** 2), s * qd[0] ** 2])
        lower = 0.5 * G * np.cos(q[0] + q[1])
        return self.motor(t) - coriolis + np.array([1.5 * G * np.cos(q[0]) + lower, lower])

    def accelerations(self, t, q, qd, mode):
        """Return q'' and the friction, where mode has -1, 1 (slips down, up) or 0 (sticks) for each joint."""
        M, f = self.M(q), self.free_forces(t, q, qd) - np.array(mode) * self.friction
        slips = [k for k in (0, 1) if mode[k]]
        qdd = np.zeros(2)
        if slips:
            qdd[slips] = np.linalg.solve(M[np.ix_(slips, slips)], f[slips])
        return qdd, M @ qdd - f

    def mode(self, t, q, qd):
        """Return the only mode that agrees with its own forces."""
        choices = [(int(np.sign(x)),) if abs(x) > 1e-13 else (-1, 0, 1) for x in qd]
        for mode in itertools.product(*choices):
            qdd, holding = self.accelerations(t, q, qd, mode)
            sticks = all(abs(holding[k]) <= self.friction[k] + 10 * TOL for k in (0, 1) if mode[k] == 0)
            slips = all(abs(qd[k]) > 1e-13 or mode[k] * qdd[k] > 0 for k in (0, 1) if mode[k])
            if sticks and slips:
                return mode
        raise AssertionError("no mode")

    def run(self, t, q, qd):
        """Return q at the instants."""
        now, y, found, mode = t[0], np.array([*q, *qd], float), [], None
        while now < t[-1] - TIGHT:
            mode = mode or self.mode(now, y[:2], y[2:])
            events = []
            for k in (0, 1):
                if mode[k]:
                    events.append(
                        (("rate", k), lambda s, y, k=k, m=mode, late=now + 1e-9: 1.0 if s < late else m[k] * y[2 + k])
                    )
                else:
                    events.append(
                        (("let go", k), lambda s, y, k=k, m=mode: self.friction[k] - abs(
                            self.accelerations(s, y[:2], y[2:], m)[1][k]))
                    )  # fmt: skip
            for k, ends in self.stops.items():
                events += [
                    (("stop", k), lambda _, y, k=k, end=end, sign=sign: sign * (end - y[k]) if sign * y[2 + k] > 0
                     else 1.0)
                    for end, sign in zip(ends, (-1, 1), strict=True)
                ]  # fmt: skip
            functions = [function for _, function in events]
            for function in functions:
                function.terminal, function.direction = True, -1

            def rates(s, y, mode=mode):
                return np.hstack([y[2:], self.accelerations(s, y[:2], y[2:], mode)[0]])

            part = solve_ivp(rates, (now, t[-1]), y, "DOP853", events=functions, rtol=1e-12, atol=1e-13,
                             dense_output=True, max_step=0.02)  # fmt: skip
            inside = t[(t >= now) & (t < part.t[-1])]
            found += [part.sol(one)[:2] for one in inside]
            now, y = part.t[-1], part.y[:, -1].copy()
            if part.status == 1:
                what, k = events[next(i for i, times in enumerate(part.t_events) if times.size)][0]
                if what == "let go":
                    _, holding = self.accelerations(now, y[:2], y[2:], mode)
                    mode = tuple(int(-np.sign(holding[k])) if i == k else m for i, m in enumerate(mode))
                    continue
                mode = None
                if what == "rate":
                    y[2 + k] = 0.0
                elif what == "stop":
                    column = np.linalg.inv(self.M(y[:2]))[:, k]
                    y[2:] -= column / column[k] * (1 + self.restitution) * y[2 + k]
        return np.array([*found, y[:2]])


def double_swing(friction, stops, restitution, motor, q0, qd0, span=3.0):
    t = np.linspace(0, span, 61)
    expected = Reference(np.array(friction), stops, restitution, motor).run(t, q0, qd0)
    loads = {
        name: hp.HingeLoad(
            friction=friction[k], motor=lambda t, *_, k=k: motor(t)[k] + 0 * t,
            **({"stops": stops[k], "stop_restitution": restitution} if k in stops else {}),
        )
        for k, name in enumerate(("j0", "j1"))
    }  # fmt: skip
    found = hp.simulate(chain(2), t, q0, qd0, loads=loads, tol=TIGHT)
    return found, expected


@pytest.mark.slow
@pytest.mark.parametrize("friction", [(0.0, 1.0), (3.0, 0.6), (0.4, 2.5)])
def test_two_joints_that_stick_and_slip_are_those_of_scipy(friction):
    found, expected = double_swing(
        friction, {}, 0.0, lambda t: np.array([4.0 * np.sin(2 * t), 2.0 * np.cos(3 * t)]), [1.2, 0.3], [0.5, -1.0]
    )
    np.testing.assert_allclose(found.q, expected, rtol=0, atol=10 * TOL)
    assert ((found.qd == 0) & (found.qdd == 0))[1:, 1].any()  # the second joint did stick
    assert np.abs(found.energy_balance().residual).max() < 10 * TOL


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [1.0, 0.5])
def test_impacts_are_felt_by_all_joints_as_scipy_has_it(restitution):
    found, expected = double_swing(
        (0.0, 0.3), {1: (-0.6, 0.8)}, restitution, lambda _: np.zeros(2), [0.2, 0.1], [0.0, 2.0], span=2.0
    )
    np.testing.assert_allclose(found.q, expected, rtol=0, atol=10 * TOL)
    assert found.q_range[1, 1] == pytest.approx(0.8, abs=TIGHT)
    balance = found.energy_balance()
    assert np.abs(balance.residual).max() < 10 * TOL
    assert ("impacts" in balance.work and balance.work["impacts"][-1] < -0.01) == (restitution < 1)


@pytest.mark.slow
def test_joints_that_lie_on_their_stops_pass_an_impact_on():
    # The upper rod rests on its lower stop; the lower one falls on its own and throws the upper one off, or not.
    loads = {
        "j0": hp.HingeLoad(stops=(-1.0, 0.0), stop_restitution=0.0),
        "j1": hp.HingeLoad(stops=(-1.0, 0.3), stop_restitution=0.4),
    }
    found = hp.simulate(chain(2), np.linspace(0, 0.6, 61), [0.0, -0.5], loads=loads, tol=TIGHT)
    assert found.q[:, 0].max() <= 0.0
    assert np.abs(found.energy_balance().residual).max() < TOL
    k = int(np.argmax(found.q[:, 1] > 0.29))
    assert found.qd[k - 1, 1] > 0 > found.qd[k + 2, 1]


@pytest.mark.slow
def test_a_robot_of_one_joint_is_the_pair():
    rng = generator(5)
    one, two = (hp.Body(rng.uniform(1, 2), rng.normal(size=3), np.diag(rng.uniform(0.6, 1, 3))) for _ in range(2))
    pair = hp.HingePair(*rng.normal(size=(3, 3)), name="k", body1=one, body2=two)
    R, v, omega = rng.normal(size=(3, 3))
    start, t = hp.BodyMotion(R=R, S=rotations(rng, 1)[0], v=v, omega=omega), np.linspace(0, 1, 11)
    load = hp.HingeLoad(stiffness=3, friction=0.2, stops=(-0.3, 0.4), stop_restitution=0.6)
    of_pair = hp.simulate(pair, t, start, 0.1, 1.0, hinge_torque=load, force2=(1, 2, 3))
    of_robot = hp.simulate(
        hp.Mechanism([pair]), t, [0.1], [1.0], loads={"k": load}, wrenches={"k": ((1, 2, 3), 0)}, base="free",
        base_motion=start,
    )  # fmt: skip
    np.testing.assert_array_equal(of_robot.q[:, 0], of_pair.psi)
    np.testing.assert_array_equal(of_robot.base_motion.S, of_pair.S1)


@pytest.mark.parametrize("base", ["free", "pinned"])
@pytest.mark.slow
def test_momenta_of_a_robot_without_loads_are_kept(base):
    rng = generator(6)
    omega = rng.normal(size=3)
    start = hp.BodyMotion(
        R=(1, 2, 3), S=rotations(rng, 1)[0], omega=omega, **({} if base == "pinned" else {"v": omega})
    )
    loads = {"j1": hp.HingeLoad(friction=0.3), "j2": hp.HingeLoad(stops=(-0.5, 0.5), stop_restitution=0.5)}
    found = hp.simulate(
        chain(3, "free"), np.linspace(0, 2, 21), [0.1, 0.2, 0.3], [1, 2, 3], base=base, base_motion=start,
        loads=loads, gravity=(0, 0, 0),
    )  # fmt: skip
    momentum = found.momentum()
    if base == "free":
        assert np.ptp(momentum.linear, axis=0).max() < TIGHT
        assert np.ptp(momentum.angular, axis=0).max() < 10 * TIGHT
    else:
        about = momentum.angular - np.cross((1, 2, 3), momentum.linear)
        assert np.ptp(about, axis=0).max() < 10 * TIGHT
    assert np.abs(found.energy_balance().residual).max() < 10 * TOL


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:j2 passes the stops")
@pytest.mark.parametrize("base", ["fixed", "free", "pinned", "moving"])
def test_the_accelerations_are_those_of_forward_dynamics_and_the_energies_grow_by_the_work(base):
    robot = chain(3, "free" if base in ("free", "pinned") else "fixed")
    loads = {
        "j0": hp.HingeLoad(stiffness=2, damping=0.1, friction=0.5),
        "j1": hp.HingeLoad(stops=(-0.1, 0.4), stop_restitution=0.5, motor=lambda t, *_: 3 * np.sin(2 * t)),
        "j2": hp.HingeLoad(stops=(-0.2, 0.5), stop_stiffness=500.0, stop_damping=0.2),
    }
    forces = {"force1": (0.1, 0, 0.3), "torque1": lambda t, _: np.stack([np.sin(t)] * 3, -1)}
    wrench = {"j2": (lambda t, now: np.stack([now.q[:, 1], t, 0 * t], -1), (0, 0.2, 0))}
    start = {"base_motion": shaken} if base == "moving" else {}
    found = hp.simulate(
        robot, np.linspace(0, 2, 41), [0.1, 0.2, 0.3], [0, 1, 0], tau=lambda _, now: 0.3 * np.cos(now.qd),
        loads=loads, wrenches=wrench, base=base, tol=1e-11, **start, **(forces if base in ("free", "pinned") else {}),
    )  # fmt: skip
    balance = found.energy_balance()
    size = 1 + np.abs(balance.kinetic).max() + np.abs(balance.potential).max()
    assert np.abs(balance.residual).max() <= 2 * TOL * size
    wrenches = {"j2": (found.loads["force_j2"], found.loads["torque_j2"])}
    if base == "pinned":
        needed = found.reactions()
        np.testing.assert_allclose(needed.tau, found.tau, rtol=0, atol=TOL)
        np.testing.assert_allclose(needed.torque1, found.loads["torque1"], rtol=0, atol=TOL)
        return
    of_base = {name: found.loads[name] for name in ("force1", "torque1")} if base == "free" else {}
    expected = robot.forward_dynamics(
        found.q, found.qd, found.tau, base_motion=found.base_motion, wrenches=wrenches, **of_base
    )
    np.testing.assert_allclose(found.qdd, expected.qdd, rtol=0, atol=10 * TOL)


@pytest.mark.slow
def test_a_driven_joint_moves_as_given_and_says_what_drives_it():
    robot = chain(3)
    found = hp.simulate(
        robot, np.linspace(0, 2, 21), [0.0, 9.0, 0.0], driven={"j1": lambda t: (np.sin(t), np.cos(t), -np.sin(t))}
    )
    np.testing.assert_allclose(found.q[:, 1], np.sin(found.t), rtol=0, atol=8 * U)
    needed = robot.inverse_dynamics(found.q, found.qd, found.qdd).tau
    np.testing.assert_allclose(found.tau, needed, rtol=0, atol=10 * TOL)
    assert np.abs(found.tau[:, [0, 2]]).max() == 0.0


def test_masses_that_resist_no_motion_are_named():
    point = hp.Body(1.0, inertia=(1, 1e-20, 1))
    bodies = {"a": point, "b": ROD}
    hinges = [hp.HingePair((0, 0, 0), (0, 0, 0), (0, 1, 0), body2=body, name=n) for n, body in bodies.items()]
    with pytest.raises(hp.ArgumentError, match=r"^robot: expected masses that resist .* resists [ab]$"):
        hp.simulate(hp.Mechanism(hinges), [0.0, 1.0], [0.0, 0.0])


def follower(leader_load, follower_load, ratio=-2.0, offset=0.1):
    """Return a robot whose second joint follows the first, with loads that its file describes."""
    of_joints = "".join(
        f'''<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/><axis xyz="0 1 0"/>
        <origin xyz="0.3 0 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/>{mimic}</joint>
        <link name="{name}"><inertial><origin xyz="0.4 0 0"/><mass value="2"/>
        <inertia ixx="0.1" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>'''
        for name, parent, mimic in (
            ("a", "root", ""), ("b", "a", f'<mimic joint="a" multiplier="{ratio}" offset="{offset}"/>')
        )
    )  # fmt: skip
    robot = hp.Mechanism.from_urdf(f'<robot name="r"><link name="root"/>{of_joints}</robot>')
    return robot.with_joint_loads({"a": leader_load, "b": follower_load})


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [-2.0, 0.5])
def test_loads_of_a_joint_that_follows_act_on_its_leader(ratio):
    first, second = (hp.HingeLoad(stiffness=k, rest=0.2 * k, damping=0.1 * k, friction=0.3 * k) for k in (1.0, 3.0))
    robot = follower(first, second, ratio)
    q, qd = [0.3], [0.7]
    wanted = robot.forward_dynamics(q, qd, [0.4], joint_loads=True).qdd
    found = hp.simulate(robot, np.linspace(0, 0.3, 7), q, qd, tau=0.4, loads=robot.joint_loads)
    np.testing.assert_allclose(found.qdd[0], wanted, rtol=512 * U)
    assert np.abs(found.energy_balance().residual).max() < 10 * TOL * np.abs(found.energy().kinetic).max()
    assert "stop" in found.loads


def test_stops_of_a_joint_that_follows_act_on_its_leader():
    stop = hp.HingeLoad(stops=(-1.0, 1.0), stop_restitution=0.0)
    robot = follower(hp.HingeLoad(), hp.HingeLoad())
    loads = {"a": hp.HingeLoad(motor=2.0), "b": stop}
    found = hp.simulate(robot, [0.0, 1.0], [0.0], [0.3], loads=loads, gravity=(0, 0, 0))
    np.testing.assert_allclose(found.loads["motor"], 2.0, rtol=64 * U)
    with pytest.raises(hp.ArgumentError, match=r"^loads\['b'\]: expected a load without a motor"):
        hp.simulate(robot, [0.0, 1.0], [0.0], loads={"b": 1.0})
    assert found.q[-1, 0] == pytest.approx(0.55, abs=TIGHT)  # b stands at -1
    with pytest.raises(hp.ArgumentError, match=r"^loads\['b'\]: expected no load at a joint that moves as given"):
        hp.simulate(robot, [0.0, 1.0], [0.0], loads={"b": stop}, driven={"a": lambda t: (t, 1, 0)})


def test_what_a_file_describes_is_handed_on_as_it_is():
    hinge = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 1, 0), body2=ROD, name="j", limits=(-1, 2))
    robot = hp.Mechanism([hinge]).with_joint_loads({"j": hp.HingeLoad(damping=0.3, friction=0.1)})
    found = hp.simulate(robot, [0.0, 1.0], [1.9], loads=robot.joint_loads)
    assert {"stop", "damper", "friction"} <= {*found.loads}
    with pytest.warns(hp.DynamicsWarning, match=r"left out are damping and dry friction of 1 joint; loads="):
        hp.simulate(robot, [0.0, 0.1], [0.0])


@pytest.mark.slow
def test_a_robot_without_joints_falls_and_keeps_its_angular_momentum():
    hinge = hp.HingePair(
        (0, 0, 0), (0, 0, 0), (0, 0, 1), name="h", body1=ROD, body2=hp.Body(1e-9, inertia=(1e-9,) * 3)
    )
    body, none = hp.Mechanism([hinge], base="free").with_locked({"h": 0.0}), np.zeros((5, 0))
    start = hp.BodyMotion(R=(1, 2, 3), S=np.eye(3), v=(0.5, 0, 1), omega=(1, 2, 0.3))
    found = hp.simulate(body, np.linspace(0, 1, 5), [], base_motion=start)
    first, momentum = (
        body.momentum(q, q, base_motion=base) for q, base in ((none[0], start), (none, found.base_motion))
    )
    centre, t = body.centre_of_mass(none, base_motion=found.base_motion), found.t[:, None]
    fallen = body.centre_of_mass(none[0], base_motion=start) + t * first.linear / body.mass - t**2 / 2 * (0, 0, G)
    np.testing.assert_allclose(centre, fallen, rtol=0, atol=TOL)
    spins = [one.angular - np.cross(at, one.linear) for one, at in ((first, fallen[0]), (momentum, centre))]
    np.testing.assert_allclose(spins[1], np.broadcast_to(spins[0], (5, 3)), rtol=0, atol=TOL)
