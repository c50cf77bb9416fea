"""
A UR5 that moves with little effort
===================================

The tool of a UR5 is to go from its right to its left in one second, and to rest there. How it moves in between is
free: among all torques that bring it there, those with the least effort are sought, by shooting. A motion is stepped
through, its derivatives tell how every later state depends on every torque, and the torques are improved until
nothing is gained. The whole takes less than a second.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

robot = hp.load_robot("ur5_robot")
n, steps, dt = robot.dof, 50, 0.02
start = np.array([-1.2, -1.0, 1.2, -0.2, 1.57, 0.0])
goal = start + np.array([2.4, 0, 0, 0, 0, 0])
target = robot.forward_kinematics(goal, frames="tool0", outputs=("R",)).R[0]
accelerate = robot.prepare("forward_dynamics")
derive = accelerate.jacobian
place = robot.prepare("pose", frames="tool0", outputs=("R",))

# %%
# Torques count with their squares, each relative to what its motor can do; rates count a little, so that no joint
# spins for nothing. That the tool misses the target, or still moves there, counts so much that it hardly does.
effort = np.diag(dt / robot.effort_limits**2)
calm, miss, haste = 1e-3 * dt, 1e3, 1.0  # of (rad/s)^2 for a second; of m^2 and of (rad/s)^2 at the end


def shoot(tau):
    """Step through the motion of torques tau, (steps, n), and return the states q, qd, (steps + 1, 2, n)."""
    states = np.zeros((steps + 1, 2, n))
    states[0, 0] = start
    for k in range(steps):
        q, qd = states[k]
        qd = qd + dt * accelerate(q, qd, tau[k]).qdd
        states[k + 1] = q + dt * qd, qd
    return states


def cost(states, tau):
    """Return what is to become small."""
    off = place(states[-1, 0]).R[0] - target
    along = ((tau @ effort) * tau).sum() + calm * (states[:-1, 1] ** 2).sum()
    return (along + miss * off @ off + haste * (states[-1, 1] ** 2).sum()) / 2


def improve(states, tau):
    """Return changes of the torques, and feedback of the states to them, that make the cost least to first order.

    All steps are differentiated in one call. Then the recursion of the linear-quadratic regulator runs backwards.
    """
    a = derive((states[:-1, 0], states[:-1, 1], tau))["qdd"]
    eye = np.broadcast_to(np.eye(n), (steps, n, n))
    low = np.concatenate((dt * a["q"], eye + dt * a["qd"]), axis=-1)
    A = np.concatenate((np.concatenate((eye, 0 * eye), axis=-1) + dt * low, low), axis=-2)
    B = np.concatenate((dt * dt * a["tau"], dt * a["tau"]), axis=-2)
    J = robot.jacobian(states[-1, 0], "tool0")[:3]
    slope = np.concatenate((miss * J.T @ (place(states[-1, 0]).R[0] - target), haste * states[-1, 1]))
    curve = np.zeros((2 * n, 2 * n))
    curve[:n, :n], curve[n:, n:] = miss * J.T @ J, haste * np.eye(n)
    changes, feedback = np.zeros((steps, n)), np.zeros((steps, n, 2 * n))
    for k in reversed(range(steps)):
        inner = effort + B[k].T @ curve @ B[k]
        both = -np.linalg.solve(inner, np.column_stack((effort @ tau[k] + B[k].T @ slope, B[k].T @ curve @ A[k])))
        changes[k], feedback[k] = both[:, 0], both[:, 1:]
        slope = A[k].T @ (slope + curve @ B[k] @ changes[k])
        slope[n:] += calm * states[k, 1]
        curve = A[k].T @ curve @ (A[k] + B[k] @ feedback[k])
        curve = (curve + curve.T) / 2
        curve[n:, n:] += calm * np.eye(n)
    return changes, feedback


# %%
# The first guess turns the shoulder alone, smoothly, and keeps all other joints still. Each iteration tries the whole
# change and, if the cost does not fall, smaller parts of it.
s = np.linspace(0, 1, steps + 1)[:, None]
guess = start + (goal - start) * (10 * s**3 - 15 * s**4 + 6 * s**5)
rate, change = (goal - start) * 30 * s**2 * (1 - s) ** 2, (goal - start) * 60 * s * (1 - s) * (1 - 2 * s)
tau = robot.inverse_dynamics(guess, rate, change, outputs=("tau",)).tau[:-1]
by_hand = tau.copy()
derive((guess, rate, change))  # compiles

began = time.perf_counter()
states = shoot(tau)
costs = [cost(states, tau)]
for _ in range(40):
    changes, feedback = improve(states, tau)
    for part in (1, 0.5, 0.2, 0.05, 0.01):
        trial, found = tau.copy(), states.copy()
        for k in range(steps):
            trial[k] = tau[k] + part * changes[k] + feedback[k] @ (found[k] - states[k]).ravel()
            found[k + 1, 1] = found[k, 1] + dt * accelerate(found[k, 0], found[k, 1], trial[k]).qdd
            found[k + 1, 0] = found[k, 0] + dt * found[k + 1, 1]
        if cost(found, trial) < costs[-1]:
            break
    else:
        break
    states, tau = found, trial
    costs.append(cost(states, tau))
    if costs[-2] - costs[-1] < 2e-3 * costs[-1]:
        break
seconds = time.perf_counter() - began

before, after = (((one @ effort) * one).sum() for one in (by_hand, tau))
off = np.linalg.norm(place(states[-1, 0]).R[0] - target)
print(f"{len(costs) - 1} iterations in {seconds:.1f} s")
print(f"effort: {after / before:.0%} of that of the shoulder alone; the tool misses by {1000 * off:.1f} mm")

# %%
# The arm draws itself in, which lowers its inertia about the shoulder and what gravity asks of it, and stretches at
# the end.
links = ("base_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link", "tool0")
figure, panels = plt.subplot_mosaic(
    [["motion", "torques", "cost"]],
    per_subplot_kw={"motion": {"projection": "3d"}},
    width_ratios=(1.3, 1, 0.7),
    figsize=(12, 4.5),
    layout="constrained",
)
axes, torques, fall = panels.values()
for number, points in enumerate(robot.forward_kinematics(states[::5, 0], frames=links).R):
    axes.plot(*points.T, "-o", color=plt.cm.viridis(number / 10), ms=2, lw=1.5)
for q, style in ((states[:, 0], "r-"), (guess, "k--")):
    axes.plot(*robot.forward_kinematics(q, frames="tool0", outputs=("R",)).R[:, 0].T, style, lw=1)
axes.set(title="motion (dashed: the shoulder alone)", xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
axes.set(xticks=(0, 0.3, 0.6), yticks=(-0.5, 0, 0.5), zticks=(0, 0.3))
axes.set_aspect("equal")
for k, name in enumerate(robot.names[:4]):
    (line,) = torques.plot(dt * np.arange(steps), tau[:, k], label=name.removesuffix("_joint"))
    torques.plot(dt * np.arange(steps), by_hand[:, k], "--", color=line.get_color(), lw=1)
torques.legend(fontsize=8)
torques.set(title="torques (dashed: the shoulder alone)", xlabel="time [s]", ylabel="torque [N m]")
fall.semilogy(costs, "-o", ms=3)
fall.set(title="cost", xlabel="iteration")
plt.show()
