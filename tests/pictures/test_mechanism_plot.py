"""The figure of a mechanism's motion."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.near import U


def curve_and_limits(axes):
    curve, *others = axes.get_lines()
    return curve.get_ydata(), [line.get_ydata()[0] for line in others]


# ---------------------------------------------------------------- a robot and its coordinates


@pytest.fixture(scope="module")
def arm():
    link = hp.Body(mass=1, centre_of_mass=(0.5, 0, 0), inertia=(1, 1, 1))
    turn = hp.HingePair((0, 0, 1), (0, 0, 0), (0, 1, 0), name="turn", limits=(-1, 1), torque_limit=5, body2=link)
    return hp.Mechanism([turn, hp.Slider((1, 0, 0), (0, 0, 0), (1, 0, 0), name="reach", body2=link)], name="arm")


Q = np.linspace((0.0, 0.1), (0.9, 0.3), 7)


def test_coordinates_of_a_robot_are_drawn_with_limits_and_paths(arm):
    t, tau = np.linspace(1, 2, 7), np.linspace((4.0, 1), (4.8, 2), 7)
    figure = hp.plot(arm, q=Q, t=t, tau=tau, qd=2 * Q, base_motion=hp.BodyMotion(R=(0, 0, 5), S=np.eye(3)))
    assert figure.get_suptitle() == "arm"
    *panels, paths = figure.axes
    assert [axes.get_title() for axes in panels[:3]] == ["position", "rate", "torque or force"]
    for i, row in enumerate((panels[:3], panels[3:])):
        for axes, array in zip(row, (Q, 2 * Q, tau), strict=True):
            np.testing.assert_array_equal(axes.get_lines()[0].get_data(), (t, array[:, i]))
    assert [curve_and_limits(axes)[1] for axes in panels] == [[1], [], [5], [], [], []]
    assert [axes.get_ylabel() for axes in panels[3:]] == ["reach\n[m]", "m/s", "N"]
    assert panels[3].get_xlabel() == "t [s]"
    line, _ = paths.get_lines()
    expected = arm.forward_kinematics(Q, frames="reach", backend="numpy")["reach"].R + np.array((0, 0, 5))
    np.testing.assert_allclose(np.stack(line.get_data_3d(), axis=1), expected, rtol=64 * U)
