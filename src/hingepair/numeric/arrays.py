"""The border: what comes in is checked once here, and what is large is walked through in blocks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import FrozenInstanceError, fields
from typing import Any, Final, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, DtypeError, ShapeError, choices, nearest, quoted

FloatArray: TypeAlias = NDArray[np.floating[Any]]
Float64Array: TypeAlias = NDArray[np.float64]
Component: TypeAlias = Any  # a float, a NumPy scalar, or an array that broadcasts against the samples
Block: TypeAlias = tuple[slice, ...]

MAX_AXES = 29  # NumPy broadcasts up to 32, and results have up to three more than arguments
FLOAT64: Final = np.dtype(np.float64)
_PLAIN_TYPES: Final = {np.ndarray, list, tuple, float, int}


def real_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return a value as a NumPy array of float64, float32 or integers, without a copy if it is one already; `name` is
    that of the argument.

    Raises:
        DtypeError: complex, object, float16, longdouble, bool or text; a masked array; a table with named columns; a
            Dask array, which would be computed unasked; an array of JAX, PyTorch or another library.
        ShapeError: nested sequences of unequal length.
    """
    if type(value) not in _PLAIN_TYPES:
        _refuse_other_kinds(name, value)
    try:
        array = np.asarray(value)
    except (ValueError, TypeError, OverflowError):
        raise ShapeError(
            name, "an array, or lists that make one", f"a {type(value).__name__} that makes none"
        ) from None
    if array.ndim > MAX_AXES:
        raise ShapeError(name, f"at most {MAX_AXES} axes", f"{array.ndim}")
    dtype = array.dtype
    if dtype.kind in "iu" or (dtype.kind == "f" and dtype.itemsize in {4, 8}):
        return array
    raise DtypeError(name, "real numbers (float64, float32 or integers)", _describe(array))


def _refuse_other_kinds(name: str, value: object) -> None:
    """Refuse tables, masked arrays, and arrays of other libraries."""
    if is_table(value):
        raise DtypeError(name, "an array (of a table: .to_numpy())", f"a {type(value).__name__} with named columns")
    if getattr(value, "__dask_graph__", lambda: None)() is not None:
        raise DtypeError(name, f"an array in memory, such as {name}.compute()", f"a Dask {type(value).__name__}")
    if not isinstance(value, np.ndarray | np.generic) and _is_of_other_library(value):
        library = type(value).__module__.partition(".")[0].removesuffix("lib")  # "jaxlib" is JAX too
        prepared = f" (prepared calls, f = robot.prepare(...), take this: f.{library})"
        expected = f"an array of NumPy{prepared if library in {'jax', 'torch'} else ''}"
        raise DtypeError(name, expected, f"{type(value).__name__} of {library}")
    if isinstance(value, np.ma.MaskedArray):
        raise DtypeError(name, "an array without a mask (use .filled(numpy.nan))", "a masked array")


def _is_of_other_library(value: object) -> bool:
    """Return whether a value is an array of JAX, PyTorch, CuPy or another library of arrays."""
    return hasattr(value, "__array_namespace__") or type(value).__module__.partition(".")[0] == "torch"


def vectors(name: str, value: ArrayLike, *sample_shape: int) -> NDArray[Any]:
    """Return a value as an array whose last axes have a given shape, such as 3, 3."""
    array = real_array(name, value)
    if array.ndim < len(sample_shape) or array.shape[array.ndim - len(sample_shape) :] != sample_shape:
        transposed = len(sample_shape) == 1 and array.ndim == 2 and array.shape[0] == sample_shape[0]
        hint = " (transpose it: .T)" if transposed else ""
        raise ShapeError(name, f"shape (..., {', '.join(map(str, sample_shape))})", f"shape {array.shape}{hint}")
    return array


def is_table(value: object) -> TypeGuard[Any]:
    """Return whether a value is a data frame of any package, that is, has named columns."""
    return hasattr(value, "columns") and hasattr(value, "to_numpy")


