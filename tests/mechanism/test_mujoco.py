"""Two robots against MuJoCo, which reads their URDF by its own reader: places, mass matrix, forces, energy."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp

# ---- what the reader of MJCF makes of names and of what it cannot read

GEOM = '<geom type="box" size=".1 .1 .1" mass="{}"/>'
EMPTY = "<mujoco><worldbody>{}</worldbody>{}</mujoco>"


def link(name, axis, mass, inside="", joint="", more=""):
    named = f'name="{name}"' if name else ""
    joint = f'name="{joint}"' if joint else ""
    return f'<body {named} pos="1 0 0"><joint {joint} axis="{axis}" {more}/>{GEOM.format(mass)}{inside}</body>'


def test_what_has_no_name_takes_none_that_is_in_use():
    last = '<body name="body2" pos="1 0 0">' + GEOM.format(4) + "</body>"
    inner = link("", "0 1 0", 2, last)
    robot = hp.Mechanism.from_mjcf(EMPTY.format(link("a", "0 0 1", 1, inner, joint="joint1"), ""))
    assert robot.mass == 7
    assert len({*robot.names}) == robot.dof == 2
    assert set(robot.links) == {"world", "a", "body2", "body2_"}
    assert hp.Mechanism.from_mjcf("<mujoco/>").tips == ("world",)


def test_a_site_is_found_beside_a_body_and_a_joint_of_its_name():
    sites = '<site name="hand" pos="1 0 0"/><site name="j" pos="0 2 0"/>'
    robot = hp.Mechanism.from_mjcf(EMPTY.format(link("hand", "0 0 1", 1, sites, joint="j"), ""))
    found = robot.forward_kinematics([0.0], frames=("hand", "hand_", "j", "j_")).R
    np.testing.assert_array_equal(found - found[0], [(0, 0, 0), (1, 0, 0), (0, 0, 0), (0, 2, 0)])


def test_what_stands_beside_a_free_base_and_acts_at_it_is_told():
    free = '<joint type="free" damping="2" armature="0.1"/>' + GEOM.format(1)
    base = f'<body name="base">{free}{link("arm", "0 1 0", 1)}</body>'
    with pytest.warns(
        hp.DynamicsWarning, match=r"bodies that stand in the world \(table\), damping, armature of the free joint"
    ):
        robot = hp.Mechanism.from_mjcf(EMPTY.format(f'<body name="table">{GEOM.format(1)}</body>{base}', ""))
    assert robot.links == ("base", "arm")
