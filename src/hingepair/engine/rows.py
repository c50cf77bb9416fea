"""The shortest way from arrays to a kernel, for one state or few, in arrays that need no conversion.

    rows(q, qd)                                 # of one state, or of few states
    rows(q, qd, out={"tau": tau}, workers=1)

All else goes to the general function that it was made with.
"""

from __future__ import annotations

import math
import operator
import weakref
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.results import Results
from hingepair.engine.ufunc import Layout, Ufunc
from hingepair.numeric.arrays import MAX_AXES

Rows = Callable[..., Any]


class Output(NamedTuple):
    """An output of a kernel."""

    name: str
    shape: tuple[int, ...]  # of one sample
    limit: float | None = None  # that no sample may exceed; such an output is checked instead of returned


def rows_function(
    layout: Layout,
    outputs: Sequence[Output],
    dtype: np.dtype[Any],
    result: type[Results] | None,
    *,
    kernel: Ufunc,
    packed: Ufunc,
    most: int,
    general: Rows,
    refuse: Callable[[Sequence[Any], bool], None],
) -> Rows:
    """Return a function of the arguments in order, `out` and `workers`, which hands all that it does not compute
    itself to `general`.

    Args:
        layout: arguments and outputs of the kernel.
        outputs: the outputs, in the order of the layout.
        dtype: of arguments and outputs.
        result: class of the result; None to return the only output, as a writable array.
        kernel: ufunc of the layout.
        packed: ufunc of the packed layout.
        most: samples below which it computes a call itself.
        general: function with the same parameters.
        refuse: called with the arguments, and whether `out` has been written, where an output exceeds its limit.
    """
    numbered = [*enumerate(one.sample_shape for one in layout.inputs)]
    matrices = [k for k, tail in numbered if len(tail) > 1]
    takes_floats = dtype.char == "d" and any(tail == () for _, tail in numbered)
    limits = [(k, one.limit) for k, one in enumerate(outputs) if one.limit is not None]
    split, finish = _splitter(layout), _finisher(outputs, result)
    lead_of = _lead_function([tail for _, tail in numbered], dtype, most)
    write = _write_function(outputs, dtype, kernel, finish, refuse)
    compute, compute_packed = kernel.call, packed.call
    freezes = result is not None and bool(layout.packed.outputs[0].sample_shape)
    array, ndarray = np.array, np.ndarray
    freeze: Callable[..., None] = np.ndarray.setflags

    def rows(*given: Any, out: Any = None, workers: int = 1, _kept: object = (kernel, packed)) -> Any:
        """Compute what needs no conversion, and hand on all else; `_kept` owns the machine code."""
        arrays = tuple([array(x) if type(x) is float else x for x in given]) if takes_floats else given
        lead: tuple[int, ...] | None = ()
        for k, tail in numbered:
            x = arrays[k]
            if type(x) is not ndarray or x.dtype is not dtype or x.shape != tail:
                lead = lead_of(arrays)
                break
        else:
            if out is None and not (matrices and any(not arrays[k].flags.c_contiguous for k in matrices)):
                memory = compute_packed(*arrays)  # of one state, one piece is quicker than one for each output
                if freezes:
                    freeze(memory, False)  # and its parts
                parts = split(memory)
                for k, limit in limits:
                    if parts[k] > limit:
                        refuse(given, False)
                return finish(parts, ())
        made = None
        if lead is not None and workers == 1:
            made = compute_few(arrays, lead) if out is None else write(arrays, lead, out)
        return general(*given, out=out, workers=workers) if made is None else made

    def compute_few(arrays: Sequence[Any], lead: tuple[int, ...]) -> Any:
        """Return the result for arrays that fit, in new arrays."""
        found = compute(*arrays)
        parts = found if type(found) is tuple else (found,)
        for k, limit in limits:
            if (parts[k] > limit).any():
                refuse(arrays, False)
        if lead and result is not None:
            for one in parts:
                freeze(one, False)
        return finish(parts, lead)

    return rows


def _lead_function(
    tails: Sequence[tuple[int, ...]], dtype: np.dtype[Any], most: int
) -> Callable[[Sequence[Any]], tuple[int, ...] | None]:
    """Return a function from arguments to the leading shape of few states, which the first argument has and the
    others have or lack; None where an argument is something else, not contiguous, or of many states.
    """
    numbered, rank, size = [*enumerate(tails)], len(tails[0]), most * math.prod(tails[0])
    ndarray = np.ndarray

    def lead_of(arrays: Sequence[Any]) -> tuple[int, ...] | None:
        first = arrays[0]
        if type(first) is not ndarray or first.size >= size or first.ndim > MAX_AXES:
            return None
        lead: tuple[int, ...] = first.shape[: first.ndim - rank]
        for k, tail in numbered:
            x = arrays[k]
            if type(x) is not ndarray or x.dtype is not dtype or not x.flags.c_contiguous:
                return None
            if x.shape != lead + tail and x.shape != tail:
                return None
        return lead

    return lead_of


