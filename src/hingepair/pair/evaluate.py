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
from hingepair.engine.loops import OperationCounts
from hingepair.engine.results import writable_arrays
from hingepair.errors import RotationError
from hingepair.pair.constants import Constants
from hingepair.pair.states import PairState, PlanarState
from hingepair.plans.plan import PLANAR_MOTION_KIND, SPATIAL_MOTION_KIND, Plan, make_plan, plan_loop
from hingepair.rotations.matrices import MAX_ORTHOGONALITY_ERROR_BY_DTYPE_ITEMSIZE, check_rotation

DEFAULT_BACKEND_AND_WORKERS: Final = Execution("auto", 1)  # backend and number of threads of a call by default
STATE_CLASS_BY_MOTION_KIND: Mapping[Any, type[PairState | PlanarState]] = {
    SPATIAL_MOTION_KIND: PairState,
    PLANAR_MOTION_KIND: PlanarState,
}
"""The class of the results, by the kind of motion of a plan."""

BODY1_QUATERNION_INPUT_NAMES: Final = ("quat_xyzw", "quat_wxyz")  # inputs that can replace S1


def cached_call(pair: Constants, plan: Plan, input_names: tuple[str, ...], backend: str, shared: bool = True) -> Call:
    """Return the Call that runs a plan for the Constants `pair` and for inputs of the given names, with the backend
    "auto", "compiled" or "numpy". The Call is made at the first request and cached in `pair.prepared`. Unless it is
    `shared`, a kernel of this pair's own constants computes few samples, too.
    """
    key = plan, input_names, backend, shared
    call: Call | None = pair.prepared.get(key)
    if call is None:
        shapes, loop = plan.kind.shapes, plan_loop(plan)
        constants = pair.values if pair.single else pair.arrays
        checks = dict.fromkeys(("attitude1_check", "attitude2_check"), MAX_ORTHOGONALITY_ERROR_BY_DTYPE_ITEMSIZE)
        if any(name in BODY1_QUATERNION_INPUT_NAMES for name in input_names):
            checks["attitude1_check"] = {8: 1.0, 4: 1.0}  # the check is 2 for a zero quaternion, and otherwise 0
        call = pair.prepared[key] = Call(
            loop, {name: shapes[name] for name in input_names},
            {name: constants[name] for name in _constant_input_names(loop, input_names)},
            STATE_CLASS_BY_MOTION_KIND[plan.kind], shape=pair.shape, backend=backend, shared=shared,
            on_limit=_check_attitudes,
            limits={name: checks[name] for name in plan.outputs if name in checks},
        )  # fmt: skip
    return call


def _constant_input_names(loop: Any, input_names: tuple[str, ...]) -> list[str]:
    """Return a list of the inputs of a loop that are constants of the pair, that is, not among `input_names`."""
    return [name for name, _ in loop.inputs if name not in input_names]


def _check_attitudes(values: Mapping[str, Any]) -> None:
    """Raise RotationError if `values`, a dict of inputs by name, holds an S1 or S2 that is not a rotation, or a
    quaternion that is zero.
    """
    for name, value in values.items():
        if name in BODY1_QUATERNION_INPUT_NAMES and (np.asarray(value) == 0).all(axis=-1).any():
            raise RotationError(name, "non-zero quaternions", "a zero quaternion")
        if name in ("S1", "S2"):
            check_rotation(name, np.asarray(value))


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
