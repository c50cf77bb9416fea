"""
Force of a scissor lift
=======================

Which force must the cylinder of a scissor lift exert, from the lowest position to the highest, and how does it depend
on where the cylinder is mounted?

The lift has two stages with arms of 1.6 m and 25 kg each, and lifts 600 kg from 0.6 m to 2.6 m; all of it is assumed.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# Each stage has two arms that cross in their middles. The lower end of arm a is hinged to the ground, or to arm b of
# the stage below; arm b is hinged to a in the middle. What the tree leaves open are loops: the foot of the lowest b,
# which slides along the ground, and the upper end of each a, which meets the lower end of the next b.
length, stages = 1.6, 2
middle, end = (length / 2, 0, 0), (length, 0, 0)
arm = hp.Body(25, middle, (0.1, 6, 6))
cross = hp.Body(25, (0, 0, 0), (0.1, 6, 6))
joints, parents = [], []
for k in range(stages):
    joints += [
        hp.HingePair((0, 0, 0) if k == 0 else middle, (0, 0, 0), (0, 0, 1), name=f"a{k}", body2=arm),
        hp.HingePair(middle, (0, 0, 0), (0, 0, 1), name=f"b{k}", body2=cross),
    ]
    parents += [0 if k == 0 else 2 * k, 2 * k + 1]
joints.append(hp.Slider((0, 0, 0), (0, 0, 0), (1, 0, 0), name="foot", body2=hp.Body(5, inertia=(0.1, 0.1, 0.1))))
tree = hp.Mechanism(joints, parents=[*parents, 0])
for k in range(stages):
    tree = tree.with_frame(f"low b{k}", f"b{k}", R=(-length / 2, 0, 0)).with_frame(f"top b{k}", f"b{k}", R=middle)
    tree = tree.with_frame(f"top a{k}", f"a{k}", R=end)
loops = [hp.Loop("low b0", "foot"), *(hp.Loop(f"top a{k}", f"low b{k + 1}") for k in range(stages - 1))]
angle = 0.5  # rad, of an arm above the ground, where the lift is assembled
turned = np.pi - 2 * angle
at = {"foot": length * np.cos(angle), **{f"a{k}": angle if k == 0 else -turned for k in range(stages)}}
at |= {f"b{k}": turned for k in range(stages)}

# %%
# The platform and its load of 600 kg rest on both upper ends. A cylinder is a strut whose length is the coordinate,
# so that its force is tau. Two mountings are compared: along the ground to the sliding foot, which it pulls, and
# between the arms, from a bracket on the lowest arm a to one on the arm b above.
tree = tree.with_frame("top", "b1", R=middle).with_frame("bracket", "a0", R=(0.25, -0.1, 0))
tree = tree.with_frame("eye", "b1", R=(-0.35, -0.25, 0)).with_frame("corner", "base", R=(-0.6, 0, 0))
lift = tree.with_payload(f"top a{stages - 1}", mass=300).with_payload(f"top b{stages - 1}", mass=300)
by_foot = lift.closed(*loops, coordinates="foot", at=at)
foot = length * np.cos(np.linspace(0.19, 0.95, 200))[:, None]
joints_of_lift = by_foot.all_coordinates(foot)
height = by_foot.forward_kinematics(foot, frames="top")["top"].R[:, 1]
force, strokes = {}, {}
for name, ends in {"along the ground": ("corner", "foot"), "between the arms": ("bracket", "eye")}.items():
    driven = lift.with_strut(*ends, "cylinder")
    strokes[name] = driven.struts(joints_of_lift)["cylinder"].length
    closed = driven.closed(*loops, coordinates="cylinder", at=at)
    force[name] = closed.gravity_forces(strokes[name][:, None], gravity=(0, -9.81, 0))[:, 0] / 1e3
    print(
        f"{name}: stroke {1e3 * np.ptp(strokes[name]):.0f} mm, force {np.abs(force[name]).max():.0f} kN at "
        f"{height[0]:.2f} m, {np.abs(force[name]).min():.0f} kN at {height[-1]:.2f} m"
    )

# %%
# By energy, the mean force of each is the same work of lifting over its stroke.
points = [f"{end} {arm}{k}" for k in range(stages) for end, arm in (("top", "a"), ("top", "b"), ("low", "b"))]
points += ["corner", "foot", "bracket", "eye", *(f"a{k}" for k in range(stages))]
figure, (side, curves) = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained", width_ratios=(1, 1.2))
for now, shade in ((0, 0.35), (199, 1.0)):
    state = lift.forward_kinematics(joints_of_lift[now], frames=points)
    bars = [(f"{end}{k}", f"top {arm}{k}", "C0") for k in range(stages) for end, arm in (("a", "a"), ("low b", "b"))]
    for first, second, colour in (
        *bars,
        ("corner", "foot", "C1"),
        ("bracket", "eye", "C2"),
        ("top a1", "top b1", "k"),
    ):
        side.plot(*np.array([state[first].R[:2], state[second].R[:2]]).T, color=colour, lw=4, alpha=shade)
side.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="The lift, low and high")
for (name, values), colour in zip(force.items(), ("C1", "C2"), strict=True):
    curves.plot(height, values, color=colour, label=name)
curves.axhline(0, color="0.5", lw=1)
curves.set(xlabel="height of the platform [m]", ylabel="force that pushes [kN]", title="Force of the cylinder")
curves.legend()
plt.show()
