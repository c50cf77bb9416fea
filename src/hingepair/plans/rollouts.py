"""One step of a robot in time, forwards and backwards: forward dynamics and the step of a method in one program.

A state has the parts q, qd, and of a free base R1, v1, omega1 and S1. The attitude of a free base is turned by the
exponential of its angular velocity: S1' = exp(h omega1) S1.

A step of "semi_implicit" Euler takes q'' at its start, then qd' = qd + h q'', q' = q + h qd'. A step of "rk4" repeats
one program four times, a stage each. Its vectors `stage` and `total` have in place of S1 the rotation vector by which
the base has turned since the start of the step. The rate of that vector is w - turn x w / 2 + turn x (turn x w) / 12,
with w = omega1 (Munthe-Kaas).
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from hingepair.engine.binding import ArrayShape
from hingepair.engine.loops import Loop
from hingepair.engine.trace import square_root, where_less
from hingepair.equations.spatial import ZERO_VECTOR, Matrix, Scalar, Vector, add, compose, cross, dot, scale, subtract
from hingepair.numeric.blocks import cosine, sine
from hingepair.plans.changes import change_shape
from hingepair.plans.derivatives import Derivative, derivative_loop
from hingepair.plans.trees import Form, TreeQuantities, TreeRequest, input_shapes

METHODS = ("semi_implicit", "rk4")  # of integration, explained above
BASE_STATE = {"R1": (3,), "v1": (3,), "omega1": (3,), "S1": (3, 3)}
"""What of a free base follows q and qd in a state, with the shape of one sample."""

Values = Mapping[str, Any]


class Control(NamedTuple):
    """Where the efforts of the joints come from: given numbers, or feedback of q and qd."""

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
        """Return a gain times errors: entry by entry, or as a matrix given row by row."""
        if self.gains == "diagonal":
            return [a * b for a, b in zip(gain, errors, strict=True)]
        size = len(errors)
        rows = (gain[size * k : size * (k + 1)] for k in range(size))
        return [sum((a * b for a, b in zip(row, errors, strict=True)), 0.0) for row in rows]


class RolloutStep(NamedTuple):
    """A step, or a stage of one, of a robot."""

    form: Form  # form of the robot
    request: TreeRequest  # says whether the base is free, and where wrenches act; it has no outputs
    method: str  # one of METHODS
    control: Control  # where the efforts come from

    @property
    def stages(self) -> int:
        """How often the program runs in a step."""
        return 4 if self.method == "rk4" else 1

    @property
    def state(self) -> dict[str, ArrayShape]:
        """Parts of a state in order, with the shape of one sample."""
        return {"q": (self.form.dof,), "qd": (self.form.dof,), **(BASE_STATE if self.request.free else {})}

    @property
    def passed(self) -> dict[str, ArrayShape]:
        """All that passes from stage to stage: the state at the start of the step, and vectors of the method."""
        size = 2 * self.form.dof + 12 * self.request.free
        return self.state | ({} if self.stages == 1 else dict.fromkeys(("stage", "total"), (size,)))

    @property
    def solved(self) -> TreeRequest:
        """The request of accelerations."""
        return self.request._replace(outputs=("a1", "alpha1", "qdd") if self.request.free else ("qdd",))


@functools.lru_cache(maxsize=64)
def step_loop(step: RolloutStep) -> Loop:
    """Return the cached loop of a step or stage. The next value of q is its output next_q."""
    own = {"tau", "force1", "torque1"}
    inputs = {name: tail for name, tail in input_shapes(step.form, step.solved).items() if name not in own}
    inputs |= step.control.shapes(step.form.dof) | step.passed | {"h": ()}
    if step.stages > 1:
        inputs["shares"] = (3,)
    outputs = {f"next_{name}": tail for name, tail in step.passed.items()}
    return Loop("rollout", functools.partial(_next, step), inputs, outputs, form=("rollout", step))


@functools.lru_cache(maxsize=64)
def backward_loop(step: RolloutStep, wrt: tuple[str, ...], held: tuple[str, ...]) -> Loop:
    """Return the loop that takes the derivatives of a loss by what a step or stage passes on, `adjoint_q` and so on,
    back to its start.

    Its input `weight_q` holds the derivatives by the recorded q alone, which count where the step is the last one
    of a record, and `ends` is 1. The derivatives by further inputs, the names in `wrt`, are added to sums: `sum_tau`
    begins anew where `begins` is 1, unless the name is in `held`, and tau does not change from step to step.
    """
    plain = step_loop(step)
    changes = {name: change_shape(name, tail) for name, tail in step.passed.items()}
    shapes = dict(plain.inputs)
    derivative = Derivative(
        "vjp", tuple(f"next_{name}" for name in changes), tuple((name, shapes[name]) for name in (*changes, *wrt))
    )
    gradients = derivative_loop(plain, derivative)

    def function(v: Mapping[str, Any]) -> dict[str, Any]:
        """Take the adjoints of the state back by a step or stage, and add the derivatives by `wrt` to their sums."""
        weights = {f"weight_next_{name}": v[f"adjoint_{name}"] for name in changes}
        for name in step.state:
            weights[f"weight_next_{name}"] = _ahead(v[f"adjoint_{name}"], v[f"weight_{name}"], v["ends"])
        found = gradients.function({**v, **weights})
        results = {f"next_adjoint_{name}": found[f"gradient_{name}"] for name in changes}
        for name in wrt:
            kept = v[f"sum_{name}"] if name in held else [x * (1 - v["begins"]) for x in v[f"sum_{name}"]]
            results[f"next_sum_{name}"] = _sums(kept, found[f"gradient_{name}"])
        return results

    sums = {f"sum_{name}": shapes[name] for name in wrt}
    passed = {f"adjoint_{name}": tail for name, tail in changes.items()} | sums
    weights = {f"weight_{name}": changes[name] for name in step.state}
    return Loop(
        "rollout_gradient", function, {**shapes, **passed, **weights, "ends": (), "begins": ()},
        {f"next_{name}": tail for name, tail in passed.items()}, form=("rollout gradient", step, wrt, held),
    )  # fmt: skip


def _next(step: RolloutStep, v: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a step or stage passes on."""
    following = _semi_implicit(step, v) if step.stages == 1 else _stage(step, v)
    return {f"next_{name}": value for name, value in following.items()}


