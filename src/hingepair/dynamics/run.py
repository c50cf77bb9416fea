"""A simulation from its first to its last instant: steps to events, samples between them, and what stopped it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.dynamics.collocation import (
    NODES,
    Stepper,
    StepPolynomial,
    TooStiffError,
    integration_matrix,
    interpolation_matrix,
)
from hingepair.dynamics.events import JointEvents, UserEvent
from hingepair.dynamics.robot_motion import (
    JointCallable,
    RobotMotion,
    RobotSamples,
    StepRecord,
    driven_at,
)
from hingepair.errors import ArgumentError, HingePairError, quoted
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, real_array
from hingepair.numeric.suspicions import suspicions
from hingepair.pair.hinge_load import check_callable

_EVALUATIONS = 509 * 17  # of callables over the whole motion, at least
_FINER = 1e-3  # tolerance of the second run, from which errors are estimated, to that of the first
_MORE_EVALUATIONS = 4.3  # in the second run, by a factor with which its instants do not fall on those of the first


class SimulationError(HingePairError, RuntimeError):
    """The simulation cannot be continued past the instant `t` [s], for the reason `why`."""

    def __init__(self, t: float, why: str) -> None:
        self.t = t
        self.why = why
        super().__init__(f"the simulation cannot go past t = {t!r}: {why}")

    def __reduce__(self) -> tuple[type, tuple[float, str]]:
        return type(self), (self.t, self.why)


class RunOptions(NamedTuple):
    """Options of a run."""

    tol: float  # largest error of a step [rad]
    breaks: Array  # instants at which loads jump, increasing [s]
    until: UserEvent | None  # the user's event
    max_steps: float  # steps tried, at most
    evaluations: float = _EVALUATIONS

    @property
    def finer(self) -> RunOptions:
        """Options of the second run, from which errors are estimated."""
        return RunOptions(
            max(self.tol * _FINER, 1e-15), self.breaks, None, 3 * self.max_steps, _EVALUATIONS * _MORE_EVALUATIONS
        )


class Run(NamedTuple):
    """A simulated motion."""

    motion: RobotMotion
    first_state: Array  # at the first instant, before its events
    steps: list[StepRecord]
    samples: RobotSamples
    ended: bool  # whether `until` ended it


class Extreme(NamedTuple):
    """Smallest or largest coordinate of a joint in a motion."""

    q: float  # [rad or m]
    t: float  # [s]


def read_options(tol: object, breaks: ArrayLike, until: UserEvent | None, max_steps: object) -> RunOptions:
    """Return the checked options of a run.

    Raises:
        ArgumentError: one cannot be used.
    """
    tolerance, step_limit = finite_number("tol", tol), finite_number("max_steps", max_steps)
    if not 1e-14 <= tolerance <= 1e-2:  # rad
        raise ArgumentError("tol", "a number from 1e-14 to 0.01", tol)
    if until is not None:
        check_callable("until", until, "t", "now")
    instants = np.sort(real_array("breaks", breaks).astype(np.float64))
    if instants.ndim != 1 or not np.isfinite(instants).all():
        raise ArgumentError("breaks", "instants at which loads jump [s], shape (M,)", quoted(breaks))
    return RunOptions(tolerance, instants, until, step_limit)


def run_motion(motion: RobotMotion, t: Array, options: RunOptions) -> Run:
    """Simulate a motion at the instants t.

    Raises:
        SimulationError: it cannot be continued.
    """
    first_state, steps, end = motion.state, list[StepRecord](), None
    if len(t) > 1:
        steps, end = _run_steps(motion, t, options)
    if end is not None:
        t = np.unique(np.hstack([t[t - t[0] < end], t[0] + end]))
    return Run(motion, first_state, steps, _sample_steps(motion, first_state, steps, t), end is not None)


def joint_extremes(run: Run, joint: int) -> tuple[Extreme, Extreme]:
    """Return the smallest and the largest coordinate of a joint in a whole motion, between the instants too."""
    samples, column = run.samples, run.motion.q.start + joint
    t, q = samples.t, samples.motion.q[:, joint]
    if run.steps and len(t) > 1:
        times = np.linspace(0.0, 1.0, 17)  # of a step
        polynomials = [step.polynomial for step in run.steps]
        starts, lengths = (np.array([getattr(p, name) for p in polynomials]) for name in ("start", "length"))
        rates = np.stack([p.rates[:, column] for p in polynomials])
        slopes = rates @ interpolation_matrix(times).T
        k, j = np.nonzero(slopes[:, :-1] * slopes[:, 1:] < 0)  # the joint turns there, near the zero of the secant
        turns = times[j] + times[1] * slopes[k, j] / (slopes[k, j] - slopes[k, j + 1])
        within = np.hstack([k, np.arange(len(polynomials))])  # and the ends of all steps
        shares = np.hstack([turns, np.ones(len(polynomials))])
        change = lengths[within] * (integration_matrix(shares) * rates[within]).sum(axis=1)
        q = np.hstack([q, np.array([p.state[column] for p in polynomials])[within] + change])
        t = np.hstack([t, samples.t[0] + starts[within] + shares * lengths[within]])
    lowest, highest = int(np.argmin(q)), int(np.argmax(q))
    return Extreme(float(q[lowest]), float(t[lowest])), Extreme(float(q[highest]), float(t[highest]))


def stop_overrun(name: str, unit: str, stops: tuple[float, float], lowest: float, highest: float) -> str:
    """Return a clause that says by how much a joint passes its stops; empty if by 0.02 rad or m at most."""
    depth = max(stops[0] - lowest, highest - stops[1])
    return f"{name} passes the stops by {depth:.3g} {unit}, for they are springs" if depth > 0.02 else ""


def angle_between(first: Array, second: Array) -> float:
    """Return the largest angle [rad] between attitudes, unit quaternions (n, 4), row by row."""
    chord = np.minimum(np.linalg.norm(first - second, axis=-1), np.linalg.norm(first + second, axis=-1))
    return float((4 * np.arcsin(np.minimum(chord / 2, 1))).max(initial=0.0))


def check_rates(name: str, motion: Callable[[Array], dict[str, Array]], t: Array, derived: Mapping[str, str]) -> None:
    """Refuse a rate of a given motion that differs by more than a tenth, over the whole motion, from the central
    difference of the quantity that `derived` names for it. S1 is an attitude; names may end with the number of a
    body.
    """
    span = float(t[-1] - t[0])
    if not span:
        return
    middles = t[0] + span * (np.arange(16) + 0.5) / 16
    given = motion(middles)
    excess = dict.fromkeys(derived, np.nan)
    # A rate counts as right if one step fits it: long ones are coarse. Short ones that drown in rounding say nothing.
    for step in span * np.array([1e-3, 1e-5, 1e-7]):
        before, after = motion(middles - step), motion(middles + step)
        for rate, quantity in derived.items():
            size, change = float(np.abs(after[quantity]).max()), after[quantity] - before[quantity]
            if quantity == "S1":
                turn = after[quantity] @ np.swapaxes(before[quantity], -1, -2)
                change = np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1) / 2
            slopes, rates = change / (2 * step), given[rate]
            rounding = np.spacing(size) + np.spacing(abs(t[0]) + span) * float(np.abs(rates).max())
            allowed = 0.1 * max(float(np.abs(slopes).sum()), float(np.abs(rates).sum()))
            if 64 * slopes.size * rounding < step * allowed:
                excess[rate] = np.fmin(excess[rate], float(np.abs(slopes - rates).sum()) - allowed)
    for rate, quantity in derived.items():
        if excess[rate] > 0:
            letters = rate.removesuffix("1"), quantity.removesuffix("1")
            expected = f"a callable whose {letters[0]} is the derivative of its {letters[1]}"
            raise ArgumentError(name, expected, f"another {letters[0]}")


def check_joint_rates(name: str, move: JointCallable, t: Array) -> None:
    """Raise an ArgumentError unless psi' and psi'' of a joint that moves as given are the derivatives of psi."""

    def motion(times: Array) -> dict[str, Array]:
        return dict(zip(("psi", "psid", "psidd"), driven_at(name, move, times), strict=True))

    check_rates(name, motion, t, {"psid": "psi", "psidd": "psid"})


