"""The instants of a scene: evenly spaced ones are worked out where they are needed, however many there are."""

from __future__ import annotations

import abc
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.numeric.tables import Shown, instant_text, unit_of
from hingepair.pair.results import MAX_INSTANTS_OF_RESULT_HELD_IN_MEMORY, RESULT_ROWS_PER_BLOCK
from hingepair.scenes.tables import Key, Table

Rows: TypeAlias = slice | NDArray[np.intp]
"""Some of the instants, by their numbers."""

MAX_SAMPLES: Final = 1_000_000_000
"""Largest number of instants of a scene; results of many go into a file block by block."""


@dataclass(frozen=True, slots=True)
class UniformInstants:
    """Evenly spaced instants [s] from `start` to `stop`, both included; `samples` is their number.

    >>> UniformInstants(0.0, 1.0, 5)[1:3]
    array([0.25, 0.5 ])
    >>> UniformInstants(0.0, 1.0, 5)[-1]
    np.float64(1.0)
    """

    start: float
    stop: float
    samples: int

    def __len__(self) -> int:
        return self.samples

    def __getitem__(self, rows: int | Rows) -> Any:
        """Return one instant as a float64, or an array of the instants with the given indices."""
        if isinstance(rows, slice):
            numbers: Any = np.arange(*rows.indices(self.samples), dtype=np.float64)
        else:
            numbers = np.asarray(rows, dtype=np.float64)
            if ((numbers < -self.samples) | (numbers >= self.samples)).any():
                raise IndexError(f"index out of range for {self.samples} instants")
            numbers = numbers % self.samples
        step = (self.stop - self.start) / max(self.samples - 1, 1)
        instants: Float64Array = numbers * step + self.start
        last = (numbers == self.samples - 1) & (self.samples > 1)
        return np.where(last, self.stop, instants)[()]


Instants: TypeAlias = UniformInstants | Float64Array
"""Increasing instants [s]."""


class SampledScene(Shown, abc.ABC):
    """Abstract base of Scene and MechanismScene."""

    __slots__ = ()

    @property
    @abc.abstractmethod
    def instants(self) -> Instants:
        """The instants [s], an array or UniformInstants."""

    @property
    def start(self) -> float:
        """First instant [s]."""
        return float(self.instants[0])

    @property
    def stop(self) -> float:
        """Last instant [s]."""
        return float(self.instants[-1])

    @property
    def span(self) -> str:
        """First and last instant as a short text such as 0..10."""
        return f"{instant_text(self.start)}..{instant_text(self.stop)}"

    @property
    def samples(self) -> int:
        """Number of instants."""
        return len(self.instants)

    def times(self) -> NDArray[np.float64]:
        """Return all instants as a read-only array; shape (samples,) s."""
        if self.samples > MAX_INSTANTS_OF_RESULT_HELD_IN_MEMORY:
            way = (
                "hingepair run SCENE --out FILE.parquet (or .csv) computes any number, scene.blocks() piece by piece"
            )
            raise ArgumentError(
                "samples",
                f"at most {MAX_INSTANTS_OF_RESULT_HELD_IN_MEMORY} instants to be held in memory; {way}",
                self.samples,
            )
        return np.asarray(read_only(self.instants[:]))

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components, as a string."""
        return unit_of(name)

    @property
    def backend(self) -> str:
        """Name of the backend that computes the scene. It is "auto" if the instants fit into one block, otherwise
        "compiled" or "numpy" for every block, so that blocks and the whole agree to the bit.
        """
        return "auto" if self.samples <= RESULT_ROWS_PER_BLOCK else "compiled" if find_spec("llvmlite") else "numpy"

    def block_rows(self) -> Iterator[slice]:
        """Yield slices of the indices of the instants, one for each block of at most RESULT_ROWS_PER_BLOCK instants
        in turn.
        """
        return (
            slice(start, start + RESULT_ROWS_PER_BLOCK) for start in range(0, self.samples, RESULT_ROWS_PER_BLOCK)
        )

    def spread(self, max_instants: int) -> Rows:
        """Return the indices of `max_instants` evenly spread instants, or of all if there are fewer, as an integer
        array.
        """
        return np.unique(np.linspace(0, self.samples - 1, min(self.samples, max_instants)).astype(np.intp))


def read_instants(time: Table) -> UniformInstants:
    """Return the UniformInstants that the keys start, stop and samples of the Table [time] define."""
    start, stop, samples = time.read(_TIME_KEYS, required=_TIME_KEYS).values()
    if not 0 <= stop - start < np.inf:
        time.fail("stop", f"a number from start = {start!r} on, at a finite distance")
    if samples == 1 and stop > start:
        time.fail("samples", f"at least 2, from start = {start!r} to stop = {stop!r}, or stop = start")
    closest = 2 * float(np.spacing(max(abs(start), abs(stop))))
    if samples > 1 and 0 < stop - start < (samples - 1) * closest:
        time.fail("samples", f"fewer: near t = {stop:.9g} s, floats tell instants {closest:.2g} s apart")
    return UniformInstants(start, stop, samples)


def read_instants_array(time: Table) -> Float64Array:
    """Return the instants of the Table [time] as a read-only array; shape (samples,) s."""
    t = read_instants(time)
    if len(t) > MAX_INSTANTS_OF_RESULT_HELD_IN_MEMORY:
        time.fail(
            "samples",
            f"at most {MAX_INSTANTS_OF_RESULT_HELD_IN_MEMORY} where a motion is integrated, which is done in memory",
        )
    return np.asarray(read_only(t[:]))


def _read_sample_count(time: Table, key: str) -> int:
    """Return the number of samples under a key of [time] as an int."""
    value: Any = time.values.get(key)
    if type(value) is float and value.is_integer():
        value = int(value)
    if type(value) is not int or not 1 <= value <= MAX_SAMPLES:
        time.fail(key, f"an integer from 1 to {MAX_SAMPLES}")
    return value


_TIME_KEYS: Final[Mapping[str, Key]] = {
    "start": Table.number,
    "stop": Table.number,
    "samples": _read_sample_count,
}
"""Keys of the table [time] and their readers; start and stop in seconds."""
