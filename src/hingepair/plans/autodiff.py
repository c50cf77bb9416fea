"""Kernels for arrays of JAX and PyTorch in the processor's memory, and derivatives for their transformations.

JAX and PyTorch see one function of their arrays whose Jacobian another kernel computes; they multiply by it. On other
devices, and for derivatives of derivatives, they run and differentiate the equations themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from hingepair.engine.binding import ArrayShape
from hingepair.engine.calls import Call
from hingepair.numeric.array_libraries import Library, is_foreign, namespace_of
from hingepair.plans.derivatives import Derivative

Arrays = Sequence[Any]
Functions = Callable[..., tuple[Any, ...]]


class Caller(Protocol):
    """What gives the calls of a computation: of its outputs, or of a derivative."""

    def __call__(self, derivative: Derivative | None = None) -> Call:
        """Return the call."""


def kernel_function(call_of: Caller, library: Library) -> Functions | None:
    """Return a function of the arrays of a library that a kernel computes, in the order of the call's arguments and
    outputs; None where the library computes by itself.
    """
    call = call_of()
    if not call.loop.traced or any(0 in tail for tail in (*call.argument_shapes.values(), *_tails(call))):
        return None
    if library.name == "jax":
        import jax

        return _jax_function(call_of) if jax.default_backend() == "cpu" else None
    if library.name == "torch":
        return _torch_function(call_of) if library.device.type == "cpu" else None
    return None


def apply(function: Functions, call: Call, values: Mapping[str, Any], library: Library) -> dict[str, Any]:
    """Return the outputs of a kernel's function for arguments by name, arrays or tuples of components."""
    arrays = []
    for name, tail in call.argument_shapes.items():
        value = values[name]
        if isinstance(value, tuple):
            shapes = [tuple(one.shape) for one in value if is_foreign(one)]
            value = library.join_components(value, np.broadcast_shapes(*shapes), tail)
        array = library.array(value)
        arrays.append(array if array.dtype == library.dtype else library.namespace.astype(array, library.dtype))
    most = max(len(one.shape) - len(tail) for one, tail in zip(arrays, call.argument_shapes.values(), strict=True))
    for k, tail in enumerate(call.argument_shapes.values()):  # so that an axis in front is one of samples
        shape = tuple(arrays[k].shape)
        arrays[k] = arrays[k].reshape((1,) * (most + len(tail) - len(shape)) + shape)
    return dict(zip(call.outputs, function(*arrays), strict=True))


def _tails(call: Call) -> list[ArrayShape]:
    """Return the shapes of one sample of the outputs."""
    by_name = dict(call.loop.outputs)
    return [by_name[name] for name in call.outputs]


def _lead(call: Call, arrays: Arrays) -> ArrayShape:
    """Return the shape of the samples."""
    tails = call.argument_shapes.values()
    return np.broadcast_shapes(
        *(tuple(one.shape)[: len(one.shape) - len(tail)] for one, tail in zip(arrays, tails, strict=True))
    )


def _computed(call: Call, arrays: Arrays) -> tuple[Any, ...]:
    """Return the outputs for arrays of NumPy."""
    found = call.rows(*arrays)
    if found is None:
        shapes = {
            name: one.shape[: one.ndim - len(tail)]
            for (name, tail), one in zip(call.argument_shapes.items(), arrays, strict=True)
        }
        found = call.run(dict(zip(call.argument_shapes, arrays, strict=True)), shapes)
    return (found,) if call.result is None else tuple(found.arrays().values())


def _jacobian_of(call_of: Caller, names: tuple[str, ...]) -> Call:
    """Return the call of the Jacobians of all outputs by arguments, output by output."""
    call = call_of()
    by = tuple((name, call.argument_shapes[name]) for name in names)
    return call_of(Derivative("jacobian", call.outputs, by, entries=True))


def _products(call: Call, names: Sequence[str], jacobians: Arrays, changes: Arrays) -> list[Any]:
    """Return the changes of the outputs for changes of arguments."""
    found, left = [], iter(jacobians)
    for tail in _tails(call):
        total: Any = 0.0
        for name, change in zip(names, changes, strict=True):
            J, inner = next(left), call.argument_shapes[name]
            lead = tuple(J.shape)[: len(J.shape) - len(tail) - len(inner)]
            matrix = J.reshape((*lead, math.prod(tail), math.prod(inner)))
            vector = change.reshape((*tuple(change.shape)[: len(change.shape) - len(inner)], math.prod(inner)))
            columns = (matrix[..., k] * vector[..., k, None] for k in range(math.prod(inner)))
            total = total + sum(columns).reshape((*lead, *tail))  # matmul of many small matrices is slow
        found.append(total)
    return found


def _traced(call: Call, library: Library, arrays: Arrays) -> tuple[Any, ...]:
    """Return the outputs as the library computes them."""
    values = dict(zip(call.argument_shapes, arrays, strict=True))
    tails = call.argument_shapes.values()
    shapes = {
        name: tuple(one.shape)[: len(one.shape) - len(tail)]
        for (name, one), tail in zip(values.items(), tails, strict=True)
    }
    found = call.run_foreign(values, shapes, library, None, 1)
    return (found,) if call.result is None else tuple(found.arrays().values())


# ---- JAX


