"""What a scene's run came to: a few instants, ranges, the largest residuals of the constraints."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.tables import instant
from hingepair.pair.accuracy import error_ratios, output_scales
from hingepair.pair.constants import with_hinge_frames
from hingepair.pair.evaluate import arrays_of
from hingepair.pair.results import column_names
from hingepair.scenes.known_motion import KnownMotion
from hingepair.scenes.mechanisms.scene import MechanismScene, MechanismSceneResult
from hingepair.scenes.scene import Scene, SceneResult

_MEANINGS = (
    ("E1", "R1 + S1 u1 - (R2 + S2 u2)", "m"),
    ("E2", "omega2 - omega1 - S2 C^T n psi'", "rad/s"),
)


class Residual(NamedTuple):
    """The largest component of the residual of one constraint over all instants, and that in units of u * scale."""

    label: str
    meaning: str
    unit: str
    largest: float
    ratio: float


class Summary:
    """A scene's run, gathered from its pieces in order; residuals are those of a pair.

    Attributes:
        lost: how many instants hold a number that is not finite.
    """

    def __init__(self, scene: Scene | MechanismScene) -> None:
        self._scene = scene
        self._notes: Any = scene.collected_notes()
        self._instants = sorted({0, (scene.samples - 1) // 2, scene.samples - 1})
        self._t: list[float] = []  # these, and each component then
        self._then: list[NDArray[np.float64]] = []
        self._names: list[str] = []
        self._least = self._most = np.array(np.nan)
        self._meanings = _MEANINGS[: scene.motion.level + 1] if isinstance(scene, Scene) else ()
        self._worst = np.full((len(self._meanings), 2), np.nan)
        self.lost = 0

    def add(self, part: SceneResult | MechanismSceneResult) -> None:
        """Look at one piece."""
        arrays = part.chosen()
        self._names = column_names(arrays)
        values = np.concatenate([array.reshape(len(part.t), -1) for array in arrays.values()], axis=1, dtype=float)
        for at in (i - part.first for i in self._instants):
            if 0 <= at < len(part.t):
                self._t.append(float(part.t[at]))
                self._then.append(values[at].copy())
        lost = ~np.isfinite(values)
        self.lost += int(lost.any(axis=1).sum())
        values[lost] = np.nan
        self._least = np.fmin(self._least, np.fmin.reduce(values))
        self._most = np.fmax(self._most, np.fmax.reduce(values))
        if isinstance(self._scene, Scene) and isinstance(part, SceneResult):
            self._worst = np.fmax(self._worst, _worst(self._scene, part.known))
        self._notes.add(part)

    def residuals(self) -> tuple[Residual, ...]:
        """Return the largest residuals of E1, and of E2 where the motion has rates, over all instants."""
        return tuple(Residual(*own, *worst) for own, worst in zip(self._meanings, self._worst.tolist(), strict=True))

    def notes(self) -> tuple[str, ...]:
        """Return sentences that a reader should see."""
        sentences: tuple[str, ...] = self._notes.sentences()
        return sentences

    def table(self) -> list[tuple[str, ...]]:
        """Return the heading and rows of a table: each component at three instants, and its range."""
        columns = [[f"{cell + 0.0:.6g}" for cell in own] for own in (*self._then, self._least, self._most)]
        heading = ("", "unit", *(f"t = {instant(t)}" for t in self._t), "smallest", "largest")
        return [heading, *zip(self._names, map(self._scene.unit, self._names), *columns, strict=True)]

    def ranges(self) -> dict[str, dict[str, float]]:
        """Return each component at the first and last instant, and its range, as numbers."""
        columns = {"first": self._then[0], "last": self._then[-1], "smallest": self._least, "largest": self._most}
        return {name: {key: float(own[i]) for key, own in columns.items()} for i, name in enumerate(self._names)}


def _worst(scene: Scene, known: KnownMotion) -> NDArray[np.float64]:
    """Compute the largest residuals of E1 and E2, absolute and in u * scale; NaN where no instant is finite."""
    pair, a = scene.space, known.bodies(scene.pair)
    W1, psid = a.pop("W1", None), a.pop("psid", None)
    scales = output_scales(u1=pair.u1, u2=pair.u2, R1=a["R1"], W1=W1, psid=psid)
    names, rate = (("gap",), {}) if psid is None else (("gap", "slip"), {"psid_given": psid})
    constants = with_hinge_frames(pair.constants)
    measured = arrays_of(constants, names, {**a, **rate}, {"R1": a["R1"].shape[:-1]})
    found = []
    for name, residual in zip(("R2", "omega2"), measured.values(), strict=False):
        error, ratio = error_ratios(name, residual, np.zeros_like(residual), scales[name])
        found.append([_largest(error), _largest(ratio)])
    return np.array(found)


def _largest(values: NDArray[Any]) -> float:
    return float(np.fmax.reduce(np.where(np.isfinite(values), values, np.nan), axis=None, initial=np.nan))
