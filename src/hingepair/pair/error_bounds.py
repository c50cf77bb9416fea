"""How far rounding can have taken a result from the exact one, sample by sample: the plan's steps over `Bounded`."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.evaluation.plan import Plan
from hingepair.numeric.array_libraries import is_foreign
from hingepair.numeric.arrays import broadcast_shape, result_dtype
from hingepair.numeric.blocks import Values, tabulate
from hingepair.numeric.bounded import Bounded, Double, kind_of
from hingepair.pair import forward_kinematics as kinematics
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import Outputs, components, leading_shapes, parts_of

Bounds = dict[str, NDArray[np.float64]]

_BEYOND = 2.0**-90
"""What the axis and the levers may be off beyond their last rounding, in units of what they are made of."""

_MADE_OF = {"n": ("n",), "along": ("u1", "u2"), "across": ("u2",), "around": ("u2",)}


def error_bounds(pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, sequence: str) -> Bounds:
    """The bounds of what forward_kinematics gives for coordinates."""
    plan, given = kinematics.plan_from_coordinates(pair, q, qd, qdd, outputs, None, sequence)
    return _bounds(pair, plan, parts_of(given), leading_shapes(given))


def error_bounds_from_body1(
    pair: Constants, body1: BodyMotion, psi: Any, psid: Any, psidd: Any, outputs: Outputs
) -> Bounds:
    """The bounds of what forward_kinematics_from_body1 gives."""
    plan, values, shapes = kinematics.plan_from_body1(pair, body1, psi, psid, psidd, outputs, None)
    own = {name: np.asarray(value) if is_foreign(value) else value for name, value in values.items()}
    return _bounds(pair, plan, own, shapes)


def planar_error_bounds(pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs) -> Bounds:
    """The bounds of what forward_kinematics of a planar pair gives."""
    plan, given = kinematics.plan_planar(pair, q, qd, qdd, outputs, None)
    return _bounds(pair, plan, parts_of(given, planar=True), leading_shapes(given))


def _bounds(pair: Constants, plan: Plan, values: Values, shapes: Mapping[str, tuple[int, ...]]) -> Bounds:
    dtype = result_dtype(c for group in values.values() for c in (group if isinstance(group, tuple) else (group,)))
    kind = kind_of(dtype)
    aligned = pair.axis is not None and pair.single and np.count_nonzero(pair.axis) == 1  # and so exactly 1 or -1
    made_of = {name: parts for name, parts in _MADE_OF.items() if name != "n" or not aligned}

    def bounds(numbers: Values) -> Mapping[str, Any]:
        found = {name: _known(group, made_of.get(name, ()), numbers, kind) for name, group in numbers.items()}
        plan.run(found)
        return {name: _largest(found[name]) for name in plan.outputs}

    wanted = plan.inputs | {"u1", "u2"}
    groups = {name: components(name, group) for name, group in {**pair.values, **values}.items() if name in wanted}
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    return tabulate(bounds, groups, dict.fromkeys(plan.outputs, ()), shape, np.dtype(np.float64))


def _known(group: Any, made_of: tuple[str, ...], numbers: Values, kind: type[Bounded]) -> Any:
    """What a plan is given, as bounded numbers: exact, or rounded from what it was made of."""
    if not isinstance(group, tuple):
        return kind.rounded(group)
    if not made_of:
        return tuple(kind.rounded(c) for c in group)
    size = sum(functools.reduce(np.maximum, map(np.abs, numbers[name])) for name in made_of)
    return tuple(kind.rounded(c, np.spacing(np.abs(c)) / 2 + _BEYOND * size + Double.smallest) for c in group)


def _largest(group: Any) -> Any:
    """The largest bound of some components; what is a plain number is exact."""
    errors = [c.error if isinstance(c, Bounded) else 0.0 for c in (group if isinstance(group, tuple) else (group,))]
    return functools.reduce(np.maximum, errors)
