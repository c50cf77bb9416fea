"""Calls as functions of JAX arrays and of PyTorch tensors, which these libraries differentiate.

JAX: each call, and each derivative of it, is a kernel, which XLA, the compiler of JAX, calls itself: on its own
arrays, without Python and without copies. One primitive tells JAX how kernels are batched, differentiated and
transposed. PyTorch, and rollouts in JAX, call back into Python.
"""

from __future__ import annotations

import ctypes
import functools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np

from hingepair.engine.backend import compiler_lock
from hingepair.engine.binding import ArrayShape
from hingepair.engine.calls import Call
from hingepair.engine.llvm.builder import FunctionBuilder
from hingepair.engine.llvm.native import Kernel
from hingepair.engine.ufunc import Layout
from hingepair.errors import ArgumentError, CompilationError, DtypeError, ShapeError
from hingepair.numeric.arrays import real_array
from hingepair.numeric.optional import require

Arrays: TypeAlias = Sequence[Any]
Pull: TypeAlias = Callable[[Sequence[int], Arrays], Arrays]
"""Function of the numbers of arguments and of weights of the outputs; returns the gradients by these arguments of the
weighted sum of outputs, one for each sample."""
Run: TypeAlias = Callable[[Arrays], tuple[Arrays, Pull]]
"""Function of NumPy arrays; returns the outputs, and what gives gradients."""


class Calls(Protocol):
    """A call and its derivatives. An attitude changes by its nine entries."""

    def __call__(self, kind: str, by: tuple[str, ...]) -> Call:
        """Return a call: the "value"; or by the arguments `by` its "jacobian", a matrix for each output; its "jvp",
        whose further arguments are changes of these; or its "vjp", whose further arguments are weights of outputs.
        """


def library_function(library: str, calls: Calls) -> Callable[..., Any]:
    """Return a call as a function of arrays of "jax" or "torch"."""
    require(library, f"f.{library}")
    call = calls("value", ())
    function = jax_function(calls) if library == "jax" else torch_function(runner(calls))

    def compute(*given: Any) -> Any:
        found = function(*library_arrays(library, call.argument_shapes, given))
        return library_results(library, call.result, call.outputs, found, len(call.loop.outputs[0][1]))

    return compute


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
        arrays = [package.as_tensor(one, dtype=dtype) for one in arrays]
    for (name, tail), array in zip(tails.items(), arrays, strict=True):
        if str(dtype).removeprefix("torch.") not in {"float32", "float64"}:
            raise DtypeError(name, "float32 or float64", str(dtype))
        if library == "torch" and array.device.type != "cpu":
            raise ArgumentError(name, "a tensor in the processor's memory: .cpu()", f"one on {array.device}")
        if tuple(array.shape[max(0, array.ndim - len(tail)) :]) != tail:
            raise ShapeError(name, f"shape (..., {', '.join(map(str, tail))})", f"shape {tuple(array.shape)}")
    return arrays


# ---- PyTorch


def torch_function(run: Run) -> Callable[..., tuple[Any, ...]]:
    """Return a function of tensors in the processor's memory, which `backward` differentiates once."""
    import torch

    class Called(torch.autograd.Function):  # type: ignore[misc]
        """What `run` computes, with its gradients."""

        @staticmethod
        def forward(ctx: Any, *tensors: Any) -> Any:
            ctx.save_for_backward(*tensors)
            found, ctx.pull = run([one.detach().numpy() for one in tensors])
            ctx.shapes = [np.shape(one) for one in found]
            return tuple(torch.tensor(one, dtype=tensors[0].dtype) for one in found)

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, *weights: Any) -> Any:
            tensors = ctx.saved_tensors  # refused by PyTorch if one was changed in place
            needed = [k for k, wanted in enumerate(ctx.needs_input_grad) if wanted]
            gradients: list[Any] = [None] * len(tensors)
            for k, one in zip(needed, ctx.pull(needed, [one.numpy() for one in weights]), strict=True):
                gradients[k] = torch.tensor(one, dtype=tensors[k].dtype).sum_to_size(tensors[k].shape)
            return tuple(gradients)

    applied: Callable[..., tuple[Any, ...]] = Called.apply
    return applied


