"""Programs of inverse kinematics: how far coordinates are from a target, and a step towards it.

A step is one of Gauss and Newton for the errors of all goals at once. Levenberg's damping vanishes with the error, so
that the last steps converge quadratically. Joints that stand at a limit and are driven beyond it are left out
(Bertsekas, "Projected Newton methods", 1982).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

from hingepair.engine.loops import Loop
from hingepair.engine.trace import square_root, where_less
from hingepair.equations.dynamics import solve_symmetric
from hingepair.equations.spatial import IDENTITY_MATRIX
from hingepair.inverse_kinematics.goals import Goal, Place, sum_of, target_size, target_slices
from hingepair.plans.trees import Form, TreeQuantities, TreeRequest

_DAMPING = 1e-2  # times the squared error; errors are angles, and lengths in reaches of the robot
_LEAST_DAMPING = 1e-12  # keeps the matrix regular in a singular pose
_SLIDE_DAMPING = 1e-9  # keeps the matrix regular where two joints shift along one line
_MAX_STEP = 1.5  # norm of a step of the coordinates [rad or m]

OPTIONS = ("caution", "position_tolerance", "angle_tolerance", "pull")
"""The numbers of a step: `caution` damps by the error itself, which finds the closest pose to a target out of reach;
`pull` moves by this share of the way towards a posture where that does not move the frames. The tolerance of angles
is of what `off_axis` returns.
"""


def shifts_by_column(form: Form) -> list[float]:
    """Return for each coordinate how far one unit of it shifts a body [m]; 0 of hinges. Followers count alike."""
    if form.closure is not None:
        return [0.0 if turns else 1.0 for turns in form.closure.turning]
    shifts = [0.0] * form.dof
    for column, axis in zip(form.columns, form.axes, strict=True):
        shifts[column] = max(shifts[column], abs(axis.shifts))
    return shifts


class Problem(NamedTuple):
    """All on which the programs depend: a robot's form, and what its frames are to reach."""

    form: Form
    request: TreeRequest  # of the frames
    goals: tuple[Goal, ...]
    bounded: bool  # whether any coordinate that moves a frame has a limit
    constants: int  # count of the robot's numbers
    held: tuple[int, ...] = ()  # columns of coordinates that do not move


@functools.lru_cache(maxsize=64)
def measure_loop(problem: Problem) -> Loop:
    """Return the Loop of the errors of the goals at coordinates, and of the pose in the order of a target."""
    size = target_size(problem.goals)
    inputs = {"constants": (problem.constants,), "q": (problem.form.dof,), "target": (size,)}
    outputs = {"pose": (size,), "errors": (len(problem.goals),)}
    form = ("inverse kinematics: errors", problem)
    return Loop("pose_errors", functools.partial(_measure, problem), inputs, outputs, form=form)


@functools.lru_cache(maxsize=64)
def step_loop(problem: Problem, pulls: bool) -> Loop:
    """Return the Loop of a step: the coordinates after it, and how many errors before it exceed their tolerances."""
    n = problem.form.dof
    inputs: dict[str, tuple[int, ...]] = {
        "constants": (problem.constants,),
        "weights": (len(problem.goals),),
        "q": (n,),
        "target": (target_size(problem.goals),),
        "options": (len(OPTIONS),),
    }
    if problem.bounded:
        inputs |= {"low": (n,), "high": (n,)}
    if pulls:
        inputs["posture"] = (n,)
    form = ("inverse kinematics: step", problem, pulls)
    return Loop("pose_step", functools.partial(_step, problem), inputs, {"q_new": (n,), "unmet": ()}, form=form)


@functools.lru_cache(maxsize=64)
def slide_loop(problem: Problem, columns: tuple[int, ...]) -> Loop:
    """Return the Loop that moves coordinates that shift, those in `columns`, until the frames are as near to their
    targets as these alone can bring them.
    """
    shapes = {"constants": (problem.constants,), "q": (problem.form.dof,), "target": (target_size(problem.goals),)}
    form = ("inverse kinematics: slide", problem, columns)
    run = functools.partial(_slide, problem, columns)
    return Loop("pose_slide", run, shapes, {"q_new": (problem.form.dof,)}, form=form)


def _measure(problem: Problem, values: dict[str, Any]) -> dict[str, Any]:
    """Return the pose in the order of a target, and the error of each goal."""
    pose: list[Any] = []
    errors: list[Any] = []
    places = _places(problem, values)
    for goal, part, (frame, _) in zip(problem.goals, target_slices(problem.goals), places, strict=True):
        pose += goal.pose(frame)
        errors.append(goal.error(frame, values["target"][part]))
    return {"pose": tuple(pose), "errors": tuple(errors)}


def _places(problem: Problem, values: dict[str, Any]) -> list[Place]:
    """Return the place of each goal."""
    found = TreeQuantities(problem.form, problem.request, {**values, "S1": IDENTITY_MATRIX})
    jacobian = found.jacobian(in_frame=False)
    return [goal.place(found, jacobian) for goal in problem.goals]


