"""
Where a Panda reaches with its hand down
========================================

A robot that picks things from a table needs its hand to point down; one that reaches into a shelf needs it level. How
much of what a Panda reaches is left with either wish? 5,000 targets in a vertical plane tell it in seconds.
"""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# The targets are a grid of positions of the hand, in a plane through the axis of the first joint. The hand's z axis
# has a direction; the turn about it is free.
panda = hp.load_robot("panda", locked={"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02})
x, z = np.linspace(0, 1, 51), np.linspace(-0.6, 1.3, 96)
R = np.stack(np.broadcast_arrays(x[:, None], 0.0, z), axis=-1)
anyhow = panda.inverse_kinematics(R, frame="panda_hand")
wishes = {"down": (0, 0, -1), "level, to the front": (1, 0, 0)}
found = {text: panda.inverse_kinematics(R, frame="panda_hand", direction=way) for text, way in wishes.items()}

# %%
# Each target stands for a ring about the axis of the first joint, if the hand may be turned with it.
rings = np.broadcast_to(x[:, None], anyhow.ok.shape)[anyhow.ok]
for text, one in found.items():
    print(f"hand {text}: {(rings * one.ok[anyhow.ok]).sum() / rings.sum():.0%} of the workspace")

# %%
# Blue is what is reached with the hand as wished. Where it is not, the colour tells how far the hand stays away in
# the closest pose found, in which a radian counts as much as the length of the arm.
figure, panels = plt.subplots(1, 2, figsize=(9.5, 5.6), layout="constrained", sharey=True)
for axes, (text, one) in zip(panels, found.items(), strict=True):
    missing = np.where(anyhow.ok & ~one.ok, 100 * one.position_error, np.nan)
    mesh = axes.pcolormesh(x, z, missing.T, cmap="YlOrRd", vmin=0, vmax=25)
    axes.pcolormesh(x, z, np.where(one.ok, 1.0, np.nan).T, cmap=mpl.colors.ListedColormap(["#1b5fa8"]))
    axes.contour(x, z, anyhow.ok.T, [0.5], colors="0.3", linewidths=1)
    axes.axhline(0, color="0.4", lw=0.8)
    axes.set(aspect="equal", xlabel="distance from the axis of joint 1 [m]", title=f"hand {text}")
panels[0].set_ylabel("z [m]")
figure.colorbar(mesh, ax=panels, label="distance of the hand from its target [cm]", extend="max")
figure.suptitle("Reached with the hand as wished (blue), in any attitude (outline)")
plt.show()
