"""Two robots against MuJoCo, which reads their URDF by its own reader: places, mass matrix, forces, energy."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

import hingepair as hp
from hingepair.formats.robots import robot_urdf
from hingepair.mechanism.mechanism import tree_of
from hingepair.validation.pinocchio_twin import BASE_AT_REST
from hingepair.validation.robot_scales import RobotScales
from support import states
from support.robot_proof import ratio

BOUND = 16.0
"""Largest difference in units of u * scale: MuJoCo turns by quaternions, and makes principal axes of the inertias."""
GRAVITY = (0, 0, -9.81)
COMPILER = {"fusestatic": "false", "balanceinertia": "false", "boundmass": "0", "boundinertia": "0"}


def model_of(name):
    """MuJoCo's model of the URDF without what is drawn; nothing but gravity acts there, and nothing stops a joint."""
    import mujoco

    root = ET.parse(robot_urdf(name)).getroot()
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    for joint in root.findall("joint"):
        for dynamics in joint.findall("dynamics"):
            joint.remove(dynamics)
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", COMPILER)
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    return mujoco, model, mujoco.MjData(model)


def by_mujoco(name, robot, links, q, qd, qdd):
    """What MuJoCo says of a robot's links and joints, these in our order; shape (N, ...)."""
    mujoco, model, data = model_of(name)
    order = [model.joint(joint).qposadr[0] for joint in robot.names]
    assert sorted(order) == list(range(robot.dof))
    rows = []
    for coordinates in zip(q, qd, qdd, strict=True):
        data.qpos[order], data.qvel[order], data.qacc[order] = coordinates
        mujoco.mj_inverse(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        full = np.zeros((model.nv, model.nv))
        for column, unit in zip(full, np.eye(model.nv), strict=True):
            mujoco.mj_mulM(model, data, column, unit)
        bodies = [model.body(link).id for link in links]
        row = {"R": data.xpos[bodies], "S": data.xmat[bodies].reshape(-1, 3, 3), "M": full[np.ix_(order, order)]}
        rows.append(row | {"tau": data.qfrc_inverse[order], "potential": data.energy[0], "kinetic": data.energy[1]})
    return {output: np.stack([row[output] for row in rows]) for output in rows[0]}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5_robot", "a1"])
def test_mujoco_moves_the_robot_as_we_do(name):
    robot, rng = hp.load_robot(name), states.generator(900)
    q, qd, qdd = rng.uniform(-3, 3, (3, 5, robot.dof))
    links = [link for link in robot.links if tree_of(robot).links[link].body]
    expected = by_mujoco(name, robot, links, q, qd, qdd)
    state, energy = robot.forward_kinematics(q, frames=links), robot.energy(q, qd)
    got = {"R": state.R, "S": state.S, "M": robot.mass_matrix(q), "tau": robot.inverse_dynamics(q, qd, qdd).tau}
    got |= {"kinetic": energy.kinetic, "potential": energy.potential}
    scales = RobotScales(tree_of(robot), [q, qd, qdd], BASE_AT_REST, np.array(GRAVITY))
    motions = [scales.motion(tree_of(robot).links[link]) for link in links]
    sizes = {"R": np.stack([one["R"] for one in motions], axis=1)[..., None]}
    sizes["S"] = np.stack([one["S"] for one in motions], axis=1)[..., None, None]
    sizes |= {"M": scales.mass_matrix()[:, 6:, 6:], "tau": scales.forces()[1][:, 1:]}
    sizes |= {output: scales.energy_and_momentum()[output] for output in ("kinetic", "potential")}
    for energies in (got, expected):  # there, the mass of the base counts too; it stands still
        energies["potential"] = energies["potential"] - energies["potential"][0]
    ratios = {output: ratio(got[output], expected[output], sizes[output]) for output in got}
    assert max(ratios.values()) <= BOUND, ratios
    print(name, ratios)


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


def test_a_site_is_found_beside_a_body_and_a_joint_of_its_name():
    sites = '<site name="hand" pos="1 0 0"/><site name="j" pos="0 2 0"/>'
    robot = hp.Mechanism.from_mjcf(EMPTY.format(link("hand", "0 0 1", 1, sites, joint="j"), ""))
    found = robot.forward_kinematics([0.0], frames=("hand", "hand_", "j", "j_")).R
    np.testing.assert_array_equal(found - found[0], [(0, 0, 0), (1, 0, 0), (0, 0, 0), (0, 2, 0)])


def test_two_equalities_of_one_joint_leave_one_coordinate():
    bodies = "".join(
        link(name, "0 1 0", 1, joint=f"j{name}", more=f'ref="{ref}"')
        for name, ref in zip("abc", (0, 20, 0), strict=True)
    )
    rules = "".join(
        f'<joint joint1="ja" joint2="j{x}" polycoef="{c} {k} 0 0 0"/>' for x, c, k in (("b", 0.1, 2), ("c", 0, 3))
    )
    robot = hp.Mechanism.from_mjcf(EMPTY.format(bodies, f"<equality>{rules}</equality>"))
    assert robot.names == ("jb",)
    jb, ref = 0.7, np.radians(20)
    ja = 0.1 + 2 * (jb - ref)
    turned = robot.forward_kinematics([jb], frames=("ja", "jb", "jc")).S
    expected = [hp.rotation_exp((0, angle, 0)) for angle in (ja, jb - ref, ja / 3)]
    np.testing.assert_allclose(
        turned @ np.swapaxes(turned, -1, -2)[[1]], expected @ np.swapaxes(expected, -1, -2)[[1]], atol=1e-14
    )


def test_what_stands_beside_a_free_base_and_acts_at_it_is_told():
    free = '<joint type="free" damping="2" armature="0.1"/>' + GEOM.format(1)
    base = f'<body name="base">{free}{link("arm", "0 1 0", 1)}</body>'
    with pytest.warns(
        hp.DynamicsWarning, match=r"bodies that stand in the world \(table\), damping, armature of the free joint"
    ):
        robot = hp.Mechanism.from_mjcf(EMPTY.format(f'<body name="table">{GEOM.format(1)}</body>{base}', ""))
    assert robot.links == ("base", "arm")
