"""Bounds on the rounding errors of a robot's results: the recursions run over numbers that carry an error bound."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.results import Results
from hingepair.errors import CompilationError, MissingDependencyError
from hingepair.mechanism.computations import RobotComputation
from hingepair.mechanism.constants import frame_numbers, number_bounds, program_numbers
from hingepair.numeric.arrays import Float64Array, broadcast_shape, result_dtype
from hingepair.numeric.blocks import Named, components_of, tabulate
from hingepair.numeric.bounded import UNIT_ROUNDOFF, Bounded, bounded_class, conversion_error
from hingepair.plans.arguments import Arguments
from hingepair.plans.derivatives import Derivative, derivative_loop
from hingepair.plans.trees import FRAME_OUTPUTS, compute_request, request_loop

_ACCELERATIONS = ("a1", "alpha1", "qdd")  # outputs of forward dynamics
_DOUBLE = np.dtype(np.float64)  # of all bounds


def error_bounds(
    computation: RobotComputation, values: Arguments, gravity: tuple[float, ...]
) -> dict[str, Float64Array]:
    """Return by output the largest bound on the errors of its components: (...), of frames' motion (..., frames)."""
    names = computation.request.outputs
    solved = tuple(name for name in names if name in _ACCELERATIONS)
    carried = tuple(name for name in names if name not in solved)
    bounds = _carried_bounds(computation, carried, values, gravity) if carried else {}
    if solved:
        bounds |= _acceleration_bounds(computation, solved, values, gravity)
    return {name: bounds[name] for name in names}


class _BoundedProgram:
    """Program of a robot's outputs, run with numbers that carry error bounds, in the precision of the arguments."""

    def __init__(self, computation: RobotComputation, outputs: tuple[str, ...], values: Arguments) -> None:
        computation.constants.tree.plain()
        components = [c for name in values.values for c in _as_tuple(values.values[name])]
        self._kind = bounded_class(result_dtype(components))
        constants, frames = computation.constants, computation.frames
        numbers = program_numbers(constants)
        numbers += [number for frame in frames for number in frame_numbers(constants, frame)]
        pairs = [*zip(numbers, number_bounds(constants, frames), strict=True)]
        # Only an exact number folds: in a program, one may be 0 that would be 1e-17.
        known = tuple(number if bound == 0 and number in {0.0, 1.0, -1.0} else None for number, bound in pairs)
        count = len(computation.form.known)
        self._form = computation.form._replace(known=known[:count])
        self._request = computation.request._replace(outputs=outputs, known=known[count:])
        self._constants = tuple(
            self._kind.rounded(*pair) for pair, folded in zip(pairs, known, strict=True) if folded is None
        )

    def derivatives(self, names: tuple[str, ...], inputs: Mapping[str, Any]) -> Callable[[Named], dict[str, Any]]:
        """Return a function from a block of `inputs` to bounded derivatives of torques, such as tau_q."""
        loop = derivative_loop(request_loop(self._form, self._request), Derivative("matrices", names, ()))
        places = {name: k for k, (name, _) in enumerate(loop.inputs)}
        pattern = [
            None if name == "constants" else (places[name], k)
            for name, tail in loop.inputs
            for k in range(math.prod(tail))
        ]
        function = loop.program(tuple(pattern)).on_bounded
        sizes = {name: math.prod(tail) for name, tail in loop.outputs}

        def bounded_derivatives(block: Named) -> dict[str, Any]:
            parts = [
                part
                for name, _ in loop.inputs
                if name in inputs
                for part in map(self._kind.rounded, block[name], block[f"{name} error"])
            ]
            results = iter(function(*self._constants, *parts))
            return {name: tuple(itertools.islice(results, size)) for name, size in sizes.items()}

        return bounded_derivatives

    def run(self, block: Named, names: Iterable[str]) -> dict[str, Any]:
        """Return the bounded outputs for a block of the inputs `names`, as `_with_conversion_errors` returns them."""
        inputs: dict[str, Any] = {
            name: tuple(map(self._kind.rounded, block[name], block[f"{name} error"])) for name in names
        }
        return compute_request(self._form, self._request, inputs | {"constants": self._constants})


