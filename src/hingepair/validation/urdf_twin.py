"""The model that Pinocchio makes of the URDF from which a robot was read.

Nothing of the robot's own description goes into the model: Pinocchio reads the text, and the rules of mimic joints
are read here. Joints that the robot holds keep their coordinate there, at a constant position.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.validation.pinocchio_twin import Twin, data_of, import_pinocchio, robot_twin


def urdf_twin(robot: Mechanism) -> tuple[Twin, str, tuple[str, ...]]:
    """Return a Twin with a free-flyer, what its model is, as a phrase, and names of joints that only one of the two
    has. The model is Pinocchio's reading of the URDF; where there is no such text, it is made of the robot. The mass
    of a fixed base, and of what is held on it, has no effect and is left out.
    """
    source, own = tree_of(robot).source, "a model built from the robot as hingepair holds it"
    if source is None:
        why = "it was not read from a URDF, or was changed afterwards"
        return robot_twin(robot, has_free_flyer=True), f"{own}, since {why}", ()
    if source.snap:
        why = f"snap={source.snap:g} changed angles of the URDF"
        return robot_twin(robot, has_free_flyer=True), f"{own}, since {why}", ()
    pin, root = import_pinocchio("cross_validate"), ET.fromstring(source.text)
    floating = any(joint.get("type") == "floating" for joint in root.findall("joint"))
    flyer = () if floating else (pin.JointModelFreeFlyer(),)
    try:
        model = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"), *flyer)
    except ValueError:
        return robot_twin(robot, has_free_flyer=True), f"{own}, since Pinocchio cannot read its URDF", ()
    model.jointPlacements[1] = pin.SE3.Identity()  # of a floating root joint
    _add_frames(pin, model, robot)
    names = list(model.names)[2:]
    rules, columns = _mimic_rules(root, {*model.names}), list(robot.names)
    ratios, offsets, unknown = np.zeros((len(names), robot.dof)), np.zeros(len(names)), {*columns}
    for row, name in enumerate(names):
        leader, ratio, offset = rules.get(name, (name, 1.0, 0.0))
        if name in source.locked:
            ratio, offset = 0.0, source.locked[name]
        elif leader in source.locked:
            ratio, offset = 0.0, ratio * source.locked[leader] + offset
        offsets[row] = offset
        if ratio and leader not in columns:
            unknown.add(leader)
        elif ratio:
            ratios[row, columns.index(leader)] = ratio
            unknown.discard(leader)
    if robot.base != "free":
        moving = {2 + int(row) for row in np.flatnonzero(ratios.any(axis=1))}
        for number in range(1, model.njoints):
            if moving.isdisjoint(model.supports[number]):
                model.inertias[number] = pin.Inertia.Zero()
    return Twin(model, data_of(model), True, ratios, offsets), "Pinocchio's reading of the URDF", (*unknown,)


def _mimic_rules(root: ET.Element, names: set[str]) -> dict[str, tuple[str, float, float]]:
    """Return (leader, ratio, offset) of the joints that follow others, by name, each with its last leader."""
    mimics = {}
    for joint in root.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and mimic.get("joint") in names:
            mimics[joint.get("name", "")] = mimic
    rules = {}
    for name in mimics:
        leader, ratio, offset = name, 1.0, 0.0
        while leader in mimics:
            mimic = mimics[leader]
            offset += ratio * float(mimic.get("offset", 0))
            ratio *= float(mimic.get("multiplier", 1))
            leader = mimic.get("joint", "")
        rules[name] = leader, ratio, offset
    return rules


def _add_frames(pin: Any, model: Any, robot: Mechanism) -> None:
    """Add the frames that were added to the robot after it was read to the model, in place."""
    known = {frame.name for frame in model.frames}
    inertias = [inertia.copy() for inertia in model.inertias]
    for name, frame in tree_of(robot).frames.items():
        if name not in known:
            placement = pin.SE3(np.array(frame.S), np.array(frame.R))
            model.addFrame(pin.Frame(name, 1 + frame.body, placement, pin.FrameType.OP_FRAME))
    for number, inertia in enumerate(inertias):  # addFrame rounds the masses
        model.inertias[number] = inertia
