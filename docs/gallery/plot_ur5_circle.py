"""
A UR5 along a circle
====================

The tool of a UR5 is to draw a circle with its axis down. Every point of the circle has up to eight solutions. Taken
each by itself, they jump from one to another; followed as a path, they do not.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# The targets are 600 positions on a circle, and one attitude: the tool's z axis points down.
robot = hp.load_robot("ur5_robot")
angle = np.linspace(0, 2 * np.pi, 600)
R = np.array([0.4, 0.15, 0.2]) + 0.2 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
down = np.diag([1.0, -1, -1])
single = robot.inverse_kinematics(R, down, frame="tool0")
path = robot.inverse_kinematics_path(R, down, frame="tool0")
print("each by itself:", single.ok.all(), int((np.abs(np.diff(single.q, axis=0)).max(axis=1) > 0.5).sum()), "jumps")
print("as a path:     ", path.ok.all(), int(path.jumps.sum()), "jumps")

# %%
# All solutions of the first point, those nearest to zero first.
first = robot.inverse_kinematics(R[0], down, frame="tool0", q0=np.zeros(6), solutions=8)
print(f"{first.ok.sum()} solutions of the first point [deg]:")
print(np.degrees(first.q[first.ok]).round().astype(int))

# %%
# On the left the arm, at the solutions of the first point and along the path; on the right the angles of its joints.
links = ("base_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link", "tool0")
figure, panels = plt.subplot_mosaic(
    [["solutions of the first point", "each point by itself"], ["along the path", "as a path"]],
    per_subplot_kw={("solutions of the first point", "along the path"): {"projection": "3d"}},
    figsize=(11, 8),
    layout="constrained",
)
for title, axes in panels.items():
    axes.set_title(title)
for axes, q in zip((*panels.values(),)[::2], (first.q[first.ok], path.q[:-1:75]), strict=True):
    for number, points in enumerate(robot.forward_kinematics(q, frames=links).R):
        axes.plot(*points.T, "-o", color=plt.cm.viridis(number / len(q)), ms=3, lw=2)
    axes.plot(*R.T, "r", lw=1)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", xticks=(0, 0.3, 0.6), yticks=(0, 0.3))
    axes.set(xlim=(-0.2, 0.65), ylim=(-0.35, 0.4), zlim=(0, 0.7), zticks=(0, 0.3, 0.6))
    axes.set_box_aspect((0.85, 0.75, 0.7), zoom=0.95)
    axes.view_init(elev=24, azim=-110)
for axes, found in zip((*panels.values(),)[1::2], (single, path), strict=True):
    for name, values in zip(robot.names, found.q.T, strict=True):
        axes.plot(np.degrees(angle), np.degrees(values), ".", ms=2, label=name.removesuffix("_joint"))
    axes.set(ylabel="angle of the joint [deg]", xticks=range(0, 361, 90), ylim=(-200, 200))
axes.set_xlabel("place on the circle [deg]")
figure.legend(*axes.get_legend_handles_labels(), ncols=6, loc="outside lower right", fontsize=9, markerscale=5)
plt.show()
