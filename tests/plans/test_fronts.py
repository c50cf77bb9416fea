"""What is given in place of a tree's values: read as far as the outputs need it, and said to be."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

import hingepair as hp
from hingepair.plans.constraints import CONSTRAINTS
from hingepair.plans.fronts import Front, needed_names
from hingepair.plans.pairs import PLANE, SPACE, PairRequest, Point
from support.near import U

MOTION = ("R1", "v1", "omega1", "a1", "alpha1")
HINGE = ("psi", "psid", "psidd")
LOADS = ("force1", "torque1", "hinge_torque")
FORMS = {
    "seven coordinates": (("q", "qd", "qdd"), False),
    "matrix": (("S1", *MOTION, *HINGE), False),
    "quaternion": (("quat_xyzw", *MOTION, *HINGE), False),
    "loads": (("q", "qd", *LOADS), False),
    "two motions": (("S1", *MOTION, "R2", "S2", "v2", "omega2", "a2", "alpha2"), False),
    "four coordinates": (("q", "qd", "qdd"), True),
}
FORCES = ("force1", "hinge_torque", "hinge_force", "bearing_torque", "kinetic", "potential", "linear", "angular")
POINTS = (Point("eye", 1), Point("tip", 2))


class Recorded(Front):
    """Values that note which of them are read."""

    def __init__(self, given):
        super().__init__(given)
        self.read = set()

    def __getitem__(self, name):
        value = self.given[name]  # a KeyError is no value that was read
        self.read.add(name)
        return value


def outputs_of(form):
    given, planar = FORMS[form]
    if "S2" in given:
        return list(CONSTRAINTS)
    kinematic = [name for name in (PLANE if planar else SPACE).levels if name not in given]
    solved = ["psidd"] if "hinge_torque" in given else []
    forces = [name for name in FORCES if name not in given and not planar]
    return [*kinematic, *forces, *solved, "tip", "eye_v", "tip_a"]


@pytest.mark.parametrize(
    ("form", "by_geometry"), [*((form, False) for form in FORMS), ("seven coordinates", True), ("two motions", True)]
)
def test_a_program_reads_the_inputs_that_it_is_said_to_need(form, by_geometry):
    """Else a value that no output needs would have to be given, or one that is needed would be missing."""
    given, planar = FORMS[form]
    for name in outputs_of(form):
        request = PairRequest((name,), given, planar, "ZYX", POINTS, by_geometry=by_geometry)
        inputs = request.inputs()
        rng = np.random.default_rng(1)
        numbers = {one: rng.uniform(0.5, 1, tail).ravel() for one, tail in inputs.items()}
        values = Recorded({one: tuple(row) if inputs[one] else row[0] for one, row in numbers.items()})
        request.compute(values)  # a KeyError for what it is not said to need
        own = {one for one in inputs if one in {*given, *SPACE.shapes, *PLANE.shapes}}
        # What a front makes together, such as v and omega of a body, may be read for one of them alone.
        assert values.read >= own & {*given} or name in {"omega2", "alpha2"}, (name, own - values.read)


def test_what_is_not_asked_for_is_never_made():
    class Careful(Front):
        needs: ClassVar = {"S1": ("phi",), "omega1": ("phi", "phid")}
        S1 = property(lambda self: self.given["phi"])

        @property
        def omega1(self):
            raise AssertionError("nobody asked")

    front = Careful({"phi": 1.0, "R1": 2.0})
    assert (front["S1"], front["R1"]) == (1.0, 2.0)
    assert needed_names((Careful,), ("S1", "R1")) == {"phi", "R1"}
    assert needed_names((Careful,), ("omega1",)) == {"phi", "phid"}


@pytest.mark.parametrize("sequence", ["XYZ", "zxz"])
def test_all_fronts_lead_to_the_same_body_2(sequence):
    rng = np.random.default_rng(2)
    u1, u2, n = rng.normal(size=(3, 3))
    pair = hp.HingePair(u1=u1, u2=u2, n=n, home=hp.rotation_exp(rng.normal(size=3)))
    q, qd = rng.uniform(-2, 2, (2, 9, 7))
    state = pair.forward_kinematics(q, qd, outputs=("R2", "S2", "v2", "omega2", "S1", "omega1"), sequence=sequence)
    given = hp.BodyMotion(R=q[:, :3], S=state.S1, v=qd[:, :3], omega=state.omega1)
    again = pair.forward_kinematics_from_body1(given, q[:, 6], qd[:, 6])
    for name in ("R2", "S2", "v2", "omega2"):
        size = np.abs(state[name]).max()
        np.testing.assert_allclose(again[name], state[name], rtol=0, atol=32 * U * size)


@pytest.mark.parametrize("order", ["quat_xyzw", "quat_wxyz"])
def test_quaternions_of_any_length_are_attitudes_of_prepared_calls(order):
    rng = np.random.default_rng(3)
    pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.2, 0.1, 0), n=(1, 2, 0))
    call = pair.prepare((order, "psi"), outputs=("S1", "S2"))
    for quat in rng.normal(size=(5, 4)) * 10.0 ** rng.uniform(-100, 100, (5, 1)):
        found = call(quat, 0.7)
        body1 = getattr(hp.BodyMotion, f"from_{order.replace('quat', 'quaternion')}")(R=np.zeros(3), **{order: quat})
        np.testing.assert_allclose(found.S1, body1.S, rtol=0, atol=12 * U)
        expected = pair.forward_kinematics_from_body1(body1, 0.7)
        np.testing.assert_allclose(found.S2, expected.S2, rtol=0, atol=24 * U)