def _run_steps(motion: RobotMotion, t: Array, options: RunOptions) -> tuple[list[StepRecord], float | None]:
    """Make steps from t[0] to t[-1]. Return them, and the time since t[0] [s] at which `until` ended the motion, or
    None.
    """
    start, elapsed = float(t[0]), t - t[0]
    span = float(elapsed[-1])
    events = JointEvents(motion, start, options.tol, options.until, span)
    breaks = [float(x) for x in options.breaks - start if 0 <= x <= span]
    margin, bounds = 8 * np.spacing(max(abs(start), abs(start + span))), np.zeros(2)
    checked = bool(motion.callable_names or options.until)
    stepper = Stepper(
        lambda elapsed, states: motion.rates(start + np.clip(elapsed, *bounds), states),
        events if events.any_events else None,
        0.0,
        motion.state,
        motion.sizes,
        motion.rate_mask,
        motion.q,
        options.tol,
        motion.first_step_length(start, span),
        span / options.evaluations if checked else np.inf,
        elapsed if checked else np.empty(0),
    )
    records, last_trials, last_t = list[StepRecord](), 0, 0.0
    for interval_start, end in itertools.pairwise(sorted({0.0, *breaks, span})):
        bounds[:] = (
            interval_start + margin * (interval_start in breaks),
            end - margin * (end in breaks),
        )  # callables are evaluated just before and after breaks, where loads jump
        while stepper.t < end:
            attitude = motion.quat, motion.phi
            try:
                polynomial = stepper.step(end)
            except TooStiffError as error:
                reason = _explain_failure(motion, start, stepper)
                reason = reason or motion.mass_doubt(start + error.t, stepper.state, 1e-6)
                reason = reason or "the loads change too fast there to be followed"
                raise SimulationError(start + error.t, f"steps became too short; {reason}") from None
            if polynomial is not None:
                records.append(StepRecord(polynomial, *attitude, motion.side, motion.held.copy()))
                stepper.apply_pending_event()
            if stepper.ended:
                return records, stepper.t
            stepper.set_state(motion.restart_attitude(stepper.state))
            if stepper.t >= span or stepper.trials < min(last_trials + 1000, options.max_steps):
                continue
            # A load that jumps to and fro stops all progress; impacts that follow each other ever faster do not.
            reason = _explain_failure(motion, start, stepper)
            remaining = (span - stepper.t) / (stepper.t - last_t) * (stepper.trials - last_trials)
            if stepper.trials >= options.max_steps or (reason and remaining > options.max_steps):
                doubts = suspicions("instants", "t", t)
                reason = reason or "; ".join(["max_steps= allows more, a larger tol needs fewer", *doubts])
                raise SimulationError(
                    start + stepper.t, f"{options.max_steps:g} steps would not reach the end; {reason}"
                )
            last_trials, last_t = stepper.trials, stepper.t
    return records, None