def runner(calls: Calls) -> Run:
    """Return what runs a call on NumPy arrays."""

    def run(arrays: Arrays) -> tuple[Arrays, Pull]:
        def pull(needed: Sequence[int], weights: Arrays) -> Arrays:
            names = tuple(calls("value", ()).argument_shapes)
            return _computed(calls("vjp", tuple(names[k] for k in needed)), [*arrays, *weights])

        return _computed(calls("value", ()), arrays), pull

    return run


def _computed(call: Call, arrays: Arrays) -> Arrays:
    """Return the outputs of a call of NumPy arrays that have their shapes."""
    tails = call.argument_shapes.items()
    leads = {name: one.shape[: one.ndim - len(tail)] for (name, tail), one in zip(tails, arrays, strict=True)}
    found = call.run(dict(zip(leads, arrays, strict=True)), leads)
    return [found] if call.result is None else [*found.arrays().values()]


# ---- JAX


def jax_function(calls: Calls) -> Callable[..., tuple[Any, ...]]:
    """Return a function of JAX arrays of one dtype that a kernel computes, and that JAX can transform."""
    import jax
    import jax.numpy as jnp

    call = calls("value", ())
    if not call.has_kernels:
        expected = "a call with few enough joints for one program, without samples among its constants"
        raise ArgumentError("jax", expected, ", ".join(call.outputs))
    tails = call.argument_shapes.values()

    def function(*arrays: Any) -> tuple[Any, ...]:
        lead = jnp.broadcast_shapes(*(one.shape[: one.ndim - len(t)] for one, t in zip(arrays, tails, strict=True)))
        spread = [jnp.broadcast_to(one, lead + tail) for one, tail in zip(arrays, tails, strict=True)]
        return tuple(_primitive().bind(*spread, calls=calls, kind="value", by=()))

    compiled: Callable[..., tuple[Any, ...]] = jax.jit(function)
    return compiled


