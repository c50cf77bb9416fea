"""Ways of `bench direct` that ask an engine, sample by sample: Pinocchio, MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np

from hingepair.bench.methods import Array, Found, Job, Motion, room_at
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import matrix_to_quaternion
from hingepair.validation.cross_validate import to_pinocchio


def pinocchio_loop(pair: HingePair, motion: Motion) -> Job:
    """Pinocchio from Python, results copied into arrays; its q, v, a made beforehand."""
    import pinocchio as pin

    twin = to_pinocchio(pair)
    model, data, frame = twin.model, twin.data, twin.body2_frame
    made = pinocchio_inputs(pair, motion)
    out = room_at(len(motion), len(motion[0]))

    def run() -> Found:
        for i in range(len(made[0])):
            pin.forwardKinematics(model, data, *(c[i] for c in made))
            placement = pin.updateFramePlacement(model, data, frame)
            out["R2"][i], out["S2"][i] = placement.translation, placement.rotation
            if len(made) > 1:
                twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
                out["v2"][i], out["omega2"][i] = twist.linear, twist.angular
            if len(made) > 2:
                change = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
                out["a2"][i], out["alpha2"][i] = change.linear, change.angular
        return out

    return run


def pinocchio_inputs(pair: HingePair, motion: Motion) -> list[Array]:
    """Pinocchio's q, v, a, as far as the motion goes."""
    twin = to_pinocchio(pair)
    body1, psi = _body1(pair, motion), [c[:, 6] for c in motion]
    made = [twin.configuration(body1, psi[0])]
    made += [twin.velocity(body1, *psi[:2])] if len(psi) > 1 else []
    made += [twin.acceleration(body1, *psi)] if len(psi) > 2 else []
    return made


def mujoco_loop(pair: HingePair, motion: Motion) -> Job:
    """MuJoCo from Python: the stages of its dynamics that make poses, velocities, accelerations, and no others."""
    import mujoco as mj

    model = mj.MjModel.from_xml_string(_mjcf(pair))
    data = mj.MjData(model)
    made = _mujoco_inputs(pair, motion)
    out = room_at(len(motion), len(motion[0]))
    body2, kind = model.body("body2").id, mj.mjtObj.mjOBJ_XBODY
    position, matrix = data.xpos[body2], data.xmat[body2].reshape(3, 3)
    targets = (data.qpos, data.qvel, data.qacc)
    six = np.zeros((6, 1))
    angular, linear = six[:3, 0], six[3:, 0]

    def run() -> Found:
        for i in range(len(made[0])):
            for target, source in zip(targets, made, strict=False):
                target[:] = source[i]
            mj.mj_kinematics(model, data)
            out["R2"][i], out["S2"][i] = position, matrix
            if len(made) > 1:
                mj.mj_comPos(model, data)
                mj.mj_comVel(model, data)
                mj.mj_objectVelocity(model, data, kind, body2, six, 0)
                out["v2"][i], out["omega2"][i] = linear, angular
            if len(made) > 2:
                mj.mj_rnePostConstraint(model, data)
                mj.mj_objectAcceleration(model, data, kind, body2, six, 0)
                out["a2"][i], out["alpha2"][i] = linear, angular
        return out

    return run


def _mujoco_inputs(pair: HingePair, motion: Motion) -> list[Array]:
    """MuJoCo's qpos, qvel, qacc: linear in world axes, angular in the body's, quaternions wxyz."""
    body1 = _body1(pair, motion)
    S1: Any = body1.S
    turning: list[Any] = [matrix_to_quaternion(S1)]
    turning += [np.einsum("kji,kj->ki", S1, c) for c in (body1.omega, body1.alpha) if c is not None]
    linear: list[Any] = [body1.R, body1.v, body1.a]
    return [np.hstack([*parts, c[:, 6:]]) for *parts, c in zip(linear, turning, motion, strict=False)]


def _body1(pair: HingePair, motion: Motion) -> BodyMotion:
    s = pair.forward_kinematics(*motion, outputs=("R1", "S1", "v1", "omega1", "a1", "alpha1")[: 2 * len(motion)])
    given: Any = {"R": s.R1, "S": s.S1, "v": s.v1, "omega": s.omega1, "a": s.a1, "alpha": s.alpha1}
    return BodyMotion(**given)


def _mjcf(pair: HingePair) -> str:
    """The pair as MuJoCo reads it, body 2 at psi = 0; without gravity, which MuJoCo counts as an acceleration."""

    def text(vector: Array) -> str:
        return " ".join(repr(float(x)) for x in vector)

    C = pair.home
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    return f"""<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/>{inertial}
      <body name="body2" pos="{text(pair.u1 - C @ pair.u2)}" quat="{text(matrix_to_quaternion(C))}">{inertial}
        <joint type="hinge" pos="{text(pair.u2)}" axis="{text(C.T @ pair.n)}"/>
      </body></body></worldbody></mujoco>"""
