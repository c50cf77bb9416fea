"""A tolerance study of a scene: the bands of body 2's pose and of points, to first order and by samples, and what
causes them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from hingepair.equations.quantities import POSE
from hingepair.errors import SceneError
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.geometry import constants_of
from hingepair.mechanism.pairs.tolerances import DEVIATIONS, LIMITS, point_scatter, read_limits, sample_pairs
from hingepair.numeric.arrays import Float64Array, Frozen
from hingepair.numeric.optional import new_figure
from hingepair.rotations.matrices import rotation_log
from hingepair.scenes.pair_scene import PairScene
from hingepair.scenes.scene import Scene
from hingepair.tables.sheets import Sheet, Shown, instant_text, json_text
from hingepair.tables.suspicions import DEGREES_IN_SCENES, suspicions
from hingepair.tables.units import SI, Units

if TYPE_CHECKING:
    from matplotlib.figure import Figure


POSE_COMPONENTS: Final = ("R2_x", "R2_y", "R2_z", "attitude_x", "attitude_y", "attitude_z")
"""First columns of a tolerance study: position [m] and rotation vector [rad] of body 2, world axes."""

# States (sampled pairs times instants) that are computed at a time.
_MAX_STATES: Final = 200_000
# Quantiles at the ends of the band, the middle 95 %.
_BAND: Final = (0.025, 0.975)
# Half the width of this band of a normal distribution, in standard deviations.
_HALF_BAND: Final = 1.96
_LIMITS_NOTE: Final = (
    'A tolerance +- is taken for three standard deviations of a normal distribution; "+-0.2 mm uniform" makes all '
    "values between the limits as likely."
)


class Band(NamedTuple):
    """Deviations of one component of the pose of body 2, or of the position of a point, at one instant."""

    #: one of `POSE_COMPONENTS`, or such as handle_x
    component: str
    #: unit of the four numbers that follow: m or rad, or those that stand for them
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
    """Deviations of the pose of body 2, and of points, along a scene under tolerances. The last axis of arrays has
    six components of the pose, `POSE_COMPONENTS`, and three of each point: k numbers.
    """

    #: title of the scene
    title: str
    #: instants [s]; (N,)
    t: Float64Array
    #: standard deviations to first order; (N, k)
    std: Float64Array
    #: standard deviations of the sampled pairs; (N, k)
    sampled_std: Float64Array
    #: the middle 95 % of the sampled pairs, as deviations from the pair as designed; (N, 2, k)
    band: Float64Array
    #: variances that each dimension causes alone, to first order, by name of the dimension; (N, k)
    contributions: Mapping[str, Float64Array]
    #: number of sampled pairs
    samples: int
    #: limits, such as "+-0.2 mm", and standard deviations of the geometry, by argument of `sample_pairs`
    tolerances: Mapping[str, Any]
    #: sentences on what limits mean, on standard deviations in doubtful units, and on instants that are left out
    notes: tuple[str, ...] = ()
    #: units of tables and plots unless others are asked for
    units: Units = SI
    #: names of the points
    points: tuple[str, ...] = ()

    @property
    def parts(self) -> tuple[str, ...]:
        """What has three components each: R2, the attitude, and the points."""
        return ("R2", "the attitude", *self.points)

    def shares(self) -> dict[str, tuple[float, ...]]:
        """Return the fractions (0 to 1) of the variances of R2, of the attitude and of each point that each dimension
        causes, by its name. The dimension with the largest fraction comes first; dimensions without scatter are left
        out.

        The variances are means over the instants.
        """
        variances = {
            name: array.reshape(len(array), -1, 3).sum(axis=(0, 2)) for name, array in self.contributions.items()
        }
        total = np.maximum(np.sum([*variances.values()], axis=0), np.finfo(np.float64).tiny)
        fractions = {name: tuple((variance / total).tolist()) for name, variance in variances.items()}
        shares = {name: own for name, own in fractions.items() if any(own)}
        return dict(sorted(shares.items(), key=lambda item: -max(item[1])))

    def _components(self) -> list[tuple[str, str]]:
        """Return the names of the components and their SI units."""
        points = [f"{name}_{letter}" for name in self.points for letter in "xyz"]
        return [(name, "rad" if name.startswith("attitude_") else "m") for name in POSE_COMPONENTS] + [
            (name, "m") for name in points
        ]

    def bands(self, units: str | None = None) -> list[Band]:
        """Return a list of `Band` records, one for each component of the pose and of points, at the instant of the
        component's largest first-order standard deviation.

        Args:
            units: units in place of SI units, such as "deg, mm"; by default those of the scene.
        """
        shown, rows = self._shown(units), []
        for k, (name, si) in enumerate(self._components()):
            i = int(np.argmax(self.std[:, k]))
            factor = shown.factor(si)
            sizes = (self.std[i, k], self.sampled_std[i, k], *self.band[i, :, k])
            first, sampled, low, high = (factor * float(size) for size in sizes)
            t = shown.factor("s") * float(self.t[i])
            rows.append(Band(name, shown.unit(si), first, sampled, low, high, t))
        return rows

    def _shown(self, units: str | None) -> Units:
        return self.units if units is None else Units.of(units)

    @property
    def verdict(self) -> str:
        """Text that names the dimensions with the largest share in the variance of R2, of the attitude and of points,
        as means over the instants. A dimension whose share is zero is not named.
        """
        shares = self.shares()
        leaders = [max(shares, key=lambda name: shares[name][k]) for k in range(len(self.parts))]
        texts = [
            f"{name} matters most for {what} ({100 * shares[name][k]:.0f} % of its variance)"
            for k, (name, what) in enumerate(zip(leaders, self.parts, strict=True))
            if shares[name][k]
        ]
        return "; ".join(texts) + ", as a mean over the motion" * bool(texts)

    def to_json(self, units: str | None = None) -> str:
        """Return title, numbers of samples and instants, tolerances, bands, shares and verdict as JSON text.

        Args:
            units: units of the bands in place of SI units; by default those of the scene.
        """
        return json_text(
            {
                "title": self.title,
                "samples": self.samples,
                "instants": len(self.t),
                "tolerances": {
                    name: {point: np.asarray(one).tolist() for point, one in value.items()}
                    if name == "points"
                    else np.asarray(value).tolist()
                    for name, value in self.tolerances.items()
                },
                "bands": [band._asdict() for band in self.bands(units)],
                "shares": {
                    name: dict(zip(("R2", "attitude", *self.points), own, strict=True))
                    for name, own in self.shares().items()
                },
                "verdict": self.verdict,
                "notes": self.notes,
            }
        )

    def plot(self, units: str | None = None) -> Figure:
        """Return a Matplotlib figure with the 95 % bands of all components over time, to first order and of the
        sampled pairs, and the shares of each dimension in the variance.

        Args:
            units: units of the bands, such as "deg, um"; by default those of the scene, or else mm and mrad.
        """
        shown = self._shown(units).over(Units("mm, mrad"))
        t = shown.factor("s") * self.t
        figure = new_figure(5 * len(self.parts), 10)
        grid = figure.add_gridspec(4, len(self.parts))
        for k, (name, si) in enumerate(self._components()):
            axes = figure.add_subplot(grid[k % 3, k // 3])
            unit, scale = shown.unit(si), shown.factor(si)
            low, high = scale * self.band[:, :, k].T
            axes.fill_between(t, low, high, alpha=0.3, linewidth=0, label=f"95 % of {self.samples} pairs")
            for sign in (-1, 1):
                label = "first order" if sign > 0 else None
                axes.plot(
                    t,
                    sign * scale * _HALF_BAND * self.std[:, k],
                    "k--",
                    linewidth=0.8,
                    label=label,
                )
            axes.set_ylabel(f"{name} [{unit}]")
            axes.grid(alpha=0.3)
            if k % 3 == 2:
                axes.set_xlabel(f"t [{shown.unit('s')}]")
            if k == 0:
                axes.legend(loc="upper right", fontsize="small")
        shares = self.shares()
        axes, places = figure.add_subplot(grid[3, :]), np.arange(len(shares))
        width = 0.8 / len(self.parts)
        for k, what in enumerate(("R2", "attitude", *self.points)):
            heights = [100 * fractions[k] for fractions in shares.values()]
            axes.bar(places + width * (k + 0.5) - 0.4, heights, width, label=what)
        axes.set_xticks(places, [*shares])
        axes.set_ylabel("part of the variance [%]")
        axes.legend(fontsize="small")
        figure.suptitle(f"{self.title}\n{self.verdict}" if self.title else self.verdict)
        return figure

    def _sheet(self) -> Sheet:
        bands, _ = self.tables()
        return Sheet(f"tolerances of {self.title}: {self.samples} pairs", bands, (self.verdict, *self.notes))

    def tables(self, units: str | None = None) -> tuple[Sequence[Sequence[str]], Sequence[Sequence[str]]]:
        """Return (bands, shares), the results of the methods `bands` and `shares` as two tables of strings. Each is a
        list of rows of cells; the first row has the headings.

        Args:
            units: units in place of SI units; by default those of the scene.
        """
        t = self._shown(units).unit("s")
        at = "at t" if t == "s" else f"at t [{t}]"
        heading = ("", "unit", "std, first order", "std, sampled", "2.5 %", "97.5 %", at)
        bands = [heading, *(band.cells() for band in self.bands(units))]
        titles: tuple[str, ...] = (
            "dimension",
            "of R2's variance",
            "of the attitude's",
            *(f"of {name}'s" for name in self.points),
        )
        shares = [titles]
        shares += [(name, *(f"{100 * part:.1f} %" for part in own)) for name, own in self.shares().items()]
        return bands, shares


def read_tolerances(scene: PairScene) -> dict[str, Any]:
    """Return the table [tolerances] of a scene, by argument of `sample_pairs`; empty if there is none."""
    table = scene.tables.table("tolerances", required=False)
    table.check_keys((*LIMITS, *DEVIATIONS, "points"))
    tolerances: dict[str, Any] = {}
    for name, value in table.values.items():
        if name == "points":
            with table.naming():
                point_scatter(_point_names(scene), value)
            tolerances[name] = value
        elif name in LIMITS:
            with table.naming(name):
                read_limits(name, value)
            if f"{name}_std" in table.values:
                table.refuse(f"{name}_std", f"no such key beside {name}, which gives the tolerance", "a value")
            tolerances[name] = value
        else:
            several = isinstance(value, list) and name != "axis_std"
            tolerances[name] = table.numbers(name, 3) if several else table.number(name)
    return tolerances


def _point_names(scene: PairScene) -> list[str]:
    return [point.name for point in constants_of(scene.pair).points]


def study_tolerances(scene: Scene, samples: int = 10_000, seed: int | None = 0, **tolerances: Any) -> ToleranceStudy:
    """Return a `ToleranceStudy` of the pose of body 2, and of points, at up to 101 instants of a Scene, to first
    order and with `samples` random pairs that `seed` determines. Of points of body 1, those with a tolerance count.

    Args:
        scene: scene of a pair; the study takes at most 101 of its instants, evenly spread.
        samples: number of pairs that are sampled.
        seed: seed of the sampled pairs; None for other pairs at every call.
        **tolerances: limits such as u1="+-0.2 mm" and standard deviations such as u1_std=0.001, by argument name of
            `sample_pairs`, in place of those of [tolerances]; points={"handle": "+-0.5 mm"} beside those of others.
    """
    of_pair: PairScene = scene.require_pair()
    of_scene = read_tolerances(of_pair)
    own = tolerances.pop("points", None)
    point_scatter(_point_names(of_pair), own)  # checked before it is merged
    of_points = {**of_scene.pop("points", {}), **(own or {})}
    replaced = {other for name in tolerances for other in (f"{name}_std", name.removesuffix("_std"))}
    of_scene = {name: value for name, value in of_scene.items() if name not in replaced}
    tolerances = {**of_scene, **tolerances} | ({"points": of_points} if of_points else {})
    if not tolerances:
        expected = 'tolerances, such as [tolerances] u1 = "+-0.2 mm", or --u1 "+-0.2 mm"'
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
        if name in DEVIATIONS
    ]
    limits = [str(value) for name, value in tolerances.items() if name in LIMITS]
    limits += [str(value) for value in of_points.values() if np.asarray(value).dtype.kind == "U"]
    assumed = [_LIMITS_NOTE] * any("normal" not in text and "uniform" not in text for text in limits)
    left_out = [f"{lost} of {len(t)} instants have no pose and are left out"] * bool(lost)
    notes = (*assumed, *itertools.chain(*doubts), *left_out)
    t, psi, body1 = t[known], psi[known], BodyMotion(R=R[known], S=S[known])
    linear = pair.propagate_covariance(body1, psi, **tolerances)
    sampled_pairs = sample_pairs(pair, samples, seed=seed, **tolerances)
    points = tuple(name for name in _point_names(of_pair) if name in pair.points2 or name in of_points)
    outputs = ("d", "S2", *points)
    # Positions are relative to R1, which may be large.
    still = BodyMotion(R=np.zeros(3), S=body1.S)
    mean = pair.forward_kinematics_from_body1(still, psi, outputs=outputs)
    columns = 6 + 3 * len(points)
    sampled_std, band = np.empty((len(t), columns)), np.empty((len(t), 2, columns))
    step = max(1, _MAX_STATES // samples)
    for start in range(0, len(t), step):
        part = slice(start, start + step)
        some = BodyMotion(R=np.zeros(3), S=body1.S[part, None])  # instants down, pairs across
        sampled = sampled_pairs.forward_kinematics_from_body1(some, psi[part, None], outputs=outputs)
        turn = rotation_log(sampled.S2 @ np.swapaxes(mean.S2[part, None], -1, -2))
        moved_points = [sampled[name].R - mean[name].R[part, None] for name in points]
        pose = np.concatenate((sampled.d - mean.d[part, None], turn, *moved_points), axis=-1)
        sampled_std[part] = pose.std(axis=1)
        band[part] = np.moveaxis(np.quantile(pose, _BAND, axis=1), 0, 1)
    of_pose, own = linear.contributions(), [linear[name] for name in points]
    by_point = [point.contributions() for point in own]
    names = dict.fromkeys((*of_pose, *(name for found in by_point for name in found)))
    none = np.zeros((len(t), 6))
    contributions = {
        name: np.concatenate(
            (of_pose.get(name, none), *(found.get(name, none[:, :3]) for found in by_point)), axis=-1
        )
        for name in names
    }
    return ToleranceStudy(
        title=of_pair.title,
        t=t,
        std=np.concatenate((linear.R2_std, linear.attitude_std, *(point.R_std for point in own)), axis=-1),
        sampled_std=sampled_std,
        band=band,
        contributions=contributions,
        samples=samples,
        tolerances=tolerances,
        notes=notes,
        units=of_pair.units,
        points=points,
    )
