"""A tolerance study of a scene: how each component of body 2's pose, and of points, deviates, and what causes it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hingepair.equations.quantities import POSE
from hingepair.errors import SceneError
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.geometry import constants_of
from hingepair.mechanism.pairs.tolerances import DEVIATIONS, LIMITS, point_scatter, read_limits
from hingepair.numeric.arrays import Float64Array, Frozen
from hingepair.scenes.scene import Scene
from hingepair.tables.sheets import instant_text
from hingepair.tables.suspicions import DEGREES_IN_SCENES, suspicions
from hingepair.tables.units import SI, Units

POSE_COMPONENTS: Final = ("R2_x", "R2_y", "R2_z", "attitude_x", "attitude_y", "attitude_z")
"""First columns of a tolerance study: position [m] and rotation vector [rad] of body 2, world axes."""
_MAX_INSTANTS: Final = 101
_LEAST_SHARE: Final = 0.01  # of a variance; dimensions that cause less are not named
_LIMITS_NOTE: Final = (
    'A tolerance +- is taken for three standard deviations of a normal distribution; "+-0.2 mm uniform" makes all '
    "values between the limits as likely."
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ToleranceStudy(Frozen):
    """Deviations of the pose of body 2, and of points, along a scene under tolerances, to first order. The last axis
    of arrays has six components of the pose, `POSE_COMPONENTS`, and three of each point: k numbers.
    """

    #: title of the scene
    title: str
    #: instants [s]; (N,)
    t: Float64Array
    #: standard deviations; (N, k)
    std: Float64Array
    #: variances that each dimension causes alone, by name of the dimension; (N, k)
    contributions: Mapping[str, Float64Array]
    #: limits, such as "+-0.2 mm", and standard deviations of the geometry, by argument of `propagate_covariance`
    tolerances: Mapping[str, Any]
    #: sentences on what limits mean, on standard deviations in doubtful units, and on instants that are left out
    notes: tuple[str, ...] = ()
    #: units of tables unless others are asked for
    units: Units = SI
    #: names of the points
    points: tuple[str, ...] = ()

    @property
    def components(self) -> dict[str, str]:
        """SI units of the components, by name."""
        names = (*POSE_COMPONENTS, *(f"{name}_{letter}" for name in self.points for letter in "xyz"))
        return {name: "rad" if name.startswith("attitude_") else "m" for name in names}

    def shares(self) -> dict[str, dict[str, float]]:
        """Return, by component, the fractions (0 to 1) of its variance that dimensions cause, the largest first, as
        means over the instants. Dimensions without effect are left out.
        """
        found = {}
        for k, component in enumerate(self.components):
            causes = {name: float(own[:, k].sum()) for name, own in self.contributions.items()}
            total = sum(causes.values())
            ordered = sorted(causes.items(), key=lambda cause: -cause[1])
            found[component] = {name: own / total for name, own in ordered if own > 0}
        return found

    def facts(self, units: str | None = None) -> dict[str, Any]:
        """Return what --json prints, in units in place of SI units; by default in those of the scene."""
        shown = self.units if units is None else Units.of(units)
        largest, shares = self.std.argmax(axis=0), self.shares()
        components = [
            {
                "component": name,
                "unit": shown.unit(si),
                "std": shown.factor(si) * float(self.std[largest[k], k]),
                "t": shown.factor("s") * float(self.t[largest[k]]),
                "shares": shares[name],
            }
            for k, (name, si) in enumerate(self.components.items())
        ]
        tolerances = {
            name: {point: np.asarray(one).tolist() for point, one in value.items()}
            if name == "points"
            else np.asarray(value).tolist()
            for name, value in self.tolerances.items()
        }
        facts = {"title": self.title, "instants": len(self.t), "tolerances": tolerances}
        return {**facts, "components": components, "notes": self.notes}

    def table(self, units: str | None = None) -> list[tuple[str, ...]]:
        """Return the rows of a table, headings first: of each component its standard deviation, at the instant at
        which it is largest, and what causes it.

        Args:
            units: units in place of SI units; by default those of the scene.
        """
        t = (self.units if units is None else Units.of(units)).unit("s")
        rows: list[tuple[str, ...]] = [("", "unit", "std", "at t" if t == "s" else f"at t [{t}]", "caused by")]
        for own in self.facts(units)["components"]:
            causes = (f"{name} {100 * part:.0f} %" for name, part in own["shares"].items() if part >= _LEAST_SHARE)
            rows.append(
                (own["component"], own["unit"], f"{own['std']:.4g}", instant_text(own["t"]), ", ".join(causes))
            )
        return rows


def read_tolerances(scene: Scene) -> dict[str, Any]:
    """Return the table [tolerances] of a scene, by argument of `propagate_covariance`; empty if there is none."""
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


def _point_names(scene: Scene) -> list[str]:
    return [point.name for point in constants_of(scene.require_pair().pair).points]


def study_tolerances(scene: Scene, **tolerances: Any) -> ToleranceStudy:
    """Return a `ToleranceStudy` of the pose of body 2, and of points, at up to 101 instants of a Scene, to first
    order. Of points of body 1, those with a tolerance count.

    Args:
        scene: scene of a pair; at most 101 of its instants are taken, evenly spread.
        **tolerances: limits such as u1="+-0.2 mm" and standard deviations such as u1_std=0.001, by argument name of
            `propagate_covariance`, in place of those of [tolerances]; points={"handle": "+-0.5 mm"} beside others.
    """
    pair, of_scene = scene.space, read_tolerances(scene)
    own = tolerances.pop("points", None)
    point_scatter(_point_names(scene), own)  # checked before it is merged
    of_points = {**of_scene.pop("points", {}), **(own or {})}
    replaced = {other for name in tolerances for other in (f"{name}_std", name.removesuffix("_std"))}
    of_scene = {name: value for name, value in of_scene.items() if name not in replaced}
    tolerances = {**of_scene, **tolerances} | ({"points": of_points} if of_points else {})
    if not tolerances:
        expected = 'tolerances, such as [tolerances] u1 = "+-0.2 mm", or --tolerance "u1=+-0.2 mm"'
        raise SceneError(f"{scene.path}: tolerances", expected, "none")
    rows = scene.spread(_MAX_INSTANTS)
    t, known = np.asarray(scene.t[rows]), scene.known(rows, POSE)
    R, S, psi = known.body1.R, known.body1.S, known.psi
    is_known = np.isfinite(R).all(axis=1) & np.isfinite(S).all(axis=(1, 2)) & np.isfinite(psi)
    if not is_known.any():
        raise SceneError(f"{scene.path}: motion", "a pose at some instant", f"none at {len(t)} instants")
    body1 = BodyMotion(R=R[is_known], S=S[is_known])
    found = pair.propagate_covariance(body1, psi[is_known], **tolerances)
    points = tuple(name for name in _point_names(scene) if name in pair.points2 or name in of_points)
    of_pose, by_point = found.contributions(), [found[name].contributions() for name in points]
    none = np.zeros((len(body1.R), 6))
    return ToleranceStudy(
        title=scene.title,
        t=t[is_known],
        std=np.concatenate((found.R2_std, found.attitude_std, *(found[name].R_std for name in points)), axis=-1),
        contributions={
            name: np.concatenate(
                (of_pose.get(name, none), *(point.get(name, none[:, :3]) for point in by_point)), axis=-1
            )
            for name in dict.fromkeys((*of_pose, *itertools.chain(*by_point)))
        },
        tolerances=tolerances,
        notes=_notes(scene, tolerances, int((~is_known).sum()), len(t)),
        units=scene.units,
        points=points,
    )


def _notes(scene: Scene, tolerances: Mapping[str, Any], lost: int, count: int) -> tuple[str, ...]:
    """Return sentences on what limits mean, on doubtful units and on instants without a pose."""
    lever = max(float(np.linalg.norm(scene.space.u1)), float(np.linalg.norm(scene.space.u2)))
    doubts = [
        suspicions("std of angle", name, value, radians=DEGREES_IN_SCENES)
        if name in {"axis_std", "home_std"}
        else suspicions("std of length", name, [np.max(value), lever])
        for name, value in tolerances.items()
        if name in DEVIATIONS
    ]
    limits = [str(value) for name, value in tolerances.items() if name in LIMITS]
    limits += [str(own) for own in tolerances.get("points", {}).values() if np.asarray(own).dtype.kind == "U"]
    assumed = [_LIMITS_NOTE] * any("normal" not in text and "uniform" not in text for text in limits)
    left_out = [f"{lost} of {count} instants have no pose and are left out"] * bool(lost)
    return (*assumed, *itertools.chain(*doubts), *left_out)
