"""Recorded torques of a robot, linear in masses and friction, and the parameters that explain them best."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.measured.statistics import Loss, loss_weights, median_variance, neighbour_correlation, sandwich
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.robots.inertial_parameters import BaseParameters, inertia_matrices
from hingepair.numeric.arrays import Float64Array

_SINGULAR = 1e-12  # of the largest eigenvalue; below, a combination of parameters has no effect on the torques
_NO_EFFECT = 1e-10  # of the largest torques of a parameter; those of a smaller one are rounding
_BLOCK = 2**23  # numbers of a regressor that are in memory at a time
_WEIGHT_ROUNDS = 3  # in which the noise of each joint and the parameters are estimated in turn
_LEAST_NOISE = 1e-7  # smallest noise assumed, of what the described parameters leave: weights stay finite
_ROUNDING = 1e-12  # smallest noise assumed, of the torques: less is rounding
_ORDERED = 0.9  # correlation of neighbouring positions, above which samples are in the order of time


class Term(NamedTuple):
    """Term of the torque of a joint by itself, in proportion to one parameter."""

    factor: Callable[[Float64Array, Float64Array], Float64Array]  # of qd and qdd: the torque for a parameter of 1
    units: tuple[str, str]  # of the parameter, of hinges and of sliders
    field: str = ""  # of the joint's load that has the parameter
    signed: bool = False  # whether it may be below 0


TERMS: Final = {  # by name
    "viscous": Term(lambda qd, _: qd, ("N m s/rad", "N s/m"), "damping"),
    "coulomb": Term(lambda qd, _: np.sign(qd), ("N m", "N"), "friction"),
    "offset": Term(lambda qd, _: np.ones_like(qd), ("N m", "N"), signed=True),
    "armature": Term(lambda _, qdd: qdd, ("kg m^2", "kg")),
}
JOINT_TERMS: Final = tuple(TERMS)
"""Names of the terms that a fit may have."""


class Recording(NamedTuple):
    """A robot and its recording of N samples; k parameters."""

    robot: Mechanism
    base: BaseParameters
    terms: tuple[str, ...]  # of the joints
    gravity: tuple[float, ...]
    values: dict[str, Float64Array]  # q, qd, qdd and tau; (N, dof) each
    known: Float64Array  # torques of what is not fitted; (N, dof)
    is_partial: bool  # whether the masses of other bodies are among these

    @property
    def described(self) -> Float64Array:
        """Parameters of the robot as described (k,)."""
        return np.concatenate((self.base.values, *(described_term(self.robot, term) for term in self.terms)))

    def blocks(self) -> Iterator[slice]:
        """Return the samples in blocks, whose regressors fit into memory."""
        size = max(_BLOCK // (self.robot.dof * self.base.matrix.shape[1]), 1)
        return (slice(start, start + size) for start in range(0, len(self.known), size))

    def rows(self, part: slice) -> Float64Array:
        """Return the columns of the base parameters and of the joint terms for some samples; shape (n, dof, k)."""
        q, qd, qdd = (self.values[name][part] for name in ("q", "qd", "qdd"))
        columns = [self.robot.torque_regressor(q, qd, qdd, gravity=self.gravity)[..., self.base.columns]]
        columns += [TERMS[term].factor(qd, qdd)[..., None] * np.eye(self.robot.dof) for term in self.terms]
        return np.concatenate(columns, axis=-1)

    def parts(self, parameters: Float64Array) -> tuple[Float64Array, dict[str, Float64Array]]:
        """Return the base parameters, which are the first, and those of all joints, (dof,), by term."""
        base, further = np.split(parameters, [len(self.base.names)])
        return base, dict(zip(self.terms, further.reshape(-1, self.robot.dof), strict=True))

    def explained(self, parameters: Float64Array) -> Float64Array:
        """Return the torques by parameters and by what is known; shape (N, dof)."""
        torques = self.known.copy()
        for part in self.blocks():
            torques[part] += self.rows(part) @ parameters
        return torques

    @property
    def is_ordered(self) -> bool:
        """Whether neighbouring samples are of neighbouring positions."""
        q = self.values["q"] - self.values["q"].mean(axis=0)
        return len(q) >= 50 and neighbour_correlation(q[:, np.ptp(q, axis=0) > 0].T) > _ORDERED


def recording_of(
    robot: Mechanism,
    base: BaseParameters,
    terms: tuple[str, ...],
    gravity: tuple[float, ...],
    values: dict[str, Float64Array],
    is_partial: bool,
) -> Recording:
    """Return a recording; if it is partial, masses of other bodies and friction that is not fitted are known."""
    q, qd, qdd = (values[name] for name in ("q", "qd", "qdd"))
    known = np.zeros_like(q) if "armature" in terms else robot.armature * qdd
    if is_partial:
        others = robot.inertial_parameters.copy()
        others[base.columns] = 0.0
        rest = robot.with_inertial_parameters(others, armature=np.zeros(robot.dof))
        known = known + rest.inverse_dynamics(q, qd, qdd, gravity=gravity).tau
        for term in {"viscous", "coulomb"} - {*terms}:
            known = known + TERMS[term].factor(qd, qdd) * described_term(robot, term)
    return Recording(robot, base, terms, gravity, values, known, is_partial)


def described_term(robot: Mechanism, term: str) -> Float64Array:
    """Return the parameter that each joint of the robot as described has for a term, 0 for "offset"; (dof,)."""
    if term == "armature":  # followers' rotors count with their leaders
        return robot.armature
    field = TERMS[term].field
    return np.array([getattr(joint.load, field) if field else 0.0 for joint in tree_of(robot).coordinates])


class Found(NamedTuple):
    """What weighted least squares found of a recording; k parameters."""

    recording: Recording
    estimate: Float64Array  # (k,)
    left: Float64Array  # of the torques; (N, dof)
    factor: Float64Array  # F, F.T @ F the weighted products of columns; (k, k)
    covariance: Float64Array  # (k, k)
    std: Float64Array  # inf of what is not determined; (k,)
    noise: Float64Array  # (dof,)
    unresolved_lag: int  # samples; 0 where the recording is long beside the correlation of its noise

    @property
    def torque_sizes(self) -> Float64Array:
        """Root mean square of the torques (dof,)."""
        return np.maximum(column_rms(self.recording.values["tau"]), 1e-300)

    @property
    def inexact(self) -> NDArray[np.bool_]:
        """Of which joints more is left than rounding (dof,)."""
        return np.asarray(column_rms(self.left) > 1e-6 * self.torque_sizes)

    @property
    def usual_left(self) -> Float64Array:
        """Variances of what is left, from medians; (dof,)."""
        return np.array([max(median_variance(column**2, 1), 1e-300) for column in self.left.T])


def weighted_least_squares(recording: Recording, loss: Loss | None) -> Found:
    """Find the parameters that explain a recording best; with a loss by repeated weights, beginning with those of
    least squares.
    """
    weights = np.ones_like(recording.known)
    found = _least_squares_with(recording, weights)
    for _ in range(0 if loss is None else 11):
        weights = np.maximum(loss_weights(loss, found.left**2 / found.usual_left, 1)[0], 1e-9)
        found = _least_squares_with(recording, weights)
    return found


def _least_squares_with(recording: Recording, weights: Float64Array) -> Found:
    """Find the parameters that explain torques with weights (N, dof) best."""
    robot, described, count = recording.robot, recording.described, len(weights)
    width, bodies = described.size, len(recording.base.names)
    off = recording.values["tau"] - recording.explained(described)
    # Products of columns, the last of which is what the described parameters leave of the torques, joint by joint:
    # (N, dof, k) would not fit into memory.
    products = np.zeros((robot.dof, width + 1, width + 1))
    for part in recording.blocks():
        columns = np.concatenate((recording.rows(part), off[part][..., None]), axis=-1)
        columns = np.moveaxis(columns * np.sqrt(weights[part])[..., None], 1, 0)
        products += np.swapaxes(columns, 1, 2) @ columns
    unexplained = np.sqrt(products[:, width, width].max() / count)
    least = max(_LEAST_NOISE * unexplained, _ROUNDING * column_rms(recording.values["tau"]).max(), 1e-100)
    # Parameters and the noise of each joint in turn.
    noise = np.ones(robot.dof)
    for _ in range(_WEIGHT_ROUNDS):
        whole = (products / noise[:, None, None] ** 2).sum(axis=0)
        lengths = np.sqrt(np.diagonal(whole)[:width])
        torques = lengths[:bodies] * base_units(recording)
        lengths[:bodies][torques < _NO_EFFECT * torques.max(initial=0.0)] = 0.0
        unit = np.where(lengths > 0, lengths, 1.0)
        sizes, vectors = np.linalg.eigh(whole[:width, :width] / np.outer(unit, unit))
        seen = sizes > _SINGULAR * sizes[-1]
        inverse = (vectors[:, seen] / sizes[seen]) @ vectors[:, seen].T
        step = inverse @ (whole[:width, width] / unit) / unit
        ends = np.append(step, -1.0)
        # Each joint loses its part of the parameters.
        free = max(count - seen.sum() / robot.dof, 1)
        noise = np.maximum(np.sqrt(np.maximum(ends @ products @ ends, 0.0) / free), least)
    if not lengths.any():
        raise FitError("q, qd, qdd", "a motion whose torques depend on the robot's masses", "none that does")
    # Covariance, from scores whose neighbours may be correlated.
    estimate, scores = described + step, []
    left = recording.values["tau"] - recording.explained(estimate)
    for part in recording.blocks():
        weighted = weights[part] * left[part] / noise**2
        scores.append(np.einsum("nik,ni->kn", recording.rows(part), weighted) / unit[:, None])
    covariance, lag = sandwich(inverse, np.concatenate(scores, axis=1))
    covariance *= count * robot.dof / max(count * robot.dof - width, 1)
    std = np.sqrt(np.diagonal(covariance)) / unit
    std[(lengths == 0) | (np.abs(vectors[:, ~seen]) > 1e-3).any(axis=1)] = np.inf
    factor = np.sqrt(np.where(seen, sizes, 0.0))[:, None] * vectors.T * unit
    return Found(recording, estimate, left, factor, covariance / np.outer(unit, unit), std, noise, lag)


def base_units(recording: Recording) -> Float64Array:
    """Return what each base parameter may amount to for the bodies as described; shape (B,)."""
    return np.sqrt((recording.base.matrix**2) @ inertial_units(recording.robot) ** 2)


def inertial_units(robot: Mechanism) -> Float64Array:
    """Return what each inertial parameter may amount to for the bodies as described; shape (10 * bodies,)."""
    mass, radius = body_sizes(robot).T
    return np.stack((mass, *[mass * radius] * 3, *[mass * radius**2] * 6), axis=1).ravel()


def body_sizes(robot: Mechanism) -> Float64Array:
    """Return mass and radius of gyration of each body, means of the others where it has no mass; (bodies, 2)."""
    parameters = robot.inertial_parameters
    mass = np.abs(parameters[::10])
    spread = np.abs(np.trace(inertia_matrices(parameters), axis1=1, axis2=2)) / 2
    heavy = (mass > 0) & (spread > 0)
    if not heavy.any():
        return np.tile((1.0, 0.1), (len(mass), 1))
    radius = np.sqrt(spread / np.where(heavy, mass, 1.0))
    means = mass[heavy].mean(), radius[heavy].mean()
    return np.asarray(np.where(heavy[:, None], np.stack((mass, radius), axis=1), means))


def column_rms(rows: NDArray[np.float64]) -> Float64Array:
    """Return the root mean squares of columns."""
    return np.asarray(np.sqrt((rows * rows).mean(axis=0)))
