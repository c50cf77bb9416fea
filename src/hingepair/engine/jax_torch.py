"""Functions of JAX arrays and of PyTorch tensors, which these libraries differentiate as often as they want.

A derivative by "jvp" takes changes of some arguments behind all arguments, and returns the changes of the outputs;
one by "vjp" takes weights of the outputs, and returns gradients by some arguments. Both are linear in these, each is
the transpose of the other, and both can be differentiated in the same way: a chain of them says what is computed.

In JAX a chain is a kernel, which XLA, the compiler of JAX, calls itself: on its own arrays, without Python and
without copies. In PyTorch, and of rollouts in JAX, the libraries call back into Python.
"""

from __future__ import annotations

import ctypes
import functools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from hingepair.engine.backend import compiler_lock
from hingepair.engine.binding import ArrayShape
from hingepair.engine.calls import Call
from hingepair.engine.llvm.builder import FunctionBuilder
from hingepair.engine.llvm.kernels import Layout, begin_table, store_row
from hingepair.engine.llvm.native import Kernel
from hingepair.errors import ArgumentError, DtypeError, ShapeError
from hingepair.numeric.arrays import real_array
from hingepair.numeric.optional import require

Arrays: TypeAlias = Sequence[Any]
Shapes: TypeAlias = tuple[ArrayShape, ...]
Chain: TypeAlias = tuple[tuple[str, tuple[int, ...]], ...]
"""Kinds of derivatives, one of the other, with the numbers of the arguments by which each is taken."""


@dataclass(frozen=True, eq=False)  # no tuple, which PyTorch would take apart
class Differentiable:
    """A function of arrays with leading axes of samples, and its derivatives."""

    arguments: Shapes  # shape of one sample of each argument
    outputs: Shapes  # of each output
    run: Callable[[Chain, Arrays], Arrays]  # from a chain and NumPy arrays with equal leading axes to the outputs
    call: Callable[[Chain], Call] | None = None  # the call of a chain, whose kernel XLA calls; None without kernels

    def shapes(self, chain: Chain) -> tuple[Shapes, Shapes]:
        """Return the shapes of one sample of arguments and outputs of a chain of derivatives."""
        arguments, outputs = self.arguments, self.outputs
        for kind, by in chain:
            some = tuple(arguments[k] for k in by)
            if kind == "jvp":
                arguments = (*arguments, *some)
            else:
                arguments, outputs = (*arguments, *outputs), some
        return arguments, outputs

    def lead(self, chain: Chain, arrays: Arrays) -> ArrayShape:
        """Return the leading shape to which those of the arguments broadcast."""
        tails = self.shapes(chain)[0]
        leads = [tuple(one.shape[: one.ndim - len(tail)]) for one, tail in zip(arrays, tails, strict=True)]
        return np.broadcast_shapes(*leads)


def gradient_of(chain: Chain) -> tuple[int, ...]:
    """Return the arguments of a gradient, and refuse all other derivatives of what has no others."""
    if len(chain) > 1 or chain[0][0] != "vjp":
        raise NotImplementedError("of rollouts there are gradients (grad, vjp, jacrev, backward), and none of these")
    return chain[0][1]


def of_calls(calls: Callable[[Chain], Call]) -> Differentiable:
    """Return the function whose chains are computed by calls."""
    call = functools.cache(calls)

    def run(chain: Chain, arrays: Arrays) -> Arrays:
        one = call(chain)
        leads = zip(one.argument_shapes.items(), arrays, strict=True)
        shapes = {name: array.shape[: array.ndim - len(tail)] for (name, tail), array in leads}
        found = one.run(dict(zip(shapes, arrays, strict=True)), shapes)
        return [found] if one.result is None else [*found.arrays().values()]

    tails = tuple(call(()).argument_shapes.values()), tuple(tail for _, tail in call(()).loop.outputs)
    return Differentiable(*tails, run, call if call(()).has_kernels else None)


