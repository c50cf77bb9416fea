"""A plan made ready: checked and compiled once, then called for one state or small batches, again and again."""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, RotationError, choices, quoted
from hingepair.evaluation.array_heads import address
from hingepair.evaluation.backend import Account, How
from hingepair.evaluation.binding import bind, rows_of
from hingepair.evaluation.dynamics_steps import (
    CONSTANTS,
    LOADS,
    MASS_STEPS,
    MASS_TAILS,
    MOVES,
    REQUIRED,
    forward_steps,
)
from hingepair.evaluation.llvm_ir import FIELDS, SCATTERED, SIDE_BY_SIDE
from hingepair.evaluation.loops import Loop, Program
from hingepair.evaluation.plan import (
    INPUTS,
    OUTPUTS,
    SPATIAL,
    Plan,
    check_names,
    default_outputs,
    make_plan,
    needed_steps,
    steps_of,
)
from hingepair.evaluation.steps import (
    CONSTRAINT_STEPS,
    COORDINATES,
    JACOBIAN_STEPS,
    ROW_STEPS,
    SENSITIVITY_STEPS,
    Step,
    coordinate_steps,
)
from hingepair.evaluation.trace import square_root, where_less
from hingepair.numeric.array_libraries import Library, foreign_components, is_foreign, library_of
from hingepair.numeric.arrays import broadcast_shape, real_array, result_dtype, vectors
from hingepair.pair import constraints, derivatives, dynamics
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import Out, check_options, loop_of, rooms, run_foreign, written
from hingepair.pair.states import PairState, Spans, State, spans_of
from hingepair.rotations.matrices import TOLERANCE, check_rotation
from hingepair.rotations.sequences import find_sequence

LEVELS: Final = {"pose": ("q",), "velocity": ("q", "qd"), "acceleration": ("q", "qd", "qdd")}
_KINDS: Final = {
    **LEVELS,
    "inverse_dynamics": ("S1", "omega1", "a1", "alpha1", "psi", "psid", "psidd"),
    "forward_dynamics": ("S1", "omega1", "psi", "psid", *REQUIRED),
}
QUATERNIONS: Final = ("quat_xyzw", "quat_wxyz")

TAILS: Final[derivatives.Tails] = {
    **{name: output.tail for name, output in OUTPUTS.items()},
    **derivatives.TAILS,
    **constraints.TAILS,
    **MASS_TAILS,
}
"""All that can be prepared, and the shape of one sample of it."""

_GIVEN: Final[derivatives.Tails] = {
    **{name: INPUTS[name] for name in ("q", "qd", "qdd", "psi", "psid", "psidd")},
    **{name: INPUTS[name] for name in ("R1", "S1", "v1", "omega1", "a1", "alpha1")},
    **{name: INPUTS[name] for name in ("R2", "S2", "v2", "omega2", "a2", "alpha2")},
    **dict.fromkeys(QUATERNIONS, (4,)),
    **LOADS,
}
_F8: Final = np.dtype(np.float64)
_CHECK: Final = "_check"  # an output that nobody asked for: whether the attitude given is one
_SMALL: Final = 2**21  # bytes of outputs that are one array
_KEPT: Final = 64  # layouts of inputs that are remembered
_WITHOUT_LOCK: Final = 4096  # samples from which other threads may go on


def _attitude_of(quat: tuple[Any, ...]) -> eq.Matrix:
    """The rotation of a quaternion (w, x, y, z) of any length but zero."""
    size = _size(quat)
    w, x, y, z = (c / size for c in quat)
    length = square_root(w * w + x * x + y * y + z * z)
    return eq.quaternion_attitude((w / length, x / length, y / length, z / length))


def _size(parts: tuple[Any, ...]) -> Any:
    """The largest absolute component."""
    return functools.reduce(lambda a, b: where_less(a, b, b, a), (where_less(c, 0.0, -c, c) for c in parts))


def _orthonormality(S: eq.Matrix) -> Any:
    """The largest element of S S^T - I; of a reflection, 2."""
    *errors, volume = eq.orthonormality(S)
    return where_less(volume, 0.0, 2.0, _size(tuple(errors)))


_ATTITUDES: Final = {
    "S1": (Step(_CHECK, _orthonormality, ("S1",)),),
    "quat_xyzw": (
        Step("quat", lambda q: (q[3], *q[:3]), ("quat_xyzw",)),
        Step("S1", _attitude_of, ("quat",)),
        Step(_CHECK, _size, ("quat",)),
    ),
    "quat_wxyz": (Step("S1", _attitude_of, ("quat_wxyz",)), Step(_CHECK, _size, ("quat_wxyz",))),
}


