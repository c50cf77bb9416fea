"""Points fixed to the bodies of a pair: R = R_i + S_i p, v = v_i + omega_i x S_i p, and a likewise (E1, E8, E9)."""

from __future__ import annotations

import functools
from collections.abc import Collection
from typing import Any, Final, NamedTuple

from hingepair.equations import spatial as eq
from hingepair.equations.quantities import QUANTITIES, Quantity, unit_of
from hingepair.numeric.blocks import Components
from hingepair.plans.steps import Step, cross_with_e_z, in_plane, in_space


class Point(NamedTuple):
    """A point that is fixed to body 1 or body 2 of a pair."""

    name: str
    body: int  # 1 or 2


POINT_ENDINGS: Final = {"R": "", "v": "_v", "a": "_a"}
"""Endings of the outputs of a point, after its name, by quantity."""

INPUT: Final = "point:"
"""Beginning of the names of inputs: the vectors from the body's reference point to points, in its axes."""


@functools.lru_cache(maxsize=256)
def point_outputs(points: tuple[Point, ...]) -> dict[str, Quantity]:
    """Return the quantities of the outputs of points by name.

    >>> [*point_outputs((Point("tip", 2),))], point_outputs((Point("tip", 2),))["tip_v"].unit
    (['tip', 'tip_v', 'tip_a'], 'm/s')
    """
    texts = {"R": "Position", "v": "Velocity", "a": "Acceleration"}
    return {
        point.name + ending: QUANTITIES[letter]._replace(text=f"{texts[letter]} of the point {point.name}")
        for point in points
        for letter, ending in POINT_ENDINGS.items()
    }


def unit_among(outputs: Collection[str], name: str) -> str:
    """Return the unit of an output, or of one of its components; outputs that are no quantities are of points.

    >>> unit_among(("tip_v", "omega2"), "tip_v_x"), unit_among(("tip_v", "omega2"), "omega2_x")
    ('m/s', 'rad/s')
    """
    output = name if name in outputs else name.rpartition("_")[0]
    if output in QUANTITIES or output not in outputs:
        return unit_of(name)
    return unit_of(output[-1] if output.endswith((POINT_ENDINGS["v"], POINT_ENDINGS["a"])) else "R")


@functools.lru_cache(maxsize=256)
def point_shapes(points: tuple[Point, ...], dimensions: int) -> dict[str, tuple[int, ...]]:
    """Return the shapes of one sample of the vectors to points and of their outputs, by name."""
    names = (*(INPUT + point.name for point in points), *point_outputs(points))
    return dict.fromkeys(names, (dimensions,))


def result_of(output: str) -> str:
    """Return the name of the step to an output of a point, which differs from those of all other steps."""
    return f"result:{output}"


def _velocity(v: Components, omega: Components, arm: Components) -> Components:
    return eq.add(v, eq.cross(omega, arm))


def _acceleration(a: Components, omega: Components, alpha: Components, arm: Components) -> Components:
    return eq.add(a, eq.point_acceleration(omega, alpha, arm))


@functools.lru_cache(maxsize=256)
def spatial_point_steps(points: tuple[Point, ...]) -> tuple[Step, ...]:
    """Return the steps to points of a pair in space."""
    steps: list[Step] = []
    for name, k in points:
        vector, arm = INPUT + name, f"arm:{name}"
        R, v, a = (result_of(name + ending) for ending in POINT_ENDINGS.values())
        steps += (
            Step(arm, eq.rotate, (f"S{k}", vector)),
            Step(R, eq.add, (f"R{k}", arm)),
            Step(v, _velocity, (f"v{k}", f"omega{k}", arm)),
            Step(a, _acceleration, (f"a{k}", f"omega{k}", f"alpha{k}", arm)),
        )
    return tuple(steps)


@functools.lru_cache(maxsize=256)
def planar_point_steps(points: tuple[Point, ...]) -> tuple[Step, ...]:
    """Return the steps to points of a planar pair, which has no S2: psi turns p in the axes of body 1."""
    steps: list[Step] = []
    for name, k in points:
        vector, arm = INPUT + name, f"arm:{name}"
        across, turned, lifted = f"across:{name}", f"turned:{name}", f"lifted:{name}"
        R, v, a = (result_of(name + ending) for ending in POINT_ENDINGS.values())
        omega, alpha = ("omega1", "alpha1") if k == 1 else ("omega2_in_space", "alpha2_in_space")
        steps += (
            Step(lifted, in_space, (vector,)),
            Step(across, cross_with_e_z, (vector,)),
            Step(turned, eq.lever_moving, (lifted, across, "hinge", "cosine")),
            Step(arm, eq.rotate, ("S1", lifted if k == 1 else turned)),
            Step(f"R:{name}", eq.add, (f"R{k}_in_space", arm)),
            Step(f"v:{name}", _velocity, (f"v{k}_in_space", omega, arm)),
            Step(f"a:{name}", _acceleration, (f"a{k}_in_space", omega, alpha, arm)),
            *(Step(result, in_plane, (f"{letter}:{name}",)) for letter, result in zip("Rva", (R, v, a), strict=True)),
        )
    return tuple(steps)


def named_results(values: dict[str, Any], outputs: tuple[str, ...]) -> None:
    """Add the results of points to `values` under the names of the outputs."""
    for name in outputs:
        result = result_of(name)
        if result in values:
            values[name] = values[result]
