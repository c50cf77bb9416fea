"""Struts whose force is a function of users: evaluated between two programs, it acts as wrenches on two links."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.tree import Tree, TreeStrut
from hingepair.plans.arguments import Coordinates


def function_force(strut: TreeStrut, length: Any, rate: Any) -> Any:
    """Return the force [N] of a strut's function, an array of the shape of its length."""
    function: Callable[[Any, Any], Any] = strut.function  # type: ignore[assignment]
    found = np.asarray(function(length, rate), np.float64)
    if found.shape not in ((), np.shape(length)):
        expected = f"an array of the lengths' shape {np.shape(length)} from force(length, rate)"
        raise ArgumentError(f"force of strut {strut.name!r}", expected, f"shape {found.shape}")
    return np.broadcast_to(found, np.shape(length))


def pushed_links(tree: Tree) -> dict[int, str]:
    """Return a link of each body on which functions push, by the number of the body."""
    bodies = {frame.body for strut in tree.struts if strut.function is not None for frame in strut.frames}
    return {body: next(name for name, link in tree.links.items() if link.body == body) for body in sorted(bodies)}


def with_function_wrenches(
    compute: Callable[[str, tuple[Any, ...], dict[str, Any]], Any],
    tree: Tree,
    q: Coordinates,
    qd: Coordinates | None,
    base_motion: BodyMotion | None,
    wrenches: Mapping[str, tuple[Any, Any]] | None,
) -> dict[str, tuple[Any, Any]]:
    """Return wrenches on links with those of struts whose force is a function.

    Args:
        compute: what the robot's methods do, by the name of a task, arguments and options.
        tree: the robot.
        q: coordinates.
        qd: their rates; None: 0.
        base_motion: of which the pose counts.
        wrenches: further ones, (force, torque) by link.
    """
    links = pushed_links(tree)
    struts = [strut for strut in tree.struts if strut.function is not None]
    frames = dict.fromkeys((*(end for strut in struts for end in strut.ends), *links.values()))
    pose = None if base_motion is None else BodyMotion(R=base_motion.R, S=base_motion.S)
    at = compute("pose", (q,), {"frames": tuple(frames), "base_motion": pose})
    states = compute("struts", (q, (0.0,) * len(tree.coordinates) if qd is None else qd), {})
    total = {link: [np.asarray(part) for part in pair] for link, pair in (wrenches or {}).items()}
    for strut in struts:
        place = tree.struts.index(strut)
        length, rate = states["strut_length"][..., place], states["strut_rate"][..., place]
        first, second = (at[end].R for end in strut.ends)
        force = (function_force(strut, length, rate) / length)[..., None] * (second - first)
        for end, frame, push in zip((first, second), strut.frames, (-force, force), strict=True):
            link = links[frame.body]
            sums = total.setdefault(link, [np.zeros(3), np.zeros(3)])
            sums[0], sums[1] = sums[0] + push, sums[1] + np.cross(end - at[link].R, push)
    return {link: (force, torque) for link, (force, torque) in total.items()}
