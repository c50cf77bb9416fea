"""Whole robots against Pinocchio's own reading of their URDF, on a base at rest, a moving and a free one."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.formats.robots import robot_names
from support.robot_proof import MODES, ratios_of

BOUND = 16.0
"""Largest difference in units of u * scale: both sides round.

It equals `pair.accuracy.PINOCCHIO_ROUNDOFFS`.
"""
KINDS = {
    "panda": "fixed",  # an arm with sliders, of which one follows the other
    "kinova": "moving",  # continuous joints
    "solo12": "free",  # a quadruped
    "quadrotor_base": "free",  # one body
}

pytestmark = pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning")


def check(name, mode, **options):
    ratios = ratios_of(name, mode, **options)
    late = {output: ratio for output, ratio in ratios.items() if not ratio <= BOUND}
    assert not late, late
    print(f"{name}, {mode}: {max(ratios.values()):.2f}")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "mode"), KINDS.items())
def test_one_robot_of_each_kind(name, mode):
    check(name, mode, count=1)


@pytest.mark.proof
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", robot_names())
def test_every_robot(name, mode):
    """All links and outputs; random states, angles to 1e15 and down to 1e-160, rates and accelerations to 1e8."""
    check(name, mode)


@pytest.mark.proof
@pytest.mark.parametrize("name", robot_names())
def test_every_description(name):
    """The library's own comparison of results with those by Pinocchio's reading of the file."""
    robot = hp.load_robot(name, base="free")
    states = np.random.default_rng(0).uniform(-2, 2, (3, 2, robot.dof))
    report = hp.cross_validate(robot, *states)
    assert report.ok, str(report)


@pytest.mark.proof
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", [*KINDS, "talos_reduced"])
def test_compiled(name, mode):
    check(name, mode, backend="compiled")


@pytest.mark.proof
def test_none_is_left_out():
    assert len(set(robot_names())) == 68