def constant(name: str, value: ArrayLike, *sample_shape: int) -> NDArray[np.float64]:
    """Return a read-only float64 copy of finite numbers whose last axes have a given shape, such as 3, 3."""
    array = np.array(vectors(name, value, *sample_shape), dtype=np.float64, order="C")
    if not all_finite(array):
        raise ArgumentError(name, "finite numbers", value)
    array.flags.writeable = False
    return array


def all_finite(array: NDArray[Any]) -> bool:
    """Return whether all numbers of an array are finite."""
    return all(map(math.isfinite, array.ravel().tolist())) if array.size < 16 else bool(np.isfinite(array).all())


def one_constant(name: str, value: ArrayLike, *sample_shape: int) -> NDArray[np.float64]:
    """Return a read-only float64 copy of finite numbers of exactly a given shape, such as 3, 3."""
    array = real_array(name, value)
    if array.shape != sample_shape:
        example = ""
        if array.ndim == 0 and len(sample_shape) == 1:
            number = -abs(array.item()) if name == "gravity" else array.item()  # the last axis points upwards
            example = f", such as {(*[0] * (sample_shape[0] - 1), number)}"
        raise ShapeError(name, f"shape {sample_shape}{example}", f"shape {array.shape}")
    return constant(name, array, *sample_shape)


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view of the array that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def own_copy(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy in the same memory layout; axes along which an array is broadcast stay broadcast."""
    if 0 not in array.strides:
        return read_only(array.copy(order="K"))
    once = array[tuple(slice(None) if step else slice(0, 1) for step in array.strides)]
    return np.broadcast_to(once.copy(order="K"), array.shape)


class Frozen:
    """Base class of frozen dataclasses whose errors tell what to do instead of a change, and whose arrays stay
    read-only in copies and pickles.
    """

    __slots__ = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__setattr__" in vars(cls):  # what dataclass(slots=True) writes fails for names that are no fields
            cls.__setattr__ = cls.__delattr__ = Frozen._refuse  # type: ignore[assignment, method-assign]

    def _refuse(self, name: str, *_: object) -> None:
        raise FrozenInstanceError(f"{name}: this {type(self).__name__} cannot be changed{self._instead(name)}")

    def _instead(self, _: str) -> str:
        """Return what to do instead of changing an attribute, for the message."""
        return ""

    def __reduce__(self) -> tuple[Any, ...]:
        values: dict[str, Any] = {one.name: getattr(self, one.name) for one in fields(self)}  # type: ignore[arg-type]
        return _frozen, (type(self), values)


def _frozen(frozen_class: type, attributes: dict[str, Any]) -> Any:
    """Return a copied or unpickled instance without a call of its constructor; makes its arrays read-only."""
    value: Any = object.__new__(frozen_class)
    for attribute in attributes.values():
        if isinstance(attribute, np.ndarray):
            attribute.flags.writeable = False  # of the array itself: what refers to it elsewhere refers to it still
    set_frozen(value, **attributes)
    return value


def set_frozen(value: object, **attributes: Any) -> None:
    """Set attributes of a frozen value, as its constructor does."""
    for name, attribute in attributes.items():
        object.__setattr__(value, name, attribute)


def call_text(value: object, *names: str) -> str:
    """Return the call that makes a value, such as "Sphere(radius=1.0)", without arguments that are None or empty."""
    arguments = ((name, getattr(value, name)) for name in names)
    shown = (f"{name}={_plain(argument)!r}" for name, argument in arguments if not _is_absent(argument))
    return f"{type(value).__name__}({', '.join(shown)})"


def _is_absent(value: Any) -> bool:
    return value is None or (isinstance(value, tuple | Mapping) and not value)


def _plain(value: Any) -> Any:
    """Return arrays as lists, those in a dict too."""
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


def row_norms(rows: Float64Array) -> Float64Array:
    """Return the lengths of vectors (..., k); shape (...,)."""
    return np.asarray(np.sqrt((rows**2).sum(axis=-1)))


def broadcast_shape(shapes: Mapping[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the shape to which shapes by name broadcast.

    Raises:
        ShapeError: names the first that does not fit those before it.
    """
    shape: tuple[int, ...] = ()
    for name, other in shapes.items():
        if other in {shape, ()}:
            continue
        try:
            shape = np.broadcast_shapes(shape, other)
        except ValueError:
            raise ShapeError(name, f"leading shape that broadcasts with {shape}", f"shape {other}") from None
    return shape


def result_dtype(components: Iterable[Component]) -> np.dtype[Any]:
    """Return the dtype to compute in: float32 if there are arrays and every one is float32, else float64. Python
    numbers do not count, as in NumPy.
    """
    dtypes = {c.dtype for c in components if isinstance(c, np.ndarray | np.generic)}
    if dtypes and all(d.kind == "f" and d.itemsize == 4 for d in dtypes):
        return np.dtype(np.float32)
    return np.dtype(np.float64)


def split_into_blocks(shape: tuple[int, ...], block_size: int) -> Iterator[Block]:
    """Yield blocks of at most `block_size` elements that cover an array of this shape, each a tuple of one slice per
    axis. The last axes are cut only if they are longer than a block.

    >>> [tuple((s.start, s.stop) for s in block) for block in split_into_blocks((2, 3), 4)]
    [((0, 1), (0, 3)), ((1, 2), (0, 3))]
    """
    axis = len(shape)
    inner = 1
    while axis > 0 and inner * shape[axis - 1] <= block_size:
        axis -= 1
        inner *= shape[axis]
    if 0 in shape:
        return
    whole = tuple(slice(0, n) for n in shape[axis:])
    if axis == 0:
        yield whole
        return
    step = max(1, block_size // inner)
    steps = [slice(i, min(i + step, shape[axis - 1])) for i in range(0, shape[axis - 1], step)]
    for index in itertools.product(*(range(n) for n in shape[: axis - 1])):
        outer = tuple(slice(i, i + 1) for i in index)
        for piece in steps:
            yield (*outer, piece, *whole)


def load(component: Component, block: Block, dtype: np.dtype[Any]) -> Component:
    """Return the elements of a component that a block selects, as a contiguous array of the dtype; axes of length 1
    are taken as a whole, and a number is returned as it is.
    """
    if not isinstance(component, np.ndarray):
        return component
    fitting = zip(block[len(block) - component.ndim :], component.shape, strict=True)
    part = component[tuple(piece if n != 1 else slice(None) for piece, n in fitting)]
    return np.asarray(part, dtype, order="C")


def check_choice(name: str, value: object, allowed_names: Iterable[str]) -> None:
    """Refuse a value that is none of the allowed names."""
    if not isinstance(value, str) or value not in allowed_names:
        names = tuple(allowed_names)
        near = nearest(value, names) if isinstance(value, str) else ""
        raise ArgumentError(name, choices(names) + near, quoted(value))


def finite_number(name: str, value: object) -> float:
    """Return a number of Python or NumPy as a finite float; refuse all else, bool too, under the name `name`."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise ArgumentError(name, "a finite number", quoted(value))
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ArgumentError(name, "a finite number", quoted(value))
    return number


def is_zero(value: object) -> bool:
    """Return whether a value is the number 0, of Python or of NumPy; False for bool and for arrays."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool) and value == 0


def number_not_below_0(name: str, value: object) -> float:
    """Return a value that `finite_number` takes as a float of at least 0."""
    number = finite_number(name, value)
    if number < 0:
        raise ArgumentError(name, "a number not below 0", value)
    return number


def _describe(array: NDArray[Any]) -> str:
    """Return the dtype and shape of an array for a message; of a single string, bool or object its repr."""
    if array.ndim == 0 and array.dtype.kind in "OUSb":
        return repr(array.item())
    return f"{array.dtype.name} of shape {array.shape}"
