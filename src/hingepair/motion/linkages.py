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
from hingepair.mechanism.requests import ask
from hingepair.mechanism.robots.methods import requests_of
from hingepair.mechanism.strut_functions import pushed_frames, with_function_wrenches
from hingepair.motion.loads import MotionAtInstants
from hingepair.numeric.arrays import Float64Array as Array

_FASTEST: Final = 1e3  # rates of other joints by that of a coordinate, in radians: beyond, it is at a dead point


class Mark(NamedTuple):
    """A function of the coordinates that is 0 where the motion ends, or where a load has a kink."""

    distance: Callable[[Array], Array]  # of q, (n, dof); above 0 where the motion has not yet come to an end
    end: str  # why the motion ends there; "" if it goes on


def marks_of(robot: Mechanism) -> tuple[Mark, ...]:
    """Return the marks of a robot: dead points of loops, ends of strokes, and kinks of the forces of struts."""
    tree, marks = tree_of(robot), list[Mark]()
    if tree.closure is not None and tree.closure.loops:
        closure, transfer = tree.closure, robot.prepare("qd_all")
        units, own = (
            np.array([1.0 if joint.unit == "rad" else closure.size for joint in joints])
            for joints in (tree.own_coordinates, tree.coordinates)
        )

        def from_dead_point(q: Array) -> Array:
            rates = transfer(q[:, None], np.diag(own))["qd_all"] / units
            return np.asarray(1 / np.abs(rates).max(axis=(1, 2)) - 1 / _FASTEST)

        names = ", ".join(str(loop.name) for loop in closure.loops)
        still = f"where {' and '.join(robot.names)} no longer moves the other joints"
        marks.append(Mark(from_dead_point, f"{names} at a dead point, {still}"))
    if tree.struts:
        lengths = robot.prepare("struts", outputs=("strut_length",))
    for k, strut in enumerate(tree.struts):
        kinks = {float(length) for length, _ in strut.law.knots}
        for sign, limit in zip((1, -1), strut.limits, strict=True):
            if np.isfinite(limit) and limit not in kinks:

                def from_end(q: Array, k: int = k, sign: int = sign, limit: float = limit) -> Array:
                    return np.asarray(sign * (lengths(q, np.zeros_like(q))[..., k] - limit))

                marks.append(Mark(from_end, f"{strut.name} at the end of its stroke, {limit:.6g} m"))
        for kink in kinks:

            def from_kink(q: Array, k: int = k, kink: float = kink) -> Array:
                return np.asarray(lengths(q, np.zeros_like(q))[..., k] - kink)

            marks.append(Mark(from_kink, ""))
    return tuple(marks)


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
        compute = functools.partial(ask, requests_of(robot))
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
