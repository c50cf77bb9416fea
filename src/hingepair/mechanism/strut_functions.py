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


def pushed_frames(tree: Tree) -> tuple[str, ...]:
    """Return the names of the frames on which functions push."""
    return tuple(dict.fromkeys(end for strut in tree.struts if strut.function is not None for end in strut.ends))


def with_function_wrenches(
    compute: Callable[[str, tuple[Any, ...], dict[str, Any]], Any],
    tree: Tree,
    q: Coordinates,
    qd: Coordinates | None,
    base_motion: BodyMotion | None,
    wrenches: Mapping[str, tuple[Any, Any]] | None,
) -> dict[str, tuple[Any, Any]]:
    """Return wrenches on frames with those of struts whose force is a function.

    Args:
        compute: what the robot's methods do, by the name of a task, arguments and options.
        tree: the robot.
        q: coordinates.
        qd: their rates; None: 0.
        base_motion: of which the pose counts.
        wrenches: further ones, (force, torque) by frame.
    """
    pose = None if base_motion is None else BodyMotion(R=base_motion.R, S=base_motion.S)
    at = compute("pose", (q,), {"frames": pushed_frames(tree), "base_motion": pose})
    states = compute("struts", (q, (0.0,) * len(tree.coordinates) if qd is None else qd), {})
    total = dict(wrenches or {})
    for place, strut in enumerate(tree.struts):
        if strut.function is not None:
            length, rate = states["strut_length"][..., place], states["strut_rate"][..., place]
            first, second = (at[end].R for end in strut.ends)
            push = (function_force(strut, length, rate) / length)[..., None] * (second - first)
            for end, force in zip(strut.ends, (-push, push), strict=True):
                before, torque = total.get(end, (0.0, 0.0))
                total[end] = np.asarray(before) + force, torque
    return total
