"""
An excavator that digs
======================

Which torques about the pivots must the cylinders of an excavator exert while the bucket cuts soil and lifts it? The
inverse dynamics of a chain of three hinges with a load at the teeth computes them.

Dimensions, masses and digging forces are assumed, of the order of an excavator of 20 t: boom 5.7 m, stick 2.9 m,
radius of the bucket 1.45 m, and largest digging forces of 150 kN by the cylinder of the bucket and 106 kN by that of
the stick.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicSpline

import hingepair as hp

# %%
# The reference point of each body is the pivot that carries it (u2 = 0), and its x axis points to the next pivot.
# All hinge axes point along -y, so that a positive angle raises the body. Lengths are in metres, masses in kilograms,
# angles in radians.
axis, pivot = (0, -1, 0), (0, 0, 0)
boom = hp.Body(mass=1750, centre_of_mass=(2.7, 0, 0.45), inertia=(260, 5200, 5100))
stick = hp.Body(mass=950, centre_of_mass=(1.05, 0, 0.12), inertia=(60, 1050, 1020))
bucket = hp.Body(mass=820, centre_of_mass=(0.65, 0, -0.25), inertia=(210, 240, 260))
hinges = [
    hp.HingePair(u1=(0.35, 0, 1.8), u2=pivot, n=axis, name="boom", body2=boom),
    hp.HingePair(u1=(5.68, 0, 0), u2=pivot, n=axis, name="stick", body2=stick),
    hp.HingePair(u1=(2.92, 0, 0), u2=pivot, n=axis, name="bucket", body2=bucket),
]
machine = hp.Mechanism(hinges).with_frame("teeth", link="bucket", R=(1.45, 0, 0))

# %%
# A spline through way points gives the motion: the arm reaches out, cuts, curls the bucket and lifts it.
instants = [0, 2.5, 4, 5.5, 7.5, 11]
way_points = np.array(
    [
        (0.54, -1.42, -0.60),
        (0.28, -1.23, -0.35),
        (0.18, -1.46, -0.80),
        (0.07, -1.58, -1.37),
        (0.38, -1.85, -2.25),
        (0.75, -1.80, -2.30),
    ]
)
path = CubicSpline(instants, way_points, bc_type="clamped")
t = np.linspace(0, 11, 551)
q, qd, qdd = path(t), path(t, 1), path(t, 2)
state = machine.forward_kinematics(q, qd, frames=("boom", "stick", "bucket", "teeth"))
teeth = state["teeth"]

# %%
# The soil resists with a force of up to 60 kN while the teeth are below the ground and move towards the machine, and
# the bucket fills with 1.1 m^3 of soil of 1700 kg/m^3. A wrench consists of a force at the origin of a link and a
# torque, so the moments of both forces about this point are added.
speed = np.linalg.norm(teeth.v, axis=-1)
below = np.clip(-teeth.R[:, 2] / 0.2, 0, 1)  # 0 above the ground, 1 from 0.2 m below it
cut = below * np.clip(-teeth.v[:, 0] / np.maximum(speed, 0.05), 0, 1)
cutting = -60e3 * cut[:, None] * teeth.v / np.maximum(speed, 0.05)[:, None]
filling = np.cumsum(cut * speed)
weight = np.array((0, 0, -9.81)) * 1.1 * 1700 * (filling / filling[-1])[:, None]
middle = state["bucket"].S @ (0.65, 0, -0.25)
moment = np.cross(teeth.R - state["bucket"].R, cutting) + np.cross(middle, weight)
tau = machine.inverse_dynamics(q, qd, qdd, wrenches={"bucket": (cutting + weight, moment)}).tau / 1000
empty = machine.inverse_dynamics(q, qd, qdd).tau / 1000
for number, name in enumerate(machine.names):
    largest_empty, largest = np.abs(empty[:, number]).max(), np.abs(tau[:, number]).max()
    print(f"{name:6}  empty {largest_empty:5.0f} kN m, digging {largest:5.0f} kN m")

# %%
# The largest digging forces correspond to torques of 150 kN x 1.45 m = 218 kN m about the pivot of the bucket and,
# with the teeth 3.6 m from it, about 106 kN x 3.6 m = 380 kN m about the pivot of the stick (dashed lines). At 60 kN
# neither is reached; the torque of the boom is largest while the full bucket leaves the ground.
figure, (side, curves) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained", width_ratios=(1.25, 1))
side.axhspan(-2.2, 0, color="tan", alpha=0.5, lw=0)
side.plot(*teeth.R[:, ::2].T, "k", lw=1, label="path of the teeth")
for instant, shade in zip((0, 2.8, 5.0, 11), (0.25, 0.5, 0.75, 1), strict=True):
    now = np.searchsorted(t, instant)
    points = np.vstack([state[link].R[now] for link in ("boom", "stick", "bucket", "teeth")])
    side.plot(
        points[:, 0], points[:, 2], "-o", color="darkorange", lw=6 * shade + 1, alpha=shade, ms=4, mec="k", mfc="w"
    )
    side.annotate(f"{instant:g} s", points[-1, ::2], (12, -12), textcoords="offset points")
side.add_patch(plt.Rectangle((-2.2, 1.0), 2.7, 1.5, color="dimgray"))
side.add_patch(plt.Rectangle((-1.8, 0), 3.4, 0.95, color="0.25"))
side.set(
    aspect="equal", xlabel="x [m]", ylabel="z [m]", xlim=(-2.5, 9.5), ylim=(-2.2, 6.5), title="Positions of the arm"
)
side.legend(loc="upper left")
for number, name in enumerate(machine.names):
    (line,) = curves.plot(t, tau[:, number], label=f"{name}, digging")
    curves.plot(t, empty[:, number], ":", color=line.get_color(), label=f"{name}, empty")
    limit = {"stick": 380, "bucket": 218}.get(name)
    if limit:
        curves.axhline(-limit, color=line.get_color(), ls="--", lw=1)
        curves.text(11, -limit + 8, f"limit of the {name}", ha="right", color=line.get_color(), fontsize="small")
curves.set(xlabel="t [s]", ylabel="torque about the pivot [kN m]", title="Torques of the cylinders", ylim=(-420, 560))
curves.legend(ncols=3, fontsize="x-small", loc="upper left")
plt.show()
