"""Messages and listings lead from a likely mistake to what was meant."""

import dataclasses
import re
from collections.abc import Callable

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.hints import SYNONYMS

PAIR = hp.HingePair(u1=(1, 0, 0), u2=(0, 0, 0), n=(0, 0, 1), name="first")
ROBOT = hp.Mechanism([PAIR, hp.HingePair(u1=(1, 0, 0), u2=(0, 0, 0), n=(0, 1, 0), name="second")])
RAMP = np.linspace(0, 1, 5)


@pytest.mark.parametrize(
    ("q", "text"),
    [
        ((0, 0, 0, 0, 0, RAMP), "got a tuple of 6"),
        ((0, 0, 0, 0, 0, 0), "got a tuple of 6"),
        ([0, 0, 0, 0, 0, 0, RAMP], "got a list of numbers and arrays: make it a tuple"),
        (np.zeros((7, 201)), "got shape (7, 201) (transpose it: .T)"),
    ],
)
def test_coordinates_of_a_pair(q: object, text: str) -> None:
    with pytest.raises(hp.ShapeError) as caught:
        PAIR.forward_kinematics(q)  # type: ignore[arg-type]
    assert str(caught.value).endswith(text)


def test_coordinates_of_a_robot() -> None:
    with pytest.raises(hp.ShapeError, match=r"got shape \(2, 100\) \(transpose it: \.T\)$"):
        ROBOT.forward_kinematics(np.zeros((2, 100)))
    with pytest.raises(
        hp.ShapeError, match=r"of the 2 joints first, second, got a list of numbers and arrays: make it"
    ):
        ROBOT.forward_kinematics([0, RAMP])
    assert ROBOT.forward_kinematics({"first": 0, "second": RAMP}).shape == (5,)
    assert ROBOT.forward_kinematics((0, RAMP)).shape == (5,)


@pytest.mark.parametrize(("name", "width"), [("q", 9), ("qd", 8)])
def test_states_of_pinocchio_are_told_how_to_convert(name: str, width: int) -> None:
    given = {"q": (0, 0), "qd": (0, 0)} | {name: np.zeros((5, width))}
    with pytest.raises(hp.ShapeError, match=r"got shape \(5, .\); robot.from_pinocchio_state\(q, v\) takes"):
        ROBOT.forward_kinematics(**given)  # type: ignore[arg-type]


def test_joints_without_an_effort_are_named() -> None:
    with pytest.raises(hp.ArgumentError, match=r"^tau\['first'\]: .* array, 0 for no torque or force, got none$"):
        hp.simulate(ROBOT, [0, 1], q0=(0, 0), tau={"second": 60})
    with pytest.raises(hp.ArgumentError, match=r"^q\['first'\]: .* array, got none, nor for second$"):
        ROBOT.forward_kinematics({})


def test_what_a_state_lists() -> None:
    state = ROBOT.forward_kinematics((0, 0), frames=("second",))
    assert "frames=(second)" in repr(state)
    assert "frames" in dir(state)
    assert "body2" in dir(PAIR.forward_kinematics((0,) * 7))
    assert "body2" not in dir(PAIR.forward_kinematics((0,) * 7, outputs=("R2",)))


def test_misspelt_name_of_the_package() -> None:
    with pytest.raises(AttributeError, match=r"'load_robots' \(nearest: load_robot\)$"):
        hp.load_robots  # noqa: B018


def test_misspelt_choices() -> None:
    with pytest.raises(hp.ArgumentError, match=r"one of fixed, free \(nearest: fixed\), got 'fix'$"):
        hp.Mechanism([PAIR], base="fix")
    with pytest.raises(hp.ArgumentError, match=r"\(nearest: second\), got 'econd'$"):
        ROBOT.jacobian((0, 0), "econd")
    with pytest.raises(hp.ArgumentError, match=r"\(nearest: panda_hand_tcp\), got 'tcp'$"):
        hp.load_robot("panda").jacobian(np.zeros(8), "tcp")


