"""Whole robots against Pinocchio's own reading of their URDF, on a fixed and on a free base."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hingepair as hp
from hingepair.formats.robots import robot_names
from support.commands import run_command

KINDS = ("panda", "kinova", "solo12", "quadrotor_base")  # mimic sliders, continuous joints, a quadruped, one body

pytestmark = pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning")


def check(name):
    """All links and outputs; random states, angles to 1e15 and down to 1e-160, rates to 1e3."""
    report = json.loads(run_command("check", name, "--json").stdout)
    assert report["ok"], report
    robot = hp.load_robot(name, base="free")
    report = hp.cross_validate(robot, *np.random.default_rng(0).uniform(-2, 2, (3, 2, robot.dof)))
    assert report.ok, str(report)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_one_robot_of_each_kind(name):
    check(name)


@pytest.mark.proof
@pytest.mark.parametrize("name", robot_names())
def test_every_robot(name):
    check(name)


@pytest.mark.proof
def test_none_is_left_out():
    assert len(set(robot_names())) == 68
