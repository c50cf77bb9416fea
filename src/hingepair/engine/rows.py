"""The shortest way from arrays to a kernel: a generated function of arrays that need no conversion.

    rows(q, qd)                                 # of one state, or of few states that q has
    rows(q, qd, out={"tau": tau}, workers=1)

All else goes to the general function that it was made with.
"""

from __future__ import annotations

import functools
import math
import weakref
from collections.abc import Callable, Sequence
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

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
    """Return a generated function of the arguments in order, `out` and `workers`, which hands all that it does not
    compute itself to `general`.

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
    shown = result or Results
    names = tuple(one.name for one in outputs if one.limit is None)
    scope: dict[str, Any] = {
        "ndarray": np.ndarray, "array": np.array, "freeze": np.ndarray.setflags, "dtype": dtype, "names": names,
        "ref": weakref.ref, "known": [(*[object] * len(names), (), set())],  # no array is what object() returns
        "kernel": kernel.call, "packed": packed.call, "kept": (kernel, packed),
        "general": general, "refuse": refuse,
        "Result": shown, "new": shown.__new__, "set_content": Results.__dict__["_content"].__set__,
    }  # fmt: skip
    slots = [name for name in names if name in shown.__slots__]
    scope |= {f"set_{name}": shown.__dict__[name].__set__ for name in slots}
    source = _source(layout, outputs, dtype.char == "d", slots if result else None, most)
    exec(_compiled(source), scope)
    function: Rows = scope["rows"]
    return function


@functools.lru_cache(maxsize=512)  # hundreds of pairs share few sources
def _compiled(source: str) -> CodeType:
    return compile(source, "<hingepair: rows>", "exec")


def _source(
    layout: Layout, outputs: Sequence[Output], takes_floats: bool, slots: Sequence[str] | None, most: int
) -> str:
    """Return the source of the function `rows`; `slots` are the attributes of the result, None for a bare array."""
    shapes = [one.sample_shape for one in layout.inputs]
    places = range(len(shapes))
    arguments = ", ".join(f"in{k}" for k in places)
    targets = ", ".join(f"out{k}" for k in range(len(outputs)))
    other = f"return general({arguments}, out=out, workers=workers)"
    frees = [] if slots is None else [f"freeze(out{k}, False)" for k, one in enumerate(outputs)]
    one_state, few_states, arrays = [], [], []
    for k, shape in enumerate(shapes):
        array = f"type(in{k}) is ndarray and in{k}.dtype is dtype"
        one = f"in{k}.shape == {shape}{f' and in{k}.flags.c_contiguous' if len(shape) > 1 else ''}"
        is_float = f"type(in{k}) is float or " if takes_floats and not shape else ""
        arrays.append(f"({is_float}{array})")
        one_state.append(f"({is_float}{one})")
        broadcast = f" or in{k}.shape == {shape}" if k else ""
        few_states.append(
            f"type(in{k}) is ndarray and (in{k}.shape == (*lead, *{shape}){broadcast}) and in{k}.flags.c_contiguous"
        )
    lead = f"in0.shape[:-{len(shapes[0])}]" if shapes[0] else "in0.shape if type(in0) is ndarray else ()"
    few_states += [f"in0.ndim <= {MAX_AXES}", f"in0.size < {most * math.prod(shapes[0])}"]

    lines = [
        f"def rows({arguments}, out=None, workers=1):",
        f"    if not ({' and '.join(arrays)}):",
        f"        {other}",
        f"    if {' and '.join(one_state)}:",
        "        lead = ()",
        "        if out is None:",
        *_indented(3, _packed_lines(layout, slots is not None, arguments)),
        *_indented(3, _result_lines(outputs, slots, arguments, written=False)),
        "    else:",
        f"        lead = {lead}",
        f"        if not ({' and '.join(few_states)}):",
        f"            {other}",
        "        if out is None and workers == 1:",
        f"            {targets} = kernel({arguments})",
        *_indented(3, frees),
        *_indented(3, _result_lines(outputs, slots, arguments, written=False)),
        "    if type(out) is not dict or workers != 1:",
        f"        {other}",
        *_indented(1, _memory_lines(shapes, outputs, other)),
        "    try:",
        f"        {targets} = kernel({arguments}, {targets})",
        "    except (ValueError, TypeError):",  # an array that cannot be written: the general function says which
        f"        {other}",
        *_indented(1, _result_lines(outputs, slots, arguments, written=True)),
    ]
    return "\n".join(lines)


def _indented(depth: int, lines: Sequence[str]) -> list[str]:
    return ["    " * depth + line for line in lines]


def _packed_lines(layout: Layout, is_result: bool, arguments: str) -> list[str]:
    """Return the lines that compute one state into new memory: one array is quicker than one for each output."""
    if len(layout.outputs) == 1:
        line = f"out0 = packed({arguments})"
        if layout.outputs[0].sample_shape:
            return [line, "freeze(out0, False)"] if is_result else [line]
        return [line] if is_result else [line, "out0 = array(out0)"]
    lines, start = [f"all = packed({arguments})"], 0
    if is_result:
        lines.append("freeze(all, False)")  # its views too
    row = layout.packed.outputs[0].sample_shape[1:]
    for k, one in enumerate(layout.outputs):
        shape, stop = one.sample_shape, start + math.prod(one.sample_shape) // math.prod(row)
        place = f"{start}" if shape == row else f"{start}:{stop}"
        reshaped = f".reshape({shape})" if len(shape) > len(row) + 1 else ""
        lines.append(f"out{k} = all[{place}]{reshaped}")
        start = stop
    return lines


def _memory_lines(shapes: Sequence[tuple[int, ...]], outputs: Sequence[Output], other: str) -> list[str]:
    """Return the lines that take the arrays of `out`, or run `other` if one is missing, does not fit, or might share
    memory. The arrays of the last such call need no second look, since their memory stays theirs.
    """
    shown = [(k, one) for k, one in enumerate(outputs) if one.limit is None]
    written = [f"out{k}" for k, _ in shown]
    lines = ["try:", *(f"    out{k} = out[{one.name!r}]" for k, one in shown), "except KeyError:", f"    {other}"]
    lines += [f"out{k} = None" for k, one in enumerate(outputs) if one.limit is not None]
    lines += [
        f"{''.join(f'{array}_ref, ' for array in written)}samples, owners = known[0]",
        f"same = len(out) == {len(shown)} and samples == lead",
        f"if not (same and {' and '.join(f'{one}_ref() is {one}' for one in written)}):",
    ]
    fits = (
        f"type(out{k}) is ndarray and out{k}.dtype is dtype and out{k}.shape == (*lead, *{one.shape})"
        for k, one in shown
    )
    checks = [f"if not (len(out) == {len(shown)} and {' and '.join(fits)}):", f"    {other}"]
    for array in written:
        checks += _owner_lines(array, f" and {array}.flags.c_contiguous", other)
    checks += [
        f"owners = {{{''.join(f'id({array}_owner), ' for array in written)}}}",
        f"if len(owners) != {len(written)}:",
        f"    {other}",
        f"known[0] = {''.join(f'ref({array}), ' for array in written)}lead, owners",
    ]
    lines += _indented(1, checks)
    read = [f"in{k}" for k, shape in enumerate(shapes) if shape]
    for array in read:
        lines += _owner_lines(array, "", other)
    theirs = "".join(f"id({array}_owner), " for array in read)
    return [*lines, f"if not owners.isdisjoint(({theirs})):", f"    {other}"]


def _owner_lines(array: str, dense: str, other: str) -> list[str]:
    """Return the lines that name the owner of an array's memory, or run `other` where that is unclear; `dense` is a
    further condition on arrays that do not own theirs.
    """
    return [
        f"{array}_owner = {array}.base",
        f"if {array}_owner is None:",
        f"    {array}_owner = {array}",
        f"elif not (type({array}_owner) is ndarray and {array}_owner.base is None{dense}):",
        f"    {other}",
    ]


def _result_lines(outputs: Sequence[Output], slots: Sequence[str] | None, arguments: str, written: bool) -> list[str]:
    """Return the lines that check the limits and return the result. Where arrays of the user were written, which stay
    writable, the result makes read-only views of them when it is asked for them.
    """
    lines = []
    for k, one in enumerate(outputs):
        if one.limit is not None:
            lines += [f"if (out{k} > {one.limit!r}).any():", f"    refuse(({arguments},), {written})"]
    shown = {f"out{k}": one.name for k, one in enumerate(outputs) if one.limit is None}
    if slots is None:
        return [*lines, f"return {next(iter(shown))}"]
    lines += ["result = new(Result)", f"set_content(result, (names, ({', '.join(shown)},), lead))"]
    if not written:
        lines += [f"set_{name}(result, {out})" for out, name in shown.items() if name in slots]
    return [*lines, "return result"]
