"""The instants of a scene: evenly spaced ones are worked out where they are needed, however many there are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.results import MAX_HELD_INSTANTS
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.scenes.tables import Key, Table

Rows: TypeAlias = slice | NDArray[np.intp]
"""Indices of some of the instants."""

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
    """Return the instants of the Table [time] as a read-only array (samples,) s; refuse more than memory holds."""
    t = read_instants(time)
    if len(t) > MAX_HELD_INSTANTS:
        time.fail(
            "samples",
            f"at most {MAX_HELD_INSTANTS} where a motion is integrated, which is done in memory",
        )
    return np.asarray(read_only(t[:]))


def _read_sample_count(time: Table, key: str) -> int:
    """Return the integer from 1 to MAX_SAMPLES under a key of [time]; 1e6 is one, too."""
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
