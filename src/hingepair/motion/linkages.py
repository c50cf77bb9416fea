"""Linkages in a simulation: functions as forces of struts, springs and dampers at joints that follow, and where
motions end: at dead points, and at the ends of a strut's stroke.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.mechanism import Mechanism, robot_of, tree_of
from hingepair.mechanism.requests import ask, subject_of
from hingepair.mechanism.struts import pushed_frames, with_function_wrenches
from hingepair.motion.loads import MotionAtInstants
from hingepair.numeric.arrays import Float64Array as Array

_FASTEST: Final = 1e3  # rates of other joints by that of a coordinate, in radians: beyond, it is at a dead point


class Marks(NamedTuple):
    """Functions of the coordinates that are 0 where the motion ends, or where a load has a kink."""

    ends: tuple[str, ...]  # of each, why the motion ends there; "" if it goes on
    distances: Callable[
        [Array], Array
    ]  # of q, (n, dof), (n, marks): above 0 where the motion has not yet come to an end


def marks_of(robot: Mechanism) -> Marks:
    """Return the marks of a robot: dead points of loops, ends of strokes, and kinks of the forces of struts."""
    tree, ends, rows = tree_of(robot), list[str](), list[tuple[int, int, float]]()
    closure = tree.closure if tree.closure is not None and tree.closure.loops else None
    if closure is not None:
        transfer = robot.prepare("qd_all")
        units, own = (
            np.array([1.0 if joint.unit == "rad" else closure.size for joint in joints])
            for joints in (tree.own_coordinates, tree.coordinates)
        )
        names = ", ".join(str(loop.name) for loop in closure.loops)
        ends.append(f"{names} at a dead point, where {' and '.join(robot.names)} no longer moves the other joints")
    for k, strut in enumerate(tree.struts):
        kinks = {float(length) for length, _ in strut.law.knots}
        for sign, limit in zip((1, -1), strut.limits, strict=True):
            if np.isfinite(limit) and limit not in kinks:
                rows.append((k, sign, limit))
                ends.append(f"{strut.name} at the end of its stroke, {limit:.6g} m")
        rows += [(k, 1, kink) for kink in kinks]
        ends += [""] * len(kinks)
    lengths = robot.prepare("struts", outputs=("strut_length",)) if rows else None
    struts, signs, limits = (np.array(column) for column in zip(*rows, strict=True)) if rows else ((),) * 3

    def distances(q: Array) -> Array:
        parts = []
        if closure is not None:
            rates = transfer(q[:, None], np.diag(own))["qd_all"] / units
            parts.append(1 / np.abs(rates).max(axis=(1, 2))[:, None] - 1 / _FASTEST)
        if lengths is not None:
            parts.append(signs * (lengths(q, np.zeros_like(q))[:, struts] - limits))
        return np.concatenate([np.zeros((len(q), 0)), *parts], axis=1)

    return Marks(tuple(ends), distances)


def beyond_strokes(robot: Mechanism) -> Mechanism:
    """Return a robot whose struts push beyond their strokes as their laws go on: the last step ends beyond."""
    tree = tree_of(robot)
    if not any(strut.law.limits for strut in tree.struts):
        return robot
    struts = tuple(replace(strut, law=strut.law._replace(limits=())) for strut in tree.struts)
    return robot_of(replace(tree, struts=struts), robot.base)


def strut_powers_of(robot: Mechanism) -> Callable[[Array, Array], Array] | None:
    """Return a function of q and qd for the power of dampers and friction of struts [W], (n,); None without any."""
    laws = [strut.law for strut in tree_of(robot).struts]
    if not any(law.damping or law.friction for law in laws):
        return None
    struts = robot.prepare("struts")

    def powers(q: Array, qd: Array) -> Array:
        moving, still = struts(q, qd), struts(q, np.zeros_like(qd))
        return np.asarray(((moving["strut_force"] - still["strut_force"]) * moving["strut_rate"]).sum(axis=-1))

    return powers


def with_strut_loads(robot: Mechanism, wrenches: Mapping[str, tuple[Any, Any]] | None) -> Any:
    """Return wrenches on links, constants or callables of (t, now), with those of functions as forces of struts."""
    tree = tree_of(robot)
    given = dict(wrenches or {})

    def push(frame: str, t: Array, now: MotionAtInstants) -> Array:
        compute = functools.partial(ask, subject_of(robot))
        found = with_function_wrenches(compute, tree, now.q, now.qd, now.base_motion, None)[frame][0]
        own = given[frame][0] if frame in given else 0.0
        return np.asarray(found + (own(t, now) if callable(own) else np.asarray(own)))

    frames = pushed_frames(tree)
    found = {frame: (functools.partial(push, frame), given.get(frame, (0, 0))[1]) for frame in frames}
    return {**given, **found} if frames else wrenches


def efforts_of_followers(robot: Mechanism, loads: Mapping[str, Any]) -> Any:
    """Return a callable of now for what springs and dampers at joints that loops close exert at the coordinates,
    (n, dof); None where there are none.

    Raises:
        ArgumentError: a load has stops, dry friction or a torque, which act only at coordinates.
    """
    tree = tree_of(robot)
    if tree.closure is None:
        return None
    columns = {joint.name: column for column, joint in enumerate(tree.own_coordinates)}
    own = {columns[name]: load for name, load in loads.items() if name in columns and name not in robot.names}
    for column, load in own.items():
        if load != HingeLoad(stiffness=load.stiffness, rest=load.rest, damping=load.damping):
            name = tree.own_coordinates[column].name
            expected = f"a spring or a damper alone, since no coordinate ({', '.join(robot.names)}) is of this joint"
            raise ArgumentError(f"loads[{name!r}]", expected, str(load))
    if not own:
        return None
    chosen = [*own]
    stiffness, rest, damping = (
        np.array([getattr(load, field) for load in own.values()]) for field in ("stiffness", "rest", "damping")
    )

    def efforts(now: MotionAtInstants) -> Array:
        q, qd = robot.all_coordinates(now.q, now.qd)
        exerted = -stiffness * (q[:, chosen] - rest) - damping * qd[:, chosen]
        _, by_rates = robot.all_coordinates(now.q[:, None], np.eye(robot.dof))
        return np.asarray((by_rates[..., chosen] @ exerted[..., None])[..., 0])

    return efforts
