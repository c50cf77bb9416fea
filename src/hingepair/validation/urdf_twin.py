"""The model that Pinocchio makes of the URDF from which a robot was read.

Nothing of the robot's own description goes into the model: Pinocchio reads the text, and the rules of mimic joints
are read here.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.numeric.arrays import Float64Array
from hingepair.pair.accuracy import unit_roundoff
from hingepair.validation.pinocchio_twin import Twin, import_pinocchio, joins_wrongly
from hingepair.validation.report import Comparison

_U = unit_roundoff(np.float64)  # in which differences are counted


class _Rule(NamedTuple):
    """The rule of a joint that follows another: q = ratio * (q of the leader) + offset."""

    leader: str
    ratio: float
    offset: float


def urdf_twin(robot: Mechanism) -> tuple[Twin | None, str]:
    """Return (twin, sentence) for a robot: a Twin with a free-flyer whose model is Pinocchio's reading of the
    URDF, or None where there is no such text, and what the robot is compared with. The mass of a fixed base, which
    has no effect, is left out.
    """
    own = "a model built from the robot as hingepair holds it"
    source = tree_of(robot).source
    if source is None:
        return None, f"{own}, since it was not read from a URDF, or was changed afterwards"
    if light := [joint.name for joint in tree_of(robot).joints if joins_wrongly(joint.body.mass)]:
        return None, f"{own}, since Pinocchio misplaces the centre of mass of the body of {light[0]!r}"
    if source.snap:
        return None, f"{own}, since snap={source.snap:g} changed angles of the URDF"
    pin = import_pinocchio("cross_validate")
    root = ET.fromstring(source.text)
    flyers = [] if any(joint.get("type") == "floating" for joint in root.findall("joint")) else ["free-flyer"]
    try:
        model = pin.buildModelFromXML(
            ET.tostring(root, encoding="unicode"), *(pin.JointModelFreeFlyer() for _ in flyers)
        )
    except ValueError:
        return None, f"{own}, since Pinocchio cannot read its URDF"
    model.jointPlacements[1] = pin.SE3.Identity()  # of a floating root joint
    rules = _mimic_rules(root, {*model.names})
    model = _reduced(pin, model, rules, source.locked)
    if robot.base != "free":
        model.inertias[1] = pin.Inertia.Zero()
    _add_frames(pin, model, robot)
    names = list(model.names)[2:]
    columns = [name for name in names if name not in rules or rules[name].leader not in names]
    ratios, offsets = np.zeros((len(names), len(columns))), np.zeros(len(names))
    for row, name in enumerate(names):
        rule = _Rule(name, 1.0, 0.0) if name in columns else rules[name]
        ratios[row, columns.index(rule.leader)] = rule.ratio
        offsets[row] = rule.offset
    return Twin(model, model.createData(), True, ratios, offsets), "Pinocchio's reading of the URDF"


def _mimic_rules(root: ET.Element, names: set[str]) -> dict[str, _Rule]:
    """Return the rules of the joints that follow others, by name, each with its last leader."""
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
        rules[name] = _Rule(leader, ratio, offset)
    return rules


def _reduced(pin: Any, model: Any, rules: Mapping[str, _Rule], locked: Mapping[str, float]) -> Any:
    """Return the model with the locked joints, and those that follow them, held in place by Pinocchio."""
    held = dict(locked)
    for name, rule in rules.items():
        if name not in held and rule.leader in locked:
            held[name] = rule.ratio * locked[rule.leader] + rule.offset
    numbers = {name: number for number, name in enumerate(model.names) if name in held}
    if not numbers:
        return model
    q = pin.neutral(model)
    for name, number in numbers.items():
        joint, position = model.joints[number], held[name]
        q[joint.idx_q : joint.idx_q + joint.nq] = configuration_of(joint.nq, position)
    return pin.buildReducedModel(model, list(numbers.values()), q)


def configuration_of(nq: int, position: float) -> tuple[float, ...]:
    """Return the coordinates of a joint in Pinocchio's q: cosine and sine for a continuous joint."""
    return (position,) if nq == 1 else (math.cos(position), math.sin(position))


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


def compare_descriptions(robot: Mechanism, twin: Twin) -> tuple[Comparison, ...]:
    """Compare the joints, placements and masses of a robot with those of its URDF twin; return a row for each. Where
    the joints have other names, there is only a row for these, and nothing else can be compared.
    """
    joints, model = tree_of(robot).joints, twin.model
    names = [joint.name for joint in joints]
    theirs = list(model.names)[2:]
    wrong = [ours != other for ours, other in zip(names, theirs, strict=False)] + [True] * abs(
        len(names) - len(theirs)
    )
    rows = [_row("names", [*names, *theirs[len(names) :]], wrong, np.where(wrong, np.inf, 0.0))]
    if any(wrong):
        return tuple(rows)
    place, sizes = [], []
    for number, joint in enumerate(joints, 2):
        there, length = model.jointPlacements[number], 1 + float(np.abs(joint.u).max())
        linear, angular = np.split(np.ravel(model.joints[number].createData().S), 2)
        axis, other = (angular, linear) if joint.axis.turns else (linear, angular)
        turned = max(_largest(joint.S - there.rotation), _largest(joint.n - axis), _largest(other))
        is_there = joint.parent == model.parents[number] - 1
        place.append(max(turned, _largest(joint.u - there.translation) / length) if is_there else np.inf)
        sizes.append(length)
    rows.append(_row("placements", names, np.multiply(place, sizes), np.divide(place, _U)))
    bodies = [tree_of(robot).base if robot.base == "free" else None, *(joint.body for joint in joints)]
    errors, ratios = [], []
    for number, body in enumerate(bodies, 1):
        there = model.inertias[number]
        if body is None:
            errors.append(0.0)
            ratios.append(0.0)
            continue
        size = 4 * (1 + float(np.linalg.norm(there.lever)))
        moment = (abs(there.mass) + float(np.abs(there.inertia).max())) * size**2 / 4
        parts = (
            (abs(body.mass - there.mass), abs(there.mass)),
            (_largest(body.centre_of_mass - there.lever) if body.mass else 0.0, size),
            (_largest(body.inertia - there.inertia), moment),
        )
        errors.append(max(error for error, _ in parts))
        ratios.append(max(error / (_U * scale) if error else 0.0 for error, scale in parts))
    rows.append(_row("inertias", ["base", *names], errors, ratios))
    return tuple(rows)


def _largest(values: Float64Array) -> float:
    return float(np.abs(values).max())


def _row(output: str, parts: Sequence[str], errors: Any, ratios: Any) -> Comparison:
    """Return the row of one part of the description; errors and ratios by part, which hold at all samples."""
    if not parts:
        return Comparison(output, 0.0, 0.0, (), 1)
    error, ratio = (np.asarray(values, dtype=np.float64)[None] for values in (errors, ratios))
    return Comparison.worst_of(output, error, ratio, (), parts)
