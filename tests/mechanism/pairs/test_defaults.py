"""Arguments by name, and those that are not given."""

from __future__ import annotations

import numpy as np

import hingepair as hp


def test_coordinates_may_be_given_by_name():
    pair = hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1))
    names = dict.fromkeys(("x", "y", "z", "phi_x", "phi_y", "phi_z"), 0.0)
    psi = np.linspace(0, 1, 3)
    found = pair.forward_kinematics({**names, "psi": psi})
    np.testing.assert_array_equal(found.R2, pair.forward_kinematics((0, 0, 0, 0, 0, 0, psi)).R2)


def test_none_is_a_body_at_rest_at_the_origin():
    door = hp.HingePair((0.1, 0, 1), (-0.45, 0.2, 0), (0, 0.6, 0.8), body2=hp.Body(mass=20, inertia=(1, 2, 2)))
    rest, hinge = hp.BodyMotion.at_rest(), (0.3, 0.1, 0.2)
    state, same = (door.forward_kinematics_from_body1(body1, *hinge) for body1 in (None, rest))
    assert all(np.array_equal(state[name], same[name]) for name in same.outputs)
    assert np.array_equal(door.hinge_wrench(None, *hinge).force, door.hinge_wrench(rest, *hinge).force)
    swings = [hp.simulate(door, [0, 0.1], body1, 0.3, 0.0, base="fixed").psi.tolist() for body1 in (None, rest)]
    assert swings[0] == swings[1]
    assert swings[0][1] != swings[0][0]
