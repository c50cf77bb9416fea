"""
Cylinders of a backhoe
======================

Which forces must the three cylinders of a backhoe exert while it lifts a full bucket, over the strokes of the
cylinders? The bucket is turned through a four-bar, so that one cylinder drives a loop that drives the bucket.

Dimensions and masses are assumed, of the order of a backhoe of 8 t: boom 2.7 m, stick 1.7 m, and 600 kg of soil.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# The reference point of each body is the pivot that carries it, x points to the next pivot, and positive angles raise
# (the axes point along -y). A rocker on the stick and a link to the bucket are the four-bar.


def part(name, u1, mass, centre, inertia):
    """Return a hinge with the body that it carries."""
    body = hp.Body(mass, centre, (inertia / 4, inertia, inertia))
    return hp.HingePair(u1, (0, 0, 0), (0, -1, 0), name=name, body2=body)


joints = [
    part("boom", (0, 0, 0.6), 320, (1.3, 0, 0.15), 210),
    part("stick", (2.7, 0, 0), 190, (0.6, 0, 0.1), 60),
    part("bucket", (1.7, 0, 0), 150, (0.35, 0, -0.05), 15),
    part("rocker", (1.35, 0, 0.03), 20, (0.18, 0, 0), 0.4),
    part("link", (0.36, 0, 0), 22, (0.18, 0, 0), 0.4),
]
tree = hp.Mechanism(joints, parents=[0, 1, 2, 2, 4])
points = {
    "link end": ("link", (0.37, 0, 0)), "bucket eye": ("bucket", (0.02, 0, 0.3)), "teeth": ("bucket", (0.75, 0, 0)),
    "boom foot": ("base", (0.15, 0, 0.25)), "boom eye": ("boom", (1.3, 0, 0.1)),
    "stick foot": ("boom", (1.2, 0, 0.4)), "stick eye": ("stick", (-0.35, 0, 0.18)),
    "bucket foot": ("stick", (-0.05, 0, 0.42)), "rocker eye": ("rocker", (0.36, 0, 0)),
}  # fmt: skip
for name, (link, R) in points.items():
    tree = tree.with_frame(name, link, R=R)
cylinders = ("boom cylinder", "stick cylinder", "bucket cylinder")
ends = (("boom foot", "boom eye"), ("stick foot", "stick eye"), ("bucket foot", "rocker eye"))
for name, (foot, eye) in zip(cylinders, ends, strict=True):
    tree = tree.with_strut(foot, eye, name)
tree = tree.with_payload("bucket", mass=600, centre_of_mass=(0.4, 0, 0.1))

# %%
# Closed, it has three coordinates: the lengths of the cylinders. One loop is the four-bar of the bucket.
at = {"boom": 0.4, "stick": -1.3, "bucket": -0.9, "rocker": 1.3, "link": -1.2}
backhoe = tree.closed(hp.Loop("link end", "bucket eye"), coordinates=cylinders, at=at)

# %%
# First the boom is lifted over its stroke with the arm held out, then the stick is drawn in, then the bucket curls:
# one cylinder moves at a time. All forces are efforts of the coordinates, positive where they push; at rest they hold
# the weights.
start, steps = np.array((1.17, 1.42, 1.30)), (0.36, 0.40, 0.30)  # m
share = np.linspace(0, 1, 101)
figure, axes = plt.subplots(1, 4, figsize=(12, 4), layout="constrained", width_ratios=(1.5, 1, 1, 1))
names = ("boom", "stick", "bucket")
drawn = []
for number, step in enumerate(steps):
    lengths = np.tile(start, (len(share), 1))
    lengths[:, number] += step * share
    force = backhoe.gravity_forces(lengths) / 1e3
    for k, name in enumerate(names):
        axes[1 + number].plot(1e3 * lengths[:, number], force[:, k], label=name)
    axes[1 + number].set(xlabel=f"length of the {cylinders[number]} [mm]", title=f"The {names[number]} moves")
    axes[1 + number].axhline(0, color="0.5", lw=1)
    largest = np.abs(force).max(axis=0)
    print(f"{names[number]:6} moves: " + ", ".join(f"{n} {x:.0f} kN" for n, x in zip(names, largest, strict=True)))
    drawn.append(lengths[0])
    start = lengths[-1]
axes[1].set_ylabel("force that pushes [kN]")
axes[1].legend()

# %%
# The transmission tells how far the loops are from a dead point, where it is 0.
transmission = backhoe.transmission(np.array([*drawn, start]))
print("transmission of the loops at the four positions:", transmission.round(3))
bars = [
    ("boom", "stick"),
    ("stick", "bucket"),
    ("bucket", "teeth"),
    ("bucket", "bucket eye"),
    ("rocker", "link"),
    ("link", "link end"),
]
for lengths, shade in zip((*drawn, start), (0.25, 0.45, 0.7, 1.0), strict=True):
    state = backhoe.forward_kinematics(lengths, frames=(*names, "rocker", "link", *points))
    for pairs, colour, width in ((bars, "C0", 4), (ends, "C1", 2.5)):
        for pair in pairs:
            axes[0].plot(*np.array([state[end].R[::2] for end in pair]).T, color=colour, lw=width, alpha=shade)
axes[0].set(aspect="equal", xlabel="x [m]", ylabel="z [m]", title="Positions")
plt.show()
