"""Points fixed to the bodies of a pair: R_i + S_i p, and its exact derivatives, wherever the pair goes."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, exactly
from hingepair.engine.trace import needed_values
from support import states, truths
from support.hinged import made, pair_of
from support.near import U

OUTPUTS = ("sensor", "arm", "sensor_v", "arm_v", "sensor_a", "arm_a")  # a step of the equations is called arm, too
SENSOR, ARM = np.array((0.25, -0.5, 1.0)), np.array((-0.75, 0.125, 0.5))  # sums with dyadic levers are exact
LEVERS = np.array((0.5, 0.25, -0.125)), np.array((-0.25, 1.5, 0.375))


def pointed(k=0, **changes):
    """A pair with a point on either body, and the constants of pairs whose reference points are these points."""
    u1, u2 = LEVERS
    _, _, n, home = states.pair(states.generator(140, k), home=k > 0)
    pair = pair_of((u1, u2, n, home), points1={"sensor": SENSOR}, points2={"arm": ARM}, **changes)
    return pair, {"sensor": (SENSOR, np.zeros(3), n, None), "arm": (u1, u2 - ARM, n, home)}


@pytest.mark.usefixtures("each_backend")
@pytest.mark.parametrize("k", [0, 1])
def test_points_are_exact_within_their_error_bounds(k):
    """Against 60 digits, where a point is the reference point of body 2 of another pair."""
    pair, others = pointed(k)
    motion = states.coordinates(states.generator(141, k), 15)
    state = pair.forward_kinematics(*motion, outputs=OUTPUTS)
    bounds = pair.error_bounds(*motion, outputs=OUTPUTS)
    shares = []
    for name, constants in others.items():
        values = truths.from_euler(constants, *motion).values
        for letter, output in zip(("R2", "v2", "a2"), (name, f"{name}_v", f"{name}_a"), strict=True):
            with mpmath.workdps(DIGITS):
                error = abs(exactly(state.arrays()[output]) - values[letter]).max(axis=-1)
            shares += [float(one) for one in error / bounds[output]]
    assert 0.05 < max(shares) <= 1


def test_points_of_chains_are_frames_of_the_body_that_carries_them():
    pair, _ = pointed(1, name="upper")
    fore = made(1, name="fore", points1={"elbow": (0, 0, 0.5)}, points2={"tip": (1, 0, 0)})
    robot, q = hp.Mechanism([pair, fore]), (0.4, -0.7)
    links = robot.forward_kinematics(q, frames=("upper", "fore"))
    found = robot.forward_kinematics(q, frames=("elbow", "tip", "arm", "sensor"))
    for name, link, position in (("elbow", "upper", (0, 0, 0.5)), ("arm", "upper", ARM), ("tip", "fore", (1, 0, 0))):
        expected = links[link].R + links[link].S @ np.asarray(position, float)
        assert abs(found[name].R - expected).max() <= 8 * U
    assert found["sensor"].R.tolist() == SENSOR.tolist()
    with pytest.raises(hp.ArgumentError, match=r"pairs: expected points with names .*'fore'"):
        hp.Mechanism([replace(pair, points1={"fore": (0, 0, 0)}), fore])


def test_a_state_has_the_motion_of_a_point_by_its_name():
    pair, _ = pointed()
    q, qd, _ = states.coordinates(states.generator(144), 4)
    state = pair.forward_kinematics(q, qd, outputs=("arm", "arm_v", "R2"))
    assert state["arm"].R.tolist() == state.arrays()["arm"].tolist()
    assert state["arm"].v.tolist() == state["arm_v"].tolist()
    assert state["arm"].a is None
    assert state["R2"] is not None
    for absent in ("sensor", "arm_a", "other"):
        with pytest.raises(KeyError):
            state[absent]
    only = pair.forward_kinematics(q, qd, outputs=("arm_v",))["arm"]
    assert only.R is None
    assert only.v.tolist() == state["arm"].v.tolist()


def test_points_cost_nothing_where_no_output_is_of_them():
    pair, _ = pointed(1)
    plain = replace(pair, points1={}, points2={})
    asked = ("R2", "v2", "arm_v")
    counts = []
    for one, more in ((plain, 0), (pair, 0), (pair, 1)):
        program, _ = one.prepare("velocity", outputs=asked[: 2 + more])._call.program_with_numbers()
        counts.append(len([*needed_values(program.traced.results)]))
    assert counts[0] == counts[1] < counts[2]
    assert pair.forward_kinematics(np.zeros(7)).outputs == plain.forward_kinematics(np.zeros(7)).outputs


@pytest.mark.filterwarnings("ignore:.*no mass properties:hingepair.DynamicsWarning")
def test_points_are_links_of_urdf_and_sites_of_mjcf():
    pair, _ = pointed(1)
    text = hp.to_urdf(pair)
    robot = hp.Mechanism.from_urdf(text)
    expected = hp.Mechanism([pair]).forward_kinematics((0.6,), frames=("arm",))["arm"].R
    simulated = hp.Mechanism.from_mjcf(hp.to_mjcf(pair, base="fixed"))
    for other in (robot, simulated):
        assert abs(other.forward_kinematics((0.6,), frames="arm")["arm"].R - expected).max() < 64 * 2.0**-53
