"""
A door closer
=============

A door closer is a spring that closes the door and a damper that limits its speed. How much damping does it need?
The motion of the door is simulated from its mass and from the torques at the hinge.

The door is 0.95 m wide and has a mass of 60 kg, the largest values for a closer of size 3 of EN 1154. The spring
torques are assumed. The ADA Standards for Accessible Design (404.2.8.1) require 5 s or more from 90 degrees to 12
degrees.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# Body 1 is the door frame, which is fixed. Body 2 is the leaf of the door, a box of 0.95 x 0.045 x 2.1 m with its
# reference point at its centre. The hinge axis is vertical, along the edge of the leaf. At psi = 0 the door is
# closed.
leaf = hp.Body(mass=60, shapes=[hp.Box(size=(0.95, 0.045, 2.1))])
door = hp.HingePair(u1=(0, 0, 1.05), u2=(-0.475, 0, 0), n=(0, 0, 1), body2=leaf)
frame = hp.BodyMotion.at_rest()
t = np.linspace(0, 9, 3001)

# %%
# The torque of the spring is 20 N m when the door is closed and 31 N m at 90 degrees, so it is zero at
# psi = -20/7 rad. The door frame is a rigid stop. The damper of a hydraulic closer is strong above the latching angle
# of 10 degrees and weaker below it. A function of this script computes the torque of the damper, and `HingeLoad` adds
# the torques of spring, friction and stop.
stiffness = 7.0  # N m/rad
latching = np.radians(10)


def closer(damping, latching_damping):
    """Return the hinge load: spring, damper [N m s/rad] above and below the latching angle, friction and stop."""

    def damper(_, psi, psid):
        share = 0.5 * (1 + np.tanh((psi - latching) / 0.02))
        return -(latching_damping + (damping - latching_damping) * share) * psid

    return hp.HingeLoad(
        stiffness=stiffness, rest=-20 / stiffness, motor=damper, friction=2, stops=(0, 2), stop_restitution=0.2
    )


cases = {  # damping above and below the latching angle [N m s/rad]
    "spring alone": (0, 0),
    "40 N m s/rad": (40, 40),
    "100 N m s/rad": (100, 100),
    "100, latching 40 N m s/rad": (100, 40),
}
motions = {}
for name, damping in cases.items():
    motion = motions[name] = hp.simulate(
        door, t, frame, np.radians(90), 0.0, hinge_torque=closer(*damping), base="fixed"
    )
    edge = 0.95 * np.abs(motion.psid)  # speed of the free edge [m/s]
    near, shut = (np.argmax(motion.psi < np.radians(angle)) for angle in (12, 0.2))
    print(f"{name:26} at 12 degrees after {t[near]:.1f} s, shut after {t[shut]:.1f} s at {edge[shut]:.2f} m/s")

# %%
# Without a damper, the edge reaches the frame at 1.9 m/s and rebounds. With 100 N m s/rad, the door needs 5.8 s to 12
# degrees, which satisfies the requirement of 5 s. In the last case the door also accelerates below the latching
# angle, so that it can overcome the latch.
figure, (above, angles, speeds) = plt.subplots(1, 3, figsize=(11, 4), layout="constrained", width_ratios=(0.8, 1, 1))
for name, motion in motions.items():
    angles.plot(t, np.degrees(motion.psi), label=name)
    speeds.plot(t, 0.95 * np.abs(motion.psid))
for psi in np.radians((90, 60, 30, 0)):
    middle = door.forward_kinematics_from_body1(frame, psi).R2
    above.plot((0, 2 * middle[0]), (0, 2 * middle[1]), lw=5, color=plt.cm.copper(1 - psi / 2), solid_capstyle="butt")
above.plot(0, 0, "ko", ms=7)
above.fill([-0.35, -0.02, -0.02, -0.35], [-0.1, -0.1, 0.1, 0.1], "0.6")
above.fill([0.97, 1.3, 1.3, 0.97], [-0.1, -0.1, 0.1, 0.1], "0.6")
above.set(aspect="equal", xlim=(-0.35, 1.3), ylim=(-0.2, 1.1), xlabel="x [m]", ylabel="y [m]", title="From above")
angles.set(xlabel="t [s]", ylabel="hinge angle [degrees]", title="Hinge angle")
angles.legend(fontsize="small")
speeds.set(xlabel="t [s]", ylabel="speed [m/s]", title="Speed of the free edge")
plt.show()