@functools.lru_cache(maxsize=256)
def _steps(given: tuple[str, ...], sequence: str | None, home: bool) -> tuple[Step, ...]:
    """Everything that can be had from what is given."""
    steps = [step for name in given for step in _ATTITUDES.get(name, ())]
    if sequence is not None:
        steps += ROW_STEPS
    steps += steps_of(sequence, home)
    if not LOADS.keys().isdisjoint(given):
        return forward_steps(tuple(steps))
    steps += CONSTRAINT_STEPS if "S2" in given else MASS_STEPS
    steps += [*JACOBIAN_STEPS, *SENSITIVITY_STEPS]
    if sequence is not None:
        steps += coordinate_steps(sequence)
    return tuple(step for step in steps if step.result not in given)


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

    def __init__(
        self, pair: Constants, given: tuple[str, ...], outputs: tuple[str, ...], sequence: str, how: How, *, now: bool
    ) -> None:
        self.given, self.outputs = given, outputs
        self._pair, self._how = constraints.with_hinge_frames(pair) if "S2" in given else pair, how
        self._loop = _loop(given, outputs, sequence if "q" in given else None, "home" in pair.values)
        needed = dict(self._loop.inputs).keys() - {*given}
        self._known = {name: value for name, value in self._pair.values.items() if name in needed}
        self._rows = tuple(given.index(name) for name, _ in self._loop.inputs if name in given)
        some = {name: np.empty((2, *tail)) for name, tail in self._loop.inputs}
        self._bound = bind(self._loop.inputs, {**some, **(self._known if pair.single else {})})
        self._program: Program = self._loop.program(self._bound.pattern)
        self._quaternion = any(name in QUATERNIONS for name in given)
        self._checked = self._loop.outputs[-1][0] == _CHECK
        self._shots: dict[Any, _Shot] = {}
        self._tails = self._loop.outputs[:-1] if self._checked else self._loop.outputs
        self._spans = spans_of(self._tails)
        self._account = Account(self._program.operations)
        self.short: Callable[..., PairState | None] = self._by_python if pair.single else self._again
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

    def __call__(self, *given: Any, out: Out = None) -> PairState:
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

    def _straight_way(self, run: Any) -> Callable[..., PairState | None]:
        """`short`, unrolled: at first for one state in arrays of float64."""
        scope: dict[str, Any] = {"run": run, "new": PairState.__new__, "PairState": PairState, "empty": np.empty}
        scope |= {"constants": np.array(self._bound.constants), "refuse": self._refuse, "again": self._again}
        scope |= {"spans": self._spans, "shape": ()}
        rows = all(
            tail == () or (tail in {(3,), (3, 3)} and begin % 3 == 0) for begin, _, tail in self._spans.values()
        )
        size, lines = sum(math.prod(tail) for _, tail in self._loop.outputs), []
        for name, (begin, end, tail) in self._spans.items():
            if name in PairState.__slots__:
                scope[f"set_{name}"] = PairState.__dict__[name].__set__
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
            "    state = new(PairState)",
            "    content(state, (buffer, spans, shape))",
            *lines,
            "    return state",
        ]
        exec("\n".join(source), scope)
        made: Callable[..., PairState | None] = scope["straight"]
        return made

    def _by_python(self, *given: Any) -> PairState | None:
        """`short`, while nothing is compiled: one state by the generated function."""
        numbers = list(self._bound.constants)
        for k in self._rows:
            value = given[k]
            if type(value) is np.ndarray and value.dtype is _F8 and value.shape == _GIVEN[self.given[k]]:
                numbers += value.ravel().tolist()
            elif type(value) is float and _GIVEN[self.given[k]] == ():
                numbers.append(value)
            else:
                return self._again(*given)
        if self._how.backend == "auto" and self._account.pays_one():
            self._compile()
        found = np.array(self._program.floats_function(*numbers))
        if self._checked:
            self._check(found[-1:], given)
        return PairState.of_buffer(found, self._spans)

    def _again(self, *given: Any) -> PairState | None:
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

    def _fire(self, shot: _Shot, given: Sequence[NDArray[Any]]) -> PairState:
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
        return PairState.of_buffer(buffer, spans, shape)

    def _first(self, given: Sequence[Any], out: Out) -> PairState:
        """The long way: everything is looked at; what can be remembered is."""
        if len(given) != len(self.given):
            raise ArgumentError("*given", f"{len(self.given)} arguments: {', '.join(self.given)}", f"{len(given)}")
        values = dict(zip(self.given, given, strict=True))
        library = library_of(values)
        if library is not None:
            return self._foreign(values, library, out)
        arrays = {name: _array(name, value) for name, value in values.items()}
        shapes = {name: a.shape[: a.ndim - len(_GIVEN[name])] for name, a in arrays.items()}
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
            self._check(results.pop(_CHECK), given)
        return PairState(results, shape)

    def _foreign(self, given: Mapping[str, Any], library: Library, out: Out) -> PairState:
        """The state of arrays of another library; whether an attitude is one is not checked."""
        check_options(library, out, How("auto", self._how.workers))
        parts: dict[str, Any] = {n: foreign_components(n, v, *_GIVEN[n]) for n, v in given.items() if _GIVEN[n]}
        parts |= {n: v if is_foreign(v) else float(v) for n, v in given.items() if not _GIVEN[n]}
        shapes = {name: np.shape(v)[: np.ndim(v) - len(_GIVEN[name])] for name, v in given.items()}
        shape = broadcast_shape({**shapes, "pair": self._pair.shape})
        found = run_foreign(self._loop.function, self._pair, parts, dict(self._tails), shape, library)
        return PairState(found, shape)

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
            part, *others = rows_of(given[k], _GIVEN[self.given[k]])
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
        name = next(name for name in self.given if name in _ATTITUDES)
        if self._quaternion:
            raise RotationError(name, "non-zero quaternions", "a zero quaternion")
        check_rotation(name, np.asarray(given[self.given.index(name)]))


