"""Robots of many joints, which are computed joint by joint: as the program of fewer joints and as Pinocchio do."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.engine import loops
from hingepair.mechanism.mechanism import tree_of
from hingepair.plans import trees
from support import states
from support.trees import Robot, base_motion, random_model, record_of, with_mimics

METHODS = {
    "forward_kinematics": ("q", "qd", "qdd"),
    "inverse_dynamics": ("q", "qd", "qdd"),
    "forward_dynamics": ("q", "qd", "tau"),
    "mass_matrix": ("q",),
    "energy": ("q", "qd"),
}


@contextlib.contextmanager
def joint_by_joint(robot):
    """A copy of a robot, of which nothing is traced within the context."""

    def refuse(*_):
        raise AssertionError("a request has been traced")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trees, "MAX_TRACED_OPERATIONS", -1)
        patch.setattr(loops, "Program", refuse)
        trees.request_loop.cache_clear()
        yield Robot(replace(tree_of(robot)), robot.base)
    trees.request_loop.cache_clear()


def arrays_of(result):
    if hasattr(result, "kinetic"):
        return {"kinetic": result.kinetic, "potential": result.potential}
    return {"result": result} if isinstance(result, np.ndarray) else result.arrays()


@pytest.mark.slow
@pytest.mark.parametrize("base", ["fixed", "free"])
@pytest.mark.parametrize("kind", ["plain", "mimic", "float32", "one state", "tuple"])
def test_joint_by_joint_gives_the_bits_of_the_program(kind, base):
    """A NaN or an infinity stays in its sample."""
    tree = record_of(random_model(5, 6))
    if kind == "mimic":
        tree = with_mimics(tree, {tree.joints[-1].name: (tree.joints[0].name, 0.5, 0.1)})
    robot, rng = Robot(tree, base), states.generator(820)
    values = dict(zip(("q", "qd", "qdd", "tau"), rng.normal(size=(4, 9, robot.dof)), strict=True))
    values["q"][3, 2], values["q"][4, -1], values["qd"][5, 1] = np.nan, np.inf, np.nan
    if kind == "float32":
        values = {name: value.astype(np.float32) for name, value in values.items()}
    elif kind == "one state":
        values = {name: value[0] for name, value in values.items()}
    elif kind == "tuple":
        columns = {name: dict(zip(robot.names, value.T, strict=True)) for name, value in values.items()}
        values = {name: {**own, robot.names[1]: 0.0} for name, own in columns.items()}
    given = {method: [values[name] for name in names] for method, names in METHODS.items()}
    expected = {method: getattr(robot, method)(*own, backend="numpy") for method, own in given.items()}
    with joint_by_joint(robot) as other:
        for method, own in given.items():
            for backend in ("numpy", "compiled", "auto"):
                found = arrays_of(getattr(other, method)(*own, backend=backend, workers=2))
                for name, array in arrays_of(expected[method]).items():
                    size = np.nanmax(np.abs(array), initial=1.0, where=np.isfinite(array))
                    off = 1e-14 * size if kind == "one state" else 0  # which Python's own sines compute
                    assert found[name].dtype == array.dtype
                    one = found[name] if kind == "one state" else np.delete(found[name], (3, 4, 5), axis=0)
                    other_one = array if kind == "one state" else np.delete(array, (3, 4, 5), axis=0)
                    np.testing.assert_allclose(one, other_one, rtol=0, atol=off, err_msg=name)
                    assert np.isnan(found[name][np.isnan(array)]).all()


def test_out_base_and_prepared_calls_of_a_robot_joint_by_joint():
    robot, rng = Robot(record_of(random_model(6, 6)), "free"), states.generator(821)
    q, qd, qdd = rng.normal(size=(3, 5, robot.dof))
    moving, out = base_motion(rng, (5,)), {"tau": np.full((5, robot.dof), 7.0)}
    expected = robot.inverse_dynamics(q, qd, qdd, base_motion=moving, backend="numpy")
    still = robot.inverse_dynamics(q, qd, qdd, backend="numpy")
    with joint_by_joint(robot) as other:
        found = other.inverse_dynamics(q, qd, qdd, base_motion=moving, out=out)
        np.testing.assert_array_equal(out["tau"], expected.tau)
        np.testing.assert_array_equal(found.torque1, expected.torque1)
        step = other.prepare("inverse_dynamics")
        np.testing.assert_array_equal(step(q, qd, qdd).tau, still.tau)
        assert "joint by joint" in str(step)
        with pytest.raises(hp.ArgumentError, match="qd"):
            other.inverse_dynamics(q, qd[:3], qdd)


def chain(count):
    """Hinges along all directions, with bodies."""
    rng = states.generator(822, count)
    pairs = []
    for k in range(count):
        body = hp.Body(mass=1.0, centre_of_mass=rng.normal(size=3) * 0.1, inertia=(0.02, 0.03, 0.04))
        place = {"u1": rng.normal(size=3) * 0.1, "u2": (0, 0, 0), "n": rng.normal(size=3)}
        home = hp.euler_to_matrix(rng.normal(size=3))
        pairs.append(hp.HingePair(**place, home=home, name=f"joint_{k}", body2=body))
    return hp.Mechanism(pairs)


@pytest.mark.slow
@pytest.mark.parametrize("count", [100, pytest.param(200, marks=pytest.mark.slow(5))])
def test_long_chains_agree_with_pinocchio(count):
    with joint_by_joint(chain(count)) as robot:
        check_chain(robot, count)


def test_what_is_traced_has_a_limit():
    """The mass matrix of 100 joints took 8 s and 350 MB as straight-line code, of 300 joints minutes."""
    robot, panda = chain(100), hp.load_robot("panda")
    for own, outputs, traced in ((robot, "mass_matrix", False), (robot, "tau", True), (panda, "mass_matrix", True)):
        request = trees.Request((outputs,), free=False)
        assert trees.request_loop(own._robot.constants.form, request).traced is traced


@pytest.mark.slow
def test_what_is_differentiated_has_a_limit():
    """The derivatives of 60 joints took LLVM minutes and more than a gigabyte."""
    for count in (60, 200):
        call = chain(count).prepare("inverse_dynamics", outputs=("tau",), backend="numpy")
        with pytest.raises(hp.ArgumentError, match="robot: expected fewer joints"):
            call.jacobian(tuple(np.zeros((3, count))))


def check_chain(robot, count):
    rng = states.generator(823)
    twin = hp.to_pinocchio(robot)
    q, qd, qdd = rng.normal(size=(3, 3, count))
    state = robot.forward_kinematics(q, qd, qdd)
    tau = robot.inverse_dynamics(q, qd, qdd).tau
    M = robot.mass_matrix(q)
    solved = robot.forward_dynamics(q, qd, tau).qdd
    for k in range(3):
        at = twin.configuration(q[k]), twin.velocity(q[k], qd[k]), twin.acceleration(q[k], qd[k], qdd[k])
        near(tau[k], pin.rnea(twin.model, twin.data, *at))
        upper = np.triu(pin.crba(twin.model, twin.data, at[0]))
        near(M[k], upper + np.triu(upper, 1).T)
        change = twin.acceleration(q[k], qd[k], solved[k])
        near(pin.rnea(twin.model, twin.data, *at[:2], change), tau[k])
        pin.forwardKinematics(twin.model, twin.data, *at)
        near(state.R[k, 0], twin.data.oMi[count].translation)
        near(state.S[k, 0], twin.data.oMi[count].rotation)


def near(found, expected):
    assert abs(found - expected).max() <= 1e-11 * abs(expected).max()  # both round along a hundred joints