def library_function(library: str, calls: Callable[[Chain], Call]) -> Callable[..., Any]:
    """Return calls as a function of arrays of "jax" or "torch"."""
    package, call, function = require(library, f"f.{library}"), calls(()), of_calls(calls)
    if library == "jax" and function.call is None:
        expected = "a call without samples among its constants"
        raise ArgumentError("jax", expected, ", ".join(call.outputs))
    applied = jax_function(function) if library == "jax" else torch_function(function)

    def compute(*given: Any) -> Any:
        found = applied(*library_arrays(library, call.argument_shapes, given))
        return library_results(library, call.result, call.outputs, found, len(function.outputs[0]))

    # The graph of `torch.compile` ends before a call, and goes on behind.
    return package.compiler.disable(compute) if library == "torch" else compute


def library_results(library: str, kind: Any, names: Sequence[str], found: Arrays, axes: int) -> Any:
    """Return outputs as results of a class, or the only output; a sample of the first has so many `axes`."""
    if kind is None:
        return found[0]
    if library == "jax":
        _register(kind)
    return kind(dict(zip(names, found, strict=True)), tuple(found[0].shape[: found[0].ndim - axes]))


def library_arrays(library: str, tails: Mapping[str, ArrayShape], given: Arrays) -> Arrays:
    """Return the arguments as arrays of "jax" or "torch"; `tails` are the shapes of one sample. Numbers and, beside
    tensors, arrays of NumPy take the dtype of the others.
    """
    if len(given) != len(tails):
        raise ArgumentError("*given", f"{len(tails)} arguments: {', '.join(tails)}", f"{len(given)}")
    package, arrays = require(library, f"f.{library}"), [*given]
    kind = package.Array if library == "jax" else package.Tensor
    for k, name in enumerate(tails):
        if not isinstance(arrays[k], kind):
            arrays[k] = real_array(name, arrays[k])
    if library == "jax":
        dtype = package.numpy.result_type(float, *arrays)  # of integers and of Python's numbers alone, that of JAX
        arrays = [package.numpy.asarray(one, dtype) for one in arrays]
    else:
        dtypes = [one.dtype for one in arrays if isinstance(one, kind)]
        dtype = functools.reduce(package.promote_types, dtypes or [package.float64])
        arrays = [package.as_tensor(one).to(dtype) for one in arrays]
    for (name, tail), array in zip(tails.items(), arrays, strict=True):
        if str(dtype).removeprefix("torch.") not in {"float32", "float64"}:
            raise DtypeError(name, "float32 or float64", str(dtype))
        if library == "torch" and array.device.type != "cpu":
            raise ArgumentError(name, "a tensor in the processor's memory: .cpu()", f"one on {array.device}")
        if tuple(array.shape[max(0, array.ndim - len(tail)) :]) != tail:
            raise ShapeError(name, f"shape (..., {', '.join(map(str, tail))})", f"shape {tuple(array.shape)}")
    return arrays


# ---- PyTorch


def torch_function(function: Differentiable) -> Callable[..., tuple[Any, ...]]:
    """Return a function of tensors in the processor's memory, which PyTorch differentiates."""
    return functools.partial(_torch_primitive().apply, function, ())


