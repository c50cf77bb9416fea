"""Every engine of `bench robots` computes what fifty digits say; the report holds a row for each."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.bench import engines
from hingepair.bench import robots as bench
from hingepair.bench.truth import ExactRobot
from hingepair.mechanism.mechanism import tree_of
from hingepair.mechanism.tree import Frame

FOLLOWERS = """<robot name="r"><link name="a"/>
<link name="b"><inertial><origin xyz="0.1 0 0.2"/><mass value="2"/>
<inertia ixx=".3" iyy=".4" izz=".5" ixy=".01" ixz="0" iyz="0"/></inertial></link>
<link name="c"><inertial><origin xyz="0 0.1 0"/><mass value="1"/>
<inertia ixx=".1" iyy=".2" izz=".25" ixy="0" ixz="0" iyz=".02"/></inertial></link>
<link name="d"><inertial><origin xyz="0 0 0.3"/><mass value="0.5"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="0.3 0 0"/>
<axis xyz="0 1 0"/><limit effort="1" velocity="1"/></joint>
<joint name="j2" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.5 0 0" rpy="0.2 0 0"/>
<axis xyz="0.6 0 0.8"/><limit effort="1" velocity="1"/></joint>
<joint name="j3" type="revolute"><parent link="c"/><child link="d"/><origin xyz="0 0.3 0"/><axis xyz="1 0 0"/>
<mimic joint="j1" multiplier="-2" offset="0.25"/><limit effort="1" velocity="1"/></joint></robot>"""

CASES = [("ur5_robot", workload) for workload in bench.WORKLOADS] + [
    ("panda", bench.POSE),  # reduced by its fingers
    pytest.param("solo12", bench.ACCELERATION_SLOPES, marks=pytest.mark.proof),  # branches
    pytest.param("talos_reduced", bench.FORWARD, marks=pytest.mark.proof),
]
FRAX = next(method for method in bench.METHODS if method.name == bench.FRAX)


def able(workload):
    """The methods that compute a workload, but for those of C++ and JAX."""
    left_out = engines.PINOCCHIO_CPP, FRAX.name
    found = [m for m in bench.METHODS if workload in bench._ONLY.get(m.name, bench.WORKLOADS)]
    return [method for method in found if method.name not in left_out]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "workload"), CASES)
def test_all_engines_agree(name, workload):
    models = bench.load_models(name)
    task = bench.make_task(*models, workload, 2 if workload in bench.SLOPES else 3)
    truth = bench.exact_results(task)
    for method in able(workload):
        own = bench.make_task(*models, workload, 1) if method.name == bench.PREPARED else task
        rounds_more = method.name == engines.MUJOCO or workload in (bench.FORWARD, bench.ACCELERATION_SLOPES)
        assert bench.result_error(method, own, truth) < (2e-13 if rounds_more else 4e-15), method.name


def test_an_error_is_seen():
    task = bench.make_task(*bench.load_models("ur5_robot"), bench.INVERSE, 3)
    wrong = bench.Method("wrong", lambda own: lambda: (bench.hingepair_job(own)()[0] * (1 + 1e-3),))
    assert 5e-4 < bench.result_error(wrong, task, bench.exact_results(task)) < 2e-3


@pytest.mark.proof
def test_the_report_has_a_row_for_each_engine(monkeypatch):
    others = [method for method in bench.METHODS if method is not FRAX]  # JAX compiles frax for seconds
    monkeypatch.setattr(bench, "METHODS", others)
    report = bench.bench_robots(["ur5_robot"], [1, 10], 1, with_cpp=False, cold=False)
    for workload in bench.WORKLOADS:
        names = {method.name for method in able(workload)}
        for size in (1, 10):
            case = f"ur5 (6 joints), {workload}, N = {size}"
            found = {row.method for row in report.rows if row.case == case}
            sizes = {m.name: (m.min_samples, 1 if m.name == bench.PREPARED else 10) for m in bench.METHODS}
            assert found == {name for name in names if sizes[name][0] <= size <= sizes[name][1]}, case
    assert all(row.error is not None and row.error < 1e-13 for row in report.rows)
    assert max(map(len, report.table())) <= 100
    panels = [panel for line in report.panels for panel in line]
    assert [panel.title for panel in panels] == [f"{workload}, N = 10" for workload in bench.WORKLOADS]
    for panel in panels:
        assert panel.y_names == ["ur5 (6 joints)"]
        assert panel.curves[0].name.startswith("hingepair: error ")
        low, high = panel.x_range
        assert all(low < x < high and y == 0 for curve in panel.curves for x, y in curve.points)


@pytest.mark.slow
def test_the_truth_holds_for_joints_of_every_kind():
    """Sliders and followers too, which the robots of the bench have none of."""
    robot = hp.Mechanism.from_urdf(FOLLOWERS)
    rng = np.random.default_rng(5)
    q, v, w = rng.uniform(-1, 1, (3, 1, robot.dof))
    joint = tree_of(robot).joints[-1].name
    state, body = robot.forward_kinematics(q, frames=(joint,)), len(tree_of(robot).joints)
    truth = ExactRobot(tree_of(robot), q, v, w)
    motion = truth.motion(Frame(body, np.zeros(3), np.eye(3)))
    np.testing.assert_allclose(motion["R"].astype(float), state[joint].R, atol=1e-15)
    np.testing.assert_allclose(motion["S"].astype(float), state[joint].S, atol=1e-15)
    np.testing.assert_allclose(truth.jacobian(body, motion["R"]).astype(float), robot.jacobian(q, joint), atol=1e-15)
    np.testing.assert_allclose(truth.mass_matrix().astype(float), robot.mass_matrix(q), rtol=1e-13)
    tau = truth.forces()[2].astype(float)
    np.testing.assert_allclose(tau, robot.inverse_dynamics(q, v, w).tau, rtol=1e-13)
    np.testing.assert_allclose(ExactRobot(tree_of(robot), q, v).accelerations(tau).astype(float), w, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # frax's own
def test_frax_agrees():
    models = bench.load_models("ur5_robot")
    task = bench.make_task(*models, bench.INVERSE, 4)
    assert bench.result_error(FRAX, task, bench.exact_results(task)) < 1e-13
