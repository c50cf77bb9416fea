"""
A hatch with gas springs
========================

Two gas springs hold the hatch of a van open. Which hand force closes it, where does it open by itself, and how fast
does it reach the end of the stroke?

Dimensions and masses are assumed. The springs are chosen from a catalogue: F1 = 300 N, a progression F2/F1 of 1.35, a
stroke of 330 mm and 30 N of friction.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# The hinge is at the upper edge of the opening, along y; at psi = 0 the hatch hangs down, and a positive angle opens
# it towards the rear (x). Each gas spring runs from the side of the opening to the hatch. Its free length is the one
# that is reached when the hatch is open.
hatch = hp.Body(mass=24, centre_of_mass=(0.05, 0, -0.55), inertia=(2.4, 2.6, 0.6))
hinge = hp.HingePair(u1=(0, 0, 0), u2=(0, 0, 0), n=(0, -1, 0), name="hatch", body2=hatch)
body = hp.Mechanism([hinge]).with_frame("handle", "hatch", R=(0.08, 0, -1.05))
for side, y in (("left", 0.6), ("right", -0.6)):
    body = body.with_frame(f"foot {side}", "base", R=(0.058, y, -0.54)).with_frame(
        f"eye {side}", "hatch", R=(0.03, y, -0.26)
    )
gas = hp.GasSpring(F1=300, F2=1.35 * 300, stroke=0.33, friction=30)
with_springs = body
for side in ("left", "right"):
    ends = f"foot {side}", f"eye {side}"
    with_springs = with_springs.with_strut(*ends, side, force=gas, free_length=0.61, damping=250)

# %%
# The hand pushes at the handle across its lever, slowly (0.01 rad/s). On extension the friction of the springs acts
# against the opening, on compression against the closing. Between both the hatch creeps, for the friction of a
# `GasSpring` never sticks; friction that holds it is `HingeLoad(friction=...)` at the hinge.
opening = np.radians(np.linspace(0, 90, 181))[:, None]
lever = 1.05
force = {}
for name, rate in (("opening", 0.01), ("closing", -0.01)):
    moment = with_springs.bias_forces(opening, np.full_like(opening, rate))[:, 0]
    force[name] = moment / lever
    print(f"{name}: hand force {force[name].min():4.0f} to {force[name].max():3.0f} N")
balance = np.degrees(opening[np.argmax(force["opening"] < 0), 0])
print(
    f"the hatch opens by itself from {balance:.0f} degrees on; without springs the hand needs "
    f"{body.gravity_forces(opening)[:, 0].max() / lever:.0f} N"
)

# %%
# Left alone just above that angle, the hatch swings up; the simulation ends where the springs reach the end of their
# stroke, or their damping has brought it to rest.
t = np.linspace(0, 5, 1001)
swing = hp.simulate(
    with_springs, t, [np.radians(balance + 2)], [0.0], until=lambda _, now: now.q[:, 0] - np.radians(90)
)
extension = with_springs.struts(swing.q, swing.qd)["left"]
print(
    f"it swings to {np.degrees(swing.q[-1, 0]):.0f} degrees in {swing.t[-1]:.1f} s, "
    f"with {extension.rate[-1]:.2f} m/s at the spring"
)

figure, (side, hand, time) = plt.subplots(1, 3, figsize=(11, 4.2), layout="constrained")
for psi, shade in zip(np.radians((0, 45, 90)), (1.0, 0.5, 1.0), strict=True):
    state = body.forward_kinematics([psi], frames=("hatch", "handle", "foot left", "eye left"))
    for links, colour, width in ((("hatch", "handle"), "C0", 5), (("foot left", "eye left"), "C1", 3)):
        ends = np.array([state[link].R for link in links])
        side.plot(ends[:, 0], ends[:, 2], "-o", color=colour, lw=width, alpha=shade, mfc="w", mec="k", ms=6)
side.set(aspect="equal", xlabel="x [m]", ylabel="z [m]", title="Hatch and gas spring")
for name, values in force.items():
    hand.plot(np.degrees(opening), values, label=name)
hand.axhline(0, color="0.5", lw=1)
hand.set(xlabel="opening [degrees]", ylabel="force up [N]", title="Force of the hand", xticks=range(0, 91, 30))
hand.legend()
time.plot(swing.t, np.degrees(swing.q[:, 0]), label="opening [degrees]")
time.plot(swing.t, 100 * extension.rate, label="rate of the spring [cm/s]")
time.set(xlabel="t [s]", title="The hatch swings up")
time.legend()
plt.show()
