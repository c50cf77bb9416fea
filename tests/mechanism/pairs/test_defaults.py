"""What constructors take where nothing is given; coordinates by name."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp

EYE, TWO, THREE = np.eye(3), np.zeros((2, 3)), np.zeros((3, 3))
LIGHT, BALL = hp.Body(mass=1, inertia=EYE), hp.Sphere(1)

ACCEPTED = {
    hp.HingePair: {
        "u1": (1, 0, 0), "u2": (0, 0, 0), "n": (0, 0, 1), "home": EYE, "name": "door", "limits": (-1, 1),
        "body1": LIGHT, "body2": None, "torque_limit": 0.0, "rate_limit": 2,
    },
    hp.PlanarPair: {"u1": (1, 0), "u2": (0, 0), "name": "link", "body1": None, "body2": LIGHT},
    hp.Body: {"mass": 2.0, "centre_of_mass": (0, 0, 1), "inertia": EYE, "shapes": [BALL, hp.Box((1, 1, 1))]},
    hp.Box: {"size": (1, 2, 3), "center": (0, 0, 1), "axes": EYE},
    hp.Cylinder: {"radius": 1, "length": 2, "center": (0, 0, 1), "axis": (0, 0, 3)},
    hp.Sphere: {"radius": 1, "center": (0, 0, 1)},
    hp.BodyMotion: {"R": (0, 0, 1), "S": EYE, "v": TWO, "omega": TWO, "a": TWO, "alpha": TWO},
    hp.BodyMotion.from_quaternion_xyzw: {"R": (0, 0, 1), "quat_xyzw": (0, 0, 0, 2), "v": TWO},
    hp.BodyMotion.from_quaternion_wxyz: {"R": (0, 0, 1), "quat_wxyz": (0, 0, 0, 2), "v": TWO},
    hp.BodyMotion.from_rotvec: {"R": (0, 0, 1), "rotvec": (0, 0, 2), "v": TWO},
}  # fmt: skip
"""Arguments that each takes."""


DEFAULTS = {
    hp.HingePair: {"home": EYE, "name": "hinge_pair", "limits": None, "torque_limit": None, "rate_limit": None},
    hp.PlanarPair: {"name": "planar_pair", "body1": None, "body2": None},
    hp.Body: {"mass": 1.0, "centre_of_mass": (0, 0, 0), "inertia": 0.01 * EYE, "shapes": ()},
    hp.Box: {"center": (0, 0, 0), "axes": EYE},
    hp.Cylinder: {"center": (0, 0, 0), "axis": (0, 0, 1)},
    hp.Sphere: {"center": (0, 0, 0)},
    hp.BodyMotion: dict.fromkeys(("v", "omega", "a", "alpha")),
}
"""What arguments are that are not given."""


@pytest.mark.parametrize("make", DEFAULTS, ids=lambda make: make.__qualname__)
def test_what_is_not_given_is_what_the_documentation_says(make):
    made = make(**{key: value for key, value in ACCEPTED[make].items() if key not in DEFAULTS[make]})
    for name, value in DEFAULTS[make].items():
        if isinstance(value, str) or value is None:
            assert getattr(made, name) == value
        else:
            np.testing.assert_array_equal(getattr(made, name), value)


def test_coordinates_by_name_are_complete():
    pair = hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1))
    names = dict.fromkeys(("x", "y", "z", "phi_x", "phi_y", "phi_z"), 0.0)
    psi = np.linspace(0, 1, 3)
    found = pair.forward_kinematics({**names, "psi": psi})
    np.testing.assert_array_equal(found.R2, pair.forward_kinematics((0, 0, 0, 0, 0, 0, psi)).R2)
    with pytest.raises(hp.ArgumentError, match=r"q\['psi'\]: expected a number or an array"):
        pair.forward_kinematics(names)
    with pytest.raises(hp.ArgumentError, match=r"qd: expected one of x, y, phi, psi"):
        hp.PlanarPair((1, 0), (0, 1)).forward_kinematics((0, 0, 0, 0), {"theta": 1})


def test_none_is_a_body_at_rest_at_the_origin():
    door = hp.HingePair((0.1, 0, 1), (-0.45, 0.2, 0), (0, 0.6, 0.8), body2=hp.Body(mass=20, inertia=(1, 2, 2)))
    rest, hinge = hp.BodyMotion.at_rest(), (0.3, 0.1, 0.2)
    state, same = (door.forward_kinematics_from_body1(body1, *hinge) for body1 in (None, rest))
    assert all(np.array_equal(state[name], same[name]) for name in same.outputs)
    assert np.array_equal(door.hinge_wrench(None, *hinge).force, door.hinge_wrench(rest, *hinge).force)
    swings = [hp.simulate(door, [0, 0.1], body1, 0.3, 0.0, base="fixed").psi.tolist() for body1 in (None, rest)]
    assert swings[0] == swings[1]
    assert swings[0][1] != swings[0][0]
