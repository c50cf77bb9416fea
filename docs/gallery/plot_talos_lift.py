"""
What the elbow of Talos can lift
================================

The humanoid robot Talos lifts a bottle with its left arm. Which motor reaches its limit first, and at which mass of
the bottle? Limits, masses and geometry are those of the robot's URDF (PAL Robotics), which the package
example-robot-data contains.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# The grippers are locked; 30 of 32 joints remain. A frame between the finger tips carries the payload. The
# pelvis stands still.
robot = hp.load_robot("talos_reduced", locked={"gripper_left_joint": -0.4, "gripper_right_joint": 0})
robot = robot.with_frame("bottle", link="gripper_left_base_link", R=(0, 0, -0.12))
pelvis = hp.BodyMotion(R=(0, 0, 1.083), S=np.eye(3))

# %%
# The arm moves from beside the hip to a position in front of the chest in 3 s, at rest and without acceleration at
# both ends. Joints that are not named stay at zero, or at the limit that is closest to zero.
start = {"arm_left_1_joint": 0.1, "arm_left_2_joint": 0.15, "arm_left_4_joint": -0.3, "torso_1_joint": 0.3}
end = {"arm_left_1_joint": 0.25, "arm_left_2_joint": 0.25, "arm_left_3_joint": -0.1, "arm_left_4_joint": -1.75}
rest = np.clip(np.zeros(robot.dof), *robot.position_limits.T)
q0, q1 = rest.copy(), rest.copy()
for values, q in ((start, q0), (end, q1)):
    for joint, angle in values.items():
        q[robot.names.index(joint)] = angle
t = np.linspace(0, 3, 301)
s = t / 3
share = np.polynomial.Polynomial((0, 0, 0, 10, -15, 6))
q, qd, qdd = (q1 - q0) * np.stack((share(s), share.deriv(1)(s) / 3, share.deriv(2)(s) / 9))[..., None]
q = q0 + q

# %%
# Torques are linear in the mass of the payload, so two computations give them for every mass: without a bottle,
# and with 1 kg. The largest mass that the motors hold follows at each instant.
bottle = hp.Body(mass=1, shapes=[hp.Cylinder(radius=0.045, length=0.3, axis=(1, 0, 0))])
empty = robot.inverse_dynamics(q, qd, qdd, base_motion=pelvis).tau
per_kilogram = robot.with_payload("bottle", bottle).inverse_dynamics(q, qd, qdd, base_motion=pelvis).tau - empty
arm = [robot.names.index(f"arm_left_{k}_joint") for k in range(1, 8)]
limits = robot.effort_limits[arm]
growth = per_kilogram[:, arm]
room = limits - np.sign(growth) * empty[:, arm]
largest = room / np.maximum(np.abs(growth), 1e-6)  # kg, by instant and joint
joint, instant = np.argmin(largest.min(axis=0)), np.argmin(largest.min(axis=1))
print(f"largest mass: {largest.min():.2f} kg, limited by joint {joint + 1} at t = {t[instant]:.2f} s")

# %%
# The motor of the elbow reaches its limit first, at 1.7 kg, with the forearm about horizontal. The last joint of the
# wrist would be the next; the joints of the shoulder stay far below their limits.
links = ("torso_2_link", *(f"arm_left_{k}_link" for k in range(1, 8)), "bottle")
state = robot.forward_kinematics(q, frames=links, outputs=("R",), base_motion=pelvis)
figure, (side, curves, bars) = plt.subplots(1, 3, figsize=(11, 4.2), layout="constrained", width_ratios=(0.8, 1, 1))
for now in (0, 120, 160, 200, 300):
    points = state.R[now]
    side.plot(points[:, 0], points[:, 2], "-o", color=plt.cm.viridis(now / 330), ms=4, lw=3)
    side.plot(*points[-1, ::2], "s", color="crimson", ms=9)
side.set(aspect="equal", xlabel="x, forward [m]", ylabel="z [m]", title="The left arm from the side")
masses = (0, 0.5, 1, 1.5, 2)
for number, mass in enumerate(masses):
    tau = (empty + mass * per_kilogram)[:, arm]
    shade = plt.cm.plasma(number / 5)
    curves.plot(t, tau[:, 3], color=shade, label=f"{mass:g} kg")
    bars.bar(np.arange(1, 8) + 0.16 * (number - 2), 100 * np.abs(tau).max(axis=0) / limits, 0.16, color=shade)
curves.axhline(-limits[3], color="r", ls="--")
curves.set(xlabel="t [s]", ylabel="torque of the elbow [N m]", title="Elbow (dashed: limit)")
curves.legend()
bars.axhline(100, color="r", ls="--")
bars.set(
    xlabel="joint of the left arm (4: the elbow)",
    ylabel="largest torque [% of the limit]",
    title="All motors, 0 to 2 kg",
)
plt.show()
