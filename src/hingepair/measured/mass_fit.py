"""Masses and friction of a robot from a recorded motion and its torques, by weighted least squares."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, FitError, ShapeError, nearest, quoted
from hingepair.measured.consistency import rigid_parameters
from hingepair.measured.findings import Finding, Report, notes
from hingepair.measured.mass_findings import judged
from hingepair.measured.statistics import LOSSES
from hingepair.measured.torques import (
    JOINT_TERMS,
    TERMS,
    Found,
    body_sizes,
    column_rms,
    inertial_units,
    recording_of,
    weighted_least_squares,
)
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.robots.inertial_parameters import BaseParameters
from hingepair.numeric.arrays import Float64Array, Frozen, broadcast_shape, check_choice, read_only
from hingepair.plans.arguments import Coordinates, read_arguments
from hingepair.tables.sheets import Sheet, cell_text
from hingepair.tables.suspicions import suspicions

_ROUNDING_OF_RATES = 1e-10  # of the largest q and qd; a joint whose rates are smaller stands still


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MassFit(Report, Frozen):
    """The result of `fit_masses`: base parameters of a robot, and what its joints do by themselves.

    Attributes:
        robot: the robot with the fitted masses, a Mechanism. Of many masses with the fitted base parameters, it has
            those nearest to the masses described; where these are none of rigid bodies, such bodies near them.
            Fitted friction is in its `joint_loads`, which methods count with `joint_loads=True`; a fitted
            rotor in its `armature`.
        base: the BaseParameters; `base.values` are those of the robot as described.
        names: names of all parameters: B base parameters, then terms of joints such as "elbow viscous".
        values: estimates, in the order of `names` [kg, kg m, kg m^2; N m s/rad, N m, N m, kg m^2 for hinges].
        std: their standard deviations; inf where the motion does not determine a parameter.
        covariance: covariance matrix of `values`, without what is not determined; shape (B + F, B + F). It allows for
            noise that is correlated from sample to sample.
        described: the same parameters of the robot as described.
        noise: standard deviation of the noise of the torques of each joint [N m]; shape (dof,).
        rms: root mean square of what is left of the torques [N m]; shape (dof,).
        rms_described: the same by the robot as described; shape (dof,).
        samples: number of samples fitted to.
        findings: sentences on what is not determined, what the torques have that the parameters have not, and what
            else is notable, as those of a HingeFit.
        joint_terms: terms of each joint that were fitted.
        unknown: the links whose masses were fitted; () of all.
    """

    robot: Mechanism
    base: BaseParameters
    names: tuple[str, ...]
    values: Float64Array
    std: Float64Array
    covariance: Float64Array
    described: Float64Array
    noise: Float64Array
    rms: Float64Array
    rms_described: Float64Array
    samples: int
    findings: tuple[Finding, ...]
    joint_terms: tuple[str, ...]
    gravity: tuple[float, ...] = field(repr=False)
    unknown: tuple[str, ...] = ()

    def torques(self, q: Coordinates, qd: Coordinates, qdd: Coordinates) -> Float64Array:
        """Return the torques of any motion by the fitted parameters, joint terms included; shape (..., dof). The
        arguments are those of `fit_masses`.
        """
        values = _arrays(self.robot, {"q": q, "qd": qd, "qdd": qdd})
        shape = values["q"].shape
        flat = {name: one.reshape(-1, shape[-1]) for name, one in values.items()}
        recording = recording_of(self.robot, self.base, self.joint_terms, self.gravity, flat, bool(self.unknown))
        return recording.explained(self.values).reshape(shape)

    def _sheet(self) -> Sheet:
        joints = tree_of(self.robot).coordinates
        units = [
            ("kg", "kg m", "kg m^2")[(column > 0) + (column > 3)] for column in (self.base.columns % 10).tolist()
        ]
        for term in self.joint_terms:
            of_hinges, of_sliders = TERMS[term].units
            units += [of_sliders if joint.unit == "m" else of_hinges for joint in joints]
        rows = [("parameter", "unit", "value", "standard deviation", "as described")]
        for name, unit, value, std, described in zip(
            self.names, units, self.values, self.std, self.described, strict=True
        ):
            rows.append((name, unit, cell_text(value), f"{std:.2g}", cell_text(described)))
        torques = [
            f"torque of {joint.name}: noise {self.noise[k]:.3g}, left {self.rms[k]:.3g} {joint.effort_unit} rms "
            f"({self.rms_described[k]:.3g} by the robot as described)"
            for k, joint in enumerate(joints)
        ]
        title = f"{self.robot.name}: {len(self.names)} parameters of {self.samples} samples"
        return Sheet(title, rows, (*torques, *self.findings))

    def _numbers(self) -> dict[str, Any]:
        of_parameters = {"value": self.values, "std": self.std, "described": self.described}
        of_joints = {"noise": self.noise, "rms": self.rms, "rms_described": self.rms_described}
        return {
            "parameters": _by_name(self.names, of_parameters),
            "joints": _by_name(self.robot.names, of_joints),
        }


def _by_name(names: Iterable[str], columns: dict[str, Float64Array]) -> dict[str, dict[str, float]]:
    return {name: {key: column[k] for key, column in columns.items()} for k, name in enumerate(names)}


def fit_masses(
    robot: Mechanism,
    q: Coordinates,
    qd: Coordinates,
    qdd: Coordinates,
    tau: Coordinates,
    *,
    joint_terms: Iterable[str] | None = None,
    unknown: Iterable[str] = (),
    loss: str = "linear",
    gravity: ArrayLike = DEFAULT_GRAVITY,
) -> MassFit:
    """Fit the masses of a robot, and the friction of its joints, to a recorded motion and its torques.

    Torques depend on the masses by the base parameters alone, in which they are linear (T13): weighted least squares,
    where the noise of each joint is estimated from the data. The noise may be correlated from sample to sample; q, qd
    and qdd count as exact.

    Args:
        robot: the robot as described, with a fixed base at rest. Its dimensions are trusted; its masses may be wrong,
            or 0, and decide where the motion does not. Its `armature` counts, unless it is fitted.
        q: recorded coordinates in time, in the forms of `robot.inverse_dynamics`; shape (N, dof). Samples with NaN
            in any argument are not used.
        qd: their first time derivatives; `hp.smooth` derives them from the coordinates of a joint.
        qdd: their second time derivatives.
        tau: recorded torques of hinges [N m] and forces of sliders [N], in the direction of q; shape (N, dof).
        joint_terms: what acts in a joint beside masses, out of "viscous" (in proportion to qd), "coulomb" (to the
            sign of qd), "offset" (constant) and "armature" (in proportion to qdd: the motor's rotor). Unless given,
            it is ("viscous", "coulomb"), and () with `unknown`.
        unknown: links or frames, such as ["tool0"] of a payload: only the masses of the bodies that carry them are
            fitted; the other bodies, and friction that is not fitted, count as described. () to fit all.
        loss: "linear" (least squares), or a loss by which torques that are far off, such as spikes, count little:
            "soft_l1", "huber", "cauchy" or "arctan", as for `fit`.
        gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).

    Returns:
        The MassFit. Check `.ok` and `.findings` before you use its numbers. Its `torques` of another motion, compared
        with recorded ones, tell whether the parameters hold for that motion.

    Raises:
        ArgumentError: an argument cannot be used, or the base is free.
        FitError: there are fewer samples than parameters, or no parameter has an effect on the torques.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> robot = hp.load_robot("ur5_robot")
    >>> t = np.arange(0, 20, 0.02)[:, None]
    >>> rates = np.linspace(1, 2, robot.dof)
    >>> q, qd, qdd = np.sin(rates * t), rates * np.cos(rates * t), -(rates**2) * np.sin(rates * t)
    >>> loaded = robot.with_payload("tool0", hp.Body(2, inertia=(0.01, 0.01, 0.01)))
    >>> tau = loaded.inverse_dynamics(q, qd, qdd).tau
    >>> fit = hp.fit_masses(robot, q, qd, qdd, tau)
    >>> fit.ok, np.allclose(fit.torques(q, qd, qdd), tau)
    (True, True)
    """
    check_choice("loss", loss, LOSSES)
    links = () if isinstance(unknown, str) else tuple(unknown)
    if isinstance(unknown, str):
        raise ArgumentError("unknown", "names of links, as a list", unknown)
    if joint_terms is None:
        joint_terms = () if links else ("viscous", "coulomb")
    terms = _checked_terms(robot, joint_terms)
    values = _arrays(robot, {"q": q, "qd": qd, "qdd": qdd, "tau": tau})
    if values["q"].ndim != 2:
        raise ShapeError("q", f"shape (N, {robot.dof}), N instants", f"shape {values['q'].shape}")
    known = np.logical_and.reduce([np.isfinite(one).all(axis=-1) for one in values.values()])
    base = robot.base_parameters(gravity=gravity)
    base = _parameters_of(robot, base, links) if links else base
    given = {name: one[known] for name, one in values.items()}
    largest = max(np.abs(given[name]).max(initial=0.0) for name in ("q", "qd"))
    is_still = np.abs(given["qd"]).max(axis=0, initial=0.0) <= _ROUNDING_OF_RATES * largest
    given["qd"] = np.where(is_still, 0.0, given["qd"])
    recording = recording_of(
        robot, base, terms, tuple(np.asarray(gravity, dtype=np.float64).tolist()), given, bool(links)
    )
    names = (*base.names, *(f"{joint} {term}" for term in terms for joint in robot.names))  # as `parts` has them
    count = len(recording.known)
    if count * robot.dof <= len(names):
        raise FitError("q", f"more than {-(-len(names) // robot.dof)} samples to fit to", f"{count}")
    found = weighted_least_squares(recording, LOSSES[loss])
    fitted, grown = _fitted_robot(found)
    findings = judged(found, fitted, grown, loss != "linear")
    doubts = suspicions("angle", "q", np.abs(recording.values["q"]).max(axis=1))
    findings += [Finding("unit", 1, 0, text) for text in doubts]
    if not known.all():
        findings += notes("missing samples", [f"{int((~known).sum())} of {known.size} samples are missing."])
    return MassFit(
        robot=fitted,
        base=base,
        names=names,
        values=read_only(found.estimate),
        std=read_only(found.std),
        covariance=read_only(found.covariance),
        described=read_only(recording.described),
        noise=read_only(found.noise),
        rms=read_only(column_rms(found.left)),
        rms_described=read_only(column_rms(given["tau"] - recording.explained(recording.described))),
        samples=count,
        findings=tuple(dict.fromkeys(findings)),
        joint_terms=terms,
        gravity=recording.gravity,
        unknown=links,
    )


def _parameters_of(robot: Mechanism, base: BaseParameters, links: tuple[str, ...]) -> BaseParameters:
    """Return the ten parameters of each body that carries one of these links or frames, as if they were base
    parameters.
    """
    tree, bodies = tree_of(robot), set()
    for name in links:
        frame = tree.links.get(name) or tree.frames.get(name)
        if frame is None:
            known = sorted({*tree.links, *tree.frames})
            raise ArgumentError("unknown", f"links or frames of the robot{nearest(str(name), known)}", quoted(name))
        if frame.body == 0:
            raise ArgumentError("unknown", "links that move", f"{name!r}, which is part of the base")
        bodies.add(frame.body - 1)
    columns = np.concatenate([np.arange(10 * body, 10 * body + 10) for body in sorted(bodies)])
    names = tuple(base.parameter_names[k] for k in columns)
    rows, values = np.eye(base.matrix.shape[1])[columns], robot.inertial_parameters[columns]
    return BaseParameters(names, columns, rows, values, base.parameter_names)


def _checked_terms(robot: Any, joint_terms: Iterable[str]) -> tuple[str, ...]:
    """Check the robot and the terms of its joints; return the terms, each once."""
    if not isinstance(robot, Mechanism):
        raise ArgumentError("robot", "a Mechanism", quoted(robot))
    if robot.base != "fixed":
        raise ArgumentError("robot", "a robot with a fixed base (base='fixed')", "a free base")
    if robot.dof == 0:
        raise ArgumentError("robot", "a robot with joints that move", "none")
    terms = (joint_terms,) if isinstance(joint_terms, str) else tuple(dict.fromkeys(joint_terms))
    for term in terms:
        if isinstance(joint_terms, str) or term not in JOINT_TERMS:
            raise ArgumentError("joint_terms", f"names out of {', '.join(JOINT_TERMS)}, as a tuple", quoted(term))
    return terms


def _arrays(robot: Mechanism, given: dict[str, Any]) -> dict[str, Float64Array]:
    """Return coordinates in any of their forms as arrays of one shape (..., dof)."""
    shapes = dict.fromkeys(given, (robot.dof,))
    read = read_arguments(given, shapes, tree_of(robot).coordinate_names)
    parts = [np.stack(np.broadcast_arrays(*one), axis=-1) if isinstance(one, tuple) else np.asarray(one)
             for one in read.values.values()]  # fmt: skip
    shape = (*broadcast_shape(read.shapes), robot.dof)
    return {
        name: np.broadcast_to(np.asarray(part, dtype=np.float64), shape)
        for name, part in zip(read.values, parts, strict=True)
    }


def _fitted_robot(found: Found) -> tuple[Mechanism, float]:
    """Return the robot with fitted friction and rotors, of which what is below 0 counts as none, and with the masses
    that have the fitted base parameters by the least change, in parts of what such bodies may have; where these are
    none of rigid bodies, others near them. Also return by how many variances the squares of what is left grow so.
    """
    recording, described = found.recording, found.recording.robot
    base, terms = recording.parts(found.estimate)
    start = described.inertial_parameters.copy()
    start[::10] = np.where(start[::10] == 0, body_sizes(described)[:, 0], start[::10])  # moments need a mass
    matrix, unit = recording.base.matrix, inertial_units(described)
    weighted = matrix * unit**2
    parameters = start + weighted.T @ np.linalg.solve(weighted @ matrix.T, base - matrix @ start)
    fits = np.repeat(np.abs(matrix).reshape(len(base), -1, 10).any(axis=(0, 2)), 10)  # of bodies that are fitted
    parameters[fits], grown = rigid_parameters(
        found.factor[:, : len(base)], *(part[..., fits] for part in (matrix, parameters, start, unit))
    )
    values = {term: np.maximum(each, 0.0) for term, each in terms.items()}
    robot = described.with_inertial_parameters(parameters, armature=values.get("armature"))
    own = {joint.name: k for k, joint in enumerate(tree_of(robot).coordinates)}
    loads = {}
    for joint in tree_of(robot).joints:  # what is fitted counts the loads of followers with the leader's
        fields: dict[str, Any] = {
            TERMS[term].field: each[own[joint.name]] if joint.name in own else 0.0
            for term, each in values.items() if TERMS[term].field
        }  # fmt: skip
        loads[joint.name] = replace(joint.load, **fields)
    return robot.with_joint_loads(loads), grown