@functools.cache
def _primitive() -> Any:
    """Return the primitive of JAX that computes the call `calls(kind, by)`, whose arguments have the same leading
    axes. Of "jvp" and "vjp" the arguments of the call itself come first, then the vectors that it multiplies.
    """
    import jax
    import jax.numpy as jnp
    from jax.extend.core import Primitive
    from jax.interpreters import ad, batching, mlir

    primitive: Any = Primitive("hingepair")
    primitive.multiple_results = True

    def parts(arrays: Arrays, calls: Calls) -> tuple[Arrays, Arrays]:
        """Return the arguments of the call itself, and the vectors."""
        count = len(calls("value", ()).argument_shapes)
        return arrays[:count], arrays[count:]

    def shapes(*arrays: Any, calls: Calls, kind: str, by: tuple[str, ...]) -> list[Any]:
        call = calls(kind, by)
        first = next(iter(call.argument_shapes.values()))
        lead = arrays[0].shape[: arrays[0].ndim - len(first)]
        return [jax.core.ShapedArray((*lead, *tail), arrays[0].dtype) for _, tail in call.loop.outputs]

    def compute(*arrays: Any, calls: Calls, kind: str, by: tuple[str, ...]) -> list[Any]:
        return _call_by_xla(calls(kind, by), arrays)

    def change(arrays: Arrays, changes: Arrays, *, calls: Calls, kind: str, by: tuple[str, ...]) -> Any:
        """Return the outputs and their changes."""
        found = primitive.bind(*arrays, calls=calls, kind=kind, by=by)
        given, _ = parts(arrays, calls)
        of_given, of_vectors = parts(changes, calls)
        moving = [not isinstance(one, ad.Zero) for one in of_given]
        if kind == "value":
            names = calls(kind, by).argument_shapes
            by = tuple(name for name, moves in zip(names, moving, strict=True) if moves)
            of_vectors = [one for one in of_given if not isinstance(one, ad.Zero)]
            return found, primitive.bind(*given, *of_vectors, calls=calls, kind="jvp", by=by)
        if any(moving):
            raise NotImplementedError(
                "hingepair: JAX gets first derivatives alone; differences of two of them give second ones"
            )
        full = map(ad.instantiate_zeros, of_vectors)
        return found, primitive.bind(*given, *full, calls=calls, kind=kind, by=by)

    def transpose(weights: Arrays, *arrays: Any, calls: Calls, kind: str, by: tuple[str, ...]) -> list[Any]:
        given, _ = parts(arrays, calls)
        full = map(ad.instantiate_zeros, weights)
        other = {"jvp": "vjp", "vjp": "jvp"}[kind]
        return [*(None for _ in given), *primitive.bind(*given, *full, calls=calls, kind=other, by=by)]

    def batch(arrays: Arrays, axes: Arrays, *, calls: Calls, kind: str, by: tuple[str, ...]) -> Any:
        size = next(one.shape[axis] for one, axis in zip(arrays, axes, strict=True) if axis is not None)
        front = [
            jnp.broadcast_to(one, (size, *one.shape)) if axis is None else jnp.moveaxis(one, axis, 0)
            for one, axis in zip(arrays, axes, strict=True)
        ]
        if any(axis is not None for axis in parts(axes, calls)[0]):
            found = primitive.bind(*front, calls=calls, kind=kind, by=by)
        else:  # many vectors of one state: the Jacobian is computed once
            given, _ = parts(arrays, calls)
            jacobians = primitive.bind(*given, calls=calls, kind="jacobian", by=by)
            found = _products(calls, kind, by, jacobians, parts(front, calls)[1])
        return found, [0] * len(found)

    primitive.def_abstract_eval(shapes)
    primitive.def_impl(compute)
    mlir.register_lowering(primitive, mlir.lower_fun(compute, multiple_results=True), platform="cpu")
    ad.primitive_jvps[primitive] = change
    ad.primitive_transposes[primitive] = transpose
    batching.primitive_batchers[primitive] = batch
    return primitive


def _products(calls: Calls, kind: str, by: tuple[str, ...], jacobians: Arrays, vectors: Arrays) -> list[Any]:
    """Return the products of Jacobians (..., rows, columns) and many vectors, which stand along the first axis."""
    import jax.numpy as jnp

    lead, value, tails = jacobians[0].shape[:-2], calls("value", ()), calls(kind, by).loop.outputs
    shapes = value.argument_shapes if kind == "jvp" else dict(value.loop.outputs)
    wide = [math.prod(shapes[name]) for name in (by if kind == "jvp" else shapes)]
    flat = [one.reshape(len(one), *lead, width) for one, width in zip(vectors, wide, strict=True)]
    if kind == "jvp":
        found = [jnp.einsum("...rc,b...c->b...r", J, jnp.concatenate(flat, axis=-1)) for J in jacobians]
    else:
        total = sum(jnp.einsum("...rc,b...r->b...c", J, one) for J, one in zip(jacobians, flat, strict=True))
        ends = np.cumsum([math.prod(tail) for _, tail in tails])[:-1]
        found = jnp.split(total, ends, axis=-1)
    return [one.reshape(*one.shape[:-1], *tail) for one, (_, tail) in zip(found, tails, strict=True)]