def _slide(problem: Problem, columns: tuple[int, ...], values: dict[str, Any]) -> dict[str, Any]:
    """Return the coordinates after the step: one of least squares, which is exact for joints that shift only."""
    q, shifts = values["q"], shifts_by_column(problem.form)
    rows: list[Any] = []
    error: list[Any] = []
    places = _places(problem, values)
    for goal, part, (pose, moves) in zip(problem.goals, target_slices(problem.goals), places, strict=True):
        if goal.is_length:
            wanted = values["target"][part]
            error += [one - place for one, place in zip(wanted, goal.pose(pose), strict=True)]
            # By metres, whatever the pitch.
            rows += [[row[k] * (1 / shifts[k]) for k in columns] for row in moves[: len(wanted)]]
    new = [*q]
    for k, change in zip(columns, _damped_solution(rows, error, _SLIDE_DAMPING), strict=True):
        new[k] = q[k] + change * (1 / shifts[k])
    return {"q_new": tuple(new)}


def _step(problem: Problem, values: dict[str, Any]) -> dict[str, Any]:
    """Return the coordinates after a step towards a target, and the count of errors that exceed their tolerances."""
    q, (caution, position_tolerance, angle_tolerance, pull) = values["q"], values["options"]
    rows: list[Any] = []
    error: list[Any] = []
    misfit: Any = 0.0
    unmet: Any = 0.0
    places = _places(problem, values)
    slices = target_slices(problem.goals)
    for goal, part, weight, (pose, moves) in zip(problem.goals, slices, values["weights"], places, strict=True):
        tolerance = position_tolerance if goal.is_length else angle_tolerance
        own = goal.approach(pose, moves, values["target"][part], weight, tolerance)
        rows += own.rows
        error += own.error
        misfit = misfit + own.misfit
        unmet = unmet + own.unmet
    misfit = where_less(misfit, 0.0, 0.0, misfit)  # a cosine may exceed 1 by its rounding
    damping = misfit * _DAMPING + square_root(misfit) * caution + _LEAST_DAMPING

    moving = [
        k
        for k in range(problem.form.dof)
        if k not in problem.held and any(type(row[k]) is not float or row[k] != 0 for row in rows)
    ]
    new = [*q]
    if moving:
        rows = [[row[k] for k in moving] for row in rows]
        posture = [(values["posture"][k] - q[k]) * pull for k in moving] if "posture" in values else None
        limits = [(values["low"][k], values["high"][k]) for k in moving] if problem.bounded else None
        change = _change(rows, error, damping, [q[k] for k in moving], limits, posture)
        for j, k in enumerate(moving):
            end = q[k] + change[j]
            if limits:
                end = where_less(end, limits[j][0], limits[j][0], end)
                end = where_less(limits[j][1], end, limits[j][1], end)
            new[k] = end
    return {"q_new": tuple(new), "unmet": unmet}


def _change(
    rows: list[list[Any]],
    error: list[Any],
    damping: Any,
    q: list[Any],
    limits: list[tuple[Any, Any]] | None,
    posture: list[Any] | None,
) -> list[Any]:
    """Return the change of the coordinates in a step; `rows` and `posture` are changed in place."""
    if limits:  # joints at a limit that would leave it do not move
        for k, (low, high) in enumerate(limits):
            drive = sum_of(row[k] * part for row, part in zip(rows, error, strict=True))
            drive = drive + posture[k] if posture else drive
            below = where_less(low, q[k], 1.0, where_less(drive, 0.0, 0.0, 1.0))
            free = below * where_less(q[k], high, 1.0, where_less(0.0, drive, 0.0, 1.0))
            for row in rows:
                row[k] = row[k] * free
            if posture:
                posture[k] = posture[k] * free
    if posture:  # what it changes of the errors is taken back: it acts where nothing is wanted
        lost = [sum_of(x * z for x, z in zip(row, posture, strict=True)) for row in rows]
        error = [part - x for part, x in zip(error, lost, strict=True)]
    change = _damped_solution(rows, error, damping)
    if posture:
        change = [part + z for part, z in zip(change, posture, strict=True)]
    square = sum_of(part * part for part in change)
    factor = where_less(square, _MAX_STEP**2, 1.0, _MAX_STEP / square_root(square))
    return [part * factor for part in change]


def _damped_solution(rows: list[list[Any]], error: list[Any], damping: Any) -> list[Any]:
    """Return (J^T J + damping)^-1 J^T error = J^T (J J^T + damping)^-1 error, by the smaller of the matrices."""
    columns = [*zip(*rows, strict=True)]
    if len(columns) < len(rows):
        right = [sum_of(x * part for x, part in zip(column, error, strict=True)) for column in columns]
        return [*solve_symmetric(_products(columns, damping), tuple(right))[0]]
    y, _ = solve_symmetric(_products(rows, damping), tuple(error))
    return [sum_of(x * part for x, part in zip(column, y, strict=True)) for column in columns]


def _products(rows: Sequence[Sequence[Any]], damping: Any) -> tuple[Any, ...]:
    """Return the entries on and below the diagonal of A A^T + damping."""
    entries = []
    for i, row in enumerate(rows):
        for j in range(i + 1):
            entry = sum_of(x * y for x, y in zip(row, rows[j], strict=True))
            entries.append(entry + damping if i == j else entry)
    return tuple(entries)
