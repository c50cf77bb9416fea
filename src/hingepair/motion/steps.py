"""Errors of integration steps (E12), and steps selected by them.

The error of a motion is measured by steps of half the length or less (step doubling). What a jump leaves of the error
of these is the difference from a quadrature by other nodes, two of which lie beside the ends of the step. For samples
the interpolant is integrated; added is an error of interpolation, from the motions through every second and every
fourth sample.

Rounding: a step that turns by an angle a is rounded by about u a. Its nodes are rounded by about u t where the rate
is a callable, which adds u t times the change of the rate over the step. The rounding errors of steps are
independent, so that their squares add up: over many steps the sum is far less than u times the angle turned in all,
over few fast steps about that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.motion.magnus import NODES, ORDER, Integral, Steps, step_means
from hingepair.motion.signals import CallableSignal, ConstantSignal, SampledSignal
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms
from hingepair.numeric.bounded import UNIT_ROUNDOFF

MAX_STEPS: Final = 2_000_000  # up to which steps are divided; more errors remain in the error estimate
_LONGEST = 1 / 16  # of the whole motion: longest step whose error is measured
_FEATURE = 1 / 509  # of the whole motion: a callable may hide what is shorter
_NOISE = 10  # standard deviations of rounding below which the other quadrature tells nothing
_UNUSUAL = 100  # times the median of errors: those beside jumps are larger
# Nodes of a second quadrature of a step; not 0 and 1, since a callable may jump at instants.
_CHECKS = (1e-4, 0.1727, 0.5, 0.8273, 1 - 1e-4)
_CHECK_WEIGHTS = np.linalg.solve(np.vander(_CHECKS, increasing=True).T, 1 / np.arange(1, len(_CHECKS) + 1))


class StepErrors(NamedTuple):
    """Measured errors of integration steps [rad]."""

    sizes: Array  # (steps,)
    largest: float  # at any instant
    rounding: float  # at any instant


def measure_errors(integral: Integral, steps: Steps, values: Array) -> StepErrors:
    """Measure the errors of steps by two or more steps in place of each; `values` are the angles or attitudes at the
    instants by the steps whose errors are wanted.
    """
    rate, own, parts = integral.rate, integral.rounding(values), 2
    if isinstance(rate, CallableSignal):
        parts *= math.ceil(steps.h.max() / (steps.t[-1] - steps.t[0]) / _FEATURE / 2)
    fine = steps.divided(np.full(steps.step_count, parts))
    changes = integral.changes(fine)
    noise, jumps = _rounding_and_jumps(rate, fine, parts)
    jumps = np.where(jumps <= _NOISE * noise, 0.0, jumps)
    sizes = jumps + integral.distances(integral.changes(steps), integral.of_groups(changes, parts))
    rounding = own + float(noise.sum() if isinstance(rate, ConstantSignal) else np.linalg.norm(noise))
    apart = float(integral.distances(values, fine.at_instants(integral.accumulated(changes))).max())
    return StepErrors(sizes, apart + float(np.linalg.norm(jumps)), rounding)


def _rounding_and_jumps(rate: Any, fine: Steps, parts: int) -> tuple[Array, Array]:
    """Return standard deviations of the rounding of steps, and sizes of the errors of their parts beside jumps [rad];
    (steps,) each.
    """
    rounding, jumps = np.empty(fine.step_count), np.zeros(fine.step_count)
    for part, start, h in fine.chunks():
        values = rate.values_at_nodes(start, h, NODES).reshape(len(h), len(NODES), -1)
        rounding[part] = UNIT_ROUNDOFF * h * row_norms(values).mean(axis=1)
        if isinstance(rate, CallableSignal):
            # As measured, nodes that are rounded by u t give a step an error of 0.4 u t times the change of the rate.
            change = row_norms(values[:, -1] - values[:, 0])
            rounding[part] = np.hypot(rounding[part], 0.4 * UNIT_ROUNDOFF * np.abs(start + h) * change)
            checks = rate.values_at_nodes(start, h, _CHECKS).reshape(len(h), len(_CHECKS), -1)
            apart = np.einsum("snk,n->sk", checks, _CHECK_WEIGHTS) - step_means(values)
            jumps[part] = h * row_norms(apart)
    return rounding.reshape(-1, parts).sum(axis=1), row_norms(jumps.reshape(-1, parts))


@np.errstate(all="ignore")
def estimate_error(integral: Integral, steps: Steps, values: Array) -> float:
    """Return an estimate of the largest error at any instant [rad] of an integral with `values` at the ends of steps;
    NaN for samples too few to tell.
    """
    values = steps.at_instants(values)
    if not steps.step_count:
        return integral.rounding(values)
    errors = measure_errors(integral, steps.no_longer_than(_LONGEST), values)
    estimate = math.hypot(errors.largest, errors.rounding)
    if not isinstance(integral.rate, SampledSignal):
        return estimate
    if len(integral.rate.t) < 4:
        return math.nan
    apart, rate = list[float](), integral.rate
    for _ in range(2):
        rate = rate.thinned()
        thinned = steps.at_instants(integral.accumulated(replace(integral, rate=rate).changes(steps)))
        apart.append(float(integral.distances(values, thinned).max()))
        values = thinned
    # Where the motion is smooth, twice the distance makes the error 64 times as large, beside a jump about twice. The
    # root of the ratio leaves room for a jump that the error of a smooth motion hides.
    return estimate + apart[0] / math.sqrt(min(max(apart[1] / apart[0], 1.0), 64.0) if apart[0] else 1.0)


@np.errstate(all="ignore")
def select_steps(integrals: Sequence[Integral], t: Array, tol: float | None) -> Steps:
    """Select integration steps between the instants t that keep the error of each integral below `tol` [rad], as far
    as MAX_STEPS can. Errors of interpolation between samples do not count. Without a tolerance each interval is one
    step.
    """
    inexact = [integral for integral in integrals if not isinstance(integral.rate, ConstantSignal)]
    if tol is None or len(t) < 2 or not inexact:
        return Steps(t)
    steps, last_usual, last_count = Steps(t).no_longer_than(_LONGEST), np.inf, len(t)
    for _ in range(64):
        values = [steps.at_instants(one.accumulated(one.changes(steps))) for one in inexact]
        measured = [measure_errors(one, steps, own) for one, own in zip(inexact, values, strict=True)]
        largest, rounding = (max(errors) for errors in zip(*(one[1:] for one in measured), strict=True))
        goal, count = max(tol - rounding, 0.5 * max(tol, rounding)), steps.step_count  # rounding stays
        sizes = np.minimum(np.max([errors.sizes for errors in measured], axis=0), 1e30)  # also of infinite ones
        total, usual = float(sizes.sum()), float(sizes[sizes <= _UNUSUAL * np.median(sizes)].sum())
        # A sum of errors that hardly falls with three times as many steps is noise of the rate, not truncation.
        if largest <= max(0.85 * goal, rounding) or (count > 3 * last_count and last_usual / 4 < usual < 1e-3):
            break
        # Errors that go to and fro cancel; larger ones cannot be added up as vectors.
        cancelled = max(1.0, total / largest) if total < 1 else 1.0
        counts = _part_counts(steps, sizes, 0.75 * float(goal) * cancelled)
        if counts.max() == 1 or counts.sum() > MAX_STEPS:
            break
        steps, last_usual, last_count = steps.divided(counts), usual, count
    return steps


def _part_counts(steps: Steps, sizes: Array, goal: float) -> NDArray[np.int64]:
    """Return into how many parts steps are divided so that the sum of their errors comes to a goal [rad]: of those
    beside jumps, whose errors do not fall by the method's order, four at most.
    """
    shortest = 16 * np.spacing(np.maximum(np.abs(steps.t[:-1]), np.abs(steps.t[1:])))
    most = np.where(steps.h <= shortest, 1, np.where(sizes > _UNUSUAL * np.median(sizes), 4, 16))
    wanted = np.ceil((sizes * steps.step_count / goal) ** (1 / ORDER))
    return np.asarray(np.clip(wanted, 1, most), np.int64)