@functools.cache
def _torch_primitive() -> Any:
    """Return the function of PyTorch that computes a chain."""
    import torch

    class Called(torch.autograd.Function):  # type: ignore[misc]
        """The outputs of a chain; its derivatives are longer chains."""

        @staticmethod
        def forward(function: Differentiable, chain: Chain, *tensors: Any) -> Any:
            found = function.run(chain, [one.detach().numpy() for one in tensors])
            return tuple(torch.tensor(one, dtype=tensors[0].dtype) for one in found)

        @staticmethod
        def setup_context(ctx: Any, inputs: Any, output: Any) -> None:  # noqa: ARG004 (as PyTorch calls it)
            ctx.function, ctx.chain, *tensors = inputs
            ctx.save_for_backward(*tensors)  # refused by PyTorch if one is changed in place
            ctx.save_for_forward(*tensors)

        @staticmethod
        def backward(ctx: Any, *weights: Any) -> Any:
            by = tuple(k for k, wanted in enumerate(ctx.needs_input_grad[2:]) if wanted)
            tensors = ctx.saved_tensors
            found = Called.apply(ctx.function, (*ctx.chain, ("vjp", by)), *tensors, *weights)
            gradients: list[Any] = [None] * len(tensors)
            for k, one in zip(by, found, strict=True):
                gradients[k] = one.sum_to_size(tensors[k].shape)
            return None, None, *gradients

        @staticmethod
        def jvp(ctx: Any, *changes: Any) -> Any:
            by = tuple(k for k, one in enumerate(changes[2:]) if one is not None)
            moving = [changes[2 + k] for k in by]
            return Called.apply(ctx.function, (*ctx.chain, ("jvp", by)), *ctx.saved_tensors, *moving)

        @staticmethod
        def vmap(_: Any, axes: Any, function: Differentiable, chain: Chain, *tensors: Any) -> Any:
            front = [x if axis is None else x.movedim(axis, 0) for x, axis in zip(tensors, axes[2:], strict=True)]
            tails = function.shapes(chain)[0]
            single = [
                x.ndim - len(tail) - (axis is not None) for x, tail, axis in zip(front, tails, axes[2:], strict=True)
            ]
            spread = [  # axes of length 1 behind the new one, up to the leading axes of all
                x if axis is None else x.reshape(len(x), *[1] * (max(single) - n), *x.shape[1:])
                for x, n, axis in zip(front, single, axes[2:], strict=True)
            ]
            found = Called.apply(function, chain, *spread)
            return found, (0,) * len(found)

    return Called


# ---- JAX


def jax_function(function: Differentiable) -> Callable[..., tuple[Any, ...]]:
    """Return a function of JAX arrays of one dtype that JAX can transform."""
    import jax
    import jax.numpy as jnp

    def spread(*arrays: Any) -> tuple[Any, ...]:
        lead = function.lead((), arrays)
        full = (jnp.broadcast_to(one, lead + tail) for one, tail in zip(arrays, function.arguments, strict=True))
        return tuple(_jax_primitive().bind(*full, function=function, chain=()))

    compiled: Callable[..., tuple[Any, ...]] = jax.jit(spread)
    return compiled