def jax_callback(run: Run, ranks: Sequence[int], tails: Sequence[ArrayShape]) -> Callable[..., tuple[Any, ...]]:
    """Return a function of JAX arrays that calls `run`, for `jit`, `vmap` and `grad`.

    Args:
        run: what computes.
        ranks: number of axes of one sample of each argument.
        tails: shapes of one sample of the outputs.
    """
    import jax
    import jax.numpy as jnp

    struct: Any = jax.ShapeDtypeStruct

    def lead(arrays: Arrays, of: Sequence[int]) -> ArrayShape:
        shapes = [one.shape[: one.ndim - rank] for one, rank in zip(arrays, of, strict=True)]
        return np.broadcast_shapes(*shapes)

    def forward(*arrays: Any) -> Any:
        results = tuple(struct((*lead(arrays, ranks), *tail), arrays[0].dtype) for tail in tails)

        def host(*values: Any) -> tuple[Any, ...]:
            return tuple(one.astype(arrays[0].dtype) for one in run([*map(np.asarray, values)])[0])

        return jax.pure_callback(host, results, *arrays, vmap_method="expand_dims")

    def backward(arrays: Arrays, weights: Arrays) -> Any:
        count, motions = len(arrays), lead(arrays, ranks)
        results = tuple(struct((*motions, *one.shape[one.ndim - rank :]), one.dtype)
                        for one, rank in zip(arrays, ranks, strict=True))  # fmt: skip

        def host(*both: Any) -> tuple[Any, ...]:
            values = [*map(np.asarray, both)]
            full = lead(values, [*ranks, *map(len, tails)])
            values = [
                np.broadcast_to(one, (*full, *one.shape[one.ndim - rank :]))
                for one, rank in zip(values, [*ranks, *map(len, tails)], strict=True)
            ]
            found = run(values[:count])[1](range(count), values[count:])
            return tuple(one.astype(arrays[0].dtype) for one in found)

        return jax.pure_callback(host, results, *arrays, *weights, vmap_method="expand_dims")

    differentiable = jax.custom_vjp(forward)
    differentiable.defvjp(lambda *arrays: (forward(*arrays), arrays), backward)

    def function(*arrays: Any) -> tuple[Any, ...]:
        motions = lead(arrays, ranks)
        spread = (jnp.broadcast_to(one, (*motions, *one.shape[one.ndim - rank :]))
                  for one, rank in zip(arrays, ranks, strict=True))  # fmt: skip
        return tuple(differentiable(*spread))

    return function


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


# ---- kernels that XLA calls

# XLA calls a handler with a call frame (`xla/ffi/api/c_api.h` of `jax.ffi.include_dir()`), which holds addresses and
# shapes of arrays. The handler, a function of machine code, hands them to the kernel's inner loop as NumPy does.
# Offsets [bytes] in XLA's structures, which only grow at their ends while the major version of the interface is 0.
_EXTENSION, _KIND = 8, 8  # in a call frame; in an extension
_ARGUMENTS, _RESULTS, _ATTRIBUTES = 72, 112, 160  # in a call frame: tables of addresses
_DATA, _RANK, _DIMENSIONS = 24, 32, 40  # in a buffer
_NUMBERS = 16  # in an array among the attributes
_METADATA = 24  # in an extension of the kind that asks for nothing but metadata
_ASKS_FOR_METADATA = 1  # kind of such an extension
_MAJOR, _MINOR, _TRAITS = 24, 28, 32  # in metadata

_targets: dict[str, tuple[Kernel, Kernel]] = {}  # kernels and their handlers by name, for the life of the process


def _call_by_xla(call: Call, arrays: Arrays) -> list[Any]:
    """Return the outputs of a call of JAX arrays with equal leading axes.

    Raises:
        CompilationError: LLVM fails.
    """
    import jax

    dtype = np.dtype(arrays[0].dtype)
    code = call.machine_code(dtype.char)
    if code is None:
        raise CompilationError(call.loop.name, "JAX needs it")
    kernel, layout, constants = code
    lead = arrays[0].shape[: arrays[0].ndim - len(layout.inputs[0].sample_shape)]
    shapes = [jax.ShapeDtypeStruct((*lead, *one.sample_shape), dtype) for one in layout.outputs]  # type: ignore[no-untyped-call]
    attributes = {} if constants is None else {"constants": constants}
    return [*jax.ffi.ffi_call(_target(kernel, layout, dtype.char), shapes)(*arrays, **attributes)]


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
            handler = Kernel("handler", ir, imports={name: kernel.address("loop")})
            capsule = ctypes.pythonapi.PyCapsule_New
            capsule.restype, capsule.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
            jax.ffi.register_ffi_target(name, capsule(handler.address("handler"), None, None), platform="cpu")
            _targets[name] = kernel, handler
    return name


