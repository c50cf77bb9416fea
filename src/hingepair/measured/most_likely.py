"""The most likely hinge of a recording, by steps of Gauss and Newton, and how well it is known.

A model says what its constraints leave of each sample, whitened: divided by the deviations that its noise gives it
(`hinge_model`). Each step estimates the noise and the weights of the samples, and moves model and clock towards the
least squares for these. The steps use some thousand samples; a last one uses all.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from hingepair.measured.hinge import slopes
from hingepair.measured.relative_poses import FEW_SAMPLES, RelativePoses
from hingepair.measured.smoothing.spline import MIN_PIECE
from hingepair.measured.statistics import Loss, loss_weights, sandwich, solve_semidefinite
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import rotation_exp

_SOME = 4096  # samples of the rounds, at most
_MAX_ROUNDS = 40
_AT_REST = 0.02  # standard deviations; shorter steps are the last
_SMALL = 1e-6  # rad, s, and parts of the size of the places; likewise: the last step with all samples squares it
_DRIFT = 2e-4  # expected clock drift [s/s], that of crystals
_MIN_CLOCK_GAIN = 10.0  # information on the clock offset over that of noise alone; below, motion does not show it
_MAX_CLOCK_STD = 0.1  # [s]: nor if it is known less well

PosesAt = Callable[[Float64Array, int], RelativePoses]
"""Function of clock offset and drift (2,), and of how many samples are needed at most."""
Model: TypeAlias = Any
"""A BodyModel or a PointModel."""


class Estimate(NamedTuple):
    """The most likely model."""

    model: Any
    clock: Float64Array  # offset of body 2's clock [s] in the middle of the recording, and drift; (2,)
    has_converged: bool  # whether the rounds came to rest


class Evaluation(NamedTuple):
    """What a model leaves of N samples, and what that tells of its parameters and the clock, k together."""

    whitened: Float64Array  # residuals; (components, N)
    weights: Float64Array  # of the loss alone; (N,)
    normal: Float64Array  # J^T W J; (k, k)
    gradient: Float64Array  # J^T W r; (k,)
    slope: Float64Array  # derivative of the gradient; (k, k)
    scores: Float64Array  # weighted J^T r of each sample; (k, N)
    J: Float64Array | None  # weighted derivatives of the residuals of few samples; (k, components, N)
    prior: Float64Array  # precisions of the unknowns before the recording; (k,)

    @property
    def squares(self) -> Float64Array:
        """Squares of the whitened residuals, summed over the components (N,)."""
        return np.asarray((self.whitened**2).sum(axis=0))

    @property
    def covariance(self) -> tuple[Float64Array, int]:
        """Covariance (k, k) of the unknowns, and the lag of `sandwich`."""
        inverse, scores = solve_semidefinite(self.slope, np.eye(self.slope.shape[0])), self.scores
        if self.J is not None:
            # Residuals are small where a sample decides on the unknowns: what it would leave without doing so is
            # (1 - J A J^T)^-1 r, A the inverse of J^T J (Bell and McCaffrey, Survey Methodology 28 (2002), 169-181).
            own = np.einsum("krn,lrn->nkl", self.J, self.J)
            # The 1e-3 keeps it regular where one sample alone decides on an unknown.
            left = (1 + 1e-3) * np.eye(len(inverse)) - own @ solve_semidefinite(self.normal, np.eye(len(inverse)))
            scores = np.linalg.solve(left, scores.T[..., None])[..., 0].T
        return sandwich(inverse, scores, np.diag(self.prior))


def most_likely(
    start: Model, poses_at: PosesAt, clock: Float64Array, loss: Loss | None
) -> tuple[Estimate, RelativePoses]:
    """Return the most likely model near `start` and `clock`, and the poses of all samples at its clock."""
    model, has_converged, share, last, sizes = start, False, 1.0, None, list[float]()
    for _ in range(_MAX_ROUNDS):
        poses = poses_at(clock, _SOME)
        if len(poses.by_clock) and poses.samples < MIN_PIECE:  # the clock left the recording
            return Estimate(model, clock, False), poses
        model = model.with_noise(poses, loss)
        seen = evaluate(model, poses, clock, loss)
        step = -solve_semidefinite(seen.normal, seen.gradient)
        sizes.append(float(np.sqrt(step @ seen.normal @ step)))
        if last is not None and last @ seen.normal @ step < -0.5 * sizes[-1] * np.sqrt(last @ seen.normal @ last):
            share /= 2  # steps to and fro, of which noise and weights change with each
        last = step
        model, clock = model.moved(share * step[: model.parameters]), clock + share * _of_clock(model, step)
        scales = np.ones(step.size)
        scales[model.angles : model.parameters] = max(poses.size, 1e-300)
        if len(sizes) > 12 and sizes[-1] > 0.5 * min(sizes[:-6]):
            break  # it goes in circles
        if sizes[-1] < _AT_REST or (np.abs(step) < _SMALL * scales).all():
            has_converged = True
            break
    # A last step with all samples.
    poses = poses_at(clock, sys.maxsize)
    seen = evaluate(model, poses, clock, loss)
    step = -solve_semidefinite(seen.slope, seen.gradient)
    model, change = model.moved(step[: model.parameters]), _of_clock(model, step)
    if change.any():
        clock = clock + change
        poses = poses_at(clock, sys.maxsize)
        has_converged &= poses.samples >= MIN_PIECE
    return Estimate(model, clock, has_converged), poses


def _of_clock(model: Model, step: Float64Array) -> Float64Array:
    """Return the part of a step that belongs to the clock, zeros where it is known; (2,)."""
    change = np.zeros(2)
    change[: step.size - model.parameters] = step[model.parameters :]
    return change


def evaluate(model: Model, poses: RelativePoses, clock: Float64Array, loss: Loss | None) -> Evaluation:
    """Return what a model leaves of all samples."""
    prior = np.zeros(model.parameters + len(poses.by_clock))
    prior[model.parameters + 1 :] = _DRIFT**-2.0
    slope, normal = np.diag(prior), np.diag(prior)
    residuals, weights, scores = [], [], []
    for block in poses.blocks():
        rows = model.rows(block)
        weight, bend = loss_weights(loss, (rows[-1] ** 2).sum(axis=0), model.components)
        score = np.einsum("kri,ri->ki", rows[:-1], rows[-1])
        J = rows[:-1] * np.sqrt(weight)
        products = np.einsum("krn,lrn->kl", J, J, optimize=True)
        normal = normal + products
        slope = slope + products + 2 * (score * bend) @ score.T
        residuals.append(rows[-1])
        weights.append(weight)
        scores.append(weight * score)
    all_scores = np.concatenate(scores, axis=1)
    gradient = all_scores.sum(axis=1) + prior * np.concatenate((np.zeros(model.parameters), clock))[: prior.size]
    return Evaluation(
        whitened=np.concatenate(residuals, axis=1),
        weights=np.concatenate(weights),
        normal=normal,
        gradient=gradient,
        slope=slope,
        scores=all_scores,
        J=J if poses.samples <= FEW_SAMPLES else None,
        prior=prior,
    )


def psi_derivatives(model: Model, poses: RelativePoses) -> Float64Array:
    """Return the derivatives of psi by the parameters and the clock; (k, N)."""
    some = poses if model.turns_samples else poses.part(slice(1))
    by_parameters = slopes(lambda step: np.sin(model.moved(step).psi(some) - model.psi(some)), model.parameters)
    rows = [*np.broadcast_to(by_parameters.T, (model.parameters, poses.samples))]
    for change in 1e-6 * np.eye(len(poses.by_clock)):
        rows.append(np.sin(model.psi(poses.at_clock(change)) - model.psi(poses)) / 1e-6)
    return np.stack(rows)


def shows_offset(model: Model, poses: RelativePoses, noise_poses: RelativePoses, loss: Loss | None) -> bool:
    """Return whether the motion determines the clock offset beside all other unknowns: far better than derivatives
    that are noise alone, those of `noise_poses`, would.
    """
    real, noise = (evaluate(model, each, np.zeros(2), loss).normal for each in (poses, noise_poses))
    k = model.parameters
    others = np.delete(np.arange(real.shape[0]), k)
    shown = real[k, k] - real[k, others] @ solve_semidefinite(real[np.ix_(others, others)], real[others, k])
    return bool(shown > _MIN_CLOCK_GAIN * noise[k, k] and shown * _MAX_CLOCK_STD**2 > 1)


def noise_bias(model: Model, poses: RelativePoses, variances: tuple[float, float, float]) -> Float64Array:
    """Return the bias (estimate less truth) of the parameters, as a step. It goes as the variance of the noise and
    does not decrease with the number of samples: a rotation that is off at random is on average a shorter matrix, so
    levers come out short.

    Args:
        model: the most likely one.
        poses: the samples.
        variances: of a usual sample: of its place [m^2], and of the attitudes of body 1 and of body 2 [rad^2].
    """
    # The mean of the gradients at the exact poses, each coordinate of noise once up and once down.
    thin = poses.thinned(FEW_SAMPLES)
    place, turn1, turn2 = np.sqrt(np.outer(variances, thin.variances))[..., None]
    Q, p = model.exact(thin)
    noisy = []
    for axis in np.concatenate((np.eye(3), -np.eye(3))):
        about1, about2 = (np.asarray(rotation_exp(size * axis)) for size in (turn1, turn2))
        noisy += [(about2 @ Q, p), (Q, p + place * axis), (about1 @ Q, np.einsum("nij,nj->ni", about1, p))]
    around = poses._replace(
        Q=np.concatenate([each[0].reshape(-1, 9) for each in noisy]).T,
        p=np.concatenate([each[1] for each in noisy]).T,
        variances=np.tile(thin.variances, len(noisy)),
        by_clock=np.zeros((0, 12, len(noisy) * thin.samples)),
    )
    seen = evaluate(model, around, np.zeros(2), None)
    return -solve_semidefinite(seen.normal / len(noisy), seen.gradient / 2)
