"""
The turning circle of a truck and trailer
=========================================

In a turn, a trailer follows a smaller circle than the truck that pulls it. In the European Union, an articulated
vehicle must be able to turn within an annulus with an outer radius of 12.5 m and an inner radius of 5.3 m (Directive
96/53/EC, annex I, 1.5). Does this vehicle satisfy the requirement?

The dimensions are assumed, of a combination of 16.5 m: a tractor with a wheelbase of 3.6 m and a semitrailer with
7.7 m from the kingpin to the middle of its three axles. The motion is planar, with the coordinates x, y, phi and psi.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import hingepair as hp

# %%
# Body 1 is the tractor with its reference point in the middle of the rear axle. Body 2 is the semitrailer with its
# reference point in the middle of its axles. The x axes of both point forward. The kingpin is 0.6 m ahead of the rear
# axle of the tractor.
WIDTH = 2.55
TRACTOR = np.array([(-1.0, -1), (-1.0, 1), (5.0, 1), (5.0, -1)]) * (1, WIDTH / 2)  # corners [m]: front overhang 1.4 m
TRAILER = np.array([(-4.3, -1), (-4.3, 1), (9.0, 1), (9.0, -1)]) * (1, WIDTH / 2)
vehicle = hp.PlanarPair(u1=(0.6, 0), u2=(7.7, 0))

# %%
# The rear wheels of the tractor and the wheels of the trailer do not slip: the velocity v2 of the trailer's axle has
# no lateral component. v2 is linear in the hinge rate, so two calls determine the rate at which this component is
# zero.


def hinge_rate(phi, psi, phid):
    """Return the hinge rate [rad/s] of a trailer that rolls without slip, with the tractor at 1 m/s."""
    q = (0, 0, phi, psi)
    qd = (np.cos(phi), np.sin(phi), phid)
    held, turned = (vehicle.forward_kinematics(q, (*qd, rate)) for rate in (0, 1))
    across = np.array((-np.sin(held.phi2), np.cos(held.phi2)))
    return -(held.v2 @ across) / ((turned.v2 - held.v2) @ across)


# %%
# The outer front corner follows the outer circle, which determines the turning radius of the tractor's rear axle. The
# vehicle drives straight ahead first, and then one full turn to the left.
radius = brentq(lambda r: np.hypot(r + WIDTH / 2, 5.0) - 12.5, 5, 12)
length = 6 + 2 * np.pi * radius


def rates(s, state):
    """Return the rates of (x, y, phi, psi) along the path [1/m]."""
    phi, psi = state[2:]
    phid = 0 if s < 6 else min((s - 6) / 3, 1) / radius  # the steering wheel turns over 3 m of path
    return np.cos(phi), np.sin(phi), phid, hinge_rate(phi, psi, phid)


path = solve_ivp(rates, (0, length), (-6, 0, 0, 0), max_step=0.5, rtol=1e-8, dense_output=True)
s = np.linspace(0, length, 400)
x, y, phi, psi = path.sol(s)
state = vehicle.forward_kinematics((x, y, phi, psi))


def corners(R, angle, outline):
    """Return an outline in the world [m], shape (N, 4, 2)."""
    c, sn = np.cos(angle), np.sin(angle)
    return R[:, None] + outline @ np.stack((c, sn, -sn, c), axis=-1).reshape(-1, 2, 2)


truck = corners(np.stack((x, y), axis=-1), phi, TRACTOR)
trailer = corners(state.R2, state.phi2, TRAILER)
centre = np.array((x[-1], y[-1])) + radius * np.array((-np.sin(phi[-1]), np.cos(phi[-1])))
side = trailer[:, 1, None] + np.linspace(0, 1, 200)[:, None] * (trailer[:, 2] - trailer[:, 1])[:, None]
inner = np.linalg.norm(side - centre, axis=-1).min(axis=-1)
print(f"rear axle of the tractor at {radius:.2f} m from the centre, hinge at {np.degrees(psi[-1]):.1f} degrees")
print(f"inner side of the trailer at {inner.min():.2f} m: {'passes' if inner.min() >= 5.3 else 'fails'} (5.3 m)")

# %%
# The left figure shows the swept area, the right figure the distance of the trailer's inner side from the centre of
# the circle.
figure, (plan, curve) = plt.subplots(1, 2, figsize=(10, 5.2), layout="constrained", width_ratios=(1.2, 1))
for outline in (*trailer[::3], *truck[::3]):
    plan.fill(*outline.T, color="lightsteelblue", lw=0)
for now in (0, 120, 250, 399):
    plan.fill(*trailer[now].T, fc="w", ec="navy", lw=1.2)
    plan.fill(*truck[now].T, fc="gold", ec="k", lw=1.2, alpha=0.9)
for limit in (5.3, 12.5):
    plan.add_patch(plt.Circle(centre, limit, fill=False, color="r", ls="--", lw=1.5))
plan.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Swept area (dashed: limits)")
curve.plot(s, inner, label="inner side of the trailer")
curve.axhline(5.3, color="r", ls="--", label="limit: 5.3 m")
curve.plot(s, np.abs(np.degrees(psi)) / 10, "0.5", label="hinge angle")
curve.set(
    xlabel="path of the tractor [m]",
    ylabel="distance from the centre [m]; angle [10 degrees]",
    ylim=(0, 13),
    title="Off-tracking",
)
curve.legend()
plt.show()