@functools.cache
def _jax_primitive() -> Any:
    """Return the primitive of JAX that computes a chain, whose arguments have the same leading axes."""
    import jax
    import jax.numpy as jnp
    from jax.extend.core import Primitive
    from jax.interpreters import ad, batching, mlir

    primitive: Any = Primitive("hingepair")
    primitive.multiple_results = True

    def outputs(arrays: Arrays, function: Differentiable, chain: Chain) -> list[Any]:
        lead, tails = function.lead(chain, arrays), function.shapes(chain)[1]
        return [jax.ShapeDtypeStruct((*lead, *tail), arrays[0].dtype) for tail in tails]  # type: ignore[no-untyped-call]

    def shapes(*arrays: Any, function: Differentiable, chain: Chain) -> list[Any]:
        return [jax.core.ShapedArray(one.shape, one.dtype) for one in outputs(arrays, function, chain)]

    def compute(*arrays: Any, function: Differentiable, chain: Chain) -> list[Any]:
        results = outputs(arrays, function, chain)
        if function.call is not None:
            return call_by_xla(function.call(chain), arrays, results)
        if chain:
            gradient_of(chain)

        def host(*values: Any) -> tuple[Any, ...]:
            found = function.run(chain, [*map(np.asarray, values)])
            return tuple(np.asarray(one, results[0].dtype) for one in found)

        return [*jax.pure_callback(host, tuple(results), *arrays)]

    def given(function: Differentiable, chain: Chain) -> int:
        """Return the number of arguments in which the last derivative is not linear."""
        return len(function.shapes(chain[:-1])[0])

    def change(arrays: Arrays, changes: Arrays, *, function: Differentiable, chain: Chain) -> Any:
        """Return the outputs and their changes."""
        found = primitive.bind(*arrays, function=function, chain=chain)
        moving = tuple(k for k, one in enumerate(changes) if not isinstance(one, ad.Zero))
        if chain and min(moving) >= (count := given(function, chain)):
            full = map(ad.instantiate_zeros, changes[count:])
            return found, primitive.bind(*arrays[:count], *full, function=function, chain=chain)
        vectors = [changes[k] for k in moving]
        return found, primitive.bind(*arrays, *vectors, function=function, chain=(*chain, ("jvp", moving)))

    def transpose(weights: Arrays, *arrays: Any, function: Differentiable, chain: Chain) -> list[Any]:
        count, (kind, by) = given(function, chain), chain[-1]
        full = map(ad.instantiate_zeros, weights)
        other = (*chain[:-1], ({"jvp": "vjp", "vjp": "jvp"}[kind], by))
        return [None] * count + [*primitive.bind(*arrays[:count], *full, function=function, chain=other)]

    def batch(arrays: Arrays, axes: Arrays, *, function: Differentiable, chain: Chain) -> Any:
        size = next(one.shape[axis] for one, axis in zip(arrays, axes, strict=True) if axis is not None)
        front = [
            jnp.broadcast_to(one, (size, *one.shape)) if axis is None else jnp.moveaxis(one, axis, 0)
            for one, axis in zip(arrays, axes, strict=True)
        ]
        found = primitive.bind(*front, function=function, chain=chain)
        return found, [0] * len(found)

    primitive.def_abstract_eval(shapes)
    primitive.def_impl(compute)
    mlir.register_lowering(primitive, mlir.lower_fun(compute, multiple_results=True), platform="cpu")
    ad.primitive_jvps[primitive] = change
    ad.primitive_transposes[primitive] = transpose
    batching.primitive_batchers[primitive] = batch
    return primitive


@functools.cache
def _register(results: Any) -> None:
    """Register a class of results as a pytree of JAX, so that functions of JAX take and return such results."""
    from jax.tree_util import register_pytree_node

    def flatten(one: Any) -> Any:
        arrays = tuple(one.arrays().values())
        return arrays, (one.outputs, arrays[0].ndim - len(one.shape))

    def unflatten(structure: tuple[tuple[str, ...], int], arrays: Arrays) -> Any:
        names, sample_axes = structure  # sample_axes: of the first output
        shape = tuple(getattr(arrays[0], "shape", ()))  # JAX also passes placeholders that are not arrays
        return results(dict(zip(names, arrays, strict=True)), shape[: len(shape) - sample_axes])

    register_pytree_node(results, flatten, unflatten)


# ---- kernels that XLA calls itself
#
# XLA calls a handler with a call frame (`xla/ffi/api/c_api.h` of `jax.ffi.include_dir()`), which holds addresses and
# shapes of arrays. The handler, a function of machine code, calls the kernel with them.

# Offsets [bytes] in XLA's structures, which only grow at their ends while the major version of the interface is 0.
_EXTENSION, _KIND = 8, 8  # in a call frame; in an extension
_ARGUMENTS, _RESULTS, _ATTRIBUTES = 72, 112, 160  # in a call frame: tables of addresses
_DATA, _RANK, _DIMENSIONS = 24, 32, 40  # in a buffer
_NUMBERS = 16  # in an array among the attributes
_METADATA = 24  # in an extension of the kind that asks for nothing but metadata
_ASKS_FOR_METADATA = 1  # kind of such an extension
_MAJOR, _MINOR, _TRAITS = 24, 28, 32  # in metadata

_targets: dict[str, tuple[Kernel, Kernel]] = {}  # kernels and their handlers by name, for the life of the process


def call_by_xla(call: Call, arrays: Sequence[Any], results: Sequence[Any]) -> list[Any]:
    """Return the outputs of a call of JAX arrays with equal leading axes.

    Raises:
        CompilationError: LLVM fails.
    """
    import jax

    dtype = np.dtype(arrays[0].dtype)
    kernel, layout, constants = call.machine_code(dtype.char)
    attributes = {"constants": constants} if constants.size else {}
    return [*jax.ffi.ffi_call(_target(kernel, layout, dtype.char), results)(*arrays, **attributes)]


