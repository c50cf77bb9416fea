"""Kernels for arrays of JAX and PyTorch in the processor's memory, and derivatives for their transformations.

JAX and PyTorch see one function of their arrays whose derivatives other kernels compute; PyTorch multiplies by the
Jacobian. On other devices, and for derivatives of derivatives, they run and differentiate the equations themselves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hingepair.engine.calls import Call
from hingepair.numeric.array_libraries import Library, namespace_of
from hingepair.plans.differentiable import (
    Arrays,
    Caller,
    Differentiable,
    Functions,
    by_library,
    leading_shapes,
    split,
)


def kernel_function(call_of: Caller, library: Library) -> Functions | None:
    """Return a function of a library's arrays, in the order of the call's arguments, that a kernel computes and the
    library can differentiate; None where the library computes by itself.
    """
    function = Differentiable(call_of)
    tails = *function.arguments.values(), *function.outputs.values()
    if not function.call.loop.traced or any(0 in tail for tail in tails):
        return None
    if library.name == "jax":
        import jax

        if jax.default_backend() == "cpu":
            from hingepair.plans.jax_functions import jax_function

            return jax_function(function)
    if library.name == "torch" and library.device.type == "cpu":
        return _torch_function(function)
    return None


def apply(function: Functions, call: Call, values: Mapping[str, Any], library: Library) -> dict[str, Any]:
    """Return the outputs of a kernel's function for arguments by name, arrays or tuples of components."""
    arrays = []
    for name, tail in call.argument_shapes.items():
        value = values[name]
        if isinstance(value, tuple):
            value = library.join_components(value, np.broadcast_shapes(*map(np.shape, value)), tail)
        array = library.array(value)
        arrays.append(array if array.dtype == library.dtype else library.namespace.astype(array, library.dtype))
    most = max(len(one.shape) - len(tail) for one, tail in zip(arrays, call.argument_shapes.values(), strict=True))
    for k, tail in enumerate(call.argument_shapes.values()):  # so that an axis in front is one of samples
        shape = tuple(arrays[k].shape)
        arrays[k] = arrays[k].reshape((1,) * (most + len(tail) - len(shape)) + shape)
    return dict(zip(call.outputs, function(*arrays), strict=True))


def _computed(call: Call, arrays: Arrays) -> tuple[Any, ...]:
    """Return the outputs that the kernel computes for arrays of NumPy."""
    found = call.rows(*arrays)
    if found is None:
        shapes = leading_shapes(call.argument_shapes, arrays)
        found = call.run(dict(zip(shapes, arrays, strict=True)), shapes)
    return (found,) if call.result is None else tuple(found.arrays().values())


def _torch_function(function: Differentiable) -> Functions:
    """Return the function of PyTorch tensors that a kernel computes, with rules for its derivatives."""
    import torch

    names = tuple(function.arguments)

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
                """Move the mapped axes to the front, where they are axes of samples."""
                moved = [
                    one.unsqueeze(0) if axis is None else one.movedim(axis, 0)
                    for one, axis in zip(arrays, in_dims, strict=True)
                ]
                found = Kernel.apply(*moved)
                return tuple(one.expand(info.batch_size, *one.shape[1:]) for one in found), (0,) * len(found)

        return Kernel.apply

    jacobians: dict[tuple[str, ...], Any] = {}

    def jacobian(by: tuple[str, ...]) -> Any:
        """Return the function, made once, of the Jacobians by these arguments."""
        if by not in jacobians:
            derived = function.derivative("jacobian", by)

            def second(given: Any, _: Any, weights: Any) -> Any:
                """Return the derivatives of weighted Jacobians, which PyTorch takes through the equations."""
                with torch.enable_grad():
                    inputs = [one.detach().requires_grad_() for one in given]
                    library = Library("torch", namespace_of(inputs[0]), inputs[0].dtype, inputs[0].device)
                    found = by_library(derived, library, inputs)
                    return torch.autograd.grad(found, inputs, weights, allow_unused=True)

            def refuse(*_: Any) -> Any:
                raise NotImplementedError("forward derivatives of derivatives: use torch.func.jacrev for the second")

            jacobians[by] = differentiable(derived, second, refuse)
        return jacobians[by]

    def pullback(given: Any, needed: Any, weights: Any) -> Any:
        """Return the gradients, by the needed arguments, of the outputs times their weights; None for the others."""
        by = tuple(name for name, one in zip(names, needed, strict=True) if one)
        total: Any = 0.0
        for J, tail, weight in zip(jacobian(by)(*given), function.outputs.values(), weights, strict=True):
            if weight is not None:
                row = weight.reshape(*weight.shape[: weight.ndim - len(tail)], math.prod(tail))
                total = total + torch.einsum("...ij,...i->...j", J, row)
        sums = dict(zip(by, split(total, [function.arguments[name] for name in by]), strict=True))
        return [
            sums[name].sum_to_size(one.shape) if name in sums else None
            for name, one in zip(names, given, strict=True)
        ]

    def pushforward(given: Any, changes: Any) -> Any:
        moving = {name: one for name, one in zip(names, changes, strict=True) if one is not None}
        found = jacobian(tuple(moving))(*given)
        return function.products(tuple(moving), found, tuple(moving.values()))

    found: Functions = differentiable(function.call, pullback, pushforward)
    return found
