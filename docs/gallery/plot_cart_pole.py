"""
A cart that swings up its pole
==============================

A pole of 1 m hangs from a cart, whose motor is too weak to lift it at once. A controller finds by sampling how to
swing it up and hold it there: every 20 ms it tries 256 courses of the force over the next 1.5 s, and averages them,
the better ones with larger weights (model predictive path integral control, MPPI). These are a million steps of the
model for each second of the motion.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

m, length = 0.3, 1.0  # kg, m; of the pole, a thin rod
across = m * length**2 / 12  # kg m^2
rod = hp.Body(m, inertia=(across, across, 1e-4))
box = hp.Body(1.0, inertia=(0.01, 0.01, 0.01))
robot = hp.Mechanism([
    hp.Slider(u1=(0, 0, 0), u2=(0, 0, 0), n=(1, 0, 0), body2=box, name="cart"),
    hp.HingePair(u1=(0, 0, 0), u2=(0, 0, length / 2), n=(0, 1, 0), body2=rod, name="pole"),
])  # fmt: skip

# %%
# Forces that are tried are the last plan and noise, which changes slowly. A future costs what its pole lacks of
# standing upright, and a little for the way of the cart and for rates near the top.
tries, horizon, dt, most = 256, 75, 0.02, 4.0  # 4 N at most
rng = np.random.default_rng(1)
lags = np.abs(np.subtract.outer(np.arange(horizon), np.arange(horizon)))
colour = 2.0 * np.linalg.cholesky(0.8**lags)  # N


def costs(futures):
    """Return the cost of each future."""
    x, psi, rate = futures.q[:, 1:, 0], futures.q[:, 1:, 1], futures.qd[:, 1:, 1]
    near_top = np.cos(psi) < -0.5
    return (1 + np.cos(psi) + 0.5 * x**2 + 0.02 * rate**2 * near_top + 50 * (np.abs(x) > 1.5)).sum(axis=1)


# %%
# The controller computes all futures in one call of ``rollout``, and a last one, of a single step, moves the cart.
q, qd, plan = np.zeros(2), np.zeros(2), np.zeros(horizon)
motion, forces, spent = [q], [], 0.0
for k in range(400):
    force = np.zeros((tries, horizon, 2))
    force[..., 0] = np.clip(plan + rng.normal(size=(tries, horizon)) @ colour.T, -most, most)
    began = time.perf_counter()
    futures = robot.rollout(q, qd, force, dt)
    spent += time.perf_counter() - began
    cost = costs(futures)
    weights = np.exp((cost.min() - cost) / 0.3)
    weights /= weights.sum()
    plan = weights @ force[..., 0]
    if k == 100:
        seen = futures.q, weights
    step = robot.rollout(q, qd, [[plan[0], 0.0]], dt)
    q, qd = step.q[-1], step.qd[-1]
    motion.append(q)
    forces.append(plan[0])
    plan = np.append(plan[1:], 0.0)
motion, t = np.array(motion), dt * np.arange(401)
height = -np.cos(motion[:, 1])
upright = t[np.flatnonzero(height < 0.95)[-1] + 1]
print(f"upright from {upright:.1f} s on, with {np.abs(forces).max():.1f} N at most")
print(f"the way of the cart: {np.ptp(motion[:, 0]):.1f} m")
print(f"rollouts take {spent / t[-1]:.1%} of the time of the motion")

# %%
# The pole swings higher four times. In the middle are the futures that are tried after 2 s: the more weight one has,
# the darker it is drawn.
figure, panels = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
for k in range(0, 300, 6):
    x, psi = motion[k]
    panels[0].plot((x, x - length * np.sin(psi)), (0, -length * np.cos(psi)), color=plt.cm.viridis(k / 300), lw=1.5)
panels[0].axhline(0, color="0.4", lw=0.8)
panels[0].set(aspect="equal", xlabel="x [m]", ylabel="z [m]", title="The first 6 s (from blue to yellow)")
paths, weights = seen
ahead = 100 * dt + dt * np.arange(horizon + 1)
for k in np.argsort(weights):
    shade = 0.15 + 0.85 * weights[k] / weights.max()
    panels[1].plot(ahead, -np.cos(paths[k, :, 1]), color="C0", alpha=shade, lw=0.6)
panels[1].plot(t, height, "k", lw=1.5)
panels[1].set(xlabel="time [s]", ylabel="height of the tip [m]", title="Height of the tip, and futures at 2 s")
panels[2].step(t[:-1], forces, where="post", lw=1)
panels[2].set(xlabel="time [s]", ylabel="force [N]", title="Force on the cart")
plt.show()