def _target(kernel: Kernel, layout: Layout, char: str) -> str:
    """Return the name by which XLA knows a kernel. It says what the kernel computes, since JAX can keep compiled
    programs on disk.
    """
    import jax

    name = f"hingepair.{kernel.key}"
    with compiler_lock:
        if name not in _targets:
            header = (Path(jax.ffi.include_dir()) / "xla/ffi/api/c_api.h").read_text(encoding="utf-8")
            minor = int(re.findall(r"^#define XLA_FFI_API_MINOR (\d+)", header, re.MULTILINE)[0])
            ir = functools.partial(_handler_ir, name, layout, np.dtype(char).itemsize, minor)
            handler = Kernel("handler", ir, imports={name: kernel.address("kernel")})
            capsule = ctypes.pythonapi.PyCapsule_New
            capsule.restype, capsule.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
            jax.ffi.register_ffi_target(name, capsule(handler.address("handler"), None, None), platform="cpu")
            _targets[name] = kernel, handler
    return name


def _handler_ir(name: str, layout: Layout, number_bytes: int, minor: int) -> str:
    """Return the LLVM module of the handler of a kernel of this name."""
    f = FunctionBuilder("ptr @handler(ptr %frame)")
    extension = f.load_word("%frame", _EXTENSION, "ptr")
    none = f.put(f"icmp eq ptr {extension}, null")
    holder = f.put(f"select i1 {none}, ptr %frame, ptr {extension}")  # the frame itself has the null there
    with f.when_else(f.put(f"icmp ne i32 {f.load_half(holder, _KIND)}, {_ASKS_FOR_METADATA}")) as otherwise:
        _call_kernel(f, name, layout, number_bytes)
        otherwise()
        metadata = f.load_word(extension, _METADATA, "ptr")
        for offset, value in ((_MAJOR, 0), (_MINOR, minor), (_TRAITS, 0)):
            f.do(f"store i32 {value}, ptr {f.pointer_at(metadata, offset)}, align 4")
    f.do("ret ptr null")
    return "\n\n".join([f'declare void @"{name}"(ptr, i64)', f.text()]) + "\n"


def _call_kernel(f: FunctionBuilder, name: str, layout: Layout, number_bytes: int) -> None:
    """Append the call of the kernel with the arrays of the call frame, which are contiguous."""
    tables = {True: f.load_word("%frame", _ARGUMENTS, "ptr"), False: f.load_word("%frame", _RESULTS, "ptr")}
    places = [(True, k) for k in range(len(layout.inputs))] + [(False, k) for k in range(len(layout.outputs))]
    buffers = [f.load_word(tables[is_input], 8 * k, "ptr") for is_input, k in places]
    constants = "null"
    if layout.constants:
        attribute = f.load_word(f.load_word("%frame", _ATTRIBUTES, "ptr"), 0, "ptr")
        constants = f.load_word(attribute, _NUMBERS, "ptr")
    table = begin_table(f, layout, constants, number_bytes)
    for k, row in layout.rows.items():
        size = number_bytes * math.prod(layout.operands[k].sample_shape)
        store_row(f, table, row, f.load_word(buffers[k], _DATA), str(size), str(number_bytes))
    count = f.buffer(8)
    f.store_word(1, count)
    dimensions = f.load_word(buffers[-1], _DIMENSIONS, "ptr")
    axes = f.put(f"sub i64 {f.load_word(buffers[-1], _RANK)}, {len(layout.operands[-1].sample_shape)}")
    with f.loop(axes) as axis:
        length = f.load_word(f.pointer_at(dimensions, f.multiply(axis, 8)), 0)
        f.store_word(f.multiply(length, f.load_word(count, 0)), count)
    f.do(f'call void @"{name}"(ptr {table}, i64 {f.load_word(count, 0)})')
