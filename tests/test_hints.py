"""Messages and listings lead from a likely mistake to what was meant."""

import numpy as np
import pytest

import hingepair as hp

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
