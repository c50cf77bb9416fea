"""Closed mechanisms for tests: a crank-rocker of 0.3, 0.9, 0.7 and 1 m with any kind of loop."""

from __future__ import annotations

import hingepair as hp

KINDS = ("ball", "hinge", "weld", "distance")
AT = {"crank": 0.3, "coupler": 0.8, "rocker": 1.9}
_TILT = hp.rotation_exp((0.2, -0.1, 0.4))  # of welded frames


def bar(name, u1, length, n=(0, 0, 1), **body1):
    """Return a hinge at u1 with a bar."""
    body = hp.Body(2 * length, (length / 2, 0, 0), (0.01, length**3 / 6, length**3 / 6 + 0.01))
    return hp.HingePair(u1, (0, 0, 0), n, name=name, body2=body, **body1)


def open_four_bar(crank=0.3, coupler=0.9, rocker=0.7, base="fixed", n=(0, 0, 1)):
    """Return the tree of a four-bar, with the frames a and b that meet."""
    body1 = {"body1": hp.Body(3, inertia=(1, 1, 1))}
    bars = [
        bar("crank", (0, 0, 0), crank, n, **body1), bar("coupler", (crank, 0, 0), coupler, n),
        bar("rocker", (1, 0, 0), rocker, n),
    ]  # fmt: skip
    robot = hp.Mechanism(bars, parents=[0, 1, 0], base=base)
    return robot.with_frame("a", "coupler", R=(coupler, 0, 0)).with_frame("b", "rocker", R=(rocker, 0, 0))


def four_bar(kind="ball", base="fixed", n=(0, 0, 1), coordinate="crank"):
    """Return a four-bar closed by a loop of a kind: welded with a further hinge, at a distance without the rocker."""
    tree, ends, at, more = open_four_bar(base=base, n=n), ("a", "b"), AT, {}
    if kind == "hinge":
        more = {"axis": n}
    if kind == "weld":
        joints = [tree["crank"], tree["coupler"], bar("knee", (0.9, 0, 0), 0.1, n), tree["rocker"]]
        tree = hp.Mechanism(joints, parents=[0, 1, 2, 0], base=base).with_frame("a", "knee", S=_TILT)
        tree, at = tree.with_frame("b", "rocker", R=(0.7, 0, 0), S=_TILT), {**AT, "knee": 0.8}
    if kind == "distance":
        tree = hp.Mechanism([tree["crank"], tree["coupler"]], base=base).with_frame("a", "coupler", R=(0.9, 0, 0))
        tree, ends, more = tree.with_frame("foot", "base", R=(1, 0, 0)), ("a", "foot"), {"length": 0.7}
        at = {name: AT[name] for name in ("crank", "coupler")}
    return tree.closed(hp.Loop(*ends, kind=kind, **more), coordinates=coordinate, at=at)