def _handler_ir(name: str, layout: Layout, number_bytes: int, minor: int) -> str:
    """Return the LLVM module of the handler of a kernel, whose inner loop has this name."""
    f = FunctionBuilder("ptr @handler(ptr %frame)")
    extension = f.load_word("%frame", _EXTENSION, "ptr")
    none = f.put(f"icmp eq ptr {extension}, null")
    holder = f.put(f"select i1 {none}, ptr %frame, ptr {extension}")  # the frame itself has the null there
    kind = f.put(f"load i32, ptr {f.pointer_at(holder, _KIND)}, align 4")
    with f.when_else(f.put(f"icmp ne i32 {kind}, {_ASKS_FOR_METADATA}")) as otherwise:
        _call_loop(f, name, layout, number_bytes)
        otherwise()
        metadata = f.load_word(extension, _METADATA, "ptr")
        for offset, value in ((_MAJOR, 0), (_MINOR, minor), (_TRAITS, 0)):
            f.do(f"store i32 {value}, ptr {f.pointer_at(metadata, offset)}, align 4")
    f.do("ret ptr null")
    return "\n".join([f'declare void @"{name}"(ptr, ptr, ptr, ptr)', "", f.text(), ""])


def _call_loop(f: FunctionBuilder, name: str, layout: Layout, number_bytes: int) -> None:
    """Call the inner loop with the arrays of the call frame, which are contiguous."""
    operands, inputs = layout.operands, len(layout.inputs)
    tables = [f.load_word("%frame", place, "ptr") for place in (_ARGUMENTS, _RESULTS)]
    buffers = [f.load_word(tables[0], 8 * k, "ptr") for k in range(inputs)]
    buffers += [f.load_word(tables[1], 8 * k, "ptr") for k in range(len(operands) - inputs)]
    # Strides of the samples, then of the axes of one sample of each array.
    sizes = [
        [number_bytes * math.prod(one.sample_shape[k:]) for k in range(len(one.sample_shape) + 1)] for one in operands
    ]
    steps = [one[0] for one in sizes] + [step for one in sizes for step in one[1:]]
    f.do(f"%args = alloca [{len(operands)} x ptr], align 8")
    f.do(f"%steps = alloca [{len(steps)} x i64], align 8")
    f.do("%count = alloca i64, align 8")
    for k, buffer in enumerate(buffers):
        f.do(f"store ptr {f.load_word(buffer, _DATA, 'ptr')}, ptr {f.pointer_at('%args', 8 * k)}, align 8")
    for k, step in enumerate(steps):
        f.store_word(step, "%steps", 8 * k)
    f.do("store i64 1, ptr %count, align 8")
    dimensions = f.load_word(buffers[-1], _DIMENSIONS, "ptr")
    axes = f.put(f"sub i64 {f.load_word(buffers[-1], _RANK)}, {len(operands[-1].sample_shape)}")
    with f.loop(axes) as axis:
        length = f.load_word(f.pointer_at(dimensions, f.multiply(axis, 8)), 0)
        f.do(f"store i64 {f.multiply(length, f.load_word('%count', 0))}, ptr %count, align 8")
    constants = "null"
    if layout.constants:
        attribute = f.load_word(f.load_word("%frame", _ATTRIBUTES, "ptr"), 0, "ptr")
        constants = f.load_word(attribute, _NUMBERS, "ptr")
    f.do(f'call void @"{name}"(ptr %args, ptr %count, ptr %steps, ptr {constants})')
