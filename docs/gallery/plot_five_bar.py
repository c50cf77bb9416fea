"""
Workspace of a five-bar robot
=============================

Two motors at the base move a point in the plane through four light bars. Where can the point go, how well do the
motors move it there, and which torques draw a circle?

The proportions are those of small robots that sort goods: motors 120 mm apart, upper arms of 180 mm, forearms of
250 mm, and 300 g at the point; the masses are assumed.
"""

import warnings

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
robot = tree.with_payload("point", mass=0.3).closed(hp.Loop("point", "other"), coordinates=("left", "right"), at=at)

# %%
# The workspace: all pairs of angles of the motors but those at which the upper arms cross. Where the loop cannot be
# closed, results are NaN, and a warning counts them. Positions of one assembly are a function of the angles; the
# transmission tells how far it is from a dead point, at which the forearms are in line and do not hold the point.
angles = np.stack(np.meshgrid(np.linspace(0.8, 3.6, 281), np.linspace(-0.46, 2.34, 281), indexing="ij"), axis=-1)
with warnings.catch_warnings():
    warnings.simplefilter("ignore", hp.DynamicsWarning)
    grid = robot.forward_kinematics(angles, frames=("point", "left fore", "right fore"))
    transmission = robot.transmission(angles)
point = grid["point"].R
crossed = grid["left fore"].R[..., 0] > grid["right fore"].R[..., 0]  # the upper arms would collide
reached = np.isfinite(transmission) & ~crossed
weak = (transmission[reached] < 0.1).mean()
print(f"{reached.mean():.0%} of the angles can be used; at {weak:.0%} of them the transmission is below 0.1")

# %%
# A circle of 140 mm in 0.8 s. Inverse kinematics follow it from target to target. The rates follow from the Jacobian
# of the closed mechanism, J q' = v, and the accelerations from its rate, J q'' = a - J' q'.
t = np.linspace(0, 0.8, 401)
turn, speed = 2 * np.pi * t / 0.8, 2 * np.pi / 0.8
circle, middle = 0.07 * np.stack((np.cos(turn), np.sin(turn), 0 * turn), axis=-1), np.array((0, 0.30, 0))
target, rate = circle + middle, speed * np.stack((-circle[:, 1], circle[:, 0], 0 * turn), axis=-1)
q = robot.inverse_kinematics_path(target, frame="point", q0=[2.2, 0.94]).q
J = robot.jacobian(q, "point")[:, :2]
qd = np.linalg.solve(J, rate[:, :2, None])[..., 0]
bias = robot.acceleration_bias(q, qd, "point")[:, :2]
qdd = np.linalg.solve(J, (-(speed**2) * circle[:, :2] - bias)[..., None])[..., 0]
torque = robot.inverse_dynamics(q, qd, qdd).tau  # it lies flat: gravity is across the plane
off = np.linalg.norm(robot.forward_kinematics(q, frames="point")["point"].R - target, axis=-1).max()
print(f"the circle is met to {1e9 * off:.1f} nm; largest torque {np.abs(torque).max():.2f} N m")

figure, (plane, curves) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained", width_ratios=(1.2, 1))
order = np.argsort(transmission[reached])  # where two pairs of angles lead to a point, the better one is shown
shown = plane.scatter(*point[reached][order, :2].T, c=transmission[reached][order], s=2, rasterized=True)
figure.colorbar(shown, ax=plane, label="transmission")
plane.plot(*target[:, :2].T, "r", lw=2)
state = robot.forward_kinematics(q[50], frames=("left", "left fore", "right", "right fore", "point"))
for side in ("left", "right"):
    ends = np.array([state[link].R[:2] for link in (side, f"{side} fore", "point")])
    plane.plot(*ends.T, "-o", color="w", lw=5, mfc="w", mec="k", ms=7)
    plane.plot(*ends.T, "-", color="k", lw=2)
plane.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Workspace of one assembly, and a circle")
for number, name in enumerate(robot.names):
    curves.plot(t, torque[:, number], label=f"{name} motor")
curves.set(xlabel="t [s]", ylabel="torque [N m]", title="Torques of the motors")
curves.legend()
plt.show()
