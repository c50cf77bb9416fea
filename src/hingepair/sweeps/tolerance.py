"""A tolerance study of a scene: the band of body 2's pose, to first order and by samples, and what causes it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations.quantities import POSE
from hingepair.errors import MissingDependencyError, SceneError
from hingepair.numeric.arrays import Float64Array, Frozen
from hingepair.numeric.suspicions import DEGREES_IN_SCENES, suspicions
from hingepair.numeric.tables import Sheet, Shown, instant_text, json_text
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.tolerances import DEVIATIONS, sample_pairs
from hingepair.rotations.matrices import rotation_log
from hingepair.scenes.pair_scene import PairScene
from hingepair.scenes.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


POSE_COMPONENTS: Final = ("R2_x", "R2_y", "R2_z", "attitude_x", "attitude_y", "attitude_z")
"""Columns of a tolerance study: position [m] and rotation vector [rad] of body 2, world axes."""

# States (sampled pairs times instants) that are computed at a time.
_MAX_STATES: Final = 200_000
# Ends of the band, the middle 95 %.
_BAND: Final = (0.025, 0.975)
# Half the width of this band of a normal distribution, in standard deviations.
_HALF_BAND: Final = 1.96


class Band(NamedTuple):
    """Deviations of one component of the pose of body 2 at one instant."""

    #: one of `POSE_COMPONENTS`
    component: str
    #: unit of the four numbers that follow: m or rad
    unit: str
    #: standard deviation to first order
    first_order_std: float
    #: standard deviation of the sampled pairs
    sampled_std: float
    #: lower end of the middle 95 % of the sampled pairs
    low: float
    #: upper end of the middle 95 % of the sampled pairs
    high: float
    #: the instant [s]
    t: float

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the band's printed row, a tuple of strings."""
        return self.component, self.unit, *(f"{size:.4g}" for size in self[2:6]), instant_text(self.t)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ToleranceStudy(Frozen, Shown):
    """Deviations of the pose of body 2 along a scene under tolerances."""

    #: title of the scene
    title: str
    #: instants [s]; (N,)
    t: Float64Array
    #: standard deviations to first order; (N, 6)
    std: Float64Array
    #: standard deviations of the sampled pairs; (N, 6)
    sampled_std: Float64Array
    #: the middle 95 % of the sampled pairs, as deviations from the pair as designed; (N, 2, 6)
    band: Float64Array
    #: variances that each dimension causes alone, to first order, by name of the dimension; (N, 6)
    contributions: Mapping[str, Float64Array]
    #: number of sampled pairs
    samples: int
    #: standard deviations of the geometry, by argument of `sample_pairs`
    tolerances: Mapping[str, Any]
    #: sentences on standard deviations in doubtful units, and on instants that are left out
    notes: tuple[str, ...] = ()

    def shares(self) -> dict[str, tuple[float, float]]:
        """Return a dict from the name of each dimension to a tuple of two fractions (0 to 1): the fraction of the
        variance of R2 and the fraction of the variance of the attitude that the dimension causes. The dimension with
        the largest fraction comes first; dimensions without scatter are left out.

        The variances are means over the instants.
        """
        variances = {
            name: np.array((array[:, :3].sum(), array[:, 3:].sum())) for name, array in self.contributions.items()
        }
        total = np.maximum(np.sum([*variances.values()], axis=0), np.finfo(np.float64).tiny)
        fractions = {name: variance / total for name, variance in variances.items()}
        shares = {name: (float(pair[0]), float(pair[1])) for name, pair in fractions.items() if pair.any()}
        return dict(sorted(shares.items(), key=lambda item: -max(item[1])))

    def bands(self) -> list[Band]:
        """Return a list of six `Band` records, one for each pose component, at the instant of the component's largest
        first-order standard deviation.
        """
        rows = []
        for k, name in enumerate(POSE_COMPONENTS):
            i = int(np.argmax(self.std[:, k]))
            sizes = (self.std[i, k], self.sampled_std[i, k], *self.band[i, :, k], self.t[i])
            rows.append(Band(name, "m" if k < 3 else "rad", *map(float, sizes)))
        return rows

    @property
    def verdict(self) -> str:
        """Text that names the dimension with the largest share in the variance of R2 and the dimension with the
        largest share in the variance of the attitude. A dimension whose share is zero is not named.
        """
        shares = self.shares()
        leaders = [max(shares, key=lambda name: shares[name][k]) for k in (0, 1)]
        texts = [
            f"{name} matters most for {what} ({100 * shares[name][k]:.0f} % of its variance)"
            for k, (name, what) in enumerate(zip(leaders, ("R2", "the attitude"), strict=True))
            if shares[name][k]
        ]
        return "; ".join(texts)

    def to_json(self) -> str:
        """Return title, numbers of samples and instants, tolerances, bands, shares and verdict as JSON text."""
        return json_text(
            {
                "title": self.title,
                "samples": self.samples,
                "instants": len(self.t),
                "tolerances": {name: np.asarray(value).tolist() for name, value in self.tolerances.items()},
                "bands": [band._asdict() for band in self.bands()],
                "shares": {name: {"R2": a, "attitude": b} for name, (a, b) in self.shares().items()},
                "verdict": self.verdict,
                "notes": self.notes,
            }
        )

    def plot(self) -> Figure:
        """Return a Matplotlib figure with the 95 % bands of the pose components over time, to first order and of the
        sampled pairs, and the shares of each dimension in the variance.
        """
        try:
            from matplotlib.figure import Figure
        except ImportError as error:
            raise MissingDependencyError("plot", "Matplotlib (pip install matplotlib)", str(error)) from None

        figure = Figure(figsize=(10, 10), layout="constrained")
        grid = figure.add_gridspec(4, 2)
        for k, name in enumerate(POSE_COMPONENTS):
            axes = figure.add_subplot(grid[k % 3, k // 3])
            unit, scale = ("mm", 1e3) if k < 3 else ("mrad", 1e3)
            low, high = scale * self.band[:, :, k].T
            axes.fill_between(self.t, low, high, alpha=0.3, linewidth=0, label=f"95 % of {self.samples} pairs")
            for sign in (-1, 1):
                label = "first order" if sign > 0 else None
                axes.plot(
                    self.t,
                    sign * scale * _HALF_BAND * self.std[:, k],
                    "k--",
                    linewidth=0.8,
                    label=label,
                )
            axes.set_ylabel(f"{name} [{unit}]")
            axes.grid(alpha=0.3)
            if k % 3 == 2:
                axes.set_xlabel("t [s]")
            if k == 0:
                axes.legend(loc="upper right", fontsize="small")
        shares = self.shares()
        axes, places = figure.add_subplot(grid[3, :]), np.arange(len(shares))
        for k, what in enumerate(("R2", "attitude")):
            axes.bar(places + 0.4 * k - 0.2, [100 * fractions[k] for fractions in shares.values()], 0.4, label=what)
        axes.set_xticks(places, [*shares])
        axes.set_ylabel("part of the variance [%]")
        axes.legend(fontsize="small")
        figure.suptitle(f"{self.title}\n{self.verdict}" if self.title else self.verdict)
        return figure

    def _sheet(self) -> Sheet:
        bands, _ = self.tables()
        return Sheet(f"tolerances of {self.title}: {self.samples} pairs", bands, (self.verdict, *self.notes))

    def tables(self) -> tuple[Sequence[Sequence[str]], Sequence[Sequence[str]]]:
        """Return (bands, shares), the results of the methods `bands` and `shares` as two tables of strings. Each is a
        list of rows of cells; the first row has the headings.
        """
        heading = ("", "unit", "std, first order", "std, sampled", "2.5 %", "97.5 %", "at t")
        bands = [heading, *(band.cells() for band in self.bands())]
        shares = [("dimension", "of R2's variance", "of the attitude's")]
        shares += [(name, f"{100 * a:.1f} %", f"{100 * b:.1f} %") for name, (a, b) in self.shares().items()]
        return bands, shares


def read_tolerances(scene: PairScene) -> dict[str, Any]:
    """Return the standard deviations in the table [tolerances] of a Scene as a dict. The keys are argument names of
    `sample_pairs`, such as u1_std; each value is a float or three floats. The dict is empty if there is no table.
    """
    table = scene.tables.table("tolerances", required=False)
    table.check_keys(DEVIATIONS)
    return {
        name: table.numbers(name, 3) if isinstance(value, list) and name != "axis_std" else table.number(name)
        for name, value in table.values.items()
    }


def study_tolerances(scene: Scene, samples: int = 10_000, seed: int | None = 0, **std: ArrayLike) -> ToleranceStudy:
    """Return a `ToleranceStudy` of the pose of body 2 at up to 101 instants of a Scene, to first order and with
    `samples` random pairs that `seed` determines. Keyword arguments such as u1_std are standard deviations, which
    override the values in the scene's table [tolerances].

    Args:
        scene: scene of a pair; the study takes at most 101 of its instants, evenly spread.
        samples: number of pairs that are sampled.
        seed: seed of the sampled pairs; None for other pairs at every call.
        **std: standard deviations by argument name of `sample_pairs`; the others are those of [tolerances].
    """
    of_pair: PairScene = scene.require_pair()
    tolerances = {**read_tolerances(of_pair), **std}
    if not tolerances:
        expected = "standard deviations, such as [tolerances] u1_std = 0.001, or --u1-std 0.001"
        raise SceneError(f"{of_pair.path}: tolerances", expected, "none")
    rows = np.unique(np.linspace(0, of_pair.samples - 1, min(of_pair.samples, 101)).astype(np.intp))
    pair, t = of_pair.space, np.asarray(of_pair.motion.t[rows])
    moved = of_pair.motion.source.part(rows, POSE).in_space(of_pair.pair)
    R, S, psi = (
        np.broadcast_to(array, (len(t), *own))
        for array, own in ((moved.body1.R, (3,)), (moved.body1.S, (3, 3)), (moved.psi, ()))
    )
    known = np.isfinite(R).all(axis=1) & np.isfinite(S).all(axis=(1, 2)) & np.isfinite(psi)
    if not known.any():
        raise SceneError(f"{of_pair.path}: motion", "a pose at some instant", f"none at {len(t)} instants")
    lost = len(t) - int(known.sum())
    lever = max(float(np.linalg.norm(pair.u1)), float(np.linalg.norm(pair.u2)))
    doubts = [
        suspicions("std of angle", name, value, radians=DEGREES_IN_SCENES)
        if name in {"axis_std", "home_std"}
        else suspicions("std of length", name, [np.max(value), lever])
        for name, value in tolerances.items()
    ]
    notes = (*itertools.chain(*doubts), *[f"{lost} of {len(t)} instants have no pose and are left out"] * bool(lost))
    t, psi, body1 = t[known], psi[known], BodyMotion(R=R[known], S=S[known])
    linear = pair.propagate_covariance(body1, psi, **tolerances)
    sampled_pairs = sample_pairs(pair, samples, seed=seed, **tolerances)
    mean = pair.forward_kinematics_from_body1(body1, psi, outputs=("d", "S2"))
    sampled_std, band = np.empty((len(t), 6)), np.empty((len(t), 2, 6))
    step = max(1, _MAX_STATES // samples)
    for start in range(0, len(t), step):
        part = slice(start, start + step)
        some = BodyMotion(R=body1.R[part, None], S=body1.S[part, None])  # instants down, pairs across
        sampled = sampled_pairs.forward_kinematics_from_body1(some, psi[part, None], outputs=("d", "S2"))
        turn = rotation_log(sampled.S2 @ np.swapaxes(mean.S2[part, None], -1, -2))
        pose = np.concatenate((sampled.d - mean.d[part, None], turn), axis=-1)
        sampled_std[part] = pose.std(axis=1)
        band[part] = np.moveaxis(np.quantile(pose, _BAND, axis=1), 0, 1)
    return ToleranceStudy(
        title=of_pair.title,
        t=t,
        std=np.concatenate((linear.R2_std, linear.attitude_std), axis=-1),
        sampled_std=sampled_std,
        band=band,
        contributions=linear.contributions(),
        samples=samples,
        tolerances=tolerances,
        notes=notes,
    )
