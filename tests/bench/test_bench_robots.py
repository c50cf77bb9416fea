"""Every engine of `bench robots` computes what fifty digits say; the report holds a row for each."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.bench import engines
from hingepair.bench import robots as bench
from hingepair.bench.robot_truth import ExactRobot
from support.sparse import sparse

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

CASES = [(name, workload) for name in bench.LOCKED_JOINT_POSITIONS_BY_ROBOT_NAME for workload in bench.WORKLOAD_NAMES]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "workload"), sparse(CASES, 5))
def test_all_engines_agree(name, workload):
    robot, model = bench._load_models(name)
    task = bench.make_robot_task(name, robot, model, workload, 3 if workload != bench.FORWARD_WORKLOAD else 1)
    truth = bench.exact_robot_results(task)
    for method in bench.COMPARED_ROBOT_METHODS:
        asked = workload in bench._WORKLOAD_NAMES_BY_NAME_OF_RESTRICTED_METHOD.get(method.name, bench.WORKLOAD_NAMES)
        if asked and method.name not in (bench.PINOCCHIO_CPP_NAME, bench.FRAX_NAME):
            one = (
                bench.make_robot_task(name, robot, model, workload, 1) if method.name == bench.PREPARED_NAME else task
            )
            rounds_more = method.name == bench.MUJOCO_NAME or workload == bench.FORWARD_WORKLOAD
            assert bench.robot_error(method, one, truth) < (1e-13 if rounds_more else 4e-15), method.name


def test_an_error_is_seen():
    robot, model = bench._load_models("ur5_robot")
    task = bench.make_robot_task("ur5_robot", robot, model, bench.INVERSE_WORKLOAD, 3)
    wrong = bench.Method("wrong", lambda own: lambda: np.asarray(bench.hingepair_robot_job(own)()) * (1 + 1e-3))
    assert 5e-4 < bench.robot_error(wrong, task, bench.exact_robot_results(task)) < 2e-3


@pytest.mark.slow
def test_the_report_has_a_row_for_each_engine():
    report = bench.measure_robots(["ur5_robot"], [1, 10], 1, False)
    assert {row.case for row in report.rows} == {
        f"ur5 (6 joints), {workload}, N = {size}" for workload in bench.WORKLOAD_NAMES for size in (1, 10)
    }
    assert {bench.PREPARED_NAME, bench.HINGEPAIR_NAME, bench.PINOCCHIO_LOOP_NAME, bench.MUJOCO_NAME} <= {
        row.method for row in report.rows
    }
    panels = [panel for line in report.panels for panel in line]
    assert [panel.title for panel in panels] == [f"{workload}, N = 10" for workload in bench.WORKLOAD_NAMES]
    for panel in panels:
        assert panel.y_names == ["ur5 (6 joints)"]
        assert panel.curves[0].name.startswith(f"{bench.HINGEPAIR_NAME}: error ")
        assert all(
            panel.x_range[0] < x < panel.x_range[1] and y == 0 for curve in panel.curves for x, y in curve.points
        )
    assert all(row.error is not None and row.error < 1e-13 for row in report.rows)
    assert max(map(len, report.table())) <= 100


def test_the_truth_holds_for_joints_of_every_kind():
    """Sliders and followers too, which the robots of the bench have none of."""
    robot = hp.Mechanism.from_urdf(FOLLOWERS)
    rng = np.random.default_rng(5)
    q, v, w = rng.uniform(-1, 1, (3, robot.dof))
    truth = ExactRobot(robot.tree, q)
    tip = robot.tree.joints[-1].name
    state = robot.forward_kinematics(q, frames=(tip,))
    np.testing.assert_allclose(truth.pose(tip).astype(float)[:3], state[tip].R, atol=1e-15)
    np.testing.assert_allclose(truth.jacobian(tip).astype(float), robot.jacobian(q, tip), atol=1e-15)
    tau = truth.inverse_dynamics(v, w).astype(float)
    np.testing.assert_allclose(tau, robot.inverse_dynamics(q, v, w).tau, rtol=1e-13)
    np.testing.assert_allclose(truth.forward_dynamics(v, tau).astype(float), w, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # frax's own
def test_frax_agrees():
    robot, model = bench._load_models("ur5_robot")
    method = next(method for method in bench.COMPARED_ROBOT_METHODS if method.name == bench.FRAX_NAME)
    for workload in (bench.INVERSE_WORKLOAD, bench.FORWARD_WORKLOAD):
        task = bench.make_robot_task("ur5_robot", robot, model, workload, 4)
        assert bench.robot_error(method, task, bench.exact_robot_results(task)) < 1e-13


@pytest.mark.proof
def test_the_cpp_loop_agrees(monkeypatch):
    """Not optimised, and with what Pinocchio's library has compiled already, which takes a tenth of the time."""
    engines.compile_library.cache_clear()
    bench._load_robots_library.cache_clear()
    library = next(engines._header_folders()).parent / "lib"
    linked = ("-Wl,--no-as-needed", f"-L{library}", f"-Wl,-rpath,{library}", "-lpinocchio_default")
    kept = [flag for flag in engines._CPP_COMPILER_FLAGS if flag not in {"-O3", "-march=native"}]
    flags = (*kept, "-O0", "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION", *linked)
    monkeypatch.setattr(engines, "_CPP_COMPILER_FLAGS", flags)
    method = next(method for method in bench.COMPARED_ROBOT_METHODS if method.name == bench.PINOCCHIO_CPP_NAME)
    for name, workload in CASES:
        robot, model = bench._load_models(name)
        task = bench.make_robot_task(name, robot, model, workload, 1)
        limit = 1e-13 if workload == bench.FORWARD_WORKLOAD else 4e-15
        assert bench.robot_error(method, task, bench.exact_robot_results(task)) < limit, (name, workload)
