"""`hingepair robots`: the robots, and the joints of one."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.mechanism import tree_of
from support.commands import run_command


def robots(*arguments: object) -> str:
    return run_command("robots", *arguments).stdout


def joints_of(name: object) -> dict[str, dict[str, object]]:
    return {row["joint"]: row for row in json.loads(robots(name, "--json"))["joints"]}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "talos_full_v2", "romeo", "kinova"])
def test_the_joints_of_a_robot_are_those_of_its_mechanism(name: str) -> None:
    robot, rows = hp.load_robot(name), joints_of(name)
    leading = [row for row in rows.values() if row["index"] is not None]
    assert tuple(row["joint"] for row in leading) == robot.names
    assert [row["index"] for row in leading] == list(range(robot.dof))
    for row, limits, rate, effort in zip(
        leading, robot.position_limits, robot.rate_limits, robot.effort_limits, strict=True
    ):
        assert np.array_equal(limits, row["limits"] or (-np.inf, np.inf))
        assert rate == (np.inf if row["rate_limit"] is None else row["rate_limit"])
        assert effort == (np.inf if row["effort_limit"] is None else row["effort_limit"])
    for joint, row in rows.items():
        pair = robot[joint]
        assert row["kind"] == ("slider" if isinstance(pair, hp.Slider) else "hinge")
        assert (row["mimic"] is None) == (row["index"] is not None)
    report = json.loads(robots(name, "--json"))
    assert report["dof"] == robot.dof
    assert report["notes"] == list(tree_of(robot).notes)
