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
