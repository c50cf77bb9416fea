"""
Workspace of a five-bar robot
=============================

Two motors at the base move a point in the plane through four light bars. Where can the point go, how well do the
motors move it there, and which torques draw a circle?

The proportions are those of small robots that sort goods: motors 120 mm apart, upper arms of 180 mm, forearms of
250 mm, and 300 g at the point; the masses are assumed.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# Two chains of two bars each meet in the point. Closed, the mechanism has two coordinates, both upper arms.
apart, upper, fore = 0.12, 0.18, 0.25


def bar(name, u1, length, mass):
    """Return a hinge at u1 that carries a uniform bar."""
    body = hp.Body(mass, (length / 2, 0, 0), (1e-5, mass * length**2 / 12, mass * length**2 / 12))
    return hp.HingePair(u1, (0, 0, 0), (0, 0, 1), name=name, body2=body)


bars = [
    bar("left", (-apart / 2, 0, 0), upper, 0.12), bar("left fore", (upper, 0, 0), fore, 0.08),
    bar("right", (apart / 2, 0, 0), upper, 0.12), bar("right fore", (upper, 0, 0), fore, 0.08),
]  # fmt: skip
tree = hp.Mechanism(bars, parents=[0, 1, 0, 3])
tree = tree.with_frame("point", "left fore", R=(fore, 0, 0)).with_frame("other", "right fore", R=(fore, 0, 0))
at = {"left": 2.2, "left fore": -1.2, "right": 0.94, "right fore": 1.2}
robot = tree.with_payload("point", mass=0.3).closed(
    hp.Loop("point", "other"), coordinates=("left", "right"), at=at
)

# %%
# The workspace: all pairs of angles of the motors. Where the loop cannot be closed, results are NaN, and a warning
# counts them. Positions of one assembly are a function of the angles; the transmission tells how far it is from a
# dead point, at which both forearms are in line and the motors no longer hold the point.
angles = np.stack(np.meshgrid(np.linspace(0.8, 3.6, 281), np.linspace(-0.46, 2.34, 281), indexing="ij"), axis=-1)
with np.errstate(all="ignore"):
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hp.DynamicsWarning)
        point = robot.forward_kinematics(angles, frames="point")["point"].R
        transmission = robot.transmission(angles)
reached = np.isfinite(transmission)
print(f"closed at {reached.mean():.0%} of the angles; transmission up to {np.nanmax(transmission):.2f}")

# %%
# A circle of 140 mm in 0.8 s. Inverse kinematics follow it from target to target, and derivatives by time come from
# the Jacobian of the closed mechanism: J q' = v.
t = np.linspace(0, 0.8, 401)
turn = 2 * np.pi * t / t[-1]
target = np.stack((0.07 * np.cos(turn), 0.30 + 0.07 * np.sin(turn), 0 * turn), axis=-1)
solved = robot.inverse_kinematics_path(target, frame="point", q0=[2.2, 0.94])
q = solved.q
qd, qdd = np.gradient(q, t, axis=0, edge_order=2), np.gradient(np.gradient(q, t, axis=0, edge_order=2), t, axis=0, edge_order=2)
torque = robot.inverse_dynamics(q, qd, qdd, gravity=(0, 0, -9.81)).tau
off = np.linalg.norm(robot.forward_kinematics(q, frames="point")["point"].R - target, axis=-1).max()
print(f"the circle is met to {1e9 * off:.1f} nm; largest torque {np.abs(torque).max():.2f} N m")
figure, (plane, curves) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained", width_ratios=(1.2, 1))
