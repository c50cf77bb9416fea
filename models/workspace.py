"""Draw where the tool of a UR5 can be: a million configurations, in a plane through the axis and seen from above.

python models/workspace.py workspace.png
"""

from __future__ import annotations

import sys

import matplotlib as mpl
import numpy as np

import hingepair as hp

COUNT = 1_000_000


def main(path: str) -> None:
    """Draw the density of the tool's position, tool positions a volume."""
    mpl.use("Agg")  # needs no screen
    from matplotlib import pyplot as plt

    robot = hp.load_robot("ur5_robot")
    least, most = robot.position_limits.T
    q = np.random.default_rng(1).uniform(least, most, (COUNT, robot.dof))
    x, y, z = robot.forward_kinematics(q, frames=("tool0",), outputs=("R",))["tool0"].R.T
    radius = np.hypot(x, y)
    figure, (side, above) = plt.subplots(1, 2, figsize=(9, 5), layout="constrained")
    style = {"bins": 200, "norm": "log", "cmap": "magma"}
    side.hist2d(radius, z, weights=1 / np.maximum(radius, 0.02), range=((0, 1), (-0.9, 1.1)), **style)
    side.set(aspect="equal", xlabel="distance from the axis [m]", ylabel="z [m]", title="through the axis")
    slab = abs(z - 0.1) < 0.2
    above.hist2d(x[slab], y[slab], range=((-1, 1), (-1, 1)), **style)
    above.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="from above, -0.1 m < z < 0.3 m")
    figure.suptitle(f"The tool of a UR5 at {COUNT:,} random configurations")
    figure.savefig(path, dpi=70)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "workspace.png")
