"""Recorded torques of a robot, linear in masses and friction, and the parameters that explain them best."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.measured.statistics import Loss, loss_weights, median_variance, sandwich
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.robots.inertial_parameters import BaseParameters, inertia_matrices
from hingepair.numeric.arrays import Float64Array

_SINGULAR = 1e-12  # of the largest eigenvalue; below, a combination of parameters has no effect on the torques
_NO_EFFECT = 1e-10  # of the largest torques of a parameter; those of a smaller one are rounding
_BLOCK = 2**23  # numbers of a regressor that are in memory at a time
_WEIGHT_ROUNDS = 3  # in which the noise of each joint and the parameters are estimated in turn
_LEAST_NOISE = 1e-7  # smallest noise assumed, of what the described parameters leave: weights stay finite
_ROUNDING = 1e-12  # smallest noise assumed, of the torques: less is rounding


class Term(NamedTuple):
    """Term of the torque of a joint by itself, in proportion to one parameter."""

    factor: Callable[[Float64Array, Float64Array], Float64Array]  # of qd and qdd: the torque for a parameter of 1
    field: str = ""  # of the joint's load that has the parameter
    signed: bool = False  # whether it may be below 0


TERMS: Final = {  # by name
    "viscous": Term(lambda qd, _: qd, "damping"),
    "coulomb": Term(lambda qd, _: np.sign(qd), "friction"),
    "offset": Term(lambda qd, _: np.ones_like(qd), signed=True),
    "armature": Term(lambda _, qdd: qdd),
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
    described: Float64Array  # parameters; (k,)
    is_partial: bool = False  # whether what is not fitted counts as described: masses, and friction of joints

    @property
    def samples(self) -> int:
        """N."""
        return len(self.values["q"])

    def blocks(self, count: int) -> Iterator[slice]:
        """Return the first `count` samples in blocks, whose regressors fit into memory."""
        size = max(_BLOCK // (self.robot.dof * self.base.matrix.shape[1]), 1)
        return (slice(start, min(start + size, count)) for start in range(0, count, size))

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

    def torques(self, part: slice) -> Float64Array:
        """Return the recorded torques without those of what is known: rotors, other bodies; shape (n, dof)."""
        q, qd, qdd, tau = (self.values[name][part] for name in ("q", "qd", "qdd", "tau"))
        rotors = 0.0 if "armature" in self.terms else self.robot.armature * qdd
        if not self.is_partial:
            return tau - rotors
        others = self.robot.inertial_parameters.copy()
        others[self.base.columns] = 0.0
        by_others = self.robot.torque_regressor(q, qd, qdd, gravity=self.gravity) @ others
        for term in {"viscous", "coulomb"} - {*self.terms}:
            by_others = by_others + TERMS[term].factor(qd, qdd) * described_term(self.robot, term)
        return tau - rotors - by_others

    def left(self, parameters: Float64Array) -> Float64Array:
        """Return what parameters leave of the torques; shape (N, dof)."""
        parts = [self.torques(part) - self.rows(part) @ parameters for part in self.blocks(self.samples)]
        return np.concatenate(parts) if parts else np.zeros((0, self.robot.dof))


def described_term(robot: Mechanism, term: str) -> Float64Array:
    """Return the parameter that each joint of the robot as described has for a term, 0 for "offset"; (dof,)."""
    if term == "armature":  # followers' rotors count with their leaders
        return robot.armature
    field = TERMS[term].field
    return np.array([getattr(joint.load, field) if field else 0.0 for joint in tree_of(robot).coordinates])


class Found(NamedTuple):
    """What weighted least squares found; k parameters."""

    step: Float64Array  # from the parameters as described; (k,)
    factor: Float64Array  # F, F.T @ F the weighted products of columns; (k, k)
    covariance: Float64Array  # (k, k)
    std: Float64Array  # inf of what is not determined; (k,)
    noise: Float64Array  # (dof,)
    unresolved_lag: int  # samples; 0 where the recording is long beside the correlation of its noise


def weighted_least_squares(recording: Recording, count: int, loss: Loss | None) -> Found:
    """Find the step from the described parameters to those that explain the first `count` samples best; with a loss
    by repeated weights, beginning with those of least squares.
    """
    weights = np.ones((count, recording.robot.dof))
    for _ in range(1 if loss is None else 12):
        found = _least_squares_with(recording, count, weights)
        if loss is None:
            break
        left = recording.left(recording.described + found.step)[:count]
        variances = np.array([max(median_variance(column**2, 1), 1e-300) for column in left.T])
        weights = np.maximum(loss_weights(loss, left**2 / variances, 1)[0], 1e-9)
    return found


def _least_squares_with(recording: Recording, count: int, weights: Float64Array) -> Found:
    """Find the step that explains the first `count` samples best, whose torques have weights (count, dof)."""
    robot, width = recording.robot, recording.described.size
    # Products of columns, the last of which is what the described parameters leave of the torques, joint by joint:
    # (N, dof, k) would not fit into memory.
    products = np.zeros((robot.dof, width + 1, width + 1))
    for part in recording.blocks(count):
        rows = recording.rows(part)
        off = recording.torques(part) - rows @ recording.described
        columns = np.concatenate((rows, off[..., None]), axis=-1) * np.sqrt(weights[part])[..., None]
        columns = np.moveaxis(columns, 1, 0)
        products += np.swapaxes(columns, 1, 2) @ columns
    unexplained = np.sqrt(products[:, width, width].max() / count)
    least = max(_LEAST_NOISE * unexplained, _ROUNDING * column_rms(recording.values["tau"][:count]).max())
    bodies = np.sqrt((recording.base.matrix**2) @ inertial_units(robot) ** 2)  # what parameters may amount to
    # Parameters and the noise of each joint in turn.
    noise = np.ones(robot.dof)
    for _ in range(_WEIGHT_ROUNDS):
        whole = (products / noise[:, None, None] ** 2).sum(axis=0)
        lengths = np.sqrt(np.diagonal(whole)[:width])
        torques = lengths[: len(bodies)] * bodies
        lengths[: len(bodies)][torques < _NO_EFFECT * torques.max(initial=0.0)] = 0.0
        unit = np.where(lengths > 0, lengths, 1.0)
        sizes, vectors = np.linalg.eigh(whole[:width, :width] / np.outer(unit, unit))
        seen = sizes > _SINGULAR * sizes[-1]
        inverse = (vectors[:, seen] / sizes[seen]) @ vectors[:, seen].T
        step = inverse @ (whole[:width, width] / unit) / unit
        ends = np.append(step, -1.0)
        # Each joint loses its part of the parameters.
        free = max(count - seen.sum() / robot.dof, 1)
        noise = np.maximum(np.sqrt(np.maximum(ends @ products @ ends, 0.0) / free), max(least, 1e-100))
    if not lengths.any():
        raise FitError("q, qd, qdd", "a motion whose torques depend on the robot's masses", "none that does")
    # Covariance, from scores whose neighbours may be correlated.
    scores = []
    for part in recording.blocks(count):
        rows = recording.rows(part)
        left = recording.torques(part) - rows @ (recording.described + step)
        scores.append(np.einsum("nik,ni->kn", rows, weights[part] * left / noise**2) / unit[:, None])
    covariance, lag = sandwich(inverse, np.concatenate(scores, axis=1), robot.dof)
    std = np.sqrt(np.diagonal(covariance)) / unit
    std[(lengths == 0) | (np.abs(vectors[:, ~seen]) > 1e-3).any(axis=1)] = np.inf
    factor = np.sqrt(np.where(seen, sizes, 0.0))[:, None] * vectors.T * unit
    return Found(step, factor, covariance / np.outer(unit, unit), std, noise, lag)


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
    return np.stack(
        (np.where(heavy, mass, mass[heavy].mean()), np.where(heavy, radius, radius[heavy].mean())), axis=1
    )


def column_rms(rows: NDArray[np.float64]) -> Float64Array:
    """Return the root mean squares of columns; NaN of no rows."""
    return np.sqrt((rows * rows).mean(axis=0)) if len(rows) else np.full(rows.shape[1], np.nan)
