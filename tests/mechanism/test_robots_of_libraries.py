"""Robots by the arithmetic of other libraries: the strict array API, JAX and PyTorch.

PyTorch is not among the extras, since its wheels bring gigabytes: where it is installed, it is tested here.
"""

from __future__ import annotations

import collections

import array_api_strict as strict
import numpy as np
import pytest

import hingepair as hp
from support.trees import Robot, random_model, record_of, with_mimics

SAMPLES = 3


@pytest.fixture(params=["strict", pytest.param("jax", marks=pytest.mark.slow(8)), "torch"])
def asarray(request):
    """What makes arrays of a library."""
    if request.param == "strict":
        yield strict.asarray
    elif request.param == "torch":
        yield pytest.importorskip("torch", reason="PyTorch is not installed: its arrays are not tested").asarray
    else:
        jax = pytest.importorskip("jax")
        with jax.enable_x64(True):
            yield jax.numpy.asarray


@pytest.fixture(scope="module")
def robot():
    """Joints of every kind, of which two follow others, on a base of either kind."""
    tree = record_of(random_model(5, 6))
    names = [joint.name for joint in tree.joints]
    return Robot(with_mimics(tree, {names[2]: (names[0], -0.5, 0.25), names[4]: (names[3], 2.0, 0.0)}))


def motion(robot, seed=6):
    return np.random.default_rng(seed).uniform(-1, 1, (3, SAMPLES, robot.dof))


def results(robot, q, qd, qdd, **more):
    """Everything that a robot can be asked."""
    found = robot.forward_kinematics(q, qd, qdd, frames=robot.tips, **more).arrays()
    found |= robot.inverse_dynamics(q, qd, qdd, **more).arrays()
    found |= robot.forward_dynamics(q, qd, qdd, **more).arrays()
    found["jacobian"] = robot.jacobian(q, robot.tips[0], **more)
    found["mass_matrix"], found["bias_forces"] = robot.mass_matrix(q, **more), robot.bias_forces(q, qd, **more)
    found["centre_of_mass"] = robot.centre_of_mass(q, **more)
    energy, momentum = robot.energy(q, qd, **more), robot.momentum(q, qd, **more)
    return found | {"kinetic": energy.kinetic, "potential": energy.potential, "linear": momentum.linear}


def require(found, expected, tolerance):
    for name, want in expected.items():
        assert not isinstance(found[name], np.ndarray), name
        got = np.asarray(found[name])
        assert (got.shape, got.dtype) == (want.shape, want.dtype), name
        size = max(1.0, float(np.abs(want).max()))
        np.testing.assert_allclose(got, want, rtol=0, atol=tolerance * size, err_msg=name)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*no rigid body:hingepair.DynamicsWarning")
@pytest.mark.parametrize("single", [False, True], ids=["float64", "float32"])
def test_what_a_robot_gives_is_what_numpy_gives(asarray, robot, single):
    q, qd, qdd = motion(robot).astype(np.float32 if single else np.float64)
    expected = results(robot, q, qd, qdd)
    require(results(robot, *map(asarray, (q, qd, qdd))), expected, 1e-3 if single else 1e-12)


def test_numbers_among_arrays_stay_numbers(asarray, robot):
    q, qd, _ = motion(robot)
    by_joint = {name: asarray(q[:, k]) for k, name in enumerate(robot.names)} | {robot.names[1]: 0.3}
    q[:, 1] = 0.3
    state = robot.forward_kinematics(by_joint, asarray(qd))
    require(state.arrays(), robot.forward_kinematics(q, qd).arrays(), 1e-13)


@pytest.mark.parametrize("single", [False, True], ids=["float64", "float32"])
def test_numpy_arrays_are_constants_of_the_library(asarray, robot, single):
    """They give what arrays of the library give, whatever their dtype, strides and flags."""
    q, qd, qdd = motion(robot)
    constants = {robot.names[k]: qd[::-1, k] for k in range(robot.dof)}
    base = hp.BodyMotion(R=np.ones(3), S=np.eye(3), v=qd[:, :3], omega=np.ones(3), a=np.ones(3), alpha=np.ones(3))
    wrenches = {robot.tips[0]: (np.arange(3), qdd[::-1, :3].astype(np.float32))}
    ask = {"base_motion": base, "wrenches": wrenches, "outputs": ("tau",)}
    expected = robot.inverse_dynamics(q, qd[::-1], qdd, **ask).tau
    found = robot.inverse_dynamics(asarray(q.astype(np.float32) if single else q), constants, qdd, **ask).tau
    assert not isinstance(found, np.ndarray)
    assert ("float32" in str(found.dtype)) == single
    size = np.abs(expected).max()
    np.testing.assert_allclose(np.asarray(found), expected, rtol=0, atol=size * (2.0**-18 if single else 2.0**-45))


@pytest.mark.slow
def test_a_base_that_moves(asarray, robot):
    q, qd, qdd = motion(robot)
    rng = np.random.default_rng(7)
    given = {letter: rng.normal(size=(SAMPLES, 3)) for letter in ("R", "v", "omega", "a", "alpha")}
    given["S"] = hp.rotation_exp(rng.normal(size=(SAMPLES, 3)))
    base = hp.BodyMotion(**{letter: asarray(value) for letter, value in given.items()})
    found = robot.inverse_dynamics(*map(asarray, (q, qd, qdd)), base_motion=base).arrays()
    expected = robot.inverse_dynamics(q, qd, qdd, base_motion=hp.BodyMotion(**given))
    require(found, expected.arrays(), 1e-13)


def test_a_prepared_call_takes_them(asarray, robot):
    q, qd, _ = motion(robot)
    step = robot.prepare("velocity")
    require(step(asarray(q), asarray(qd)).arrays(), step(q, qd).arrays(), 1e-13)


@pytest.mark.slow(5)
def test_jax_runs_the_folded_program():
    """What is known of the robot costs JAX nothing: its program has the operations of the generated code."""
    jax = pytest.importorskip("jax")
    robot = hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})
    q, qd, qdd = motion(robot)
    program = jax.make_jaxpr(lambda *x: robot.inverse_dynamics(*x, outputs=("tau",)).tau)(q, qd, qdd)
    counts = collections.Counter(one.primitive.name for one in program.jaxpr.eqns)
    left = sum(robot.prepare("inverse_dynamics", outputs=("tau",), backend="numpy").operations[:2])
    assert sum(counts[name] for name in ("add", "sub", "mul", "div", "neg")) <= left
    assert counts["concatenate"] == 0  # XLA would compute what the components share again for each of them


@pytest.mark.slow(5)
def test_derivatives_of_a_turn_about_any_axis_are_finite_at_every_angle():
    """The versine of the generated code is chosen by the cosine: what is not chosen divides by nothing at pi."""
    jax = pytest.importorskip("jax")
    pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -1))
    with jax.enable_x64(True):
        turned = jax.jit(jax.jacobian(lambda q: pair.forward_kinematics(q, outputs=("S2",)).S2[0, 1]))
        for psi in (0.0, 1e-9, 0.5, np.pi / 2, np.pi, -np.pi, 3.0, 7.0):
            found = float(turned(jax.numpy.asarray([0, 0, 0, 0, 0, 0, psi]))[6])
            ax, ay, az = pair.n
            expected = ax * ay * np.sin(psi) - az * np.cos(psi)  # of n n^T (1 - cos) + [n]x sin
            assert found == pytest.approx(expected, rel=1e-14, abs=1e-15)