def _splitter(layout: Layout) -> Callable[[Any], Sequence[Any]]:
    """Return a function from the packed outputs of one state to these outputs."""
    if len(layout.outputs) == 1:
        return lambda memory: (memory,)
    row = layout.packed.outputs[0].sample_shape[1:]
    places: list[int | slice] = []
    shapes, start = {}, 0
    for k, one in enumerate(layout.outputs):
        stop = start + math.prod(one.sample_shape) // math.prod(row)
        places.append(start if one.sample_shape == row else slice(start, stop))
        if len(one.sample_shape) > len(row) + 1:
            shapes[k] = one.sample_shape
        start = stop
    pick = operator.itemgetter(*places)
    if not shapes:
        return pick
    return lambda memory: [x.reshape(shapes[k]) if k in shapes else x for k, x in enumerate(pick(memory))]


def _finisher(outputs: Sequence[Output], result: type[Results] | None) -> Callable[..., Any]:
    """Return a function that makes the result of outputs and their leading shape. Where the arrays are those of the
    user, which stay writable, the result makes read-only views of them when it is asked for them.
    """
    shown = [k for k, one in enumerate(outputs) if one.limit is None]
    names = tuple(outputs[k].name for k in shown)
    if result is None:
        place = shown[0]
        return lambda parts, *_: parts[place] if isinstance(parts[place], np.ndarray) else np.array(parts[place])
    kind, new, set_content = result, result.__new__, Results.__dict__["_content"].__set__
    slots = [
        (k, result.__dict__[name].__set__) for k, name in zip(shown, names, strict=True) if name in result.__slots__
    ]
    checks = len(shown) < len(outputs)

    def finish(parts: Sequence[Any], lead: tuple[int, ...], own: bool = True) -> Results:
        made = new(kind)
        set_content(made, (names, tuple([parts[k] for k in shown]) if checks else parts, lead))
        if own:
            for k, put in slots:
                put(made, parts[k])
        return made

    return finish


def _write_function(
    outputs: Sequence[Output],
    dtype: np.dtype[Any],
    kernel: Ufunc,
    finish: Callable[..., Any],
    refuse: Callable[[Sequence[Any], bool], None],
) -> Callable[[Sequence[NDArray[Any]], tuple[int, ...], Any], Any]:
    """Return a function of arguments that fit, their leading shape and `out`, which computes into the arrays of `out`
    and returns the result; None if an array is missing, does not fit, or might share memory with another or with an
    argument. The arrays of the last call need no second look, since their memory stays theirs.
    """
    shown = [one for one in outputs if one.limit is None]
    limits = [(k, one.limit) for k, one in enumerate(outputs) if one.limit is not None]
    count, compute, ndarray = len(shown), kernel.call, np.ndarray
    # Of the last call: leading shape, weak references by name, identities of those who own the memory.
    known: list[tuple[Any, list[tuple[str, Any]], set[int]]] = [(None, [], set())]

    def look(out: dict[str, Any], lead: tuple[int, ...]) -> bool:
        """Return whether these arrays fit, and keep what is known of them."""
        owners = set()
        for output in shown:
            one = out.get(output.name)
            if type(one) is not ndarray or one.dtype is not dtype or one.shape != lead + output.shape:
                return False
            owner = _owner(one)
            if owner is None or not (one.base is None or one.flags.c_contiguous):
                return False
            owners.add(id(owner))
        known[0] = lead, [(one.name, weakref.ref(out[one.name])) for one in shown], owners
        return len(owners) == count

    def write(arrays: Sequence[NDArray[Any]], lead: tuple[int, ...], out: Any) -> Any:
        if type(out) is not dict or len(out) != count:
            return None
        samples, references, owners = known[0]
        written: list[Any] = [one for name, get in references if (one := get()) is not None and out.get(name) is one]
        if samples != lead or len(written) != count:
            if not look(out, lead):
                known[0] = None, [], set()
                return None
            _, _, owners = known[0]
            written = [out[one.name] for one in shown]
        for x in arrays:
            owner = x if x.base is None else _owner(x)
            if owner is None or id(owner) in owners:
                return None
        for k, _ in limits:
            written.insert(k, None)  # a new array
        try:
            found = compute(*arrays, *written)
        except (ValueError, TypeError):  # an array that cannot be written: the general function says which
            return None
        parts = found if type(found) is tuple else (found,)
        for k, limit in limits:
            if (parts[k] > limit).any():
                refuse(arrays, True)
        return finish(parts, lead, False)

    return write


def _owner(array: NDArray[Any]) -> Any:
    """Return the array that owns the memory of another; None where that is unclear."""
    owner = array.base
    if owner is None:
        return array
    return owner if type(owner) is np.ndarray and owner.base is None else None
