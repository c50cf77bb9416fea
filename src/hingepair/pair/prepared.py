"""A plan made ready: checked and compiled once, then called for one state or small batches, again and again."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.array_heads import address
from hingepair.engine.backend import Account, How
from hingepair.engine.binding import bind, rows_of
from hingepair.engine.llvm_ir import FIELDS, SCATTERED, SIDE_BY_SIDE
from hingepair.engine.loops import Program
from hingepair.errors import ArgumentError, RotationError, quoted
from hingepair.numeric.array_libraries import library_of
from hingepair.numeric.arrays import broadcast_shape, real_array, result_dtype, vectors
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import AUTO, STATES, Out, dtype_of, evaluate, evaluate_foreign, rooms, written
from hingepair.pair.states import Spans, State, spans_of
from hingepair.plans.plan import Plan, loop_of, make_plan
from hingepair.plans.steps import ATTITUDE_STEPS
from hingepair.rotations.matrices import TOLERANCE, check_rotation

CHECK: Final = "attitude_check"
"""An output that nobody asks for: whether the attitude given is one."""
QUATERNIONS: Final = ("quat_xyzw", "quat_wxyz")

_F8: Final = np.dtype(np.float64)
_SMALL: Final = 2**21  # bytes of outputs that are one array
_KEPT: Final = 64  # layouts of inputs that are remembered
_WITHOUT_LOCK: Final = 4096  # samples from which other threads may go on


def compute(
    pair: Constants,
    plan: Plan,
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    out: Out = None,
    how: How = AUTO,
    dtype: np.dtype[Any] | None = None,
) -> Any:
    """The state at all samples, as `evaluate` gives it; one state goes the short way."""
    given = None if any(shapes.values()) or not pair.single else _doubles(values)
    if given is not None:
        known = ready(pair, plan, tuple(values), how.backend)
        found = known.short(*given)
        if found is None:
            found = known.short(*(np.array(value, order="C") for value in given))
        if found is not None:
            return found if out is None else written(found, out, {})
    return evaluate(pair, plan, values, shapes, out, how, dtype)


def _doubles(values: Mapping[str, Any]) -> list[Any] | None:
    """Floats, and arrays of float64, where that is what values are computed in."""
    given = []
    for one in values.values():
        value = np.array(one) if type(one) is tuple else one
        if type(value) is not float and value.dtype is not _F8:
            return [np.array(v, _F8) for v in values.values()] if dtype_of(values) == _F8 else None
        given.append(value)
    return given


def ready(pair: Constants, plan: Plan, given: tuple[str, ...], backend: str) -> Prepared:
    """A plan made ready for one pair, once."""
    key = plan, given, backend
    found: Prepared | None = pair.prepared.get(key)
    if found is None:
        found = pair.prepared[key] = Prepared(pair, plan, given, How(backend, 1), now=False)
    return found


def arrays_of(
    pair: Constants,
    outputs: Iterable[str],
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    dtype: np.dtype[Any] | None = None,
    sequence: str | None = None,
) -> dict[str, NDArray[Any]]:
    """New arrays of what is computed of values, by name."""
    plan = make_plan(tuple(outputs), sequence, "home" in pair.values, given=tuple(values))
    arrays: dict[str, NDArray[Any]] = compute(pair, plan, values, shapes, dtype=dtype).released()
    return arrays


class _Shot(NamedTuple):
    """A kernel aimed at arrays of one layout: all that is left to do is to fill in where they are."""

    kernel: Any
    table: tuple[int, ...]
    inner: int
    size: int
    starts: tuple[int, ...]
    spans: Spans
    shape: tuple[int, ...]
    constants: NDArray[Any]
    tables: list[Any]


class Prepared:
    """What `HingePair.prepare` gives: call it with arrays in the order of `given`.

    Attributes:
        given: what it takes, in order.
        outputs: what it computes.
        source: the Python code that runs where nothing is compiled.
        llvm: the LLVM code that runs else.
        short: the state of arrays that need no looking at; None of others.
    """

    def __init__(self, pair: Constants, plan: Plan, given: tuple[str, ...], how: How, *, now: bool) -> None:
        self.given, self.outputs = given, tuple(name for name in plan.outputs if name != CHECK)
        self._pair, self._plan, self._how = pair, plan, how
        self._shapes, self._state = plan.kind.shapes, STATES[plan.kind]
        self._loop = loop_of(plan)
        self._known = {name: v for name, v in pair.values.items() if name in plan.inputs and name not in given}
        self._rows = tuple(given.index(name) for name, _ in self._loop.inputs if name in given)
        some = {name: np.empty((2, *tail)) for name, tail in self._loop.inputs}
        self._bound = bind(self._loop.inputs, {**some, **(self._known if pair.single else {})})
        self._program: Program = self._loop.program(self._bound.pattern)
        self._quaternion = any(name in QUATERNIONS for name in given)
        self._checked = CHECK in plan.outputs
        self._shots: dict[Any, _Shot] = {}
        self._tails = self._loop.outputs[:-1] if self._checked else self._loop.outputs
        self._spans = spans_of(self._tails)
        self._account = Account(self._program.operations)
        self.short: Callable[..., Any] = self._by_python if pair.single else self._again
        if how.backend == "compiled" or (how.backend == "auto" and pair.single and now):
            self._compile()

    def _compile(self) -> None:
        """Go over to compiled code, if it can be had."""
        key = self._key("d")
        if self._how.backend == "compiled" or self._program.can_have(key):
            run = self._program.kernel(*key).run_objects
            self.short = self._again if run is None or not self._pair.single else self._straight_way(run)

    def __repr__(self) -> str:
        return f"Prepared(given={self.given}, outputs={self.outputs})"

    @property
    def source(self) -> str:
        """The Python code that runs where nothing is compiled."""
        return self._program.source

    @property
    def llvm(self) -> str:
        """The LLVM code that runs for one state and for rows of states."""
        code: str = self._program.kernel(*self._key("d")).ir
        return code

    def __call__(self, *given: Any, out: Out = None) -> Any:
        """The state: one sample or many.

        Args:
            *given: what it was prepared for, in that order; shape (..., 7), (..., 3), (..., 3, 3), (..., 4) or (...);
                they broadcast.
            out: arrays by output name, written in place.

        Raises:
            ArgumentError: an argument cannot be used; names it.
        """
        known = out is None or (type(out) is dict and out.keys() <= {*self.outputs})
        if known and len(given) == len(self.given):
            found = self.short(*given)
            if found is not None and out is None:
                return found
            if found is not None and out is not None:
                inputs = zip(self.given, given, strict=True) if found.shape else ()
                return written(found, out, dict(inputs))
        return self._first(given, out)

    def _straight_way(self, run: Any) -> Callable[..., Any]:
        """`short`, unrolled: at first for one state in arrays of float64."""
        scope: dict[str, Any] = {"run": run, "new": self._state.__new__, "State": self._state, "empty": np.empty}
        scope |= {"constants": np.array(self._bound.constants), "refuse": self._refuse, "again": self._again}
        scope |= {"spans": self._spans, "shape": ()}
        rows = all(
            tail == () or (tail in {(3,), (3, 3)} and begin % 3 == 0) for begin, _, tail in self._spans.values()
        )
        size, lines = sum(math.prod(tail) for _, tail in self._loop.outputs), []
        for name, (begin, end, tail) in self._spans.items():
            if name in self._state.__slots__:
                scope[f"set_{name}"] = self._state.__dict__[name].__set__
                if rows:  # one row of the buffer, or three, or one number
                    part = f"[{begin // 3} : {end // 3}]" if tail == (3, 3) else f"[{begin // 3}]"
                    part = part if tail else f"[{begin // 3}, {begin % 3}]"
                else:
                    part = f"[{begin}:{end}]" + ("" if len(tail) == 1 else f".reshape({tail})")
                lines.append(f"    set_{name}(state, buffer{part})")
        scope["size"] = (-(-size // 3), 3) if rows else size
        scope["content"] = State.__dict__["_content"].__set__
        arguments = [f"in{k}" for k in range(len(self.given))]
        given = ", ".join(arguments)
        bad = "== 0.0" if self._quaternion else f"> {2 * TOLERANCE[8]!r}"
        checked = [f"    if buffer.item({size - 1}) {bad}:", f"        refuse(({given},))"]
        source = [
            f"def straight({given}):",
            "    buffer = empty(size)",
            f"    if not run({', '.join(arguments[k] for k in self._rows)}, constants, buffer):",
            f"        return again({given})",
            *(checked if self._checked else ()),
            "    state = new(State)",
            "    content(state, (buffer, spans, shape))",
            *lines,
            "    return state",
        ]
        exec("\n".join(source), scope)
        made: Callable[..., Any] = scope["straight"]
        return made

    def _by_python(self, *given: Any) -> Any:
        """`short`, while nothing is compiled: one state by the generated function."""
        numbers = list(self._bound.constants)
        for k in self._rows:
            value = given[k]
            if type(value) is np.ndarray and value.dtype is _F8 and value.shape == self._shapes[self.given[k]]:
                numbers += value.ravel().tolist()
            elif type(value) is float and self._shapes[self.given[k]] == ():
                numbers.append(value)
            else:
                return self._again(*given)
        if self._how.backend == "auto" and self._account.pays_one():
            self._compile()
        found = np.array(self._program.floats_function(*numbers))
        if self._checked:
            self._check(found[-1:], given)
        return self._state.of_buffer(found, self._spans)

    def _again(self, *given: Any) -> Any:
        """The state, where arrays of this layout came before."""
        for array in given:
            if type(array) is not np.ndarray:
                return None
        shot = self._shots.get(tuple([(array.shape, array.strides, array.dtype) for array in given]))
        return None if shot is None else self._fire(shot, given)

    def learn(self, given: Sequence[Any]) -> None:
        """Remember the layout of arrays that went the long way, if the quick one is open to them."""
        if self._program.kernels.get(self._key("d")) is not None and self.short == self._by_python:
            self._compile()
        if len(self._shots) < _KEPT and all(type(array) is np.ndarray for array in given):
            self._shot_at(given, given[0].shape[:-1], result_dtype(given))

    def _fire(self, shot: _Shot, given: Sequence[NDArray[Any]]) -> Any:
        """Run a kernel over arrays whose layout it knows."""
        kernel, lines, inner, size, starts, spans, shape, constants, tables = shot
        buffer = np.empty(size, constants.dtype)
        try:
            table = tables.pop()
        except IndexError:
            table = (ctypes.c_int64 * len(lines))(*lines)
        place = len(lines) - FIELDS * (len(self._rows) + len(starts))
        for k in self._rows:
            table[place] = address(given[k])
            place += FIELDS
        start = address(buffer)
        for offset in starts:
            table[place] = start + offset
            place += FIELDS
        kernel(table, 1, inner)
        tables.append(table)
        if self._checked:
            self._check(buffer[size - inner :], given)
        return self._state.of_buffer(buffer, spans, shape)

    def _first(self, given: Sequence[Any], out: Out) -> Any:
        """The long way: everything is looked at; what can be remembered is."""
        if len(given) != len(self.given):
            raise ArgumentError("*given", f"{len(self.given)} arguments: {', '.join(self.given)}", f"{len(given)}")
        values = dict(zip(self.given, given, strict=True))
        library = library_of(values)
        ranks = {name: len(self._shapes[name]) for name in values}
        if library is not None:  # whether an attitude is one is not checked
            shapes = {name: np.shape(v)[: np.ndim(v) - ranks[name]] for name, v in values.items()}
            plan = replace(self._plan, outputs=self.outputs)
            return evaluate_foreign(self._pair, plan, values, shapes, library, out, How("auto", self._how.workers))
        arrays = {name: _array(name, value, self._shapes[name]) for name, value in values.items()}
        shapes = {name: a.shape[: a.ndim - ranks[name]] for name, a in arrays.items()}
        shape = broadcast_shape({**shapes, "pair": self._pair.shape})
        dtype = result_dtype(arrays.values())
        for name in out or ():
            if name not in self.outputs:
                raise ArgumentError("out", f"arrays for nothing but {', '.join(self.outputs)}", quoted(name))
        results = rooms(self._loop.outputs, shape, dtype, out, arrays)
        shot = self._shot_at(given, shape, dtype) if out is None and 0 not in shape else None
        if shot is not None:
            return self._fire(shot, given)
        if shape == () and out is None and dtype == np.float64:
            one = self.short(*(array.astype(np.float64) for array in arrays.values()))
            if one is not None:
                return one
        constants = self._known if self._pair.single else self._pair.arrays
        self._loop.run({**constants, **arrays}, results, shape, dtype, self._how)
        if self._checked:
            self._check(results.pop(CHECK), given)
        return self._state(results, shape)

    def _shot_at(self, given: Sequence[Any], shape: tuple[int, ...], dtype: np.dtype[Any]) -> _Shot | None:
        """A shot at arrays like these, if they are such that one can be."""
        spans = spans_of(self._loop.outputs, shape)
        count, size, total = math.prod(shape), dtype.itemsize, max(stop for _, stop, _ in spans.values())
        plain = all(type(a) is np.ndarray and a.dtype == dtype and a.dtype.isnative for a in given)
        if not plain or size * total > _SMALL or self._how.workers != 1 or not self._pair.single or len(shape) > 1:
            return None
        if self._how.backend == "numpy":  # also where somebody else had the kernel compiled
            return None
        key = self._key(dtype.char)
        kernel = self._program.kernels.get(key)
        if kernel is None and self._how.backend == "compiled":
            kernel = self._program.kernel(*key)
        if kernel is None:
            return None
        constants = np.array(self._bound.constants, dtype)
        table = [address(constants), 0, 0, size, 0] if len(constants) else []
        for k in self._rows:
            part, *others = rows_of(given[k], self._shapes[self.given[k]])
            if others or part.shape[:-1] != shape:
                return None
            table += (0, 0, part.strides[0] if shape else 0, part.strides[-1], 0)
        for _, tail in self._loop.outputs:
            table += (0, 0, size * math.prod(tail), size, SIDE_BY_SIDE if count > 1 else SCATTERED)
        starts = tuple(size * start for start, _, _ in spans.values())
        run = kernel.run_one if count < _WITHOUT_LOCK else kernel.run
        shot = _Shot(run, tuple(table), count, total, starts, spans_of(self._tails, shape), shape, constants, [])
        if len(self._shots) >= _KEPT:
            self._shots.clear()
        self._shots[tuple([(array.shape, array.strides, array.dtype) for array in given])] = shot
        return shot

    def _key(self, char: str) -> Any:
        """Of the kernel for rows of states."""
        counts = tuple(math.prod(tail) for _, tail in self._loop.outputs)
        return (False,) * len(self._bound.pieces), counts, char

    def _check(self, found: NDArray[Any], given: Sequence[Any]) -> None:
        """Refuse a quaternion of zero, and a matrix that is no rotation."""
        bad = found == 0 if self._quaternion else found > 2 * TOLERANCE[found.dtype.itemsize]
        if bad.any():
            self._refuse(given)

    def _refuse(self, given: Sequence[Any]) -> None:
        name = next(name for name in self.given if name in ATTITUDE_STEPS)
        if self._quaternion:
            raise RotationError(name, "non-zero quaternions", "a zero quaternion")
        check_rotation(name, np.asarray(given[self.given.index(name)]))


def _array(name: str, value: Any, tail: tuple[int, ...]) -> NDArray[Any]:
    if value is None:
        raise ArgumentError(name, "a value, since this was prepared for it", None)
    return vectors(name, value, *tail) if tail else real_array(name, value)
