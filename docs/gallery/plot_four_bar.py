"""
A four-bar that draws a straight line
=====================================

Hoeken's linkage turns the rotation of a crank into a stroke along a line, which a walking machine or a cutter needs.
How straight is the line, how even is the speed along it, and which torque drives the crank?

The bars have Hoeken's proportions 1 : 2 : 2.5 : 2.5 with a crank of 60 mm; their masses are assumed, 0.8 kg/m.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# The bars are a tree: the coupler hangs on the crank, the rocker on the base 120 mm from it. Closing the loop where
# coupler and rocker meet leaves one coordinate, the crank. The pen is at the other end of the coupler.
a = 0.06  # m


def bar(name, u1, length):
    """Return a hinge at u1 that carries a uniform bar of this length."""
    mass = 0.8 * length
    body = hp.Body(mass, (length / 2, 0, 0), (1e-6, mass * length**2 / 12, mass * length**2 / 12))
    return hp.HingePair(u1, (0, 0, 0), (0, 0, 1), name=name, body2=body)


bars = [bar("crank", (0, 0, 0), a), bar("coupler", (a, 0, 0), 5 * a), bar("rocker", (2 * a, 0, 0), 2.5 * a)]
tree = hp.Mechanism(bars, parents=[0, 1, 0])
tree = tree.with_frame("middle", "coupler", R=(2.5 * a, 0, 0)).with_frame("pen", "coupler", R=(5 * a, 0, 0))
tree = tree.with_frame("tip", "rocker", R=(2.5 * a, 0, 0))
hoeken = tree.closed(hp.Loop("middle", "tip"), coordinates="crank", at={"coupler": 1.0, "rocker": 1.6})

# %%
# All points, rates and torques are functions of the crank's angle. It turns at 60 rpm; gravity acts along -y.
crank = np.linspace(0, 2 * np.pi, 721)[:, None]
rate = np.full_like(crank, 2 * np.pi)
state = hoeken.forward_kinematics(crank, rate, frames=("crank", "coupler", "middle", "tip", "rocker", "pen"))
torque = hoeken.inverse_dynamics(crank, rate, 0 * crank, gravity=(0, -9.81, 0)).tau[:, 0]
pen, speed = state["pen"].R, state["pen"].v[:, 0]
straight = np.abs(crank[:, 0] - np.pi) < np.radians(90)  # half of a turn, symmetric about the crank at 180 degrees
height, width = pen[straight, 1], np.ptp(pen[straight, 0])
print(f"stroke {1e3 * width:.0f} mm in half of a turn, straight to {1e3 * np.ptp(height):.2f} mm")
print(f"speed there {np.abs(speed[straight]).min():.2f} to {np.abs(speed[straight]).max():.2f} m/s")
print(
    f"largest torque {np.abs(torque).max():.2f} N m; the rocker transmits at {hoeken.transmission(crank).min():.2f}"
)

# %%
# The pen stays within 0.6 mm on a line of 240 mm, and returns above it in the other half of the turn.
figure, (plane, curves) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained", width_ratios=(1.3, 1))
for now, shade in ((360, 1.0), (270, 0.35), (450, 0.35)):
    for links, colour in ((("crank", "coupler"), "C0"), (("coupler", "pen"), "C1"), (("rocker", "tip"), "C2")):
        ends = np.array([state[link].R[now] for link in links])
        plane.plot(*ends.T[:2], "-o", color=colour, alpha=shade, lw=4, mfc="w", mec="k", ms=6)
plane.plot(*pen.T[:2], "k", lw=1, label="path of the pen")
plane.plot(*pen[straight].T[:2], "r", lw=2.5, label="half of a turn")
plane.plot([0, 2 * a], [0, 0], "k^", ms=12)
plane.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Hoeken's linkage")
plane.legend(loc="lower right")
curves.plot(np.degrees(crank), speed, label="speed of the pen along x [m/s]")
curves.plot(np.degrees(crank), torque, label="torque of the crank [N m]")
curves.axvspan(90, 270, color="r", alpha=0.1)
curves.set(xlabel="crank [degrees]", title="Speed and torque at 60 rpm", xticks=range(0, 361, 90))
curves.legend()
plt.show()
