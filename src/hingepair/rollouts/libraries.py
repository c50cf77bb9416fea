"""Rollouts of arrays of JAX and PyTorch, whose transformations take the gradients of rollouts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from hingepair.engine.binding import ArrayShape
from hingepair.errors import ArgumentError, ShapeError
from hingepair.numeric.array_libraries import Library
from hingepair.numeric.arrays import FloatArray

Arrays = Sequence[Any]
_SAMPLE_AXES = {"q0": 1, "qd0": 1, "tau": 2}  # axes of one sample, behind those of the motions


class Recorded(Protocol):
    """What is used of the results of a rollout."""

    def arrays(self) -> dict[str, FloatArray]:
        """Return the recorded states by name."""

    def vjp(self, cotangents: Mapping[str, Any], wrt: Sequence[str]) -> dict[str, FloatArray]:
        """Return gradients by name."""


Roll = Callable[..., Recorded]
"""What returns a rollout from q0, qd0 and tau by name."""


def rolled_out_in(library: Library, roll: Roll, arguments: Mapping[str, Any], dof: int) -> dict[str, Any]:
    """Return recorded states as arrays of a library, which it can differentiate by the arguments.

    Args:
        library: the library.
        roll: the rollout.
        arguments: q0, qd0 and tau, as far as they are arrays of the library.
        dof: number of coordinates.

    Raises:
        ArgumentError: the library is none that can be used, or an argument has another shape.
    """
    functions = {"jax": _jax_function, "torch": _torch_function}
    if library.name not in functions:
        raise ArgumentError(next(iter(arguments)), "arrays of NumPy, JAX or PyTorch", f"those of {library.name}")
    values = []
    for name, value in arguments.items():
        shape = tuple(value.shape)
        if not shape or shape[-1] != dof:
            raise ShapeError(name, f"shape (..., {dof})", f"shape {shape}")
        values.append(value[None] if len(shape) < _SAMPLE_AXES[name] else value)
    # All get as many axes of motions, so that an axis in front of them is one of samples.
    ends = [_SAMPLE_AXES[name] for name in arguments]
    axes = max(len(value.shape) - end for value, end in zip(values, ends, strict=True))
    values = [
        value.reshape((1,) * (axes + end - len(value.shape)) + tuple(value.shape))
        for value, end in zip(values, ends, strict=True)
    ]
    shape = np.broadcast_shapes(*(tuple(value.shape[:axes]) for value in values))
    nothing = [np.zeros((0, *value.shape[axes:])) for value in values]
    recorded = roll(**dict(zip(arguments, nothing, strict=True))).arrays()
    outputs = {name: (*shape, *one.shape[1:]) for name, one in recorded.items()}
    function = functions[library.name](_Function(roll, tuple(arguments), axes, outputs), library)
    return dict(zip(outputs, function(*values), strict=True))


class _Function(NamedTuple):
    """A rollout as a function of arrays of NumPy in order, which may have further axes of samples in front."""

    roll: Roll
    names: tuple[str, ...]  # of the arguments
    axes: int  # of the motions
    outputs: Mapping[str, ArrayShape]

    def run(self, values: Arrays) -> Recorded:
        """Return the rollout."""
        return self.roll(**dict(zip(self.names, (np.asarray(value, np.float64) for value in values), strict=True)))

    def pull(self, recorded: Recorded, values: Arrays, weights: Arrays) -> list[FloatArray]:
        """Return the gradients by the values, for weights of the outputs; in their shapes, with axes of samples."""
        states = recorded.arrays()
        cotangents = {name: np.asarray(one, np.float64) for name, one in zip(self.outputs, weights, strict=True)}
        if "S1" in cotangents:  # the entries of an attitude change so where it turns
            cotangents["S1"] = np.cross(states["S1"], cotangents["S1"], axis=-2).sum(axis=-1)
        found = recorded.vjp(cotangents, self.names)
        gradients = []
        for name, value in zip(self.names, values, strict=True):
            end = value.ndim - _SAMPLE_AXES[name]
            shared = tuple(k for k in range(end - self.axes, end) if value.shape[k] == 1)
            gradients.append(found[name].sum(axis=shared, keepdims=True))
        return gradients


def _jax_function(function: _Function, library: Library) -> Callable[..., Any]:
    """Return the rollout as a function of JAX arrays, whose gradients `function.pull` computes."""
    import jax

    struct: Any = jax.ShapeDtypeStruct
    shapes = [struct(shape, library.dtype) for shape in function.outputs.values()]

    def host(*values: Any) -> tuple[Any, ...]:
        return tuple(one.astype(library.dtype) for one in function.run(values).arrays().values())

    def host_gradients(*both: Any) -> tuple[Any, ...]:
        """Return the gradients for NumPy arrays: the values, then the weights of the outputs."""
        count = len(function.names)
        pairs = zip(both[count:], shapes, strict=True)
        samples = np.broadcast_shapes(*(one.shape[: one.ndim - len(expected.shape)] for one, expected in pairs))
        values = [np.asarray(one) for one in both[:count]]
        lead = samples + (1,) * (values[0].ndim - len(samples))
        values[0] = np.broadcast_to(values[0], np.broadcast_shapes(lead, values[0].shape))
        found = function.pull(function.run(values), values, both[count:])
        return tuple(one.astype(library.dtype) for one in found)

    def forward(*values: Any) -> Any:
        return jax.pure_callback(host, tuple(shapes), *values, vmap_method="expand_dims")

    def backward(values: Any, weights: Any) -> Any:
        gradients = tuple(struct(value.shape, library.dtype) for value in values)
        return jax.pure_callback(host_gradients, gradients, *values, *weights, vmap_method="expand_dims")

    differentiable = jax.custom_vjp(forward)
    differentiable.defvjp(lambda *values: (forward(*values), values), backward)
    return differentiable


def _torch_function(function: _Function, library: Library) -> Callable[..., Any]:
    """Return the rollout as a function of PyTorch tensors, whose gradients `function.pull` computes."""
    import torch

    class Rolled(torch.autograd.Function):  # type: ignore[misc]
        """The rollout with its gradients."""

        @staticmethod
        def forward(ctx: Any, *values: Any) -> Any:
            ctx.values = [value.detach().cpu().numpy() for value in values]
            ctx.recorded = function.run(ctx.values)
            found = ctx.recorded.arrays().values()
            return tuple(torch.tensor(one, dtype=library.dtype, device=library.device) for one in found)

        @staticmethod
        def backward(ctx: Any, *weights: Any) -> Any:
            full = [
                np.zeros(shape) if one is None else one.cpu().numpy()
                for one, shape in zip(weights, function.outputs.values(), strict=True)
            ]
            found = function.pull(ctx.recorded, ctx.values, full)
            return tuple(torch.tensor(one, dtype=library.dtype, device=library.device) for one in found)

    applied: Callable[..., Any] = Rolled.apply
    return applied
