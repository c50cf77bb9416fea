"""A tolerance study of a scene: how each component of body 2's pose, and of points, deviates, and what causes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hingepair.equations.quantities import POSE
from hingepair.errors import SceneError
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.tolerances import LIMITS, point_covariances, read_limits
from hingepair.mechanism.requests import subject_of
from hingepair.numeric.arrays import Float64Array, Frozen
from hingepair.scenes.scene import Scene
from hingepair.tables.sheets import instant_text
from hingepair.tables.units import SI, Units

_MAX_INSTANTS: Final = 101
_LEAST_SHARE: Final = 0.01  # of a variance; dimensions that cause less are not named
_LIMITS_NOTE: Final = "A tolerance +- is taken for three standard deviations of a normal distribution."


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ToleranceStudy(Frozen):
    """Deviations of the pose of body 2, and of points, along a scene under tolerances, to first order. Components are
    those of R2 and of points [m], and of the rotation vector `attitude` [rad], world axes; in the plane those in it.
    """

    #: title of the scene
    title: str
    #: instants [s]; (N,)
    t: Float64Array
    #: standard deviations by component; (N,) each
    std: Mapping[str, Float64Array]
    #: by component, the variances that dimensions cause alone, by name of the dimension; (N,) each
    contributions: Mapping[str, Mapping[str, Float64Array]]
    #: limits of the geometry, such as "+-0.2 mm", by argument of `propagate_covariance`
    tolerances: Mapping[str, Any]
    #: sentences on what limits mean, and on instants that are left out
    notes: tuple[str, ...] = ()
    #: units of tables unless others are asked for
    units: Units = SI

    def shares(self) -> dict[str, dict[str, float]]:
        """Return, by component, the fractions (0 to 1) of its variance that dimensions cause, the largest first, as
        means over the instants. Dimensions without effect are left out.
        """
        found = {}
        for component, causes in self.contributions.items():
            sums = sorted(((float(own.sum()), name) for name, own in causes.items()), reverse=True)
            found[component] = {name: own / sum(own for own, _ in sums) for own, name in sums if own > 0}
        return found

    def facts(self, units: str | None = None) -> dict[str, Any]:
        """Return what --json prints, in units in place of SI units; by default in those of the scene."""
        shown, shares, components = self.units if units is None else Units.of(units), self.shares(), []
        for name, std in self.std.items():
            si, k = "rad" if name.startswith("attitude_") else "m", std.argmax()
            own = {"component": name, "unit": shown.unit(si), "std": shown.factor(si) * float(std[k])}
            components.append(own | {"t": shown.factor("s") * float(self.t[k]), "shares": shares[name]})
        facts = {"title": self.title, "instants": len(self.t), "tolerances": self.tolerances}
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
            causes = [f"{name} {100 * part:.0f} %" for name, part in own["shares"].items() if part >= _LEAST_SHARE]
            at = instant_text(own["t"])
            rows.append((own["component"], own["unit"], f"{own['std']:.4g}", at, ", ".join(causes)))
        return rows


def read_tolerances(scene: Scene) -> dict[str, Any]:
    """Return the table [tolerances] of a scene, by argument of `propagate_covariance`; empty if there is none."""
    table = scene.tables.table("tolerances", required=False)
    table.check_keys((*LIMITS, "points"))
    for name in LIMITS:
        with table.naming(name):
            if name in table.values:
                read_limits(name, table.values[name])
    with table.naming():
        point_covariances(_point_names(scene), table.values.get("points"))
    return dict(table.values)


def _point_names(scene: Scene) -> list[str]:
    return [point.name for point in subject_of(scene.space).points]


def study_tolerances(scene: Scene, **tolerances: Any) -> ToleranceStudy:
    """Return a `ToleranceStudy` of the pose of body 2, and of points, at up to 101 instants of a Scene, to first
    order. Of points of body 1, those with a tolerance count.

    Args:
        scene: scene of a pair; at most 101 of its instants are taken, evenly spread.
        **tolerances: limits such as u1="+-0.2 mm", by argument name of `propagate_covariance`, beside or in place of
            those of [tolerances]; points={"handle": "+-0.5 mm"} likewise.
    """
    pair, of_scene = scene.space, read_tolerances(scene)
    point_covariances(_point_names(scene), tolerances.get("points"))  # checked before it is merged
    of_points = {**of_scene.get("points", {}), **(tolerances.get("points") or {})}
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
    found = pair.propagate_covariance(BodyMotion(R=R[is_known], S=S[is_known]), psi[is_known], **tolerances)
    by_pose, std, contributions = found.contributions(), {}, {}
    arrays = {"R2": (found.R2_std, {name: own[:, :3] for name, own in by_pose.items()})}
    arrays["attitude"] = (found.attitude_std, {name: own[:, 3:] for name, own in by_pose.items()})
    for name in _point_names(scene):
        if name in pair.points2 or name in of_points:
            arrays[name] = (found[name].R_std, found[name].contributions())
    for name, (deviations, causes) in arrays.items():
        for k, letter in enumerate("xyz"):
            if not scene.assembly.planar or (letter == "z") == (name == "attitude"):
                std[f"{name}_{letter}"] = deviations[:, k]
                contributions[f"{name}_{letter}"] = {cause: own[:, k] for cause, own in causes.items()}
    return ToleranceStudy(
        title=scene.title,
        t=t[is_known],
        std=std,
        contributions=contributions,
        tolerances=tolerances,
        notes=_notes(tolerances, int((~is_known).sum()), len(t)),
        units=scene.units,
    )


def _notes(tolerances: Mapping[str, Any], lost: int, count: int) -> tuple[str, ...]:
    """Return sentences on what limits mean, and on instants without a pose."""
    given = (*tolerances.values(), *(tolerances.get("points") or {}).values())
    assumed = [_LIMITS_NOTE] * any(map(_is_limit, given))
    left_out = [f"{lost} of {count} instants have no pose and are left out"] * bool(lost)
    return (*assumed, *left_out)


def _is_limit(value: Any) -> bool:
    """Return whether a tolerance is a limit, which is a text or has texts; standard deviations are numbers."""
    parts = (value,) if isinstance(value, str) else value
    return isinstance(parts, Sequence) and any(isinstance(part, str) for part in parts)
