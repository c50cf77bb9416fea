"""Draw the pictures of README and of the first page: `python docs/pictures.py` writes them into docs/_static.

Two of them are the figures of gallery scripts, drawn smaller.
"""

import runpy
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import hingepair as hp

DOCS = Path(__file__).parent


def trailer(axes):
    """Draw the area that a truck and its trailer sweep."""
    drive = runpy.run_path(str(DOCS / "gallery" / "plot_trailer.py"))
    for outline in (*drive["trailer"][::3], *drive["truck"][::3]):
        axes.fill(*outline.T, color="lightsteelblue", lw=0)
    for now in (0, 140, 290):
        axes.fill(*drive["trailer"][now].T, fc="w", ec="navy", lw=1)
        axes.fill(*drive["truck"][now].T, fc="gold", ec="k", lw=1)
    axes.set(aspect="equal", title="The path that a trailer sweeps")
    axes.axis("off")


def knee(axes):
    """Draw the angle of a knee that was identified from recorded markers."""
    walk = runpy.run_path(str(DOCS / "gallery" / "plot_knee.py"))
    fit = walk["fit"]
    axes.plot(100 * walk["share"], np.degrees(fit.psi), ".", ms=3)
    found = {
        "angle": f"{np.degrees(np.median(fit.std['psi'])):.2f} deg",
        "axis": f"{np.degrees(np.linalg.norm(fit.std['n'])):.2f} deg",
        "centre": f"{1000 * np.linalg.norm(fit.std['u1']):.1f} mm",
    }
    axes.text(3, 35, "\n".join(f"{name} +- {value}" for name, value in found.items()))
    axes.set(title="A knee from recordings, with +- values", xlabel="gait cycle [%]", ylabel="flexion [degrees]")
    axes.spines[["top", "right"]].set_visible(False)


def robot(axes):
    """Show the web page of a robot."""
    with Image.open(DOCS.parent / "models" / "page.gif") as page:
        page.seek(page.n_frames // 2)
        axes.imshow(page.convert("RGB").crop((0, 0, int(0.67 * page.width), int(0.9 * page.height))))
    axes.set(title="A robot on its web page")
    axes.axis("off")


def four_bar(axes):
    """Draw a four-bar and the curve of a point of its coupler."""
    bars = [("crank", (0, 0, 0)), ("coupler", (0.3, 0, 0)), ("rocker", (1, 0, 0))]
    joints = [hp.HingePair(u1, (0, 0, 0), (0, 0, 1), name=name) for name, u1 in bars]
    tree = hp.Mechanism(joints, parents=[0, 1, 0]).with_frame("a", "coupler", R=(0.9, 0, 0))
    tree = tree.with_frame("b", "rocker", R=(0.7, 0, 0)).with_frame("tip", "coupler", R=(0.5, 0.35, 0))
    linkage = tree.closed(hp.Loop("a", "b"), coordinates="crank", at={"crank": 0.3, "coupler": 0.8, "rocker": 1.9})
    turn = linkage.forward_kinematics(np.linspace(0, 2 * np.pi, 200)[:, None], frames=("tip", "coupler", "b"))
    axes.plot(*turn["tip"].R[:, :2].T, "C1", lw=2)
    tip, joint, end = (turn[name].R[25, :2] for name in ("tip", "coupler", "b"))
    axes.plot(*np.transpose([(0, 0), joint, end, (1, 0)]), "o-", color="navy", lw=3, ms=5)
    axes.fill(*np.transpose([joint, tip, end]), color="navy", alpha=0.25, lw=0)
    axes.plot([0, 1], [0, 0], "k^", ms=9, zorder=0)
    axes.set(aspect="equal", title="The coupler curve of a four-bar")
    axes.axis("off")


SPEED = {
    "pose": (7.4, 205),
    "Jacobian": (14, 338),
    "inverse dynamics": (15, 691),
    "forward dynamics": (31, 1530),
    "derivatives of torques": (108, 2440),
    "derivatives of accelerations": (177, 3530),
}
"""ns a state: `python benchmarks/robots.py --names panda --cpp --sizes 100000`, hingepair and Pinocchio in C++."""


def speed(axes):
    """Draw run times of a Panda arm."""
    place = np.arange(len(SPEED))
    ours, theirs = np.transpose([*SPEED.values()])
    axes.barh(place - 0.2, ours, 0.38, color="C1", label="hingepair")
    axes.barh(place + 0.2, theirs, 0.38, color="lightsteelblue", label="loop over Pinocchio in C++")
    for k, (own, other) in enumerate(SPEED.values()):
        axes.text(own * 1.1, k - 0.2, f"{own:g} ns", va="center", fontsize=8)
        axes.text(other * 1.1, k + 0.2, f"{other:,} ns", va="center", fontsize=8)
    axes.set(
        xscale="log", xlim=(2, 1e5), yticks=place, yticklabels=[*SPEED], title="Panda, a state in a call of 100,000"
    )
    axes.invert_yaxis()
    axes.set_xticks([])
    axes.set_xticks([], minor=True)
    axes.spines[["top", "right", "bottom"]].set_visible(False)
    axes.legend(loc="upper right", frameon=False)


def main():
    """Write all pictures."""
    plt.rcParams.update({"font.size": 9, "axes.titlesize": 10})
    figure, panels = plt.subplots(1, 4, figsize=(12, 2.9), layout="constrained")
    for draw, axes in zip((trailer, knee, robot, four_bar), panels, strict=True):
        draw(axes)
    figure.savefig(DOCS / "_static" / "examples.png", dpi=100, pil_kwargs={"optimize": True})
    figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
    speed(axes)
    figure.savefig(DOCS / "_static" / "speed.png", dpi=100, pil_kwargs={"optimize": True})


if __name__ == "__main__":
    main()
