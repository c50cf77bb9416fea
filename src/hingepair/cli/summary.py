"""What a scene's run came to: a few instants, ranges, the largest residuals of the constraints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import split
from hingepair.numeric.tables import finite_or_none
from hingepair.pair.accuracy import error_ratios, output_scales
from hingepair.pair.constraints import constraint_values
from hingepair.pair.results import column_names

if TYPE_CHECKING:
    from rich.table import Table

    from hingepair.scenes.known_motion import KnownMotion
    from hingepair.scenes.scene import Scene, SceneResult

_SLAB = 65536

_MEANINGS = (
    ("E1", "R1 + S1 u1 - (R2 + S2 u2)", "m", "max abs(R1) + abs(u1) + abs(u2)"),
    ("E2", "omega2 - omega1 - S2 C^T n psi'", "rad/s", "W2 = W1 + abs(psi')"),
)


@dataclass(frozen=True, slots=True)
class Residual:
    """The largest residual of one constraint over all instants.

    Attributes:
        label: of the equation.
        meaning: the residual, spelled out.
        unit: of `largest`.
        largest: largest component.
        ratio: the same in units of u * scale.
        scale: the formula of the scale.
    """

    label: str
    meaning: str
    unit: str
    largest: float
    ratio: float
    scale: str


def residuals(scene: Scene) -> tuple[Residual, ...]:
    """How far the computed motion is from E1, and from E2 where it has rates, over all instants of the scene."""
    motion = scene.motion
    meanings = _MEANINGS[: motion.level + 1]
    worst = np.full((len(meanings), 2), np.nan)
    for (rows,) in split(motion.t.shape, _SLAB):
        worst = np.fmax(worst, _worst(scene, motion.known(rows, len(meanings) - 1)))
    return tuple(
        Residual(label, meaning, unit, largest, ratio, scale)
        for (label, meaning, unit, scale), (largest, ratio) in zip(meanings, worst.tolist(), strict=True)
    )


def table(result: SceneResult) -> Table:
    """First, middle and last instant of every component, and its range."""
    from rich import box
    from rich.table import Table

    names, values = _columns(result)
    instants = sorted({0, (len(result.t) - 1) // 2, len(result.t) - 1})
    found = Table(box=box.SIMPLE_HEAD)
    found.add_column("", no_wrap=True)
    for heading in (*(f"t = {result.t[i]:.6g}" for i in instants), "smallest", "largest"):
        found.add_column(heading, justify="right", no_wrap=True)
    for name, column in zip(names, values, strict=True):
        cells = [*(column[i] for i in instants), *_range(column)]
        found.add_row(name, *(f"{cell + 0.0:.6g}" for cell in cells), end_section=name.endswith(("_z", "_zz")))
    return found


def as_json(result: SceneResult) -> dict[str, Any]:
    """The same as numbers; what is not finite is None."""
    names, values = _columns(result)
    columns = {}
    for name, column in zip(names, values, strict=True):
        smallest, largest = _range(column)
        numbers = {"first": column[0], "last": column[-1], "smallest": smallest, "largest": largest}
        columns[name] = {key: finite_or_none(float(number)) for key, number in numbers.items()}
    return columns


def not_finite(result: SceneResult) -> int:
    """How many instants hold a number that is not finite."""
    _, values = _columns(result)
    return int(np.count_nonzero(~np.logical_and.reduce([np.isfinite(column) for column in values])))


def _worst(scene: Scene, known: KnownMotion) -> NDArray[np.float64]:
    """Largest residual of E1 and E2, absolute and in units of u * scale; NaN where no instant is finite."""
    pair, a = scene.space, known.bodies(scene.pair)
    W1, psid = known.rates() if known.level else (None, None)
    scales = output_scales(u1=pair.u1, u2=pair.u2, R1=a["R1"], W1=W1, psid=psid)
    names, rate = (("gap",), {}) if psid is None else (("gap", "slip"), {"psid_given": psid})
    measured = constraint_values(pair.constants, names, {**a, **rate}, {"R1": a["R1"].shape[:-1]})
    found = []
    for name, residual in zip(("R2", "omega2"), measured.values(), strict=False):
        error, ratio = error_ratios(name, residual, np.zeros_like(residual), scales[name])
        found.append([_largest(error), _largest(ratio)])
    return np.array(found)


def _largest(values: NDArray[Any]) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else math.nan


def _columns(result: SceneResult) -> tuple[list[str], list[NDArray[Any]]]:
    arrays = result.state.arrays()
    return column_names(arrays), [c for a in arrays.values() for c in a.reshape(len(result.t), -1).T]


def _range(column: NDArray[Any]) -> tuple[float, float]:
    finite = column[np.isfinite(column)]
    return (float(finite.min()), float(finite.max())) if finite.size else (math.nan, math.nan)
