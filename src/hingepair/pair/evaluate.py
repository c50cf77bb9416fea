"""Runs of plans for a pair: cached calls, and the states and arrays that they compute.

`pair` are the Constants of a pair, `values` are the other inputs by name, `shapes` are the shapes of the samples by
argument, and `out` holds arrays to write into.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.binding import bind
from hingepair.engine.calls import Call, Out
from hingepair.engine.loops import Loop, OperationCounts
from hingepair.engine.results import writable_arrays
from hingepair.pair.constants import Constants
from hingepair.pair.states import PairState, PlanarState
from hingepair.plans.arguments import CoordinateNames
from hingepair.plans.computation import Computation
from hingepair.plans.plan import PLANAR_MOTION_KIND, SPATIAL_MOTION_KIND, MotionKind, Plan, make_plan, plan_loop
from hingepair.plans.steps import LOG_COLUMN_NAMES_OF_Q_QD_QDD_BY_COORDINATE_NAMES

DEFAULT_BACKEND_AND_WORKERS: Final = Execution("auto", 1)  # backend and number of threads of a call by default
STATE_CLASS_BY_MOTION_KIND: Mapping[Any, type[PairState | PlanarState]] = {
    SPATIAL_MOTION_KIND: PairState,
    PLANAR_MOTION_KIND: PlanarState,
}
"""The class of the results, by the kind of motion of a plan."""

COORDINATES: Mapping[Any, CoordinateNames] = {
    kind: CoordinateNames(kind.coordinates, LOG_COLUMN_NAMES_OF_Q_QD_QDD_BY_COORDINATE_NAMES[kind.coordinates])
    for kind in (SPATIAL_MOTION_KIND, PLANAR_MOTION_KIND)
}
"""Names of the coordinates, by the kind of motion."""


def computation_of(kind: MotionKind, pair: Constants, outputs: tuple[str, ...], sequence: str | None) -> Computation:
    """Return the Computation of outputs of a pair; it is made once, and kept with the pair's constants."""
    key = Computation, outputs, sequence
    found: Computation | None = pair.prepared.get(key)
    if found is None:
        has_home = "home" in pair.values

        def loop(names: tuple[str, ...], given: tuple[str, ...]) -> Loop:
            return plan_loop(make_plan(names, sequence, has_home, kind=kind, given_names=given))

        found = pair.prepared[key] = Computation(
            loop, outputs, kind.shapes, pair.values if pair.single else pair.arrays,
            STATE_CLASS_BY_MOTION_KIND[kind], COORDINATES[kind], shape=pair.shape, shared=True,
        )  # fmt: skip
    return found


def cached_call(pair: Constants, plan: Plan, input_names: tuple[str, ...], backend: str) -> Call:
    """Return the Call that runs a plan for the Constants `pair` and for inputs of the given names, with the backend
    "auto", "compiled" or "numpy". The Call is made at the first request and cached in `pair.prepared`.
    """
    key = plan, input_names, backend
    call: Call | None = pair.prepared.get(key)
    if call is None:
        shapes, loop = plan.kind.shapes, plan_loop(plan)
        constants = pair.values if pair.single else pair.arrays
        call = pair.prepared[key] = Call(
            loop, {name: shapes[name] for name in input_names},
            {name: constants[name] for name, _ in loop.inputs if name not in input_names},
            STATE_CLASS_BY_MOTION_KIND[plan.kind], shape=pair.shape, backend=backend, shared=True,
        )  # fmt: skip
    return call


def compute_state(
    pair: Constants,
    plan: Plan,
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    out: Out = None,
    execution: Execution = DEFAULT_BACKEND_AND_WORKERS,
    dtype: np.dtype[Any] | None = None,
) -> Any:
    """Compute the outputs of a plan at all samples; return them as a PairState or PlanarState. `pair` holds the
    Constants of the pair, `values` is a dict of the other inputs, and `shapes` a dict of their leading shapes.
    Results are written into the arrays of the dict `out`, if given. `execution` says the backend and the number of
    threads; the compiled call is cached in `pair.prepared`. If `dtype` is None, the results have the dtype of the
    values.
    """
    return cached_call(pair, plan, tuple(values), execution.backend).run(
        values, shapes, out, execution.workers, dtype
    )


def compute_arrays(
    pair: Constants,
    outputs: Iterable[str],
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    dtype: np.dtype[Any] | None = None,
    sequence: str | None = None,
) -> dict[str, NDArray[Any]]:
    """Compute the outputs of a spatial pair that `outputs` names; return them as a dict of new, writable arrays by
    output name. `pair` holds the Constants of the pair, `values` is a dict of the other inputs, and `shapes` a dict
    of their leading shapes; `sequence` is the Euler sequence if there are Euler angles. The compiled call is cached
    in `pair.prepared`.
    """
    plan = make_plan(tuple(outputs), sequence, "home" in pair.values, given_names=tuple(values))
    return writable_arrays(compute_state(pair, plan, values, shapes, dtype=dtype))


def count_operations(plan: Plan, pair: Constants, values: Mapping[str, Any]) -> OperationCounts:
    """Return the OperationCounts of a plan for a single pair: the number of all arithmetic operations, and the number
    of operations that are left if the Constants `pair` and those inputs in the dict `values` that are numbers count
    as known.

    Args:
        plan: plan of the computation.
        pair: constants of a single pair.
        values: inputs of the plan by name, each a number, an array, or a tuple of them.
    """
    loop = plan_loop(plan)

    def as_two_samples(component: Any) -> Any:
        """Return an array of two samples for an array, which may hold one sample, and a number as it is."""
        return np.empty(2) if isinstance(component, np.ndarray) else component

    unknown_inputs = {name: np.empty((2, *sample_shape)) for name, sample_shape in loop.inputs}
    partly_known_inputs = {
        name: tuple(map(as_two_samples, value)) if isinstance(value, tuple) else as_two_samples(value)
        for name, value in values.items()
    }
    full_program = loop.program(bind(loop.inputs, unknown_inputs).pattern)
    program = loop.program(bind(loop.inputs, {**unknown_inputs, **pair.values, **partly_known_inputs}).pattern)
    return program.count_operations(full_program)
