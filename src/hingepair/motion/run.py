"""A simulation from its first to its last instant: steps to events, samples between them, and what stopped it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, SimulationError, quoted
from hingepair.mechanism.bodies.hinge_load import check_callable, stop_range
from hingepair.mechanism.mechanism import tree_of
from hingepair.motion.collocation import (
    NODES,
    Stepper,
    StepPolynomial,
    TooStiffError,
    integration_matrix,
    interpolation_matrix,
)
from hingepair.motion.equations_of_motion import RobotMotion, RobotSamples, StepRecord
from hingepair.motion.events import JointEvents, UserEvent
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, real_array
from hingepair.tables.suspicions import suspicions

_EVALUATIONS = 509 * 17  # of callables over the whole motion, at least
_TRIALS_BETWEEN_CHECKS = 50  # of whether callables keep no memory
_FINER = 1e-3  # tolerance of the second run, which tells the errors, in parts of that of the first
_MORE_EVALUATIONS = 4.3  # times as many in the second run, whose instants then do not fall on those of the first


class RunOptions(NamedTuple):
    """Options of a run."""

    tol: float  # largest error of a step [rad]
    breaks: Array  # instants at which loads jump, increasing [s]
    until: UserEvent | None  # the user's event
    max_steps: float  # steps tried, at most
    evaluations: float = _EVALUATIONS  # of callables over the whole motion, at least

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
    ended_by: str  # what ended it: "until", or a sentence of `linkages`; "" if nothing did


class Impact(NamedTuple):
    """An impact of a joint at a rigid stop."""

    #: name of the joint; psi of a pair
    joint: str
    #: instant [s]
    t: float
    #: rate before the impact [rad/s or m/s]
    before: float
    #: rate after it [rad/s or m/s]
    after: float


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
    """Simulate a motion at the instants t, up to that at which `until` ends it.

    Raises:
        SimulationError: it cannot be continued.
    """
    first_state, steps, end, ended_by = motion.state, list[StepRecord](), 0.0, ""
    if len(t) > 1:
        steps, end, ended_by = _run_steps(motion, t, options)
    if ended_by:
        t = np.unique(np.hstack([t[t - t[0] < end], t[0] + end]))
    return Run(motion, first_state, steps, _sample_steps(motion, first_state, steps, t), ended_by)


def turning_points(run: Run, joint: int) -> tuple[Array, Array]:
    """Return instants and coordinates of a joint, the smallest and the largest of the whole motion among them."""
    samples, column = run.samples, run.motion.q.start + joint
    t, q = samples.t, samples.motion.q[:, joint]
    if not run.steps or len(t) < 2:
        return t, q
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
    reached = np.array([p.state[column] for p in polynomials])[within] + change
    return np.hstack([t, t[0] + starts[within] + shares * lengths[within]]), np.hstack([q, reached])


def rate_jumps(run: Run) -> Iterator[tuple[StepRecord, StepRecord, Array]]:
    """Yield, where rates of joints jump, the steps before and after, and the state at the end of the former."""
    columns = slice(run.motion.q.stop, run.motion.q.stop + run.motion.dof)
    for last, after in itertools.pairwise((*run.steps[:1], *run.steps)):
        end_state = run.first_state
        if last is not after:
            end_state = last.polynomial.states_at(np.array([after.polynomial.start]))[0]
        rates, changed = end_state[columns], after.polynomial.state[columns]
        if (np.abs(changed - rates) > 1e-12 * (1 + np.abs(rates))).any():
            yield last, after, end_state


def joint_impacts(run: Run, joint: int, name: str) -> list[Impact]:
    """Return the impacts of a joint at its rigid stops, in order of time."""
    column, stops = run.motion.q.start + joint, run.motion.joint_loads[joint].rigid_stops
    rate, impacts = run.motion.q.stop + joint, []
    for _, after, end_state in rate_jumps(run) if stops else ():
        start, state = after.polynomial.start, after.polynomial.state
        if state[column] in stops and state[rate] != end_state[rate]:
            t = float(run.samples.t[0] + start)
            impacts.append(Impact(name, t, float(end_state[rate]), float(state[rate])))
    return impacts


def joint_range(
    run: Run, joint: int, name: str, limits: tuple[float, float], tol: float
) -> tuple[tuple[float, float], list[str]]:
    """Return the smallest and the largest coordinate of a joint in a whole motion, and a sentence if it passes its
    stops, and if it passes, by more than `tol`, a limit at or inside which there is no stop.
    """
    t, q = turning_points(run, joint)
    lowest, highest = int(np.argmin(q)), int(np.argmax(q))
    stops, unit = stop_range(run.motion.joint_loads[joint]), tree_of(run.motion.robot).coordinates[joint].unit
    depth, doubts = max(stops[0] - q[lowest], q[highest] - stops[1]), list[str]()
    if depth > 0.02:  # rad or m
        beyond = f"{name} passes the stops by {depth:.3g} {unit}, for they are springs"
        doubts.append(f"{beyond}; HingeLoad(stop_stiffness=...) hardens them")
    passed = [lowest] if q[lowest] < limits[0] - tol and stops[0] < limits[0] else []
    passed += [highest] if q[highest] > limits[1] + tol and stops[1] > limits[1] else []
    if passed:
        reached = " and ".join(f"{q[k]:.6g} {unit} at t = {t[k]:g} s" for k in passed)
        leaves = f"{name} leaves its limits, {limits[0]:g} to {limits[1]:g} {unit}: it reaches {reached}"
        doubts.append(f"{leaves}; HingeLoad(stops=...) enforces them")
    return (float(q[lowest]), float(q[highest])), doubts


def _run_steps(motion: RobotMotion, t: Array, options: RunOptions) -> tuple[list[StepRecord], float, str]:
    """Make steps from t[0] to t[-1]. Return them, the time since t[0] [s] at which the motion ended, and what ended
    it; "" at the last instant.
    """
    start, elapsed = float(t[0]), t - t[0]
    span = float(elapsed[-1])
    events = JointEvents(motion, start, options.tol, options.until, span)
    breaks = [float(x) for x in options.breaks - start if 0 <= x <= span]
    _check_memory(motion, start, start + span, motion.state)
    margin, bounds = 8 * np.spacing(max(abs(start), abs(start + span))), np.zeros(2)
    checked = motion.asks_callables or options.until is not None

    def rates(elapsed: Array, states: Array) -> Array:
        return motion.rates(start + (np.clip(elapsed, *bounds) if breaks else elapsed), states)

    stepper = Stepper(
        rates,
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
    records, last_trials, last_t, next_check = list[StepRecord](), 0, 0.0, 1
    for interval_start, end in itertools.pairwise(sorted({0.0, *breaks, span})):
        # Callables are evaluated just before and after breaks, where loads jump.
        bounds[:] = interval_start + margin * (interval_start in breaks), end - margin * (end in breaks)
        while stepper.t < end:
            quat = motion.quat
            try:
                polynomial = stepper.step(end)
            except TooStiffError as error:
                reason = _explain_failure(motion, start, stepper)
                reason = reason or motion.mass_doubt(start + error.t, stepper.state, 1e-6)
                reason = reason or "the loads change too fast there to be followed"
                raise SimulationError(start + error.t, f"steps became too short; {reason}") from None
            if stepper.trials >= next_check:
                next_check = stepper.trials + _TRIALS_BETWEEN_CHECKS
                _check_memory(motion, start + stepper.t, start + span, stepper.state)
            if polynomial is not None:
                records.append(StepRecord(polynomial, quat, motion.side, motion.held.copy()))
                stepper.apply_pending_event()
            if stepper.ended:
                return records, stepper.t, events.ended_by
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
    return records, stepper.t, ""


def _check_memory(motion: RobotMotion, t: float, last: float, state: Array) -> None:
    """Refuse a callable load that returns other values when it is called again, such as a controller that adds up
    what it is given: steps are tried in any order and more than once. In between it is called at the last instant
    and beside the state, since an integral of a constant error over time would come back to where it was.
    """
    if not motion.loads.has_callables:
        return
    times, states = np.full(2, t), np.stack([state] * 2)
    first = motion.callable_loads(times, states)
    motion.callable_loads(np.full(2, last), states + 1e-6 * motion.sizes)
    again = motion.callable_loads(times, states)
    for name, values in first.items():
        if not np.array_equal(values, again[name], equal_nan=True):
            expected = "a callable that returns the same values whenever it is called with the same arguments"
            got = f"{values[0].tolist()} and then {again[name][0].tolist()} at t = {t:g}; does it keep a sum?"
            raise ArgumentError(name, expected, got)


def _sample_steps(motion: RobotMotion, first_state: Array, steps: list[StepRecord], t: Array) -> RobotSamples:
    """Return motion and loads at instants t from the steps."""
    elapsed, states = t - t[:1], np.tile(first_state, (len(t), 1))
    # The first instant has the state before its events.
    still = StepPolynomial(0.0, 1.0, first_state, np.zeros((NODES, len(first_state))))
    records = [*steps[:1]] or [StepRecord(still, motion.quat, motion.side, motion.held)] * len(t)
    for step in steps:
        first = len(records)
        end = int(np.searchsorted(elapsed, step.polynomial.start + step.polynomial.length, side="right"))
        end = max(first, len(t) if step is steps[-1] else end)
        states[first:end] = step.polynomial.states_at(elapsed[first:end])
        records += [step] * (end - first)
    return motion.sample_steps(t, states, records[: len(t)])._replace(steps=len(steps))


def _explain_failure(motion: RobotMotion, start: float, stepper: Stepper) -> str:
    """Return which load is no number or jumps at the present time and state, and what to do; "" if none does."""
    worst, names, now = (1e-3, ""), motion.robot.names, start + stepper.t
    probes = [("t", now, -1, 1e-9)]
    for place, ending, increment in ((motion.q.start, "", 1e-9), (motion.q.stop, "'", 1e-6)):
        probes += [(f"{n}{ending}", stepper.state[place + k], place + k, increment) for k, n in enumerate(names)]
    for name, value, column, increment in probes:
        times, states = np.full(2, now), np.stack([stepper.state] * 2)
        apart = np.array([-increment, increment]) * max(1.0, abs(value))
        remedy = "HingeLoad(friction=..., stops=...) has friction and stops that are followed"
        if column < 0:
            times, remedy = times + apart, "breaks= names the instants at which loads jump"
        else:
            states[:, column] += apart
        for load, values in motion.callable_loads(times, states).items():
            low, high = values.reshape(2, -1)
            if not np.isfinite(values).all():
                number = values[~np.isfinite(values)][0]
                where = [f"{n} = {stepper.state[motion.q.start + k]:.6g}" for k, n in enumerate(names)]
                return f"{load} is {number} near {', '.join([f't = {now:.6g}', *where])}"
            k = int(np.abs(high - low).argmax())
            change = float(abs(high[k] - low[k]) / max(abs(high[k]), abs(low[k]), 1e-300))
            if not change <= worst[0]:
                worst = change, f"{load} jumps from {low[k]:.6g} to {high[k]:.6g} at {name} = {value:.6g}; {remedy}"
    return worst[1]
