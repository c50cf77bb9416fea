"""MuJoCo, Pinocchio and yourdfpy read what is written, and move it as the pair says."""

from __future__ import annotations

import math
from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.mechanism.pairs.accuracy import norm, output_scales
from support import states
from support.exported import corner_pair
from support.truths import ratios

pytestmark = pytest.mark.filterwarnings("ignore:.*no mass properties:hingepair.DynamicsWarning")

U = 2.0**-53
OUTPUTS = ("R2", "S2", "v2", "omega2", "a2", "alpha2")


def motion_of(k, count=2):
    rng = states.generator(85, k)
    names = ("R", "S", "v", "omega", "a", "alpha")
    return hp.BodyMotion(**dict(zip(names, states.body1(rng, count), strict=True))), rng.normal(size=(3, count))


def ratios_of(pair, body1, hinge, found, *, arms_in_world=False):
    """Differences to the pair's own answer, in units of u * scale.

    MuJoCo takes velocities from the model's centre of mass: arms in world axes, as long as R1 and rounded like it.
    """
    state = pair.forward_kinematics_from_body1(body1, *hinge)
    W1, A1 = norm(body1.omega), norm(body1.alpha)
    sizes = {"R1": body1.R, "v1": body1.v, "a1": body1.a, "W1": W1, "A1": A1, "psid": hinge[1], "psidd": hinge[2]}
    scales = output_scales(u1=pair.u1, u2=pair.u2, pinocchio=True, **sizes)
    if arms_in_world:
        scales["v2"] = scales["v2"] + (W1 + np.abs(hinge[1])) * np.abs(body1.R).max(axis=-1)
    return {
        name: ratios(getattr(state, name), found[name], scales[name] * np.ones(len(W1))).max() for name in OUTPUTS
    }


def in_mujoco(text, body1, hinge):
    """Motion of the body `body2` in the model that MuJoCo makes of the text."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    model.opt.gravity[:] = 0
    data, body = mujoco.MjData(model), model.body("body2").id
    frame = mujoco.mjtObj.mjOBJ_XBODY
    found = {name: [] for name in OUTPUTS}
    for i, (psi, psid, psidd) in enumerate(hinge.T):
        S = body1.S[i]
        quat_xyzw = pin.Quaternion(S).coeffs()
        data.qpos[:] = (*body1.R[i], quat_xyzw[3], *quat_xyzw[:3], psi)
        data.qvel[:] = (*body1.v[i], *(S.T @ body1.omega[i]), psid)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        data.qacc[:] = (*body1.a[i], *(S.T @ body1.alpha[i]), psidd)
        mujoco.mj_rnePostConstraint(model, data)
        twist, rate = np.empty((2, 6))
        mujoco.mj_objectVelocity(model, data, frame, body, twist, 0)
        mujoco.mj_objectAcceleration(model, data, frame, body, rate, 0)
        place = (data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy())
        for name, value in zip(OUTPUTS, (*place, twist[3:], twist[:3], rate[3:], rate[:3]), strict=True):
            found[name].append(value)
    return {name: np.array(values) for name, values in found.items()}


def pinocchio_of_urdf(pair, body1, psi, psid, psidd):
    """Frame body2's motion by the model that Pinocchio makes of the URDF: nq = 7 + 2 (cos psi, sin psi)."""
    model = pin.buildModelFromXML(hp.to_urdf(pair), pin.JointModelFreeFlyer())
    assert (model.nq, model.nv, model.joints[2].nq) == (9, 7, 2)
    data, frame = model.createData(), model.getFrameId("body2")
    twin = hp.to_pinocchio(pair)
    q, v, a = (
        twin.configuration(body1, psi),
        twin.velocity(body1, psi, psid),
        twin.acceleration(body1, psi, psid, psidd),
    )
    found = {name: [] for name in ("R2", "S2", "v2", "omega2", "a2", "alpha2")}
    for i, angle in enumerate(psi):
        pin.forwardKinematics(model, data, np.r_[q[i, :7], math.cos(angle), math.sin(angle)], v[i], a[i])
        place = pin.updateFramePlacement(model, data, frame)
        twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        classical = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        values = (place.translation, place.rotation, twist.linear, twist.angular, classical.linear, classical.angular)
        for name, value in zip(found, values, strict=True):
            found[name].append(value.copy())
    return {name: np.array(values) for name, values in found.items()}


READERS = {
    "mjcf in MuJoCo": lambda pair, *motion: in_mujoco(hp.to_mjcf(pair), *motion),
    "urdf in MuJoCo": lambda pair, *motion: in_mujoco(hp.to_urdf(pair, base="floating"), *motion),
    "urdf in Pinocchio": lambda pair, body1, hinge: pinocchio_of_urdf(pair, body1, *hinge),
}


@pytest.mark.slow(2)
@pytest.mark.parametrize("reader", READERS)
def test_simulators_move_body2_as_the_pair_does(reader):
    for k in range(60):
        pair, motion = corner_pair(k), motion_of(k)
        found = READERS[reader](pair, *motion)
        worst = ratios_of(pair, *motion, found, arms_in_world="MuJoCo" in reader)
        assert max(worst.values()) <= 16, (k, worst)


@pytest.mark.slow
@pytest.mark.parametrize("aside", [1e-13, 9e-13, 1.5e-12, 3e-12])
def test_an_axis_a_hair_off_a_coordinate_axis_is_not_rounded_to_it(aside):
    """Pinocchio takes what is within 1e-12 of x, y or z for that."""
    for k in range(3):
        pair, (body1, hinge) = corner_pair(k, home=None, n=np.roll((1, aside, -aside), k)), motion_of(k)
        ratios = ratios_of(pair, body1, hinge, pinocchio_of_urdf(pair, body1, *hinge))
        assert max(ratios.values()) <= 16, ratios


@pytest.mark.parametrize("limits", [(-1, 2), None], ids=["revolute", "continuous"])
@pytest.mark.parametrize(
    ("torque", "rate"), [(12.5, 3.25), (0.0, 0.0), (12.5, None), (None, 3.25), (None, None)], ids=str
)
def test_limits_of_torque_and_rate_reach_the_simulators_and_come_back(limits, torque, rate):
    import mujoco

    pair = corner_pair(1, limits=limits, torque_limit=torque, rate_limit=rate)
    back = hp.from_urdf(hp.to_urdf(pair), "hinge")
    none = limits is None and torque is None and rate is None
    expected = [invented if own is None else own for own, invented in ((torque, 1000.0), (rate, 100.0))]
    assert [back.torque_limit, back.rate_limit] == ([None, None] if none else expected)
    twin, model = hp.to_pinocchio(pair).model, pin.buildModelFromXML(hp.to_urdf(pair), pin.JointModelFreeFlyer())
    if torque is not None:
        assert twin.lowerEffortLimit[-1] == model.lowerEffortLimit[-1] == -torque
        assert twin.upperEffortLimit[-1] == model.upperEffortLimit[-1] == torque
    if rate is not None:
        assert twin.upperVelocityLimit[-1] == model.upperVelocityLimit[-1] == rate
        assert twin.lowerVelocityLimit[-1] == -rate  # Pinocchio 4.1 reads it from URDF without the sign
    told = pytest.warns(hp.DynamicsWarning, match="torque_limit = 0: left out") if torque == 0 else nullcontext()
    with told:
        model = mujoco.MjModel.from_xml_string(hp.to_mjcf(pair))
    assert model.jnt_actfrclimited[1] == bool(torque)
    assert tuple(model.jnt_actfrcrange[1]) == ((-torque, torque) if torque else (0, 0))