def prepare(
    pair: Constants,
    bodies: dynamics.Bodies,
    given: str | Iterable[str],
    outputs: Iterable[str] | None,
    sequence: str,
    gravity: ArrayLike,
    how: How,
) -> Prepared:
    """A plan made ready; see `HingePair.prepare`."""
    names = _checked_given(given)
    forward = not LOADS.keys().isdisjoint(names)
    if outputs is None and forward:
        outputs = MOVES
    elif outputs is None and given == "inverse_dynamics":
        outputs = REQUIRED
    rows = "q" in names
    if rows:
        find_sequence(sequence)
    level = sum(name in names for name in (("qd", "qdd") if rows else ("psid", "psidd")))
    steps = _steps(names, sequence if rows else None, "home" in pair.values)
    wanted = default_outputs(level) if outputs is None else check_names(outputs, TAILS)
    needed = needed_steps(steps, wanted)[1]
    if not needed.isdisjoint(CONSTANTS):
        pair = dynamics.with_masses(pair, bodies, gravity, needed)
    if forward:
        dynamics.check_resistance(pair, bodies)
    known = {*names, *constraints.with_hinge_frames(pair).values}
    for name in wanted:
        unknown = name in constraints.TAILS and "S2" not in names and not forward
        missing = sorted(needed_steps(CONSTRAINT_STEPS if unknown else steps, (name,))[1] - known)
        if missing:
            raise ArgumentError("given", f"what output {name} needs too: {', '.join(missing)}", ", ".join(names))
    return Prepared(pair, names, wanted, sequence, how, now=True)


def _checked_given(given: str | Iterable[str]) -> tuple[str, ...]:
    try:
        names = _KINDS[given] if isinstance(given, str) else tuple(given)
    except (KeyError, TypeError):
        raise ArgumentError("given", f"{choices(tuple(_KINDS))}, or a tuple of names", quoted(given)) from None
    for name in names:
        if name not in _GIVEN:
            raise ArgumentError("given", choices(tuple(_GIVEN)), quoted(name))
    attitudes = [name for name in names if name in {"q", *_ATTITUDES}]
    if len(attitudes) != 1 or len({*names}) != len(names):
        raise ArgumentError("given", "one attitude of body 1: q, S1, quat_xyzw or quat_wxyz", quoted(names))
    return names


@functools.lru_cache(maxsize=256)
def _loop(given: tuple[str, ...], outputs: tuple[str, ...], sequence: str | None, home: bool) -> Loop:
    """The loop from what is given to the outputs, and to what the attitude is checked by."""
    if all(name in LEVELS["acceleration"] for name in given) and all(name in OUTPUTS for name in outputs):
        return loop_of(make_plan(outputs, sequence, home), True)
    checks = (_CHECK,) if any(name in _ATTITUDES for name in given) else ()
    tails = {**{name: TAILS[name] for name in outputs}, **dict.fromkeys(checks, ())}
    steps, inputs = needed_steps(_steps(given, sequence, home), tails)
    plan = Plan(tuple(tails), steps, inputs, (), sequence, home, SPATIAL)
    known = {name: _GIVEN[name] for name in given if name in inputs}
    known |= {name: INPUTS.get(name, (3,)) for name in sorted(inputs - known.keys())}
    labels = {name: tuple(f"{one}{name[1:]}" for one in COORDINATES) for name in ("q", "qd", "qdd")}
    return Loop("state", plan.run, known, tails, labels=labels)


def _array(name: str, value: Any) -> NDArray[Any]:
    if value is None:
        raise ArgumentError(name, "a value, since this was prepared for it", None)
    tail = _GIVEN[name]
    return vectors(name, value, *tail) if tail else real_array(name, value)
