"""
A trebuchet throws a stone
==========================

How far does a trebuchet throw, and when must the sling let the stone go? The machine is a robot of three hinges
without motors: a beam on an axle with dry friction, a counterweight that hangs from its short arm, and a sling at the
end of its long arm. `hp.simulate` computes the throw, and an event ends it where the sling opens.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# All hinges rotate about y, and at the angle 0 the x axes of beam, counterweight and sling point along the x axis of
# the world. The reference point of each body is the hinge that carries it. Links are depth-first, siblings by name.
AXLE, LONG, SHORT, HANGER, SLING = 6.0, 5.0, 1.2, 1.0, 4.0  # height of the axle and lengths [m]
G = 9.81  # m/s^2
timber = hp.Body(mass=160, shapes=[hp.Box((LONG + SHORT, 0.2, 0.25), center=((LONG - SHORT) / 2, 0, 0))])
iron = hp.Body(mass=1500, centre_of_mass=(HANGER, 0, 0), inertia=(250, 250, 250))
stone = hp.Body(mass=12, centre_of_mass=(SLING, 0, 0), inertia=(0.1, 0.1, 0.1))
beam = hp.HingePair(u1=(0, 0, AXLE), u2=(0, 0, 0), n=(0, 1, 0), body2=timber, name="beam")
weight = hp.HingePair(u1=(-SHORT, 0, 0), u2=(0, 0, 0), n=(0, 1, 0), body2=iron, name="counterweight")
sling = hp.HingePair(u1=(LONG, 0, 0), u2=(0, 0, 0), n=(0, 1, 0), body2=stone, name="sling")
trebuchet = hp.Mechanism([beam, weight, sling], parents=[0, 1, 1], name="trebuchet")
trebuchet = trebuchet.with_frame("stone", link="sling", R=(SLING, 0, 0))

# %%
# At the start the long arm points down and back, the counterweight hangs, and the sling lies level below the beam.
start = np.radians([130, -40, -130])
loads = {"beam": hp.HingeLoad(friction=250)}  # N m, of the axle
throw = hp.simulate(trebuchet, np.linspace(0, 1.6, 801), start, loads=loads)
print(throw.energy_balance())

# %%
# If the sling let the stone go at some instant of this motion, it would fly along a parabola from there.
R, v = throw["stone"].R, throw["stone"].v


def flight_range(R, v):
    """Return x where a stone with position R and velocity v reaches the ground [m]; shape (N,)."""
    return R[:, 0] + v[:, 0] * (v[:, 2] + np.sqrt(v[:, 2] ** 2 + 2 * G * np.maximum(R[:, 2], 0))) / G


best = int(np.argmax(flight_range(R, v)))
release = throw.q[best, 2]
print(f"release at {np.degrees(release):.0f} degrees between beam and sling, {flight_range(R, v)[best]:.0f} m")

# %%
# The event `until` ends the throw at this angle, to machine precision and not at the next instant. A hook
# that opens 10 degrees too early or too late costs a tenth of the range.
found = hp.simulate(trebuchet, throw.t, start, loads=loads, until=lambda _, now: now.q[:, 2] - release)
R0, v0 = found["stone"].R[-1], found["stone"].v[-1]
near = np.abs(throw.q[:, 2] - release) < np.radians(20)

fig, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), width_ratios=(1.2, 1))
time = np.linspace(0, (v0[2] + np.sqrt(v0[2] ** 2 + 2 * G * R0[2])) / G, 200)
left.plot(R0[0] + v0[0] * time, R0[2] + v0[2] * time - G / 2 * time**2, color="tab:red", linewidth=1)
state = found.state(("beam", "counterweight", "sling", "stone"))
for k in np.linspace(0, len(found.t) - 1, 9).astype(int):
    points = {name: state[name].R[k] for name in state.frames}
    iron_at = points["counterweight"] + state["counterweight"].S[k] @ (HANGER, 0, 0)
    line = np.array([iron_at, points["counterweight"], points["sling"], points["stone"]])
    shade = str(0.75 - 0.75 * k / (len(found.t) - 1))
    left.plot(line[:, 0], line[:, 2], color=shade, linewidth=1.2)
    left.plot(*iron_at[[0, 2]], "s", color=shade, markersize=7)
    left.plot(*points["stone"][[0, 2]], "o", color="tab:red", markersize=3)
left.plot(found["stone"].R[:, 0], found["stone"].R[:, 2], color="tab:red", linewidth=0.8)
left.axhline(0, color="0.4", linewidth=1)
left.set(xlabel="x [m]", ylabel="z [m]", title="the throw, and the flight that follows", aspect="equal")
left.set(xlim=(-10, 14), ylim=(-1, 20))
right.plot(np.degrees(throw.q[near, 2]), flight_range(R, v)[near])
right.axvline(np.degrees(release), color="tab:red", linewidth=1)
right.set(xlabel="angle between beam and sling [degrees]", ylabel="range [m]", title="where the sling opens")
right.grid(alpha=0.3)
fig.tight_layout()
plt.show()
