"""
Landing gear extended by gravity
================================

When the hydraulic pump of an aircraft fails, the landing gear must extend by its own weight. Does it reach its stop
against the drag, and which load does its hinge carry? The motion of the leg is simulated, and the load of the bearing
follows from the motion.

The dimensions are assumed, of the order of a light aircraft: a leg of 0.95 m and 21 kg, at airspeeds of 40 m/s and
65 m/s. The hinge axis is inclined, so that the wheel moves outward and backward together.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# Body 1 is the aircraft, with x forward, y to the left and z up; its reference point is its centre of gravity. Body 2
# is the leg of the left wheel; its reference point is the hub. At psi = 0 the gear is extended, at 90 degrees it is
# in the wing.
leg = hp.Body(mass=21, centre_of_mass=(0, 0.02, 0.2), inertia=(1.9, 1.9, 0.2))
axis = (-np.cos(np.radians(20)), -np.sin(np.radians(20)), 0.12)
rake = hp.rodrigues((0, 1, 0), np.radians(8))  # on the ground the leg is raked back
gear = hp.HingePair(u1=(0.35, 1.4, -0.55), u2=(0, 0.05, 0.95), n=axis, home=rake, body2=leg)
aircraft = hp.BodyMotion.at_rest()

# %%
# A damper in the actuator slows the leg, and the stop at psi = 0 is a stiff spring with damping. The drag of the
# wheel acts at the hub: half the density times a drag area of 0.06 m^2 times the square of the airspeed. In flight
# with a load factor N, the apparent gravity in the aircraft is N times 9.81 m/s^2.
hinge = hp.HingeLoad(damping=60, friction=6, stops=(0, np.pi / 2), stop_stiffness=2e5, stop_damping=0.5)
t = np.linspace(0, 3, 3001)
cases = {"40 m/s, 1 g": (40, 1.0), "40 m/s, 1.5 g": (40, 1.5), "65 m/s, 1 g": (65, 1.0)}
angle, moment = {}, {}  # hinge angle [degrees] and bending moment of the bearing [N m] over time
for name, (airspeed, load_factor) in cases.items():
    gravity = (0, 0, -9.81 * load_factor)
    drag = np.array((-0.5 * 1.2 * 0.06 * airspeed**2, 0, 0))
    fall = hp.simulate(
        gear, t, aircraft, np.pi / 2, 0.0, hinge_torque=hinge, force2=drag, gravity=gravity, base="fixed"
    )
    # The wrench of the hinge on the leg is the wrench that the motion requires, minus the wrench of the drag.
    wrench = gear.hinge_wrench(aircraft, fall.psi, fall.psid, fall.psidd, gravity=gravity)
    lever = -np.einsum("tij,j->ti", fall.S2, gear.u2)  # from the hinge point to the hub
    force = wrench.force - drag
    torque = wrench.torque - np.cross(lever, drag)
    bending = torque - np.outer(torque @ gear.n, gear.n)
    down = np.argmax(fall.psi < np.radians(0.2))
    rate = np.degrees(abs(fall.psid[down])) if down else 0
    print(
        f"{name:14} down after {t[down]:.2f} s at {rate:.0f} deg/s, "
        f"force {np.linalg.norm(force, axis=1).max():.0f} N, bending {np.linalg.norm(bending, axis=1).max():.0f} N m"
    )
    angle[name], moment[name] = np.degrees(fall.psi), np.linalg.norm(bending, axis=1)

# %%
# The leg reaches the stop after about a second in all three cases. The bending moment of the bearing is due to the
# drag, which grows with the square of the airspeed; the impact on the stop adds a short peak, which grows with the
# hinge rate.
figure, (front, angles, loads) = plt.subplots(1, 3, figsize=(11, 4), layout="constrained", width_ratios=(0.9, 1, 1))
for name in cases:
    angles.plot(t, angle[name], label=name)
    loads.plot(t, moment[name], label=name)
for psi in np.radians((90, 65, 40, 20, 0)):
    state = gear.forward_kinematics_from_body1(aircraft, psi)
    hub, pin = state.R2, gear.u1
    wheel = hub[:, None] + 0.23 * state.S2[:, [0, 2]] @ np.array([np.cos(t * 2), np.sin(t * 2)])
    shade = plt.cm.viridis(0.9 - 0.5 * psi)
    front.plot([pin[1], hub[1]], [pin[2], hub[2]], color=shade, lw=4)
    front.plot(wheel[1], wheel[2], color=shade, lw=1.5)
front.plot(gear.u1[1], gear.u1[2], "ko")
front.fill([-0.1, 2.6, 2.6, -0.1], [-0.55, -0.42, -0.3, -0.3], color="0.7", zorder=0)
front.set(aspect="equal", xlabel="y, to the left [m]", ylabel="z [m]", title="The left leg, seen from the front")
front.invert_xaxis()
angles.set(xlabel="t [s]", ylabel="hinge angle [degrees]", title="Hinge angle")
angles.legend()
loads.set(xlabel="t [s]", ylabel="bending moment of the bearing [N m]", title="Load of the bearing")
loads.legend()
plt.show()
