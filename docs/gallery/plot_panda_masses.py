"""
What a robot's arm weighs, from its motors
==========================================

A Panda was fitted with a tool, and its gears have friction; its URDF file knows neither. Twenty seconds of motion and
the torques of its motors tell both.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# The recording is computed here, with noise in the positions (0.01 mrad) and in the torques (0.2 N m).
robot = hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})
tool = hp.Body(mass=1.2, centre_of_mass=(0, 0.02, 0.08), inertia=(0.004, 0.004, 0.002))
friction = {name: hp.HingeLoad(damping=0.6, friction=0.4) for name in robot.names}
real = robot.with_payload("panda_hand", tool).with_joint_loads(friction)

rng = np.random.default_rng(4)
t = np.arange(0, 20, 0.01)  # s
waves = 2 * np.pi * np.array((0.07, 0.16, 0.27, 0.38, 0.49))  # rad/s
phase = waves * t[:, None, None] + rng.uniform(0, 2 * np.pi, (robot.dof, 5))
size = 0.35 / np.arange(1, 6)  # rad
q = robot.position_limits.mean(axis=1) + (size * np.sin(phase)).sum(axis=-1)
qd, qdd = (size * waves * np.cos(phase)).sum(axis=-1), -(size * waves**2 * np.sin(phase)).sum(axis=-1)
tau = real.inverse_dynamics(q, qd, qdd, joint_loads=True).tau + 0.2 * rng.standard_normal(q.shape)
q = q + 1e-5 * rng.standard_normal(q.shape)

# %%
# Rates and accelerations come from the positions; the last quarter of the samples is not fitted to.
q, qd, qdd = (np.stack(part, axis=-1) for part in zip(*(hp.smooth(t, joint) for joint in q.T), strict=True))
fit = hp.fit_masses(robot, q, qd, qdd, tau, physical=True)
print(fit)

# %%
# Measured torques of three joints, those by the URDF file, and those by the fitted masses and friction; below,
# what both leave. What the fit leaves is noise, also in the samples that it has not seen (grey).
joints = (1, 3, 5)
described = robot.inverse_dynamics(q, qd, qdd, joint_loads=True).tau
fitted = fit.torques(q, qd, qdd)
for name, model in (("as described", described), ("fitted", fitted)):
    print(f"{name}: {np.sqrt(np.mean((tau - model)[1500:, 1] ** 2)):.2f} N m of joint 2 are left in the test")

figure, panels = plt.subplots(2, 3, sharex=True, figsize=(12, 6), layout="constrained", height_ratios=(2, 1))
for (above, below), k in zip(panels.T, joints, strict=True):
    above.plot(t, tau[:, k], color="0.75", lw=3, label="measured")
    above.plot(t, described[:, k], color="tab:orange", lw=1, label="URDF file")
    above.plot(t, fitted[:, k], color="tab:blue", lw=1, label="fitted")
    above.set_title(f"torque of joint {k + 1} [N m]")
    below.plot(t, (tau - described)[:, k], color="tab:orange", lw=0.6)
    below.plot(t, (tau - fitted)[:, k], color="tab:blue", lw=0.6)
    below.set(title="measured less computed [N m]", xlabel="t [s]")
    for axes in (above, below):
        axes.axvspan(15, 20, color="0.94", zorder=0)
        axes.grid(alpha=0.3)
        axes.margins(x=0)
figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
plt.show()
