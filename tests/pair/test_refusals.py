"""Every refusal of every constructor of pairs, bodies, shapes and motions: its error, argument and words."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hingepair as hp
from hingepair.errors import AxisError

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

SHAPE, KIND = (hp.ShapeError, "shape"), (hp.errors.DtypeError, "real numbers (float64, float32 or integers)")
FINITE, NUMBER = (hp.ArgumentError, "finite numbers"), (hp.ArgumentError, "a finite number")
LEADING = (hp.ShapeError, "leading shape that broadcasts with (2,)")
ROTATION = (hp.RotationError, "rotations to within 1e-09 (project_to_rotation gives the nearest)")
TEXT, A_BODY = (hp.ArgumentError, "a text that is not empty"), (hp.ArgumentError, "a Body")
SOLIDS = (hp.ArgumentError, "Box, Cylinder or Sphere")

NO_VECTOR = [
    ((1, 0), SHAPE), ((1, 0, math.nan), FINITE), ((-math.inf, 0, 1), FINITE), (("a", 0, 0), KIND), (None, KIND),
]  # fmt: skip
NO_PLANAR = [((1, 0, 0), SHAPE), ((0, math.nan), FINITE), ((1j, 0), KIND), (None, KIND)]
NO_ROTATION = [
    (np.eye(2), SHAPE), (np.diag([1, 1, -1]), ROTATION), (EYE + 1e-8, ROTATION), (np.full((3, 3), math.nan), FINITE),
    ("x", KIND),
]  # fmt: skip
NO_NAME = [(name, TEXT) for name in ("", " \n", 5, None, b"door", ("a",))]
NO_BODY = [(2.5, A_BODY), (BALL, A_BODY), ("door", A_BODY)]
NO_LIMIT = [
    (-1, (hp.ArgumentError, "a number not below 0")), (math.nan, NUMBER), (math.inf, NUMBER), ("1", NUMBER),
    (True, NUMBER), ((1, 2), NUMBER),
]  # fmt: skip
NO_SIZE = [
    (0, (hp.ArgumentError, "a number above 0")), (-1.0, (hp.ArgumentError, "a number above 0")), (math.nan, NUMBER),
    (math.inf, NUMBER), ("1", NUMBER), (True, NUMBER), ((1, 2), NUMBER),
]  # fmt: skip
NO_MOTION = [
    ((1, 0), (hp.ShapeError, "shape (..., 3), of what moves in the plane (x, y, 0)")), ((1, 0, 0, 0), SHAPE),
    ((1j, 0, 0), KIND), (("a", 0, 0), KIND), (np.float16([1, 2, 3]), KIND), (THREE, LEADING),
]  # fmt: skip
NO_QUATERNION = [((0, 0, 0), SHAPE), ("q", KIND), ((0, 0, 0, 0), (hp.RotationError, "non-zero quaternions"))]

REFUSED = {
    hp.HingePair: {
        "u1": NO_VECTOR,
        "u2": NO_VECTOR,
        "n": [
            ((1, 0), SHAPE), ((0, 0, 0), (AxisError, "a non-zero axis")), ("n", KIND), (None, KIND),
            ((0, 0, math.nan), (AxisError, "a finite axis")), ((0, math.inf, 0), (AxisError, "a finite axis")),
        ],
        "home": NO_ROTATION,
        "name": NO_NAME,
        "limits": [
            ((1, -1), (hp.ArgumentError, "(lower, upper) with lower <= upper")),
            ((0, math.inf), FINITE), ((math.nan, 1), FINITE), ((1,), SHAPE), ((1, 2, 3), SHAPE), (1, SHAPE),
            (((0, 1), (0, 1)), SHAPE), ("ab", KIND),
        ],
        "body1": NO_BODY,
        "body2": NO_BODY,
        "torque_limit": NO_LIMIT,
        "rate_limit": NO_LIMIT,
    },
    hp.PlanarPair: {"u1": NO_PLANAR, "u2": NO_PLANAR, "name": NO_NAME, "body1": NO_BODY, "body2": NO_BODY},
    hp.Body: {
        "mass": NO_SIZE,
        "centre_of_mass": [*NO_VECTOR[:-1], (TWO, SHAPE)],
        "inertia": [
            *((np.diag(own), (hp.ArgumentError, "principal moments above 0")) for own in ((0, 1, 1), (1, 1, -1))),
            (THREE, (hp.ArgumentError, "principal moments above 0")),
            ((1, 0, 1), (hp.ArgumentError, "principal moments above 0")),
            ([[1, 0.1, 0], [0, 1, 0], [0, 0, 1]], (hp.ArgumentError, "a symmetric matrix")),
            ((1, 1, 2.005), (hp.ArgumentError, "no principal moment above the sum of the other two")),
            (np.eye(2), SHAPE), (np.zeros((2, 3, 3)), SHAPE), (EYE * math.nan, FINITE), ("x", KIND),
        ],
        "shapes": [
            (("box",), SOLIDS), ([BALL, LIGHT], SOLIDS),
            (BALL, (hp.ArgumentError, "a sequence of Box, Cylinder and Sphere")),
        ],
    },
    hp.Box: {
        "size": [
            *((size, (hp.ArgumentError, "three lengths above 0")) for size in ((1, 0, 1), (1, 1, -1))),
            (1, SHAPE), ((1, 2), SHAPE), ((1, 2, math.inf), FINITE), (None, KIND),
        ],
        "center": NO_VECTOR,
        "axes": [*NO_ROTATION, (np.stack([EYE, EYE]), SHAPE)],
    },
    hp.Cylinder: {
        "radius": NO_SIZE,
        "length": NO_SIZE,
        "center": NO_VECTOR,
        "axis": [*NO_VECTOR, ((0, 0, 0), (AxisError, "a non-zero axis")), (TWO, SHAPE)],
    },
    hp.Sphere: {"radius": NO_SIZE, "center": NO_VECTOR},
    hp.BodyMotion: {
        "R": [*NO_MOTION[:-1], (None, KIND)],
        "S": [case for case in NO_ROTATION if case[1] is not FINITE],
        **dict.fromkeys(("omega", "a", "alpha"), NO_MOTION),
        "v": NO_MOTION[:-1],
    },
    hp.BodyMotion.from_quaternion_xyzw: {"quat_xyzw": NO_QUATERNION},
    hp.BodyMotion.from_quaternion_wxyz: {"quat_wxyz": NO_QUATERNION},
    hp.BodyMotion.from_rotvec: {"rotvec": [((0, 0), SHAPE), ("r", KIND)]},
}  # fmt: skip
"""Of each argument, values that are refused: the error, and how what is expected begins."""


@pytest.mark.parametrize("make", ACCEPTED, ids=lambda make: make.__qualname__)
def test_the_arguments_beside_those_that_are_refused_are_taken(make):
    made = make(**ACCEPTED[make])
    assert "object at" not in repr(made)
    with pytest.raises(TypeError, match="unexpected keyword argument"):
        make(**ACCEPTED[make], weight=1)


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


@pytest.mark.parametrize(
    ("make", "argument", "value", "error", "expected"),
    [
        pytest.param(make, argument, value, *told, id=f"{make.__qualname__}-{argument}-{i}")
        for make, arguments in REFUSED.items()
        for argument, cases in arguments.items()
        for i, (value, told) in enumerate(cases)
    ],
)
def test_an_argument_that_cannot_be_used_is_refused_by_name(make, argument, value, error, expected):
    with pytest.raises(hp.ArgumentError) as caught:
        make(**ACCEPTED[make] | {argument: value})
    assert type(caught.value) is error
    assert caught.value.name == argument
    assert str(caught.value).startswith(f"{argument}: expected {expected}")
    assert "\n" not in str(caught.value)


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
