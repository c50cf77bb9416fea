"""Arrays of other libraries (JAX, PyTorch, what keeps the array API standard): the equations run over them.

Nothing here imports such a library: it is asked of the arrays that came in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted

ForeignArray: TypeAlias = Any

# Types that need no look at array libraries: of NumPy and of Python.
_PLAIN = (np.ndarray, np.generic, float, int, complex, str, bytes, list, tuple, dict, type(None))


class Library(NamedTuple):
    """Array library other than NumPy, in which the equations run."""

    name: str
    namespace: Any  # module with its functions, which have the names of the array API standard
    dtype: Any  # in which results are computed
    device: Any  # on which results are computed; None if the library decides

    def array(self, value: Any) -> ForeignArray:
        """Return a number or a NumPy array as an array of this library; an array of another one as it is."""
        if is_foreign(value):
            return value
        if isinstance(value, np.ndarray):
            value = np.array(value, np.float64, order="C")  # PyTorch would share memory, and refuses some strides
        return self.namespace.asarray(value, dtype=self.dtype, device=self.device)

    def join_components(
        self, components: tuple[Any, ...], shape: tuple[int, ...], sample_shape: tuple[int, ...]
    ) -> ForeignArray:
        """Stack components, which broadcast to the samples, into one array (*shape, *sample_shape)."""
        parts = [self.namespace.broadcast_to(self.array(c), shape) for c in components]
        if not sample_shape:
            return parts[0]
        if self.name == "jax" and type(parts[0]).__name__.endswith("Tracer"):
            # XLA computes what components share again for each element of what is stacked: 200 times the time.
            array = self.namespace.zeros((*shape, len(parts)), self.dtype)
            for k, part in enumerate(parts):
                array = array.at[..., k].set(part)
        else:
            array = self.namespace.stack(parts, axis=-1)
        return self.namespace.reshape(array, (*shape, *sample_shape))


def is_foreign(value: Any) -> bool:
    """Return whether a value is an array of a library other than NumPy."""
    if isinstance(value, _PLAIN) or not (hasattr(value, "__array_namespace__") or hasattr(value, "__dlpack__")):
        return False
    from array_api_compat import is_array_api_obj

    return bool(is_array_api_obj(value))


def library_of(arguments: Mapping[str, Any]) -> Library | None:
    """Return the library of the arrays among arguments by name; None if all are NumPy's, which are constants beside
    those of another library: their dtype does not count.

    Raises:
        ArgumentError: they are arrays of two libraries other than NumPy.
        DtypeError: arrays of another library are neither float32 nor float64.
    """
    foreign = {name: value for name, value in arguments.items() if is_foreign(value)}
    if not foreign:
        return None
    from array_api_compat import array_namespace, device

    first, one = next(iter(foreign.items()))
    namespace = array_namespace(one)
    name = _name_of(one)
    for other, value in arguments.items():
        if other in foreign:
            same = array_namespace(value) is namespace
        else:
            same = value is None or isinstance(value, float | int | np.ndarray | np.generic)
        if not same:
            expected = f"an array of {name}, as {first} is, or of NumPy, or a number"
            raise ArgumentError(other, expected, quoted(type(value).__name__))
    dtypes = []
    for other, value in foreign.items():
        if value.dtype not in (namespace.float32, namespace.float64):
            raise DtypeError(other, "float32 or float64", str(value.dtype))
        dtypes.append(value.dtype)
    place = None if name == "jax" else device(one)  # JAX puts a number where the array beside it is
    return Library(name, namespace, namespace.result_type(*dtypes), place)


def foreign_components(name: str, value: Any, *sample_shape: int) -> tuple[Any, ...]:
    """Return the components of an array of another library, those of matrices row by row, or those of a tuple, whose
    number is checked. The last arguments are the shape of one sample.
    """
    count = math.prod(sample_shape)
    if isinstance(value, tuple):
        if len(value) != count:
            raise ShapeError(name, f"a tuple of {count} components", f"one of {len(value)}")
        return tuple(c if is_foreign(c) else float(c) for c in value)
    check_sample_shape(name, value, *sample_shape)
    if len(sample_shape) == 1:
        return tuple(value[..., i] for i in range(sample_shape[0]))
    return tuple(value[..., i, j] for i in range(sample_shape[0]) for j in range(sample_shape[1]))


def check_sample_shape(name: str, array: ForeignArray, *sample_shape: int) -> None:
    """Refuse an array whose last axes do not have this shape; `name` is that of the argument."""
    shape = tuple(array.shape)
    if shape[max(0, len(shape) - len(sample_shape)) :] != sample_shape:
        raise ShapeError(name, f"shape (..., {', '.join(map(str, sample_shape))})", f"shape {shape}")


def apply_function(function_name: str, x: ForeignArray) -> ForeignArray:
    """Return "sine", "cosine", "versine" (1 - cos) or "square_root" of each element of an array of another library.
    The versine is 2 sin^2(x/2): all its digits where x is small, and derivatives everywhere.
    """
    if function_name == "versine":
        half = apply_function("sine", 0.5 * x)
        return 2.0 * half * half
    return getattr(namespace_of(x), {"sine": "sin", "cosine": "cos", "square_root": "sqrt"}[function_name])(x)


def where_less(a: Any, b: Any, then: Any, otherwise: Any) -> ForeignArray:
    """Return `then` where a < b, and `otherwise` elsewhere; at least one of a and b is an array of another
    library.
    """
    return namespace_of(a if is_foreign(a) else b).where(a < b, then, otherwise)


def namespace_of(x: Any) -> Any:
    """Return the module with the functions of an array's library, named as in the array API standard."""
    if isinstance(x, np.ndarray):
        return np
    from array_api_compat import array_namespace

    return array_namespace(x)


def _name_of(array: ForeignArray) -> str:
    """Return the name of the library of an array, such as "jax" or "torch"."""
    name = type(array).__module__.partition(".")[0]
    return "jax" if name == "jaxlib" else name