def _jax_function(call_of: Caller) -> Functions:
    import jax

    call = call_of()
    names = tuple(call.argument_shapes)

    def differentiable(call: Call, rule: Callable[[Any, Any], Any], **options: Any) -> Any:
        """Return what a kernel computes as a function of JAX with a rule for its changes."""

        def on_host(*arrays: Any) -> tuple[Any, ...]:
            return _computed(call, [np.asarray(one) for one in arrays])

        def function(*arrays: Any) -> Any:
            lead = _lead(call, arrays)
            struct: Any = jax.ShapeDtypeStruct
            shapes = [struct((*lead, *tail), arrays[0].dtype) for tail in _tails(call)]
            return tuple(jax.pure_callback(on_host, tuple(shapes), *arrays, vmap_method="expand_dims"))

        found = jax.custom_jvp(function)
        found.defjvp(rule, **options)
        return found

    jacobians: dict[tuple[str, ...], Any] = {}

    def jacobian(by: tuple[str, ...]) -> Any:
        if by not in jacobians:
            derived = _jacobian_of(call_of, by)

            def by_equations(*arrays: Any) -> Any:
                library = Library("jax", jax.numpy, arrays[0].dtype, None)
                return _traced(derived, library, arrays)

            jacobians[by] = differentiable(derived, lambda given, changes: jax.jvp(by_equations, given, changes))
        return jacobians[by]

    def rule(given: Any, changes: Any) -> Any:
        still = jax.custom_derivatives.SymbolicZero
        moving = {name: one for name, one in zip(names, changes, strict=True) if not isinstance(one, still)}
        results = function(*given)
        found = jacobian(tuple(moving))(*given)
        return results, tuple(_products(call, tuple(moving), found, tuple(moving.values())))

    function = differentiable(call, rule, symbolic_zeros=True)
    compiled: Functions = jax.jit(function)
    return compiled


# ---- PyTorch


def _torch_function(call_of: Caller) -> Functions:
    import torch

    call = call_of()
    names = tuple(call.argument_shapes)

    def differentiable(call: Call, pullback: Any, pushforward: Any) -> Any:
        """Return what a kernel computes as a function of PyTorch with rules for its derivatives."""

        class Kernel(torch.autograd.Function):  # type: ignore[misc]
            """Function that a kernel computes."""

            @staticmethod
            def forward(*arrays: Any) -> Any:
                found = _computed(call, [one.detach().numpy() for one in arrays])
                return tuple(torch.from_numpy(np.array(one)) for one in found)

            @staticmethod
            def setup_context(ctx: Any, inputs: Any, output: Any) -> None:  # noqa: ARG004
                ctx.save_for_backward(*inputs)
                ctx.save_for_forward(*inputs)

            @staticmethod
            def backward(ctx: Any, *weights: Any) -> Any:
                return tuple(pullback(ctx.saved_tensors, ctx.needs_input_grad, weights))

            @staticmethod
            def jvp(ctx: Any, *changes: Any) -> Any:
                return tuple(pushforward(ctx.saved_tensors, changes))

            @staticmethod
            def vmap(info: Any, in_dims: Any, *arrays: Any) -> Any:
                moved = [
                    one.unsqueeze(0) if axis is None else one.movedim(axis, 0)
                    for one, axis in zip(arrays, in_dims, strict=True)
                ]
                found = Kernel.apply(*moved)
                return tuple(one.expand(info.batch_size, *one.shape[1:]) for one in found), (0,) * len(found)

        return Kernel.apply

    jacobians: dict[tuple[str, ...], Any] = {}

    def jacobian(by: tuple[str, ...]) -> Any:
        if by not in jacobians:
            derived = _jacobian_of(call_of, by)

            def second(given: Any, _: Any, weights: Any) -> Any:
                with torch.enable_grad():
                    inputs = [one.detach().requires_grad_() for one in given]
                    library = Library("torch", namespace_of(inputs[0]), inputs[0].dtype, inputs[0].device)
                    found = _traced(derived, library, inputs)
                    return torch.autograd.grad(found, inputs, weights, allow_unused=True)

            def refuse(*_: Any) -> Any:
                raise NotImplementedError("forward derivatives of derivatives: use torch.func.jacrev for the second")

            jacobians[by] = differentiable(derived, second, refuse)
        return jacobians[by]

    def pullback(given: Any, needed: Any, weights: Any) -> Any:
        by = tuple(name for name, one in zip(names, needed, strict=True) if one)
        found = iter(jacobian(by)(*given))
        sums: dict[str, Any] = dict.fromkeys(by, 0.0)
        for tail, weight in zip(_tails(call), weights, strict=True):
            for name in by:
                J, inner = next(found), call.argument_shapes[name]
                if weight is not None:
                    lead = J.shape[: J.ndim - len(tail) - len(inner)]
                    matrix = J.reshape(*lead, math.prod(tail), math.prod(inner))
                    row = weight.reshape(*lead, math.prod(tail))
                    sums[name] = sums[name] + torch.einsum("...ij,...i->...j", matrix, row).reshape(*lead, *inner)
        return [
            sums[name].sum_to_size(one.shape) if name in sums else None
            for name, one in zip(names, given, strict=True)
        ]

    def pushforward(given: Any, changes: Any) -> Any:
        moving = {name: one for name, one in zip(names, changes, strict=True) if one is not None}
        found = jacobian(tuple(moving))(*given)
        return _products(call, tuple(moving), found, tuple(moving.values()))

    function: Functions = differentiable(call, pullback, pushforward)
    return function