def _sample_steps(motion: RobotMotion, first_state: Array, steps: list[StepRecord], t: Array) -> RobotSamples:
    """Return motion and loads at instants t from the steps."""
    elapsed, states = t - t[:1], np.tile(first_state, (len(t), 1))
    # The first instant has the state before its events.
    still = StepPolynomial(0.0, 1.0, first_state, np.zeros((NODES, len(first_state))))
    records = [*steps[:1]] or [StepRecord(still, motion.quat, motion.phi, motion.side, motion.held)] * len(t)
    for step in steps:
        first = len(records)
        end = int(np.searchsorted(elapsed, step.polynomial.start + step.polynomial.length, side="right"))
        end = max(first, len(t) if step is steps[-1] else end)
        states[first:end] = step.polynomial.states_at(elapsed[first:end])
        records += [step] * (end - first)
    return motion.sample_steps(t, states, records[: len(t)])._replace(steps=len(steps))


def _explain_failure(motion: RobotMotion, start: float, stepper: Stepper) -> str:
    """Return which load is no number or jumps at the present time and state, and what to do; "" if none does."""
    worst = (1e-3, "")
    names = motion.loads.coordinate_names
    probes = [("t", -1, 1e-9)]
    for k, (coordinate, rate) in enumerate(names):
        probes += [(coordinate, motion.q.start + k, 1e-9), (rate, motion.q.stop + k, 1e-6)]
    t, states = np.full(2, start + stepper.t), np.stack([stepper.state] * 2)
    for name, column, increment in probes:
        times, shifted = t.copy(), states.copy()
        if column < 0:
            times += np.array([-increment, increment]) * max(1.0, abs(t[0]))
            value, remedy = t[0], "breaks= names the instants at which loads jump"
        else:
            value = states[0, column]
            remedy = "HingeLoad(friction=..., stops=...) has friction and stops that are followed"
            shifted[:, column] += np.array([-increment, increment]) * max(1.0, abs(value))
        for load, values in motion.callable_loads(times, shifted).items():
            low, high = values.reshape(2, -1)
            if not np.isfinite(values).all():
                number = values[~np.isfinite(values)][0]
                where = ", ".join(f"{one} = {states[0, motion.q.start + k]:.6g}" for k, (one, _) in enumerate(names))
                return f"{load} is {number} near t = {t[0]:.6g}, {where}"
            k = int(np.abs(high - low).argmax())
            change = float(abs(high[k] - low[k]) / max(abs(high[k]), abs(low[k]), 1e-300))
            if not change <= worst[0]:
                worst = change, f"{load} jumps from {low[k]:.6g} to {high[k]:.6g} at {name} = {value:.6g}; {remedy}"
    return worst[1]