def slope_bounds(
    computation: RobotComputation, names: tuple[str, ...], values: Arguments, gravity: tuple[float, ...]
) -> dict[str, Float64Array]:
    """Return by name the largest bound on the errors of the entries of derivatives of torques, such as tau_q."""
    program = _BoundedProgram(computation, computation.outputs, values)
    groups = _input_groups(computation, computation.complete(values, gravity))
    function = program.derivatives(names, groups)

    def block_bounds(block: Named) -> Mapping[str, Any]:
        return {name: _largest_bounds(result, 0) for name, result in function(block).items()}

    samples = broadcast_shape(values.shapes)
    return tabulate(block_bounds, _with_conversion_errors(groups), dict.fromkeys(names, ()), samples, _DOUBLE)


def _carried_bounds(
    computation: RobotComputation, names: tuple[str, ...], values: Arguments, gravity: tuple[float, ...]
) -> dict[str, Float64Array]:
    """Return for each named output the largest bound that its components carry through the program."""
    program, frame_count = _BoundedProgram(computation, names, values), len(computation.frames)
    groups = _input_groups(computation, computation.complete(values, gravity))

    def block_bounds(block: Named) -> Mapping[str, Any]:
        results = program.run(block, groups)
        return {name: _largest_bounds(results[name], frame_count if name in FRAME_OUTPUTS else 0) for name in names}

    shapes = {name: (frame_count,) if name in FRAME_OUTPUTS else () for name in names}
    samples = broadcast_shape(values.shapes)
    return tabulate(block_bounds, _with_conversion_errors(groups), shapes, samples, _DOUBLE)


def _acceleration_bounds(
    computation: RobotComputation, names: tuple[str, ...], values: Arguments, gravity: tuple[float, ...]
) -> dict[str, Float64Array]:
    """Return bounds on the errors of the accelerations of either backend, from their residuals in inverse dynamics.

    Carried through the elimination of joints (T5), bounds grow tenfold with each joint.
    """
    constants, free, dof = computation.constants, computation.request.free, computation.form.dof
    unknown, loads = (_ACCELERATIONS, ("force1", "torque1", "tau")) if free else (("qdd",), ("tau",))
    solver = RobotComputation(constants, unknown, free, (), (), Results)
    inverse = RobotComputation(constants, (*loads, "mass_matrix"), free, (), (), None)
    program = _BoundedProgram(inverse, inverse.request.outputs, values)
    complete, samples = solver.complete(values, gravity), broadcast_shape(values.shapes)
    given = _input_groups(solver, {name: complete[name] for name in loads})
    worst = dict.fromkeys(names, np.zeros(samples))
    for backend in ("numpy", "compiled"):
        try:
            found = solver.run(values, Execution(backend, 1), gravity)
        except (CompilationError, MissingDependencyError):
            continue  # then no other backend computes either
        groups = _input_groups(inverse, complete | {name: np.asarray(found[name]) for name in unknown})

        def block_bounds(block: Named, inputs: Iterable[str] = tuple(groups)) -> Mapping[str, Any]:
            results = program.run(block, inputs)
            left = [
                np.abs(got.value - load) + got.error + error
                for name in loads
                for got, load, error in zip(
                    results[name], block[f"{name} given"], block[f"{name} given error"], strict=True
                )
            ]
            errors = _solution_errors(left, results["mass_matrix"])
            parts = {"a1": errors[:3], "alpha1": errors[3:6], "qdd": errors[len(errors) - dof :]}
            return {name: functools.reduce(np.maximum, parts[name]) for name in names}

        groups |= {f"{name} given": group for name, group in given.items()}
        bounds = tabulate(block_bounds, _with_conversion_errors(groups), dict.fromkeys(names, ()), samples, _DOUBLE)
        worst = {name: np.maximum(worst[name], bound) for name, bound in bounds.items()}
    return worst


