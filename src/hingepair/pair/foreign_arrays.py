"""Forward kinematics of arrays of other libraries: the plan's steps over their components, the same kind back."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.evaluation.backend import How
from hingepair.evaluation.plan import Plan, outputs_of
from hingepair.numeric.array_libraries import ForeignArray, Library
from hingepair.numeric.arrays import broadcast_shape
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import Out, StateT
from hingepair.pair.states import PairState, PlanarState


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
    check_options(library, out, how)
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    tails = {name: outputs_of(plan.kind)[name].tail for name in plan.outputs}
    return state(run_foreign(plan.run, pair, values, tails, shape, library), shape)


def check_options(library: Library, out: Out, how: How) -> None:
    """Refuse what is of NumPy arrays only.

    Raises:
        ArgumentError: names the option.
    """
    if out is not None:
        raise ArgumentError("out", f"None, since {library.name} makes its own arrays", quoted(out))
    if how.backend != "auto":
        raise ArgumentError("backend", f"'auto', since {library.name} runs the equations", quoted(how.backend))
    if how.workers != 1:
        raise ArgumentError("workers", f"1, since {library.name} has threads of its own", how.workers)


def run_foreign(
    run: Callable[[dict[str, Any]], Mapping[str, Any]],
    pair: Constants,
    values: Mapping[str, Any],
    tails: Mapping[str, tuple[int, ...]],
    shape: tuple[int, ...],
    library: Library,
) -> dict[str, ForeignArray]:
    """What some steps make of a pair and of arrays of another library: arrays of that library, by name.

    Args:
        run: of values by name, to results by name.
        pair: the pair's constants.
        values: the other inputs: components, arrays of the library or numbers.
        tails: shape of one sample of each result.
        shape: of the samples.
        library: of the arrays.
    """
    constants = {
        name: tuple(library.array(c) if isinstance(c, np.ndarray) else c for c in group)  # a number stays one
        for name, group in pair.values.items()
    }
    found = run({**constants, **values})
    if library.name == "jax":
        _teach_jax()
    results = {name: found[name] if isinstance(found[name], tuple) else (found[name],) for name in tails}
    return {name: library.joined(results[name], shape, tail) for name, tail in tails.items()}


@functools.cache
def _teach_jax() -> None:
    """Tell JAX what states are made of, so that its functions take and return them."""
    from jax.tree_util import register_pytree_node

    def parts(state: Any) -> tuple[tuple[Any, ...], tuple[tuple[str, ...], int]]:
        arrays = tuple(state.arrays().values())
        return arrays, (state.outputs, arrays[0].ndim - len(state.shape))

    def joined(state: Any, form: tuple[tuple[str, ...], int], arrays: Any) -> Any:
        names, axes = form  # of the first output, how many axes one sample has
        own = dict(zip(names, arrays, strict=True))
        shape = getattr(own[names[0]], "shape", ())  # JAX also asks for states of what is no array
        return state(own, tuple(shape[: len(shape) - axes]))

    for state in (PairState, PlanarState):
        register_pytree_node(state, parts, functools.partial(joined, state))
