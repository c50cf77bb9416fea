"""Bodies that nothing draws: rods from joint to joint, drums of hinges, prisms of sliders."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.formats.simple_bodies import robot_size, simple_bodies
from hingepair.mechanism.mechanism import tree_of
from hingepair.pictures.page_model import robot_model
from support.near import U

BASE = hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 0, 1), name="base joint")
ELBOW = hp.HingePair(u1=(2, 0, 0), u2=(-0.5, 0, 0), n=(0, 1, 0), name="elbow")
RAM = hp.Slider(u1=(0.5, 0, 0), u2=(0, 0, 0), n=(1, 0, 0), name="ram", limits=(0, 0.5))


def rods_of(body):
    """The ends of the rods of a body, as (begin, end)."""
    rods = [shape for shape in body.links if isinstance(shape, hp.Cylinder)]
    return [(rod.center - rod.length / 2 * rod.axis, rod.center + rod.length / 2 * rod.axis) for rod in rods]


def simple(*pairs):
    tree = tree_of(hp.Mechanism(pairs))
    return simple_bodies(tree, robot_size(tree))


def test_rods_reach_from_joint_to_joint():
    """A body of the tree has its origin at its joint: the elbow's is 0.5 m from body 2's reference point."""
    base, first, second, last = simple(BASE, ELBOW, RAM)
    for body, end in ((base, (0, 0, 1)), (first, (2, 0, 0)), (second, (1, 0, 0))):
        ((begin, far),) = rods_of(body)
        np.testing.assert_allclose(begin, np.zeros(3), atol=8 * U)
        np.testing.assert_allclose(far, end, atol=8 * U)
    assert rods_of(last) == []


# ---------------------------------------------------------------- shapes that a robot comes with

LINK = """<link name="{name}">{shapes}</link>"""
BOX = '<{tag}><origin xyz="0 0 1"/><geometry><box size="1 2 3"/></geometry></{tag}>'
MESH = '<{tag}><geometry><mesh filename="a.stl"/></geometry></{tag}>'
BROKEN = '<{tag}><geometry><sphere radius="big"/></geometry></{tag}>'
CASES = {
    "visual": (BOX.format(tag="visual"), [(1, 2, 3)], True),
    "collision for a mesh": (MESH.format(tag="visual") + BOX.format(tag="collision"), [(1, 2, 3)], True),
    "visual-before-collision": (
        BOX.format(tag="visual") + BOX.format(tag="collision").replace("1 2 3", "4 5 6"),
        [(1, 2, 3)],
        True,
    ),
    "mesh": (MESH.format(tag="visual") + MESH.format(tag="collision"), [], False),
    "mesh and box": (MESH.format(tag="visual") + BOX.format(tag="visual"), [], False),
    "nothing": ("", [], False),
    "no number": (BROKEN.format(tag="visual"), [], False),
    "far away": (BOX.format(tag="visual").replace("0 0 1", "0 0 1e308"), [(1, 2, 3)], True),
    "no size": (BOX.format(tag="visual").replace("1 2 3", "1 0 3"), [], False),
}


def robot_of(shapes, extra=""):
    arm = LINK.format(name="arm", shapes=shapes)
    joint = (
        '<joint name="turn" type="continuous"><parent link="root"/><child link="arm"/><origin xyz="1 0 0"/></joint>'
    )
    return hp.Mechanism.from_urdf(f'<robot name="r"><link name="root"/>{arm}{joint}{extra}</robot>')


@pytest.mark.parametrize(("shapes", "sizes", "complete"), CASES.values(), ids=CASES)
def test_a_link_is_drawn_by_its_shapes_or_by_a_simple_body(shapes, sizes, complete):
    drawing = tree_of(robot_of(shapes)).drawings[1]
    assert [tuple(box.size.tolist()) for box in drawing.shapes or ()] == sizes
    assert bool(drawing.shapes) == complete
    kinds = [type(shape) for _, shape in robot_model(robot_of(shapes), "r").bodies[1].shapes]
    assert (kinds if complete else kinds[-2:]) == ([hp.Box] if complete else [hp.Sphere, hp.Cylinder])


def test_shapes_of_folded_links_stand_where_these_are():
    origin = '<origin xyz="0 5 0" rpy="3.141592653589793 0 0"/>'
    fixed = f'<joint name="fix" type="fixed"><parent link="arm"/><child link="hand"/>{origin}</joint>'
    box, mesh = BOX.format(tag="visual"), MESH.format(tag="visual")
    arm, other = tree_of(robot_of(box, LINK.format(name="hand", shapes=box) + fixed)).drawings[1].shapes
    np.testing.assert_array_equal((arm.center, other.center), [(0, 0, 1), (0, 5, -1)])
    drawing = tree_of(robot_of(box, LINK.format(name="hand", shapes=mesh) + fixed)).drawings[1]
    assert drawing.shapes is None


def test_shapes_of_pairs_and_payloads_are_drawn():
    ball = hp.Body(mass=1, shapes=[hp.Sphere(0.1, (0, 0, 0.2))])
    arm = hp.HingePair(u1=(0, 0, 1), u2=(-1, 0, 0), n=(0, 1, 0), name="arm", body2=ball)
    robot = hp.Mechanism([arm])
    (sphere,), *_ = tree_of(robot).drawings[1]
    np.testing.assert_array_equal(sphere.center, (1, 0, 0.2))  # from the joint
    loaded = robot_of(MESH.format(tag="visual")).with_payload("arm", ball)
    assert not tree_of(loaded).drawings[1].shapes
    first, *others = (shape for _, shape in robot_model(loaded, "r").bodies[1].shapes)
    assert (first.radius, first.center.tolist()) == (0.1, [0, 0, 0.2])
    assert len(others) > 1