def _solution_errors(left: Sequence[Any], matrix: Sequence[Any]) -> list[NDArray[np.float64]]:
    """Return bounds on the errors of the components of x, whose residuals |M x - b| are at most `left`; inf if none.

    `matrix` holds the bounded entries of M, row by row. With X next to the inverse of M and |I - X M| <= E, the
    errors e are at most |X| left + E e, hence e <= w / (1 - c) for every w >= |X| left with E w <= c w.
    """
    size = len(left)
    values = [c.value if isinstance(c, Bounded) else c for c in matrix]
    errors = [c.error if isinstance(c, Bounded) else 0.0 for c in matrix]
    columns = np.stack(np.broadcast_arrays(*left, *values, *errors), axis=-1)
    r, M, off = np.split(columns, (size, size + size * size), axis=-1)
    M, off = (part.reshape(*part.shape[:-1], size, size) for part in (M, off))
    # Coordinates in which the diagonal is 1; powers of two, which round nothing.
    scale = np.exp2(-np.round(np.log2(np.abs(np.diagonal(M, axis1=-2, axis2=-1))) / 2))
    both = scale[..., None] * scale[..., None, :]
    known = np.isfinite(r * scale).all(axis=-1) & np.isfinite(M * both).all(axis=(-2, -1))
    M, off = np.where(known[..., None, None], M * both, np.eye(size)), off * both
    X = _inverse(M)
    rounding = (2 * size + 8) * UNIT_ROUNDOFF * (np.abs(X) @ np.abs(M))
    E = np.abs(np.eye(size) - X @ M) + rounding + np.abs(X) @ off
    w = (np.abs(X) @ (r * scale)[..., None])[..., 0] * (1 + 2.0**-30)
    w = w + w.max(axis=-1, keepdims=True) / 1024 + np.finfo(np.float64).tiny
    c = ((E @ w[..., None])[..., 0] / w).max(axis=-1)
    found = np.where((known & (c < 1))[..., None], w / (1 - c)[..., None] * scale, np.inf)
    return list(np.moveaxis(found, -1, 0))


def _inverse(M: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverses of matrices, NaN of singular ones."""
    try:
        return np.asarray(np.linalg.inv(M))
    except np.linalg.LinAlgError:
        return np.full_like(M, np.nan) if M.ndim == 2 else np.stack([_inverse(one) for one in M])


def _input_groups(computation: RobotComputation, values: Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    """Return the inputs of a computation that `values` has, each as a tuple of components; without the constants."""
    return {
        name: _input_components(values[name], sample_shape)
        for name, sample_shape in computation.inputs.items()
        if name in values and name != "constants"
    }


def _with_conversion_errors(groups: Mapping[str, tuple[Any, ...]]) -> Named:
    """Return the groups and, by "NAME error", what converting each component to float64 changes."""
    return {**groups, **{f"{name} error": tuple(map(conversion_error, group)) for name, group in groups.items()}}


def _as_tuple(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _input_components(value: Any, sample_shape: tuple[int, ...]) -> tuple[Any, ...]:
    """Return the components of an array of samples, or of a tuple, as numbers or arrays."""
    if isinstance(value, tuple):
        return value
    array = np.asarray(value)
    if array.ndim == len(sample_shape):
        return tuple(array.ravel().tolist()) if array.dtype.char == "d" else tuple(array.ravel())
    flat = array.reshape(*array.shape[: array.ndim - len(sample_shape)], math.prod(sample_shape))
    return components_of(flat)


def _largest_bounds(components: Any, frame_count: int) -> Any:
    """Return the largest bound of components, or one for each of `frame_count` frames; plain numbers are exact."""
    errors = [c.error if isinstance(c, Bounded) else 0.0 for c in _as_tuple(components)]
    if not frame_count:
        return functools.reduce(np.maximum, errors, 0.0)
    count = len(errors) // frame_count
    return tuple(functools.reduce(np.maximum, errors[k * count : (k + 1) * count]) for k in range(frame_count))
