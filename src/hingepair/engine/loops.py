"""Functions of scalars, run over samples: traced once for each build of their inputs, then as NumPy, Python or LLVM.

    loop = Loop("turn", function, inputs={"omega": (3,), "h": ()}, outputs={"q": (4,)})
    loop.run({"omega": omega, "h": h}, {"q": q}, shape, dtype, how)

`function` takes and returns values by name, a vector as the tuple of its components: arithmetic, and the functions of
`trace`. With a carry it is a scan: the samples of the last axis are a chain, of which each takes over what the one
before it made.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from hingepair.engine import python_source
from hingepair.engine.backend import Account, How, give_up
from hingepair.engine.binding import (
    Bound,
    Pattern,
    Spec,
    bind,
    bind_foreign,
    forms_of,
    in_threads,
    layout_of,
    rows_of,
    walk,
)
from hingepair.engine.llvm_ir import kernel_ir
from hingepair.engine.llvm_parts import Carry, Group
from hingepair.engine.llvm_writer import number_type
from hingepair.engine.trace import (
    FUNCTIONS,
    Operand,
    Trace,
    Value,
    line_name,
    name_lines,
    needed_lines,
    operations,
)
from hingepair.errors import CompilationError, MissingDependencyError
from hingepair.numeric.array_libraries import Library
from hingepair.numeric.arrays import Block, load, split

if TYPE_CHECKING:
    from hingepair.engine.native import Kernel

Buffers: TypeAlias = Mapping[str, NDArray[Any]]
Extent: TypeAlias = tuple[int, ...]

_BLOCK_SAMPLES: Final = 2048
"""Number of samples that NumPy computes at a time: 16 kB a component."""

_MAX_CONVERTED_BYTES: Final = 4_000_000
"""Size of what is converted to another dtype at a time (one piece is still held while the next is made)."""


class Key(NamedTuple):
    """The key of one kernel of a program.

    Attributes:
        still: for each piece of the inputs, whether it stays the same along the inner axis.
        parts: numbers of components of each part of the outputs.
        char: character of the dtype, "d" or "f".
    """

    still: tuple[bool, ...]
    parts: tuple[int, ...]
    char: str


class Loop:
    """A function of scalars that runs over samples.

    Args:
        name: what its generated code is called.
        function: of values by name, traced or not, to results by name.
        inputs: shape of one sample of each input.
        outputs: the same of each output.
        exact: whether the compiled code may not fuse products with sums (compensated arithmetic cannot bear it).
        carry: makes it a scan: of an input that is handed on, the result that becomes it. What is given for such an
            input is where each chain starts.
        labels: what the components of inputs are called in generated code, unless it is their name and number.
    """

    def __init__(
        self,
        name: str,
        function: Callable[[dict[str, Any]], Mapping[str, Any]],
        inputs: Mapping[str, Extent],
        outputs: Mapping[str, Extent],
        *,
        exact: bool = False,
        carry: Mapping[str, str] | None = None,
        labels: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        self.name = name
        self.function = function
        self.inputs: Spec = tuple(inputs.items())
        self.outputs: Spec = tuple(outputs.items())
        self.exact = exact
        self.carry = dict(carry or {})
        self.labels = dict(labels or {})
        self.program = functools.lru_cache(maxsize=256)(functools.partial(Program, self))

    def run(self, values: Mapping[str, Any], out: Buffers, shape: Extent, dtype: np.dtype[Any], how: How) -> None:
        """Write the outputs of all samples into the arrays of `out`: the samples' shape, and then their own.

        Args:
            values: inputs by name: arrays with the components last, or tuples of components; a component is a number
                or an array. All broadcast to the samples.
            out: arrays of the dtype by output; they may lie over inputs only sample on sample.
            shape: of the samples; of a scan, the last axis is the chain.
            dtype: to compute in, float64 or float32.
            how: backend and threads.
        """
        if 0 in shape:
            return
        bound = bind(self.inputs, values, frozenset(self.carry))
        if not bound.pieces and how.backend == "compiled":  # one sample rounds as many do
            bound = bind(self.inputs, values, moving=True)
        self.program(bound.pattern).run(bound, out, shape, dtype, how)

    def of_library(self, values: Mapping[str, Any], library: Library) -> dict[str, tuple[Any, ...]]:
        """Return the components of all outputs by name, by the arithmetic of another library.

        Args:
            values: inputs by name: numbers and arrays of the library, vectors as tuples of these.
            library: the other library.
        """
        pattern, constants, arrays = bind_foreign(self.inputs, values)
        flat = iter(self.program(pattern).library_function(library)(*constants, *arrays))
        return {name: tuple(next(flat) for _ in range(math.prod(tail))) for name, tail in self.outputs}


class Operations(NamedTuple):
    """The numbers of operations of a program.

    Attributes:
        each: for each sample.
        once: for all samples together.
        full: where nothing is known beforehand.
    """

    each: int
    once: int
    full: int

    @property
    def known(self) -> int:
        """The number of operations that fold away."""
        return self.full - self.each - self.once


class Traced(NamedTuple):
    """A traced function: its inputs, and its results by name."""

    constants: tuple[Value, ...]
    pieces: tuple[tuple[Value, ...], ...]
    results: dict[str, Any]

    def flat(self, outputs: Spec) -> list[Operand]:
        """Return the components of all outputs, one after the other."""
        return [part for name, _ in outputs for part in components(self.results[name])]


T = TypeVar("T")


class _Once(functools.cached_property[T]):
    """A cached property without the lock of Python 3.11, which a fork could leave locked in the child for ever."""

    def __get__(self, instance: Any, owner: type[Any] | None = None) -> T:  # type: ignore[override]
        found = instance.__dict__[self.attrname] = self.func(instance)
        return found


class Program:
    """A loop, traced and folded for one pattern of inputs."""

    def __init__(self, loop: Loop, pattern: Pattern) -> None:
        self.loop = loop
        self.pattern = pattern
        self._kernels: dict[Key, Kernel] = {}
        self._accounts: dict[Key, Account] = {}
        self._compiles = True  # until LLVM fails

    # ---- running it

    def run(self, bound: Bound, out: Buffers, shape: Extent, dtype: np.dtype[Any], how: How) -> None:
        """Run the program as `Loop.run` does, over inputs that are bound."""
        targets = [part for name, tail in self.loop.outputs for part in rows_of(out[name], tail)]
        if not bound.pieces or how.backend == "numpy":
            self._by_numpy(bound, targets, shape, dtype, how.workers)
            return
        chained = bool(self.loop.carry)
        layout = layout_of(forms_of((*bound.pieces, *targets)), shape, chained)
        still = tuple(line[1] == 0 for line in layout.lines[: len(bound.pieces)])
        key = Key(still, tuple(part.shape[-1] for part in targets), dtype.char)
        if how.backend == "auto":
            kernel = self.kernel_if_paid(key, math.prod(shape), shape[-1] if chained else 1)
        else:
            kernel = self.kernel(key)
        if kernel is None:
            self._by_numpy(bound, targets, shape, dtype, how.workers)
        elif all(piece.dtype == dtype for piece in bound.pieces):
            constants = np.array(bound.constants, dtype) if bound.constants else None
            walk(kernel.run, layout, bound.pieces, targets, constants, how.workers, chained)
        else:  # as many samples at a time as are converted without much memory
            for block in split(
                shape, max(1, _MAX_CONVERTED_BYTES // (dtype.itemsize * sum(p.shape[-1] for p in bound.pieces)))
            ):
                pieces = [load(piece, (*block, slice(piece.shape[-1])), dtype) for piece in bound.pieces]
                part = {name: array[block] for name, array in out.items()}
                size = tuple(own.stop - own.start for own in block)
                self.run(bound._replace(pieces=pieces), part, size, dtype, How("compiled", how.workers))

    def key_of_samples(self) -> Key:
        """Return the key of the kernel for float64 inputs that all change from sample to sample."""
        pieces = {place[0] for place in self.pattern if isinstance(place, tuple)}
        return Key((False,) * len(pieces), tuple(math.prod(tail) for _, tail in self.loop.outputs), "d")

    def kernel_if_paid(self, key: Key, samples: int, links: int = 1) -> Kernel | None:
        """Return the kernel if it is there, or pays from this call on and compiles; see `backend.Account`.

        Args:
            key: of the kernel.
            samples: number of samples of this call; 0 of one state that Python computes.
            links: length of each chain, of a scan.
        """
        kernel = self._kernels.get(key)
        if kernel is not None or not self._compiles:
            return kernel
        account = self._accounts.get(key)
        if account is None:
            account = self._accounts.setdefault(key, Account(self.operations, sum(key.parts)))
        pays = account.pays(samples, links) if samples else account.pays_one()
        return self.kernel_if_compiled(key) if pays else None

    def kernel_if_made(self, key: Key) -> Kernel | None:
        """Return the kernel where it is there."""
        return self._kernels.get(key)

    def kernel_if_compiled(self, key: Key) -> Kernel | None:
        """Return the kernel; None where it cannot be compiled, which is warned of once."""
        try:
            return self.kernel(key)
        except MissingDependencyError as error:
            give_up(error)
        except CompilationError as error:
            if self._compiles:
                warnings.warn(f"{error}; computing with NumPy", RuntimeWarning, stacklevel=2)
            self._compiles = False
        return None

    def kernel(self, key: Key) -> Kernel:
        """Return the compiled kernel, which is made at the first call.

        Raises:
            MissingDependencyError: llvmlite is not installed.
            CompilationError: LLVM fails.
        """
        kernel = self._kernels.get(key)
        if kernel is None:
            from hingepair.engine.native import Kernel, can_fuse, compiler_lock

            with compiler_lock:  # whoever comes second finds the kernel of the first
                kernel = self._kernels.get(key)
                if kernel is None:
                    ir = self.llvm(*key, fuse=can_fuse() and not self.loop.exact)
                    kernel = self._kernels[key] = Kernel(self.loop.name, ir, number_type(key.char == "f"))
        return kernel

    def llvm(self, still: tuple[bool, ...], parts: tuple[int, ...], char: str, fuse: bool) -> str:
        """Return the LLVM code of the kernel of a key; `fuse` is whether the machine multiplies and adds in one."""
        traced = self.traced(still)
        inputs = [Group(traced.constants, False)] if traced.constants else []
        inputs += [Group(piece, not quiet) for piece, quiet in zip(traced.pieces, still, strict=True)]
        flat, outputs = traced.flat(self.loop.outputs), []
        for count in parts:
            outputs.append(Group(tuple(flat[:count])))
            del flat[:count]
        carry = None
        if self.loop.carry:
            before = [part for name in self.loop.carry for part in components(traced.results["before"][name])]
            after = [part for name in self.loop.carry.values() for part in components(traced.results[name])]
            carry = Carry(tuple(before), tuple(after))
        return kernel_ir(inputs, outputs, single=char == "f", fuse=fuse, carry=carry)

    def _by_numpy(
        self, bound: Bound, parts: Sequence[NDArray[Any]], shape: Extent, dtype: np.dtype[Any], workers: int
    ) -> None:
        """Run the program by NumPy in blocks of samples; what all samples share is computed once, in floats."""
        if not bound.pieces and dtype == np.float64:
            found = self.floats_function(*bound.constants)
            for part in parts:
                count = part.shape[-1]
                part[...], found = found[:count], found[count:]
            return
        numbers = bound.constants if dtype == np.float64 else [dtype.type(x) for x in bound.constants]
        pieces = [piece[..., c] for piece in bound.pieces for c in range(piece.shape[-1])]
        targets = [part[..., c] for part in parts for c in range(part.shape[-1])]
        if self.loop.carry:
            self._chain(numbers, pieces, targets, shape, dtype)
            return
        function = self.arrays_function

        def work(some: Sequence[Block]) -> None:
            with np.errstate(all="ignore"):
                for block in some:
                    found = function(*numbers, *(load(piece, block, dtype) for piece in pieces))
                    for target, part in zip(targets, found, strict=True):
                        target[block] = part

        blocks: list[Block] = [*split(shape, _BLOCK_SAMPLES)] if pieces else [()]
        workers = min(workers, len(blocks))
        in_threads(work, [blocks[i::workers] for i in range(workers)])

    # ---- the program written out

    @_Once
    def source(self) -> str:
        """The source of the generated Python function."""
        traced = self._moving
        inputs = [*traced.constants, *(value for piece in traced.pieces for value in piece)]
        after = [part for name in self.loop.carry.values() for part in components(traced.results[name])]
        return python_source.source_of(self.loop.name, inputs, [*traced.flat(self.loop.outputs), *after])

    @_Once
    def floats_function(self) -> Callable[..., tuple[Any, ...]]:
        """The generated function for one state, of Python floats: constants, then inputs."""
        return python_source.for_floats(self.loop.name, self.source)

    @_Once
    def arrays_function(self) -> Callable[..., tuple[Any, ...]]:
        """The generated function for NumPy arrays."""
        return python_source.for_arrays(self.loop.name, self.source)

    @_Once
    def library_function(self) -> Callable[[Library], Callable[..., tuple[Any, ...]]]:
        """What makes the generated function for arrays of another library, once for each library and dtype."""
        return functools.lru_cache(maxsize=8)(
            functools.partial(python_source.for_library, self.loop.name, self.source)
        )

    @_Once
    def operations(self) -> int:
        """The number of operations that are left, sines counted as ten."""
        return sum((10 if v.operation in FUNCTIONS else 1) for v in self._lines if v.operation != "input")

    def count(self, full: Program) -> Operations:
        """Return the numbers of operations left, beside those of the program for which nothing is known."""
        each, once = (operations(self._lines, moving) for moving in (True, False))
        return Operations(each, once, operations(full._lines))

    @_Once
    def _lines(self) -> list[Value]:
        return needed_lines(self._moving.flat(self.loop.outputs))

    @_Once
    def _moving(self) -> Traced:
        """The traced function, for inputs that all change from sample to sample."""
        return self.traced((False,) * len({place[0] for place in self.pattern if isinstance(place, tuple)}))

    def traced(self, still: tuple[bool, ...]) -> Traced:
        """Trace the function; `still` names the inputs that do not change from sample to sample."""
        trace, places = Trace(), iter(self.pattern)
        constants: list[Value] = []
        pieces: dict[int, dict[int, Value]] = {}
        values: dict[str, Any] = {}
        for name, tail in self.loop.inputs:
            own: list[Operand] = []
            count = math.prod(tail)
            for k in range(count):
                place, labels = next(places), self.loop.labels.get(name)
                wish = labels[k] if labels else line_name(name, k, count)
                if place is None:
                    constants.append(trace.input(wish, False))
                    own.append(constants[-1])
                elif isinstance(place, tuple):
                    piece = pieces.setdefault(place[0], {})
                    if place[1] not in piece:
                        moves = not still[place[0]] or name in self.loop.carry
                        piece[place[1]] = trace.input(wish, moves)
                    own.append(piece[place[1]])
                else:
                    own.append(place)
            values[name] = tuple(own) if tail else own[0]
        before = {name: values[name] for name in self.loop.carry}
        results = {**self.loop.function(values), "before": before}
        for name, _ in self.loop.outputs:
            name_lines(name, results[name])
        ordered = tuple(tuple(piece[c] for c in sorted(piece)) for _, piece in sorted(pieces.items()))
        return Traced(tuple(constants), ordered, results)

    def _chain(
        self,
        numbers: Sequence[Any],
        pieces: Sequence[Any],
        targets: Sequence[Any],
        shape: Extent,
        dtype: np.dtype[Any],
    ) -> None:
        """Run a scan by NumPy: all chains at once, one sample after the other."""
        places = iter(self.pattern)
        parts = [(name, next(places)) for name, tail in self.loop.inputs for _ in range(math.prod(tail))]
        carried = [place for name, place in parts if name in self.loop.carry]
        index = {place: k for k, place in enumerate(sorted({p for _, p in parts if isinstance(p, tuple)}))}
        at = [index[place] for place in carried if isinstance(place, tuple)]
        chains = shape[:-1]
        own = [np.broadcast_to(piece, shape) for piece in pieces]
        state = {k: own[k][..., 0].astype(dtype) for k in at}
        with np.errstate(all="ignore"):
            for j in range(shape[-1]):
                given = [state[k] if k in state else piece[..., j].astype(dtype) for k, piece in enumerate(own)]
                found = self.arrays_function(*numbers, *given)
                for k, one in zip(at, found[len(targets) :], strict=True):
                    state[k] = one if np.shape(one) == chains else np.broadcast_to(np.asarray(one, dtype), chains)
                for target, one in zip(targets, found, strict=False):
                    target[..., j] = one


def components(value: Any) -> tuple[Any, ...]:
    """Return the components of a vector, or a scalar as a tuple of one."""
    return value if isinstance(value, tuple) else (value,)
