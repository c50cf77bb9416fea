"""Whole robots over Dask arrays: what comes lazily is what NumPy gives, one task a chunk, and nothing is computed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

import hingepair as hp
from support.states import body1 as random_body
from support.states import generator

pytest.importorskip("dask.distributed", reason="the extra dask is not installed")

import dask
import dask.array as da
import dask.dataframe as dd
import pandas as pd

from support.lazy import computed, refuse

COUNT, CHUNK = 50, 20
U = 2.0**-53


def assert_close(found, expected):
    """Equal but for the last bits, which depend on the backend that "auto" takes."""
    assert (found.shape, found.dtype) == (np.shape(expected), np.asarray(expected).dtype)
    assert np.abs(found - expected).max() <= 256 * U * np.abs(expected).max()


LETTERS = ("R", "S", "v", "omega", "a", "alpha")


def chunked(array):
    return da.from_array(array, chunks=(CHUNK, *array.shape[1:]))


def robot(base: str = "fixed") -> hp.Mechanism:
    """Two hinges and a slider, with masses."""
    rng = generator(500)
    boom, stick, rod = (hp.Body(m, rng.normal(size=3), inertia=rng.uniform(2, 3, 3)) for m in (3, 2, 1))
    frame = hp.Body(5, inertia=(1, 1, 1))
    joints = [
        hp.HingePair((0, 0, 0.1), (0, 0, 0), (0, 0.6, 0.8), name="boom", body1=frame, body2=boom),
        hp.HingePair((0.5, 0, 0), (0, 0.1, 0), (0, 1, 0), name="stick", body2=stick),
        hp.Slider((0.2, 0, 0), (0, 0, 0), (1, 0, 0), name="rod", body2=rod),
    ]  # fmt: skip
    return hp.Mechanism(joints, base=base)


ROBOT, FREE = robot(), robot("free")
Q, QD, QDD = generator(501).normal(size=(3, COUNT, 3))
FORCE, TORQUE = generator(502).normal(size=(2, COUNT, 3))
BASE = hp.BodyMotion(**dict(zip(LETTERS, random_body(generator(503), COUNT), strict=True)))
LAZY_BASE = hp.BodyMotion(**{letter: chunked(getattr(BASE, letter)) for letter in LETTERS})


class Given(NamedTuple):
    """What calls are given, of NumPy or of Dask."""

    q: list
    wrench: list
    base: hp.BodyMotion


CALLS = {
    "pose": lambda g: ROBOT.forward_kinematics(g.q[0]),
    "frames": lambda g: ROBOT.forward_kinematics(*g.q, frames=("stick", "rod"), outputs=("a", "S")),
    "one_frame": lambda g: ROBOT.forward_kinematics(*g.q, frames=("stick", "rod"))["rod"],
    "moving_base": lambda g: ROBOT.forward_kinematics(*g.q, base_motion=g.base),
    "jacobian": lambda g: ROBOT.jacobian(g.q[0], "rod"),
    "free_jacobian": lambda g: FREE.jacobian(g.q[0], "rod", base_motion=g.base),
    "acceleration_bias": lambda g: ROBOT.acceleration_bias(*g.q[:2], "rod"),
    "inverse_dynamics": lambda g: ROBOT.inverse_dynamics(*g.q, gravity=(0, 1, 2)),
    "wrenches": lambda g: ROBOT.inverse_dynamics(*g.q, wrenches={"rod": (g.wrench[0], 0), "boom": (0, g.wrench[1])}),
    "forward_dynamics": lambda g: ROBOT.forward_dynamics(*g.q),
    "free_dynamics": lambda g: FREE.forward_dynamics(*g.q, force1=g.wrench[0], base_motion=g.base),
    "mass_matrix": lambda g: ROBOT.mass_matrix(g.q[0]),
    "bias_forces": lambda g: ROBOT.bias_forces(*g.q[:2]),
    "gravity_forces": lambda g: ROBOT.gravity_forces(g.q[0]),
    "centre_of_mass": lambda g: ROBOT.centre_of_mass(g.q[0]),
    "centre_of_mass_jacobian": lambda g: ROBOT.centre_of_mass_jacobian(g.q[0]),
    "energy": lambda g: ROBOT.energy(*g.q[:2]),
    "momentum": lambda g: ROBOT.momentum(*g.q[:2], about="centre"),
    "error_bounds": lambda g: ROBOT.error_bounds(*g.q, outputs=("R", "tau")),
    "by_joint": lambda g: ROBOT.jacobian({"boom": g.q[0][:, 0], "stick": 0.5, "rod": g.q[0][:, 2]}, "rod"),
}


def arrays_of(result) -> dict:
    if isinstance(result, np.ndarray | da.Array):
        return {"": result}
    return result if isinstance(result, dict) else result.arrays()


@pytest.mark.slow
@pytest.mark.parametrize("name", CALLS)
def test_a_robot_gives_what_numpy_gives(name):
    with dask.config.set(scheduler=refuse):
        lazy = CALLS[name](Given([*map(chunked, (Q, QD, QDD))], [chunked(FORCE), chunked(TORQUE)], LAZY_BASE))
    plain = CALLS[name](Given([Q, QD, QDD], [FORCE, TORQUE], BASE))
    expected, found = arrays_of(plain), arrays_of(lazy)
    assert found.keys() == expected.keys()
    for key, array in expected.items():
        own = found[key]
        assert (own.shape, own.dtype, own.chunks[0]) == (array.shape, array.dtype, (20, 20, 10))
        assert_close(computed(own), array)


def test_there_is_one_task_a_chunk():
    (graph,) = dask.optimize(ROBOT.inverse_dynamics(*map(chunked, (Q, QD, QDD))).tau)
    assert sum(not str(key).startswith("('array-") for key in graph.__dask_graph__()) == 3


def test_data_frames_go_by_the_names_of_joints():
    table = pd.DataFrame({"rod": Q[:, 2], "boom": Q[:, 0], "stick": Q[:, 1]})
    lazy = ROBOT.jacobian(dd.from_pandas(table, npartitions=2), "rod")
    assert_close(computed(lazy), ROBOT.jacobian(Q, "rod"))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda q: ROBOT.jacobian(q[:, :2], "rod"), r"q: expected shape \(..., 3\)"),
        (lambda q: ROBOT.jacobian(q, "hook"), "frames: expected"),
        (lambda q: ROBOT.jacobian(q, "rod", out=np.empty((COUNT, 6, 3))), "out: expected None, since Dask"),
        (lambda q: ROBOT.forward_dynamics(q, q[:7], q), r"qd: expected leading shape that broadcasts with \(50,\)"),
    ],
)
def test_what_cannot_be_used_is_refused_before_anything_is_computed(call, message):
    with dask.config.set(scheduler=refuse), pytest.raises(hp.ArgumentError, match=message):
        call(chunked(Q))
