"""Struts between two frames of a mechanism: springs, dampers, gas springs and forces by a table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.tree import Tree, TreeStrut
from hingepair.numeric.arrays import finite_number, number_not_below_0, vectors


@dataclass(frozen=True, slots=True)
class GasSpring:
    """A gas spring by the values of its data sheet; its force pushes the points of its strut apart.

    The force on extension falls linearly from F2, compressed by the stroke, to F1, extended; on compression it is
    larger by `friction`, and at rest by half of it.

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
) -> Tree:
    """Return a copy of a tree with a strut between two frames."""
    if not isinstance(name, str) or not name:
        raise ArgumentError("name", "a name", quoted(name))
    if name in {strut.name for strut in tree.struts} | {joint.name for joint in tree.joints}:
        raise ArgumentError("name", "a name that no joint and no other strut has", quoted(name))
    frames = tuple(tree.known_frame(argument, end) for argument, end in zip(("frame1", "frame2"), ends, strict=True))
    if frames[0].body == frames[1].body:
        got = f"{ends[0]!r} and {ends[1]!r} of one body"
        raise ArgumentError("frame2", "a frame of another body than frame1's", got)
    if any(frame.samples is not None for frame in frames):
        raise ArgumentError("frame1", "frames that are the same for all samples", f"{ends[0]!r} and {ends[1]!r}")
    law, knots = _law(force, stiffness, free_length, damping)
    strut = TreeStrut(name, ends, (frames[0], frames[1]), law, knots)
    return replace(tree, struts=(*tree.struts, strut), source=None)


def _law(
    force: Any, stiffness: float, free_length: float | None, damping: float
) -> tuple[tuple[float, ...], tuple[tuple[float, float], ...]]:
    """Return the numbers of a strut's force: c0, c1, damping, friction and the constant of its energy; and its knots.

    The energy is 0 at the free length; of a table, where it begins.
    """
    k, d = number_not_below_0("stiffness", stiffness), number_not_below_0("damping", damping)
    length = None if free_length is None else finite_number("free_length", free_length)
    if length is None and (k or isinstance(force, GasSpring)):
        raise ArgumentError(
            "free_length", "the length [m] at which the spring is free, or the gas spring extended", None
        )
    c0, c1, friction, zero = k * (length or 0.0), -k, 0.0, length or 0.0
    knots: tuple[tuple[float, float], ...] = ()
    if isinstance(force, GasSpring):
        slope = (force.F2 - force.F1) / force.stroke
        c0 += force.F1 + force.friction / 2 + slope * zero
        c1 -= slope
        friction = force.friction / 2
    elif callable(force):
        raise ArgumentError("force", "a GasSpring, or a table (lengths, forces)", "a function")
    elif force is not None:
        lengths, forces = _table(force)
        slopes = np.diff(forces) / np.diff(lengths)
        c0 += float(forces[0] - slopes[0] * lengths[0])
        c1 += float(slopes[0])
        changes = np.diff(slopes)
        knots = tuple((float(at), float(change)) for at, change in zip(lengths[1:-1], changes, strict=True))
        zero = float(lengths[0])
    return (c0, c1, d, friction, c0 * zero + c1 * zero * zero / 2), knots


def _table(force: ArrayLike) -> tuple[Any, Any]:
    """Return the lengths and forces of a table, whose first and last lines go on beyond it."""
    try:
        lengths, forces = (vectors("force", row).ravel() for row in force)  # type: ignore[union-attr]
    except (TypeError, ValueError):
        raise ArgumentError("force", "a GasSpring, or a table (lengths, forces)", quoted(force)) from None
    if lengths.shape != forces.shape or len(lengths) < 2 or not np.isfinite([lengths, forces]).all():
        raise ArgumentError(
            "force", "two finite lengths or more, and as many forces", f"{len(lengths)} and {len(forces)}"
        )
    if (np.diff(lengths) <= 0).any():
        raise ArgumentError("force", "lengths that grow", quoted(lengths.tolist()))
    return lengths, forces