def _accelerations(step: RolloutStep, v: Mapping[str, Any], moved: Mapping[str, Any]) -> dict[str, Any]:
    """Return the accelerations where coordinates, rates and a free base have other values than those given. Dry
    friction stops a joint within the step at most; a damper acts on the rate at the end of a semi-implicit step.
    """
    tau = step.control.efforts(v, moved["q"], moved["qd"])
    own = {"constants", *input_shapes(step.form, step.solved)}
    values = {**{name: v[name] for name in own & v.keys()}, **moved, "tau": tau, "step": v["h"]}
    if step.stages == 1:
        values["implicit_step"] = v["h"]
    values |= dict.fromkeys(("force1", "torque1"), ZERO_VECTOR)
    return dict(zip(("a1", "alpha1", "qdd"), TreeQuantities(step.form, step.solved, values).solved, strict=True))


def _semi_implicit(step: RolloutStep, v: Mapping[str, Any]) -> dict[str, Any]:
    """Return the state after a step of "semi_implicit"."""
    h, moved = v["h"], {name: v[name] for name in step.state}
    found = _accelerations(step, v, {name: moved[name] for name in moved if name not in {"R1", "v1"}})
    qd = _ahead(v["qd"], found["qdd"], h)
    following = {"q": _ahead(v["q"], qd, h), "qd": qd}
    if step.request.free:
        v1, omega1 = _ahead(v["v1"], found["a1"], h), _ahead(v["omega1"], found["alpha1"], h)
        turned = _turned(scale(omega1, h), v["S1"])
        following |= {"R1": _ahead(v["R1"], v1, h), "v1": v1, "omega1": omega1, "S1": turned}
    return following


def _stage(step: RolloutStep, v: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a stage of "rk4" passes on. `shares` are those of a step until the next stage, and of the stage in
    the mean; and whether the stage is the last one.
    """
    ahead, share, is_last = v["shares"]
    to_next, weight = v["h"] * ahead, v["h"] * share
    state, now, dof = step.state, v["stage"], step.form.dof
    parts = {"q": now[:dof], "qd": now[dof : 2 * dof]}
    start = (*v["q"], *v["qd"])
    if step.request.free:
        _, v1, omega1, turn = (now[2 * dof + 3 * k : 2 * dof + 3 * k + 3] for k in range(4))
        parts |= {"omega1": omega1, "S1": _turned(turn, v["S1"])}
        start = (*start, *v["R1"], *v["v1"], *v["omega1"], 0.0, 0.0, 0.0)
    found = _accelerations(step, v, parts)
    rates = (*parts["qd"], *found["qdd"])
    if step.request.free:
        across = cross(turn, omega1)
        turning = add(subtract(omega1, scale(across, 0.5)), scale(cross(turn, across), 1 / 12))
        rates = (*rates, *v1, *found["a1"], *found["alpha1"], *turning)
    total = _ahead(v["total"], rates, weight)
    moved = total
    ends = {"q": total[:dof], "qd": total[dof : 2 * dof]}
    if step.request.free:
        ends |= {name: total[2 * dof + 3 * k : 2 * dof + 3 * k + 3] for k, name in enumerate(("R1", "v1", "omega1"))}
        ends["S1"] = _turned(total[-3:], v["S1"])
        moved = (*total[:-3], 0.0, 0.0, 0.0)
    following = {name: _either(is_last, ends[name], v[name]) for name in state}
    following["stage"] = _either(is_last, moved, _ahead(start, rates, to_next))
    following["total"] = _either(is_last, moved, total)
    return following


def _either(condition: Scalar, then: Iterable[Scalar], otherwise: Iterable[Scalar]) -> tuple[Scalar, ...]:
    """Return one of two vectors; a condition is 1 or 0."""
    return tuple(where_less(0.0, condition, a, b) for a, b in zip(then, otherwise, strict=True))


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
