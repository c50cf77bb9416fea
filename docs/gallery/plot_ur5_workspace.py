"""
The workspace of a UR5
======================

Which positions can the tool of a robot reach? One call computes the tool positions of a million random configurations
of a UR5. Their density shows how many configurations reach a place: many where the picture is bright, few where it is
dark.
"""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# The robot is read from its URDF in the package example-robot-data. All joints are drawn uniformly within their
# limits.
COUNT = 1_000_000
robot = hp.load_robot("ur5_robot")
least, most = robot.position_limits.T
q = np.random.default_rng(1).uniform(least, most, (COUNT, robot.dof))

# %%
# `outputs=("R",)` requests only the position of the tool, so nothing else is computed.
x, y, z = robot.forward_kinematics(q, frames=("tool0",), outputs=("R",))["tool0"].R.T
print(f"smallest distance of the tool from the axis of joint 1: {np.hypot(x, y).min():.3f} m")
print(f"largest distance of the tool from the shoulder: {np.sqrt(x**2 + y**2 + (z - 0.089159) ** 2).max():.3f} m")

# %%
# The density, in configurations per litre, is computed for rings about the axis of joint 1 and for squares in a
# horizontal slice.
rings, edges, heights = np.histogram2d(np.hypot(x, y), z, (95, 200), ((0, 0.95), (-0.9, 1.1)))
rings /= 1000 * np.pi * np.diff(edges**2)[:, None] * np.diff(heights)
low, high = -0.1, 0.3  # the slice [m]
inside = (z > low) & (z < high)
squares, across, along = np.histogram2d(x[inside], y[inside], 95, ((-0.95, 0.95), (-0.95, 0.95)))
squares /= 1000 * (high - low) * np.diff(across)[:, None] * np.diff(along)

figure, (side, above) = plt.subplots(1, 2, figsize=(9, 5), layout="constrained")
style = {"cmap": "magma", "norm": mpl.colors.LogNorm(30, 3000), "rasterized": True}
side.pcolormesh(edges, heights, np.where(rings > 0, rings, np.nan).T, **style)
side.pcolormesh(-edges[::-1], heights, np.where(rings > 0, rings, np.nan)[::-1].T, **style)
side.axhspan(low, high, fill=False, ec="0.6", ls="--")
side.set(
    aspect="equal", xlabel="distance from the axis of joint 1, both sides [m]", ylabel="z [m]", title="From the side"
)
mesh = above.pcolormesh(across, along, np.where(squares > 0, squares, np.nan).T, **style)
above.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="From above, between the dashed lines")
figure.colorbar(mesh, ax=above, label="configurations per litre", shrink=0.8, extend="both")
figure.suptitle(f"Where the tool of a UR5 is, at {COUNT:,} random configurations")
plt.show()

# %%
# The tool never reaches the axis of joint 1: the wrist is 109 mm to one side of the vertical plane through this axis
# in which upper arm and forearm move, and the tool is 82 mm from the wrist. At least 27 mm remain in every
# configuration.
