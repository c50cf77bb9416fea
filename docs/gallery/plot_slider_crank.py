"""
Forces in a slider-crank
========================

A piston compressor runs at 1,500 rpm. Which torque does its crank need over a turn, and which forces act in the
piston pin and on the wall of the cylinder?

The dimensions are assumed: a stroke of 60 mm, a connecting rod of 110 mm, a bore of 50 mm, and air that is compressed
from 1 to 8 bar.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# The tree: a crank and on it the connecting rod; and the piston, a slider on the base along x. The loop is the
# piston pin, a point that rod and piston share.
throw, rod_length, bore = 0.03, 0.11, 0.05  # m
joints = [
    hp.HingePair(
        (0, 0, 0), (0, 0, 0), (0, 0, 1), name="crank", body2=hp.Body(0.6, (0.006, 0, 0), (2e-4, 3e-4, 5e-4))
    ),
    hp.HingePair(
        (throw, 0, 0), (0, 0, 0), (0, 0, 1), name="rod", body2=hp.Body(0.25, (0.035, 0, 0), (3e-5, 4e-4, 4e-4))
    ),
    hp.Slider((0, 0, 0), (0, 0, 0), (1, 0, 0), name="piston", body2=hp.Body(0.3, inertia=(1e-4, 1e-4, 1e-4))),
]
tree = hp.Mechanism(joints, parents=[0, 1, 0]).with_frame("pin", "rod", R=(rod_length, 0, 0))
compressor = tree.closed(hp.Loop("pin", "piston"), coordinates="crank", at={"piston": throw + rod_length})

# %%
# The piston's position, speed and acceleration follow from the crank's. The pressure is that of a polytropic
# compression and expansion with 5 % clearance; it acts on the piston as an outer force.
crank = np.linspace(0, 2 * np.pi, 1441)[:, None]
rate = np.full_like(crank, 1500 * 2 * np.pi / 60)
position, speed, acceleration = (joints[:, 2] for joints in compressor.all_coordinates(crank, rate, 0 * crank))
top = throw + rod_length
volume = 0.05 + (top - position) / (2 * throw)  # of the swept volume
out = speed > 0  # towards the head: compression, then delivery at 8 bar; back: expansion, then suction at 1 bar
pressure = np.where(out, np.minimum(8, (1.05 / volume) ** 1.3), np.maximum(1, 8 * (0.05 / volume) ** 1.3))
gas = np.zeros((len(crank), 3))
gas[:, 0] = -(pressure - 1) * 1e5 * np.pi * bore**2 / 4
loads = {"piston": (gas, 0)}
torque = compressor.inverse_dynamics(crank, rate, 0 * crank, wrenches=loads).tau[:, 0]
pin = compressor.loop_wrenches(crank, rate, 0 * crank, wrenches=loads)["pin-piston"].force
idle = compressor.inverse_dynamics(crank, rate, 0 * crank).tau[:, 0]

# %%
# The rod pushes the piston sideways with the y component of the force in the pin. The mean torque is the work of the
# gas in a turn, whatever the masses do in between.
work = np.trapezoid(-gas[:, 0] * speed / rate[:, 0], crank[:, 0])
print(f"mean torque {torque[:-1].mean():.2f} N m, work of the gas {work:.1f} J a turn: {work / (2 * np.pi):.2f} N m")
print(f"largest acceleration of the piston {np.abs(acceleration).max() / 9.81:.0f} g")
largest, wall = np.linalg.norm(pin[:, :2], axis=1).max(), np.abs(pin[:, 1]).max()
print(f"largest force in the pin {largest:.0f} N, on the wall {wall:.0f} N")

figure, axes = plt.subplots(1, 3, figsize=(11, 4), layout="constrained")
degrees = np.degrees(crank[:, 0])
axes[0].plot(1e3 * position, pressure, "k")
axes[0].set(xlabel="piston [mm]", ylabel="pressure [bar]", title="Pressure over the stroke")
axes[1].plot(degrees, torque, label="with gas")
axes[1].plot(degrees, idle, "--", label="masses alone")
axes[1].axhline(torque[:-1].mean(), color="0.5", lw=1)
axes[1].set(xlabel="crank [degrees]", ylabel="torque [N m]", title="Torque of the crank", xticks=range(0, 361, 90))
axes[1].legend()
axes[2].plot(degrees, pin[:, 0] / 1e3, label="along the cylinder")
axes[2].plot(degrees, pin[:, 1] / 1e3, label="on the wall")
axes[2].set(xlabel="crank [degrees]", ylabel="force [kN]", title="Force in the piston pin", xticks=range(0, 361, 90))
axes[2].legend()
plt.show()
