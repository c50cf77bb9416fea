"""What a scene's run came to: a few instants, ranges, the largest residuals of the constraints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.tables import finite_or_none, instant
from hingepair.pair.accuracy import error_ratios, output_scales
from hingepair.pair.constraints import constraint_values
from hingepair.pair.results import column_names
from hingepair.scenes.scene import Notes

if TYPE_CHECKING:
    from rich.table import Table

    from hingepair.scenes.known_motion import KnownMotion
    from hingepair.scenes.scene import Scene, SceneResult

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


class Summary:
    """A scene's run, gathered from its pieces in order.

    Attributes:
        lost: how many instants hold a number that is not finite.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._notes = Notes(scene)
        self._instants = sorted({0, (scene.samples - 1) // 2, scene.samples - 1})
        self._seen: list[tuple[float, list[float]]] = []  # these instants, and each component then
        self._names: list[str] = []
        self._ranges = np.empty((0, 2))
        self._meanings = _MEANINGS[: scene.motion.level + 1]
        self._worst = np.full((len(self._meanings), 2), np.nan)
        self.lost = 0

    def add(self, part: SceneResult) -> None:
        """Look at one piece."""
        arrays = part.chosen()
        columns = [column for array in arrays.values() for column in array.reshape(len(part.t), -1).T]
        if not self._names:
            self._names = column_names(arrays)
            self._ranges = np.full((len(columns), 2), np.nan)
        for i in self._instants:
            if 0 <= i - part.first < len(part.t):
                at = i - part.first
                self._seen.append((float(part.t[at]), [float(column[at]) for column in columns]))
        ranges = np.array([_range(column) for column in columns])
        self._ranges = np.stack(
            [np.fmin(self._ranges[:, 0], ranges[:, 0]), np.fmax(self._ranges[:, 1], ranges[:, 1])], axis=1
        )
        self.lost += int(np.count_nonzero(~np.logical_and.reduce([np.isfinite(column) for column in columns])))
        self._worst = np.fmax(self._worst, _worst(self._scene, part.known))
        self._notes.add(part)

    def residuals(self) -> tuple[Residual, ...]:
        """How far the computed motion is from E1, and from E2 where it has rates, over all instants."""
        return tuple(
            Residual(label, meaning, unit, largest, ratio, scale)
            for (label, meaning, unit, scale), (largest, ratio) in zip(
                self._meanings, self._worst.tolist(), strict=True
            )
        )

    def notes(self) -> tuple[str, ...]:
        """What a reader should know."""
        return self._notes.sentences()

    def table(self) -> Table:
        """First, middle and last instant of every component, and its range."""
        from rich import box
        from rich.table import Table

        found = Table(box=box.SIMPLE_HEAD)
        found.add_column("", no_wrap=True)
        for heading in (*(f"t = {instant(t)}" for t, _ in self._seen), "smallest", "largest"):
            found.add_column(heading, justify="right", no_wrap=True)
        for i, name in enumerate(self._names):
            cells = [*(values[i] for _, values in self._seen), *self._ranges[i]]
            found.add_row(name, *(f"{cell + 0.0:.6g}" for cell in cells), end_section=name.endswith(("_z", "_zz")))
        return found

    def as_json(self) -> dict[str, Any]:
        """The same as numbers; what is not finite is None."""
        keys = ("first", "last", "smallest", "largest")
        return {
            name: {
                key: finite_or_none(float(number))
                for key, number in zip(
                    keys, (self._seen[0][1][i], self._seen[-1][1][i], *self._ranges[i]), strict=True
                )
            }
            for i, name in enumerate(self._names)
        }


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
    return _range(values)[1]


def _range(column: NDArray[Any]) -> tuple[float, float]:
    finite = column[np.isfinite(column)]
    return (float(finite.min()), float(finite.max())) if finite.size else (math.nan, math.nan)
