"""
A satellite unfolds a panel
===========================

While a spring unfolds the solar panel of a satellite in orbit, the satellite rotates in the opposite direction. By
which angle does it rotate, and at which rate does the panel reach its stop? Both bodies are free, and the motion
follows from their masses.

The satellite has the size and mass of ESA's PROBA-1 (0.6 x 0.6 x 0.8 m, 94 kg). The panel is invented: it is 1.2 m
long and has a mass of 4 kg.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# Reference points are the centres of the bodies. At psi = 0 the panel lies along the side of the satellite; at 90
# degrees it points away from it. `home`, the rotation of body 2 relative to body 1 at psi = 0, turns the x axis of
# the panel, its long side, into the direction of -z.
satellite = hp.Body(mass=94, shapes=[hp.Box(size=(0.6, 0.6, 0.8))])
panel = hp.Body(mass=4, shapes=[hp.Box(size=(1.2, 0.6, 0.02))])
stowed = hp.rodrigues((0, 1, 0), np.pi / 2)
pair = hp.HingePair(u1=(0.31, 0, 0.4), u2=(-0.6, 0, 0), n=(0, -1, 0), home=stowed, body1=satellite, body2=panel)
start = hp.BodyMotion.at_rest()

# %%
# The torque of the spring is 0.3 N m when the panel is stowed. When the panel is unfolded, a torque of 0.1 N m holds
# it against the stop. The torque of dry friction is 0.03 N m. The motion is computed without and with an eddy-current
# damper.
t = np.linspace(0, 15, 1501)
motions, turns = {}, {}
for name, damping in {"no damper": 0.0, "1 N m s/rad": 1.0}.items():
    hinge = hp.HingeLoad(
        stiffness=0.127,
        rest=2.36,
        damping=damping,
        friction=0.03,
        stops=(0, np.pi / 2),
        stop_restitution=0.3,
    )
    motion = motions[name] = hp.simulate(pair, t, start, 0.0, 0.0, hinge_torque=hinge, gravity=(0, 0, 0))
    turn = turns[name] = np.degrees(np.arctan2(motion.S1[:, 0, 2], motion.S1[:, 2, 2]))  # of the satellite about y
    arrival = np.argmax(motion.psi > np.radians(89))
    kinetic = motion.energy().kinetic
    momentum = motion.momentum()
    print(
        f"{name:12} out after {t[arrival]:5.2f} s at {np.degrees(motion.psid[arrival]):5.2f} deg/s with "
        f"{1000 * kinetic[arrival]:.0f} mJ; the satellite ends at {turn[-1]:.2f} degrees; "
        f"angular momentum within {np.abs(momentum.angular).max():.0e} N m s of zero"
    )

# %%
# The angle by which the satellite rotates does not depend on the damper: no external torque acts, so in a planar
# motion its attitude follows from the hinge angle alone. The damper dissipates the energy that the stop would
# otherwise have to absorb.
figure, (plan, angles, rates) = plt.subplots(1, 3, figsize=(11, 4.2), layout="constrained", width_ratios=(0.9, 1, 1))
for name, motion in motions.items():
    (line,) = angles.plot(t, np.degrees(motion.psi), label=f"panel, {name}")
    angles.plot(t, 10 * turns[name], "--", color=line.get_color(), label="satellite, times 10")
    rates.plot(t, np.degrees(motion.psid), color=line.get_color(), label=name)
motion = motions["1 N m s/rad"]
half_satellite, half_panel = np.array((0.3, 0, 0.4)), np.array((0.6, 0, 0.01))
outline = np.array([(-1, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)])
for now in (0, 500, 1500):
    shade = plt.cm.cividis(0.85 - 0.85 * motion.psi[now] / (np.pi / 2))
    for R, S, half, colour in (
        (motion.R1[now], motion.S1[now], half_satellite, "0.5"),
        (motion.R2[now], motion.S2[now], half_panel, shade),
    ):
        points = R + (outline * half) @ S.T
        plan.fill(points[:, 0], points[:, 2], fc="none" if colour == "0.5" else shade, ec=colour, lw=1.5)
plan.set(aspect="equal", xlabel="x [m]", ylabel="z [m]", title="From the side, at 0, 5 and 15 s")
angles.set(xlabel="t [s]", ylabel="angle [degrees]", title="Angles of panel and satellite")
angles.legend(fontsize="small")
rates.set(xlabel="t [s]", ylabel="hinge rate [deg/s]", title="Hinge rate")
rates.legend()
plt.show()
