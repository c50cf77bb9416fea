"""Loads of linkages in a simulation: functions as forces of struts, and springs and dampers at joints that follow."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.strut_functions import pushed_links, with_function_wrenches
from hingepair.motion.loads import MotionAtInstants
from hingepair.numeric.arrays import Float64Array as Array


def with_strut_loads(robot: Mechanism, wrenches: Mapping[str, tuple[Any, Any]] | None) -> Any:
    """Return wrenches on links, constants or callables of (t, now), with those of functions as forces of struts."""
    tree = tree_of(robot)
    links = pushed_links(tree)
    if not links:
        return wrenches
    given = dict(wrenches or {})

    def push(link: str, place: int, t: Array, now: MotionAtInstants) -> Array:
        found = with_function_wrenches(robot, tree, now.q, now.qd, now.base_motion, None)[link][place]
        own = given[link][place] if link in given else 0.0
        return np.asarray(found + (own(t, now) if callable(own) else np.asarray(own)))

    found = {link: tuple(functools.partial(push, link, place) for place in range(2)) for link in links.values()}
    return {**given, **found}


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
