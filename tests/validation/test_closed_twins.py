"""Closed mechanisms and struts against Pinocchio: what is right passes, and what is off is seen."""

import itertools
import sys
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.robots.methods import MechanismMethods
from support.linkages import KINDS, four_bar
from support.sparse import sparse

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import multibody as mb

GRAVITY = (0, -9.81, 0)
BODY = hp.Body(2, (0.4, 0.1, 0), (0.1, 0.2, 0.3))


def with_spring(robot):
    return robot.with_strut("a", "base", "spring", stiffness=70, free_length=0.2, damping=3)


def states(count, dof, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (3, count, dof))


@pytest.mark.parametrize(("kind", "base"), sparse(zip(KINDS, itertools.cycle(("fixed", "free")), strict=False), 4))
def test_every_kind_of_loop_agrees_with_pinocchio(kind, base):
    report = hp.cross_validate(with_spring(four_bar(kind, base)), *states(6, 1), gravity=GRAVITY)
    assert report.ok, str(report)
    assert {"gap", "gap_rate", "gap_acceleration", "tau", "forward_dynamics"} <= {row.output for row in report.rows}


@pytest.mark.slow(4)
def test_cylinders_and_overconstrained_loops_agree_with_pinocchio():
    boom = hp.HingePair((0, 0, 1), (0, 0, 0), (0, 1, 0), name="boom", body2=BODY)
    crane = (
        hp.Mechanism([boom]).with_frame("foot", "base", R=(0.4, 0, 0.3)).with_frame("eye", "boom", R=(1.8, 0, 0.4))
    )
    crane = crane.with_strut("foot", "eye", "cylinder").closed(coordinates="cylinder", at={"boom": -0.4})
    _, qd, qdd = states(5, 1)
    assert hp.cross_validate(crane, np.linspace(1.9, 2.1, 5)[:, None], qd, qdd).ok
    bricard = mb.bricard(np.zeros(2)).mechanism
    report = hp.cross_validate(bricard, *states(5, 1) * 0.2)
    assert report.ok, str(report)


def off_tau(forces):
    changed = {name: getattr(forces, name) for name in forces.outputs}
    changed["tau"] = changed["tau"] + 1e-11
    return type(forces)(changed, np.shape(forces.tau)[:-1])


OTHER = np.array([0, 1, 0])  # a joint that follows
OFF = {
    "gap": ("all_coordinates", lambda q, qd, qdd: (q + OTHER * 1e-13, qd, qdd)),
    "gap_rate": ("all_coordinates", lambda q, qd, qdd: (q, qd + OTHER * 1e-13, qdd)),
    "gap_acceleration": ("all_coordinates", lambda q, qd, qdd: (q, qd, qdd + OTHER * 1e-12)),
    "tau": ("inverse_dynamics", off_tau),
    "mass_matrix": ("mass_matrix", lambda M: M * (1 + 1e-11)),
    "gap, struts": (
        "struts",
        lambda found: {"spring": found["spring"]._replace(length=found["spring"].length + 1e-13)},
    ),
}


@pytest.mark.parametrize("output", OFF)
def test_what_is_off_is_seen(output, monkeypatch):
    robot = with_spring(four_bar())
    name, change = OFF[output]
    method = getattr(MechanismMethods, name)

    def changed(self, *given, **options):
        found = method(self, *given, **options)
        if name == "all_coordinates" and len(given) < 3:
            return found
        return change(*found) if name == "all_coordinates" else change(found)

    monkeypatch.setattr(MechanismMethods, name, changed)
    report = hp.cross_validate(robot, *states(6, 1), gravity=GRAVITY)
    assert output.partition(",")[0] in {row.output for row in report.rows if not row.ok}


def test_samples_that_cannot_be_closed_are_left_out():
    robot = with_spring(four_bar())
    q, qd, qdd = states(3, 1)
    q[1] = np.nan
    report = hp.cross_validate(robot, q, qd, qdd)
    assert report.ok
    assert report.skipped == 1
