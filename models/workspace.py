"""Draw where the tool of a UR5 can be: a million configurations, in a plane through the axis and seen from above.

python models/workspace.py workspace.png
"""

from __future__ import annotations

import sys

import matplotlib as mpl
import numpy as np

import hingepair as hp

COUNT = 1_000_000
SLAB = (-0.1, 0.3)  # z seen from above [m]


def main(path: str) -> None:
    """Draw the density of the tool's position, tool positions a volume."""
    mpl.use("Agg")  # needs no screen
    from matplotlib import pyplot as plt

    robot = hp.load_robot("ur5_robot")
    least, most = robot.position_limits.T
    q = np.random.default_rng(1).uniform(least, most, (COUNT, robot.dof))
    x, y, z = robot.forward_kinematics(q, frames=("tool0",), outputs=("R",))["tool0"].R.T

    # Configurations a litre: in rings about the axis, and in squares of a slab.
    rings, edges, heights = np.histogram2d(np.hypot(x, y), z, (95, 200), ((0, 0.95), (-0.9, 1.1)))
    rings /= 1000 * np.pi * np.diff(edges**2)[:, None] * np.diff(heights)
    low, high = SLAB
    inside = (z > low) & (z < high)
    squares, across, along = np.histogram2d(x[inside], y[inside], 95, ((-0.95, 0.95), (-0.95, 0.95)))
    squares /= 1000 * (high - low) * np.diff(across)[:, None] * np.diff(along)

    figure, (side, above) = plt.subplots(1, 2, figsize=(9, 5), layout="constrained")
    style = {"cmap": "magma", "norm": mpl.colors.LogNorm(30, 3000), "rasterized": True}
    side.pcolormesh(edges, heights, np.where(rings > 0, rings, np.nan).T, **style)
    side.set(aspect="equal", xlabel="distance from the axis of joint 1 [m]", ylabel="z [m]", title="from the side")
    side.axhspan(low, high, fill=False, ec="0.5", ls="--")
    mesh = above.pcolormesh(across, along, np.where(squares > 0, squares, np.nan).T, **style)
    above.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="from above, between the dashed lines")
    figure.colorbar(mesh, ax=above, label="configurations a litre", shrink=0.8, extend="both")
    figure.suptitle(f"Where the tool of a UR5 is, at {COUNT:,} random configurations")
    figure.savefig(path, dpi=75)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "workspace.png")