@pytest.mark.parametrize(
    ("value", "name", "text"),
    [
        (ROBOT, "gravity", "gravity: this Mechanism cannot be changed; gravity is an argument of each call"),
        (ROBOT, "name", "name: this Mechanism cannot be changed; methods such as with_payload and with_base return"),
        (ROBOT, "second", "second: this Mechanism cannot be changed; the joint is robot['second']"),
        (PAIR, "gravity", "gravity: this HingePair cannot be changed"),
        (PAIR, "u1", "u1: this HingePair cannot be changed"),
        (hp.Body(1), "colour", "colour: this Body cannot be changed"),
        (hp.HingeLoad(), "spring", "spring: this HingeLoad cannot be changed"),
        (hp.BodyMotion(R=(0, 0, 0)), "q", "q: this BodyMotion cannot be changed"),
        (hp.PlanarPair((1, 0), (0, 0)), "mass", "mass: this PlanarPair cannot be changed"),
    ],
)
def test_what_is_frozen_says_so(value: object, name: str, text: str) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError, match="^" + re.escape(text)):
        setattr(value, name, 1)
    with pytest.raises(dataclasses.FrozenInstanceError, match="^" + re.escape(text)):
        delattr(value, name)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("nq", "Mechanism has no 'nq' (here: dof)"),
        ("rnea", "Mechanism has no 'rnea' (here: inverse_dynamics)"),
        (
            "computeRNEADerivatives",
            "Mechanism has no 'computeRNEADerivatives' (here: inverse_dynamics_derivatives)",
        ),
        ("joint_limits", "Mechanism has no 'joint_limits' (here: position_limits)"),
        ("forward_kinematic", "Mechanism has no 'forward_kinematic' (nearest: forward_kinematics)"),
        ("second", "Mechanism has no 'second'; the joint is robot['second']"),
        ("gravity", "Mechanism has no 'gravity'; gravity is an argument of each call, such as gravity=(0, 0, -1.62)"),
    ],
)
def test_attributes_of_other_libraries_lead_to_those_of_a_robot(name: str, text: str) -> None:
    with pytest.raises(AttributeError) as caught:
        getattr(ROBOT, name)
    assert str(caught.value) == text


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: hp.load_robot("my.urdf"), "robot: expected .*; hp.Mechanism.from_urdf reads a file, got 'my.urdf'"),
        (lambda: hp.load_robot("my.xml"), "robot: expected .*; hp.Mechanism.from_mjcf reads a file, got 'my.xml'"),
        (lambda: hp.Mechanism("my.urdf"), "pairs: expected .*; hp.Mechanism.from_urdf .* read files, got 'my.urdf'"),
        (lambda: hp.Body(mass=np.ones(3)), r"mass: expected a finite number; robot.with_payload\(link, mass"),
    ],
)
def test_what_reads_files_and_samples_is_named(call: Callable[[], object], text: str) -> None:
    with pytest.raises(hp.ArgumentError, match=f"^{text}"):
        call()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("load_urdf", "here: hp.Mechanism.from_urdf"),
        ("Robot", "here: hp.load_robot or "),
        ("rnea", r"here: robot\.inverse_dynamics\)"),
        ("forward_kinematics", r"here: robot\.forward_kinematics\)"),
    ],
)
def test_names_of_other_libraries_lead_to_those_of_the_package(name: str, text: str) -> None:
    with pytest.raises(AttributeError, match=rf"'{name}' \({text}"):
        getattr(hp, name)


@pytest.mark.parametrize(
    ("R", "S", "text"),
    [
        (
            np.eye(4),
            None,
            "R: expected shape (..., 3); of poses T, 4 x 4, R is T[..., :3, 3] and S is T[..., :3, :3]",
        ),
        ((0, 0, 0), np.eye(4), "S: expected shape (..., 3, 3); of poses T, 4 x 4, R is T[..., :3, 3]"),
        ((0, 0, 0), (0, 0, 0, 1), "S: expected shape (..., 3, 3); R=hp.BodyMotion.from_quaternion_xyzw(R=..., quat"),
        ((0, 0), None, "R: expected shape (..., 3), got shape (2,)"),
    ],
)
def test_targets_of_other_libraries_are_told_how_to_convert(R: object, S: object, text: str) -> None:
    with pytest.raises(hp.ShapeError, match="^" + re.escape(text)):
        ROBOT.inverse_kinematics(R, S)  # type: ignore[arg-type]


def test_a_number_in_place_of_a_vector_is_answered_with_one() -> None:
    with pytest.raises(hp.ShapeError, match=r"^gravity: expected shape \(3,\), such as \(0, 0, -9.81\), got shape"):
        ROBOT.inverse_dynamics((0, 0), (0, 0), (0, 0), gravity=-9.81)


def test_one_output_is_named_without_a_tuple() -> None:
    assert PAIR.forward_kinematics((0,) * 7, outputs="R2").outputs == ("R2",)


@pytest.mark.slow
def test_degrees_are_warned_of_once() -> None:
    with pytest.warns(hp.DynamicsWarning) as caught:
        hp.simulate(hp.load_robot("ur5_robot"), [0, 0.001], [90, 45, 30, -90, 90, 180])
    assert len(caught) == 1
    assert str(caught[0].message).endswith("numpy.radians(90). So do 5 further angles of q0.")


def test_synonyms_name_what_exists() -> None:
    for name, here in SYNONYMS.items():
        owner, attribute = (hp, here[3 : here.index("(")]) if here.startswith("hp.") else (hp.Mechanism, here)
        assert hasattr(owner, attribute), here
        assert not hasattr(hp.Mechanism, name), name
