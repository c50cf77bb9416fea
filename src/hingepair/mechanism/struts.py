"""Struts between two frames of a mechanism: springs, dampers, gas springs, and forces by a table or a function."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.tree import Tree, TreeStrut, check_name
from hingepair.numeric.arrays import FloatArray, finite_number, number_not_below_0, one_constant, vectors
from hingepair.plans.arguments import Coordinates
from hingepair.plans.struts import Law

_SLACK: Final = 1e-6  # of the stroke: so far beyond its ends a motion may be that ends there


@dataclass(frozen=True, slots=True)
class GasSpring:
    """A gas spring by the values of its data sheet; its force pushes the points of its strut apart.

    The force on extension falls from F2, compressed by the stroke, to F1, extended; on compression it is larger by
    `friction`, and at rest by half of it, which changes over rates below 0.1 mm/s. Between F1 and F2 it is linear in
    the length, as data sheets draw it. Beyond the stroke, or the `limits` of the strut, it is NaN.

    This friction never sticks: a lid that it alone holds creeps. `HingeLoad(friction=...)` at the hinge holds it.

    Args:
        F1: force [N] extended, that is, at the `free_length` of the strut.
        F2: force [N] compressed by `stroke`.
        stroke: by how much it is compressed there [m].
        friction: force [N] by which compression exceeds extension.

    >>> import hingepair as hp
    >>> hp.GasSpring(F1=300, F2=400, stroke=0.2).stroke
    0.2
    """

    F1: float
    F2: float
    stroke: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        for name in ("F1", "F2", "stroke", "friction"):
            number_not_below_0(name, getattr(self, name))
        if self.stroke == 0:
            raise ArgumentError("stroke", "a length above 0", quoted(self.stroke))
        if self.F2 < self.F1:
            raise ArgumentError("F2", "at least F1, since a compressed gas pushes harder", quoted(self.F2))


def add_strut(
    tree: Tree,
    ends: tuple[str, str],
    name: str,
    force: Any,
    stiffness: float,
    free_length: float | None,
    damping: float,
    limits: ArrayLike | None,
) -> Tree:
    """Return a copy of a tree with a strut between two frames."""
    check_name("name", name)
    if name in {strut.name for strut in tree.struts} | {joint.name for joint in tree.joints}:
        raise ArgumentError("name", "a name that no joint and no other strut has", quoted(name))
    frames = tuple(tree.known_frame(argument, end) for argument, end in zip(("frame1", "frame2"), ends, strict=True))
    if frames[0].body == frames[1].body:
        got = f"{ends[0]!r} and {ends[1]!r} of one body"
        raise ArgumentError("frame2", "a frame of another body than frame1's", got)
    if any(frame.samples is not None or tree.has_sampled_axes(frame.body) for frame in frames):
        raise ArgumentError("frame1", "frames that are the same for all samples", f"{ends[0]!r} and {ends[1]!r}")
    function = force if callable(force) else None
    law = _law(None if callable(force) else force, stiffness, free_length, damping)
    ends_of_stroke = _limits(limits, force, free_length)
    if math.isfinite(ends_of_stroke[1]) and (force is not None or stiffness or damping):
        low, high = ends_of_stroke
        slack = _SLACK * (high - low)
        law = law._replace(limits=(low - slack, high + slack))
    strut = TreeStrut(name, ends, (frames[0], frames[1]), law, ends_of_stroke, function)
    return replace(tree, struts=(*tree.struts, strut), source=None)


def beyond_stroke(strut: TreeStrut, lengths: FloatArray) -> str | None:
    """Return at how many of the samples a strut is beyond its stroke, where its force is NaN, and how far; None where
    it is nowhere.

    Args:
        strut: the strut.
        lengths: its lengths [m]; shape (...).
    """
    low, high = strut.law.limits or (-math.inf, math.inf)
    beyond = np.maximum(low - lengths, lengths - high)
    bad = beyond > 0
    if not bad.any():
        return None
    furthest = float(np.ravel(lengths)[np.argmax(np.where(bad, beyond, 0.0))])
    count = f", at {int(bad.sum())} of {bad.size} samples" if bad.shape else ""
    low, high = strut.limits
    return (
        f"strut {strut.name!r}: {furthest:.4g} m is beyond its stroke, {low:.6g} to {high:.6g} m, where its "
        f"force is unknown{count}"
    )


def _limits(limits: ArrayLike | None, force: Any, free_length: float | None) -> tuple[float, float]:
    """Return the least and the greatest length: those given, or those of a gas spring's stroke."""
    if limits is not None:
        low, high = one_constant("limits", limits, 2).tolist()
        if not 0 <= low < high:
            raise ArgumentError("limits", "the least and the greatest length", quoted((low, high)))
        return low, high
    if isinstance(force, GasSpring) and free_length is not None:
        return free_length - force.stroke, free_length
    return -math.inf, math.inf


def _law(force: Any, stiffness: float, free_length: float | None, damping: float) -> Law:
    """Return the law of a spring and a damper beside a force. Its energy is 0 at the free length; of a table, where
    it begins.
    """
    k, d = number_not_below_0("stiffness", stiffness), number_not_below_0("damping", damping)
    length = None if free_length is None else finite_number("free_length", free_length)
    if length is None and (k or isinstance(force, GasSpring)):
        expected = "the length [m] at which the spring is free, or the gas spring extended"
        raise ArgumentError("free_length", expected, None)
    zero = length or 0.0
    law = Law(at_zero=k * zero, slope=-k, damping=d)
    if isinstance(force, GasSpring):
        if zero <= force.stroke:
            raise ArgumentError(
                "free_length", f"a length [m] above the stroke, {force.stroke:g} m", quoted(free_length)
            )
        law = law._replace(at_zero=law.at_zero + force.friction / 2, friction=force.friction / 2)
        force = (zero - force.stroke, zero), (force.F2, force.F1)
    elif force is not None:
        zero = float(_table(force)[0][0])
    if force is not None:
        lengths, forces = _table(force)
        slopes = np.diff(forces) / np.diff(lengths)
        law = law._replace(
            at_zero=law.at_zero + float(forces[0] - slopes[0] * lengths[0]),
            slope=law.slope + float(slopes[0]),
            knots=tuple(zip(lengths[1:-1].tolist(), np.diff(slopes).tolist(), strict=True)),
        )
    return law._replace(energy=law.energy + law.at_zero * zero + law.slope * zero * zero / 2)


def _table(force: ArrayLike) -> tuple[Any, Any]:
    """Return the lengths and forces of a table, whose first and last lines go on beyond it."""
    try:
        lengths, forces = (vectors("force", row).ravel() for row in force)  # type: ignore[union-attr]
    except (TypeError, ValueError):
        expected = "a GasSpring, a table (lengths, forces) or a function of (length, rate)"
        raise ArgumentError("force", expected, quoted(force)) from None
    if lengths.shape != forces.shape or len(lengths) < 2 or not np.isfinite([lengths, forces]).all():
        raise ArgumentError(
            "force", "two finite lengths or more, and as many forces", f"{len(lengths)} and {len(forces)}"
        )
    if (np.diff(lengths) <= 0).any():
        raise ArgumentError("force", "lengths that grow", quoted(lengths.tolist()))
    return lengths, forces


# ---- forces that are functions of users: evaluated between two programs, they act as wrenches on two links


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
