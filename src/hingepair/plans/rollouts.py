"""One step of a robot in time: forward dynamics and the step of a method in one program.

A state is one vector: q, qd, and of a free base R1, v1, omega1 and S1. The attitude of a free base is turned by the
exponential of its angular velocity: S1' = exp(h omega1) S1.

A step of "semi_implicit" Euler takes q'' at its start, then qd' = qd + h q'', q' = q + h qd'. A step of "rk4" is four
runs of one program, a stage, whose vectors have in place of S1 the rotation vector by which the base has turned since
the start of the step. The rate of that vector is w - turn x w / 2 + turn x (turn x w) / 12, with w = omega1
(Munthe-Kaas).
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from hingepair.engine.binding import ArrayShape
from hingepair.engine.loops import Loop
from hingepair.engine.trace import square_root, where_less
from hingepair.equations.spatial import ZERO_VECTOR, Matrix, Scalar, Vector, add, compose, cross, dot, scale, subtract
from hingepair.numeric.blocks import cosine, sine
from hingepair.plans.trees import Computation, Form, Request, input_shapes

METHODS = ("semi_implicit", "rk4")
BASE_STATE = {"R1": (3,), "v1": (3,), "omega1": (3,), "S1": (3, 3)}
"""What of a free base follows q and qd in a state, with the shape of one sample."""

Values = Mapping[str, Any]


class Control(NamedTuple):
    """Where the efforts of the joints come from."""

    gains: str  # "none": tau is given; "diagonal" or "full": feedback with such gains
    limited: bool  # whether efforts are clipped to the input "limit"

    def shapes(self, dof: int) -> dict[str, ArrayShape]:
        """Return the shapes of one sample of its inputs."""
        names = ("tau",) if self.gains == "none" else ("q_ref", "qd_ref", "tau_ff")
        shapes: dict[str, ArrayShape] = dict.fromkeys(names, (dof,))
        if self.gains != "none":
            shapes |= dict.fromkeys(("K", "D"), (dof,) if self.gains == "diagonal" else (dof, dof))
        return shapes | ({"limit": (dof,)} if self.limited else {})

    def efforts(self, v: Values, q: Any, qd: Any) -> tuple[Scalar, ...]:
        """Return the efforts of the joints at q and qd."""
        tau = v["tau" if self.gains == "none" else "tau_ff"]
        if self.gains != "none":
            for gain, wanted, found in (("K", "q_ref", q), ("D", "qd_ref", qd)):
                errors = [a - b for a, b in zip(v[wanted], found, strict=True)]
                tau = _sums(tau, self._products(v[gain], errors))
        if self.limited:
            pairs = zip(tau, v["limit"], strict=True)
            tau = tuple(where_less(x, -most, -most, where_less(most, x, most, x)) for x, most in pairs)
        return tuple(tau)

    def _products(self, gain: Any, errors: list[Scalar]) -> list[Scalar]:
        if self.gains == "diagonal":
            return [a * b for a, b in zip(gain, errors, strict=True)]
        size = len(errors)
        rows = (gain[size * k : size * (k + 1)] for k in range(size))
        return [sum((a * b for a, b in zip(row, errors, strict=True)), 0.0) for row in rows]


@functools.lru_cache(maxsize=64)
def step_loop(form: Form, request: Request, method: str, control: Control) -> Loop:
    """Return the cached loop of a step, `state` -> `end`; of "rk4" that of a stage, which takes `state`, the vectors
    `stage` and `total`, and returns the next ones, with `end` after the last. The parts of `end` are outputs, too.
    The request, which has no outputs, says whether the base is free, and where wrenches act.
    """
    solved = request._replace(outputs=("qdd", "a1", "alpha1") if request.free else ("qdd",))
    own = {"q", "qd", "tau", "force1", "torque1", *(BASE_STATE if request.free else ())}
    inputs = {name: tail for name, tail in input_shapes(form, solved).items() if name not in own}
    size = 2 * form.dof + 18 * request.free
    inputs |= control.shapes(form.dof) | {"state": (size,)}
    outputs: dict[str, ArrayShape] = {"end": (size,)}
    if method == "semi_implicit":
        inputs["h"] = ()
    else:
        inputs |= {"h": (), "ahead": (), "weight": ()}  # step, and shares of it: to the next stage, in the mean
        inputs |= dict.fromkeys(("stage", "total"), (stage_size(form, request),))
        outputs |= dict.fromkeys(("stage_next", "total_next"), (stage_size(form, request),))
    outputs |= state_parts(form, request)
    function = _semi_implicit if method == "semi_implicit" else _stage
    return Loop(
        "rollout", functools.partial(function, form, solved, control), inputs, outputs,
        form=("rollout", form, solved, method, control),
    )  # fmt: skip


def state_parts(form: Form, request: Request) -> dict[str, ArrayShape]:
    """Return the parts of a state in order, with the shape of one sample."""
    return {"q": (form.dof,), "qd": (form.dof,), **(BASE_STATE if request.free else {})}


def stage_size(form: Form, request: Request) -> int:
    """Return the number of components of a stage: q, qd, and of a free base R1, v1, omega1 and its turn."""
    return 2 * form.dof + 12 * request.free


def _accelerations(
    form: Form, request: Request, control: Control, v: Values, q: Any, qd: Any, base: Values
) -> tuple[Vector, Vector, tuple[Scalar, ...]]:
    """Return a1 and alpha1 of a free base, and qdd. Dry friction stops a joint within the step at most."""
    values = {**v, **base, "q": q, "qd": qd, "tau": control.efforts(v, q, qd), "step": v["h"]}
    values |= dict.fromkeys(("force1", "torque1"), ZERO_VECTOR)
    a1, alpha1, qdd = Computation(form, request, values).solved
    return a1, alpha1, qdd


def _with_parts(form: Form, request: Request, results: dict[str, Any]) -> dict[str, Any]:
    """Add the parts of the state at the end to the results."""
    numbers = iter(results["end"])
    parts = {
        name: tuple(itertools.islice(numbers, math.prod(tail))) for name, tail in state_parts(form, request).items()
    }
    return results | parts


def _semi_implicit(form: Form, request: Request, control: Control, v: Values) -> dict[str, Any]:
    h, state, dof = v["h"], v["state"], form.dof
    q, qd = state[:dof], state[dof : 2 * dof]
    if not request.free:
        _, _, qdd = _accelerations(form, request, control, v, q, qd, {"implicit_step": h})
        qd = _ahead(qd, qdd, h)
        return _with_parts(form, request, {"end": (*_ahead(q, qd, h), *qd)})
    R1, v1, omega1, S1 = _base(state[2 * dof :])
    a1, alpha1, qdd = _accelerations(
        form, request, control, v, q, qd, {"omega1": omega1, "S1": S1, "implicit_step": h}
    )
    qd, v1, omega1 = _ahead(qd, qdd, h), _ahead(v1, a1, h), _ahead(omega1, alpha1, h)
    end = (*_ahead(q, qd, h), *qd, *_ahead(R1, v1, h), *v1, *omega1, *_turned(scale(omega1, h), S1))
    return _with_parts(form, request, {"end": end})


def _stage(form: Form, request: Request, control: Control, v: Values) -> dict[str, Any]:
    state, stage, total, dof = v["state"], v["stage"], v["total"], form.dof
    to_next, share = v["h"] * v["ahead"], v["h"] * v["weight"]
    q, qd = stage[:dof], stage[dof : 2 * dof]
    if not request.free:
        _, _, qdd = _accelerations(form, request, control, v, q, qd, {})
        rates, end = (*qd, *qdd), _ahead(total, (*qd, *qdd), share)
        results = {"stage_next": _ahead(state, rates, to_next), "total_next": end, "end": end}
        return _with_parts(form, request, results)
    start, S1 = state[: 2 * dof + 9], state[2 * dof + 9 :]
    _, v1, omega1, turn = (stage[2 * dof + 3 * k : 2 * dof + 3 * k + 3] for k in range(4))
    base = {"omega1": omega1, "S1": _turned(turn, S1)}
    a1, alpha1, qdd = _accelerations(form, request, control, v, q, qd, base)
    across = cross(turn, omega1)
    turning = add(subtract(omega1, scale(across, 0.5)), scale(cross(turn, across), 1 / 12))
    rates = (*qd, *qdd, *v1, *a1, *alpha1, *turning)
    total = _ahead(total, rates, share)
    results = {
        "stage_next": _ahead((*start, 0.0, 0.0, 0.0), rates, to_next), "total_next": total,
        "end": (*total[:-3], *_turned(total[-3:], S1)),
    }  # fmt: skip
    return _with_parts(form, request, results)


def _base(numbers: Any) -> tuple[Vector, Vector, Vector, Matrix]:
    return numbers[0:3], numbers[3:6], numbers[6:9], numbers[9:18]


def _sums(x: Any, y: Any) -> tuple[Scalar, ...]:
    return tuple(a + b for a, b in zip(x, y, strict=True))


def _ahead(x: Any, rates: Any, h: Scalar) -> Any:
    return tuple(a + h * b for a, b in zip(x, rates, strict=True))


def _turned(turn: Vector, S: Matrix) -> Matrix:
    """Return exp([turn]x) S."""
    square = dot(turn, turn) * 0.25
    half = square_root(square)
    sine_over = where_less(0.0, square, sine(half) / half, 1.0)  # of half the angle, over it
    first, second = sine_over * cosine(half), 0.5 * (sine_over * sine_over)
    x, y, z = turn
    ax, ay, az, bx, by, bz = first * x, first * y, first * z, second * x, second * y, second * z
    rotation = (
        1 - (by * y + bz * z), bx * y - az, bx * z + ay,
        bx * y + az, 1 - (bx * x + bz * z), by * z - ax,
        bx * z - ay, by * z + ax, 1 - (bx * x + by * y),
    )  # fmt: skip
    return compose(rotation, S)
