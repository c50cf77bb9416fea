"""Kernels as functions of JAX that its transformations know.

Three primitives compute all: a kernel; the Jacobian of a function, or its transpose, times a vector for each sample,
which is a kernel of its own; and the same times many vectors, which needs the entries of the Jacobian. Derivatives of
derivatives are those of the equations.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from hingepair.engine.binding import ArrayShape
from hingepair.engine.calls import Call
from hingepair.engine.xla import xla_function
from hingepair.numeric.array_libraries import Library
from hingepair.plans.differentiable import Arrays, Differentiable, Functions, Names, by_library, leading_shapes, split


def jax_function(function: Differentiable) -> Functions:
    """Return a function of JAX arrays, in the order of the arguments, which kernels compute and JAX can transform."""
    tails = function.arguments

    def spread(lead: ArrayShape, names: Iterable[str], arrays: Arrays) -> list[Any]:
        return [jnp.broadcast_to(one, lead + tails[name]) for name, one in zip(names, arrays, strict=True)]

    def values(*arrays: Any) -> Any:
        lead = np.broadcast_shapes(*leading_shapes(tails, arrays).values())
        return tuple(_kernel.bind(*spread(lead, tails, arrays), to=function.call))

    def rule(given: Any, changes: Any) -> Any:
        """Return the outputs and their changes."""
        still = jax.custom_derivatives.SymbolicZero
        moving = {name: one for name, one in zip(tails, changes, strict=True) if not isinstance(one, still)}
        lead = np.broadcast_shapes(*leading_shapes(tails, given).values())
        arrays = *spread(lead, tails, given), *spread(lead, moving, [*moving.values()])
        return differentiable(*given), tuple(_product.bind(*arrays, to=_Map(function, tuple(moving))))

    differentiable = jax.custom_jvp(values)
    differentiable.defjvp(rule, symbolic_zeros=True)
    compiled: Functions = jax.jit(differentiable)
    return compiled


class _Map(NamedTuple):
    """The Jacobian of a function by some of its arguments, or its transpose, as a linear map of vectors."""

    function: Differentiable
    by: Names
    transposed: bool = False

    @property
    def targets(self) -> list[ArrayShape]:
        """Shapes of one sample of the products."""
        if self.transposed:
            return [self.function.arguments[name] for name in self.by]
        return [*self.function.outputs.values()]

    def divide(self, arrays: Arrays) -> tuple[Arrays, Arrays]:
        """Return the arguments of the function, and the vectors behind them."""
        count = len(self.function.arguments)
        return arrays[:count], arrays[count:]

    def lead(self, given: Arrays) -> ArrayShape:
        """Return the shape of the samples, which is that of all arguments."""
        return next(iter(leading_shapes(self.function.arguments, given).values()))

    def jacobians(self, given: Arrays) -> tuple[Any, ...]:
        """Return the Jacobians, a matrix for each output."""
        call = self.function.derivative("jacobian", self.by)
        found = jax.custom_jvp(lambda *arrays: tuple(_kernel.bind(*arrays, to=call)))
        found.defjvp(functools.partial(jax.jvp, functools.partial(_by_library, call)))
        jacobians: tuple[Any, ...] = found(*given)
        return jacobians

    def one(self, *arrays: Any) -> list[Any]:
        """Return the products with one vector for each sample, from the Jacobians."""
        given, vectors = self.divide(arrays)
        return self.function.products(self.by, self.jacobians(given), vectors, self.transposed)

    def axis(self, given: Arrays) -> int:
        """Return the axis along which the products with many vectors stand, such that those with unit vectors are the
        Jacobian as it is.
        """
        return len(self.lead(given)) if self.transposed else -1

    def many(self, *arrays: Any) -> list[Any]:
        """Return the products with vectors that do not depend on the sample, from the Jacobians."""
        given, vectors = self.divide(arrays)
        jacobians = self.jacobians(given)
        if self.transposed:
            J = [jnp.expand_dims(one, self.axis(given)) for one in jacobians]
            return self.function.products(self.by, J, vectors, transposed=True)
        return self._shaped(given, [jnp.tensordot(J, _joined(vectors), (-1, -1)) for J in jacobians])

    def unit(self, *arrays: Any) -> list[Any]:
        """Return the products with all unit vectors in order."""
        given, _ = self.divide(arrays)
        jacobians = self.jacobians(given)
        if self.transposed:
            return split(jnp.concatenate(jacobians, axis=-2), self.targets)
        return self._shaped(given, jacobians)

    def _shaped(self, given: Arrays, matrices: Arrays) -> list[Any]:
        """Return matrices in the shapes of the outputs."""
        lead, width = self.lead(given), matrices[0].shape[-1]
        return [one.reshape(*lead, *tail, width) for one, tail in zip(matrices, self.targets, strict=True)]


def _joined(vectors: Arrays) -> Any:
    return jnp.concatenate([one.reshape(one.shape[0], -1) for one in vectors], axis=1)


def _compute(arrays: Arrays, call: Call) -> tuple[Any, ...]:
    """Return the outputs of a call: by its kernel inside JAX, or by JAX itself if there is none."""
    function = xla_function(call, np.dtype(arrays[0].dtype).char)
    return _by_library(call, *arrays) if function is None else function(*arrays)


def _by_library(call: Call, *arrays: Any) -> tuple[Any, ...]:
    return by_library(call, Library("jax", jnp, arrays[0].dtype, None), arrays)


def _compute_product(arrays: Arrays, linear: _Map) -> tuple[Any, ...]:
    """Return the products with one vector for each sample, by a kernel."""
    return _compute(arrays, linear.function.derivative("vjp" if linear.transposed else "jvp", linear.by))


def _compute_products(arrays: Arrays, linear: _Map) -> list[Any]:
    """Return the products with many vectors; those with unit vectors, as of jacfwd, need no multiplication."""
    _, vectors = linear.divide(arrays)
    joined = _joined(vectors)
    if joined.shape[0] != joined.shape[1]:
        return linear.many(*arrays)
    is_unit = (joined == jnp.eye(len(joined), dtype=joined.dtype)).all()
    found: list[Any] = jax.lax.cond(is_unit, linear.unit, linear.many, *arrays)
    return found


# ---- primitives


def _primitive(
    name: str, shapes: Callable[..., Iterable[ArrayShape]], compute: Callable[..., Any], batch: Callable[..., Any]
) -> Any:
    """Return a primitive of several results.

    Args:
        name: its name.
        shapes: function of the arguments and of what they are given to, a call or a map; returns the results' shapes.
        compute: function of the same that returns the results.
        batch: rule for `jax.vmap`: a function of arguments, their axes of samples, and the same.
    """
    made: Any = Primitive(f"hingepair_{name}")
    made.multiple_results = True

    def described(*arrays: Any, to: Any) -> list[Any]:
        return [jax.core.ShapedArray(shape, arrays[0].dtype) for shape in shapes(arrays, to)]

    made.def_abstract_eval(described)
    made.def_impl(lambda *arrays, to: compute(arrays, to))
    mlir.register_lowering(made, mlir.lower_fun(lambda *arrays, to: compute(arrays, to), multiple_results=True))
    batching.primitive_batchers[made] = lambda arrays, axes, *, to: batch(arrays, axes, to)
    return made


def _in_front(arrays: Arrays, axes: Sequence[int | None]) -> list[Any]:
    """Return arrays with an axis of samples in front."""
    size = next(one.shape[axis] for one, axis in zip(arrays, axes, strict=True) if axis is not None)
    return [
        jnp.broadcast_to(one, (size, *one.shape)) if axis is None else jnp.moveaxis(one, axis, 0)
        for one, axis in zip(arrays, axes, strict=True)
    ]


def _batch_kernel(arrays: Arrays, axes: Sequence[int | None], call: Call) -> tuple[list[Any], list[int]]:
    """Make a batch of calls of a kernel one call, with an axis more."""
    found = _kernel.bind(*_in_front(arrays, axes), to=call)
    return found, [0] * len(found)


def _batch_product(arrays: Arrays, axes: Sequence[int | None], linear: _Map) -> tuple[list[Any], list[int]]:
    """Make a batch of products one primitive: many vectors of one Jacobian, or one of each of many samples."""
    given, vectors = linear.divide(arrays)
    sides = linear.divide(axes)
    if any(axis is not None for axis in sides[0]):
        found, axis = _product.bind(*_in_front(arrays, axes), to=linear), 0
    elif linear.lead(given):
        found, axis = jax.vmap(linear.one, in_axes=axes)(*arrays), 0
    else:
        found, axis = _products.bind(*given, *_in_front(vectors, sides[1]), to=linear), linear.axis(given)
    return found, [axis % one.ndim for one in found]


def _batch_products(arrays: Arrays, axes: Sequence[int | None], linear: _Map) -> tuple[list[Any], list[int]]:
    """Make a batch of products with many vectors one primitive, if the vectors are the same for all."""
    given, vectors = linear.divide(arrays)
    sides = linear.divide(axes)
    if any(axis is not None for axis in sides[1]):
        found = jax.vmap(linear.many, in_axes=axes)(*arrays)
    else:
        found = _products.bind(*_in_front(given, sides[0]), *vectors, to=linear)
    return found, [0] * len(found)


def _kernel_shapes(arrays: Arrays, call: Call) -> list[ArrayShape]:
    lead = next(iter(leading_shapes(call.argument_shapes, arrays).values()))
    tails = dict(call.loop.outputs)
    return [(*lead, *tails[name]) for name in call.outputs]


def _product_shapes(arrays: Arrays, linear: _Map) -> list[ArrayShape]:
    given, _ = linear.divide(arrays)
    return [(*linear.lead(given), *tail) for tail in linear.targets]


def _products_shapes(arrays: Arrays, linear: _Map) -> list[ArrayShape]:
    given, vectors = linear.divide(arrays)
    lead, count = linear.lead(given), vectors[0].shape[0]
    return [(*lead, count, *tail) if linear.transposed else (*lead, *tail, count) for tail in linear.targets]


def _filled(arrays: Arrays) -> list[Any]:
    """Return arrays in the place of what JAX knows to be zero."""
    fill: Any = ad.instantiate_zeros
    return [fill(one) for one in arrays]


def _transpose_product(weights: Arrays, *arrays: Any, to: _Map) -> list[Any]:
    """Return the transposed product of weights by the vectors; None for the arguments of the function."""
    given, _ = to.divide(arrays)
    weights = _filled(weights)
    found = _product.bind(*given, *weights, to=to._replace(transposed=not to.transposed))
    return [*(None for _ in given), *found]


def _transpose_products(weights: Arrays, *arrays: Any, to: _Map) -> list[Any]:
    """Return the transposed products of weights by the vectors; None for the arguments of the function."""
    given, vectors = to.divide(arrays)
    weights = _filled(weights)
    products = jax.linear_transpose(lambda *some: to.many(*given, *some), *(one.aval for one in vectors))
    return [*(None for _ in given), *products(weights)]


def _differentiate(compute: Callable[[_Map], Callable[..., Any]]) -> Callable[..., Any]:
    """Return the rule for `jax.jvp` of what a function computes, too."""
    return lambda given, changes, *, to: jax.jvp(compute(to), given, tuple(_filled(changes)))


_kernel = _primitive("kernel", _kernel_shapes, _compute, _batch_kernel)
_product = _primitive("product", _product_shapes, _compute_product, _batch_product)
_products = _primitive("products", _products_shapes, _compute_products, _batch_products)
ad.primitive_jvps[_product] = _differentiate(lambda linear: linear.one)
ad.primitive_jvps[_products] = _differentiate(lambda linear: linear.many)
ad.primitive_transposes[_product] = _transpose_product
ad.primitive_transposes[_products] = _transpose_products
