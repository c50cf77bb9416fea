"""Forward kinematics of arrays of other libraries: the plan's steps over their components, the same kind back."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.evaluation.backend import How
from hingepair.evaluation.plan import Plan, outputs_of
from hingepair.numeric.array_libraries import Library
from hingepair.numeric.arrays import broadcast_shape
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import Out, StateT


def evaluate_foreign(
    state: type[StateT],
    plan: Plan,
    pair: Constants,
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    library: Library,
    out: Out,
    how: How,
) -> StateT:
    """The state at all samples, as arrays of the library.

    Args:
        state: what it is called.
        plan: what to compute.
        pair: the pair's constants.
        values: the plan's other inputs by name: components, arrays of the library or numbers.
        shapes: of the samples, by argument.
        library: of the arrays.
        out: nothing; arrays to write into are NumPy's.
        how: the backend, which is not chosen, and one thread.

    Raises:
        ArgumentError: an option that is of NumPy arrays only.
    """
    if out is not None:
        raise ArgumentError("out", f"None, since {library.name} makes its own arrays", quoted(out))
    if how.backend != "auto":
        raise ArgumentError("backend", f"'auto', since {library.name} runs the equations", quoted(how.backend))
    if how.workers != 1:
        raise ArgumentError("workers", f"1, since {library.name} has threads of its own", how.workers)
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    constants = {name: tuple(map(_own_constant(library), group)) for name, group in pair.values.items()}
    found = plan.run({**constants, **values})
    tails = outputs_of(plan.kind)
    arrays = {}
    for name in plan.outputs:
        group = found[name]
        arrays[name] = library.joined(group if isinstance(group, tuple) else (group,), shape, tails[name].tail)
    if library.name == "jax":
        known: Any = state
        _teach_jax(known, plan.kind)
    return state(arrays, shape)


def _own_constant(library: Library) -> Any:
    """What makes a pair's constant one of the library: a number stays one."""
    return lambda c: library.array(c) if isinstance(c, np.ndarray) else c


@functools.cache
def _teach_jax(state: Any, kind: str) -> None:
    """Tell JAX what states are made of, so that its functions take and return them."""
    from jax.tree_util import register_pytree_node

    def parts(made: Any) -> tuple[tuple[Any, ...], tuple[str, ...]]:
        return tuple(made.arrays().values()), made.outputs

    def joined(names: tuple[str, ...], arrays: Any) -> Any:
        first, axes = next(iter(arrays), None), len(outputs_of(kind)[names[0]].tail)
        own = getattr(first, "shape", ())
        return state(dict(zip(names, arrays, strict=True)), tuple(own[: len(own) - axes]))

    register_pytree_node(state, parts, joined)
