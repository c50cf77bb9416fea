"""Prepared calls, which compute given outputs of a pair from given inputs."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.calls import Call, Out
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.numeric.array_libraries import library_of
from hingepair.numeric.arrays import real_array, vectors
from hingepair.pair import dynamics
from hingepair.pair.constants import ADDED_HINGE_FRAME_VECTOR_NAMES, Constants, with_hinge_frames
from hingepair.pair.derivatives import POSE_SENSITIVITY_NAMES, VELOCITY_SENSITIVITY_NAMES
from hingepair.pair.evaluate import BODY1_QUATERNION_INPUT_NAMES, cached_call
from hingepair.pair.forward_kinematics import check_out
from hingepair.plans.dynamics_steps import (
    DYNAMICS_CONSTANT_NAMES,
    FORWARD_DYNAMICS_LOAD_NAMES,
    FORWARD_DYNAMICS_OUTPUT_NAMES,
    INVERSE_DYNAMICS_OUTPUT_NAMES,
)
from hingepair.plans.plan import SPATIAL_MOTION_KIND, Plan, check_outputs, default_outputs, make_plan, needed_steps
from hingepair.plans.steps import ATTITUDE1_AND_CHECK_STEPS_BY_INPUT_NAME
from hingepair.rotations.sequences import find_sequence

# The names of inputs for which a keyword such as "velocity" stands.
_INPUT_NAMES_BY_PREPARED_COMPUTATION_NAME: Final = {
    "pose": ("q",),
    "velocity": ("q", "qd"),
    "acceleration": ("q", "qd", "qdd"),
    "inverse_dynamics": ("S1", "omega1", "a1", "alpha1", "psi", "psid", "psidd"),
    "forward_dynamics": ("S1", "omega1", "psi", "psid", *INVERSE_DYNAMICS_OUTPUT_NAMES),
}
# All inputs that a prepared call can take.
_ALLOWED_INPUT_NAMES: Final = (
    *("q", "qd", "qdd", "psi", "psid", "psidd", "R1", "S1", "v1", "omega1", "a1", "alpha1"),
    *("R2", "S2", "v2", "omega2", "a2", "alpha2", *BODY1_QUATERNION_INPUT_NAMES, *FORWARD_DYNAMICS_LOAD_NAMES),
)
_TWO_BODY_OUTPUT_NAMES: Final = (
    *("gap", "tilt", "tilt_angle", "psi", "gap_rate", "tilt_rate", "slip", "psid", "gap_acceleration"),
    *("tilt_acceleration", "psidd", "constraint_jacobian", "constraint_bias"),
)
"""Outputs that need the motions of both bodies."""
_ALLOWED_OUTPUT_NAMES: Final = (
    *SPATIAL_MOTION_KIND.levels,
    *("jacobian", "coordinate_jacobian", "coordinate_jacobian_rate", "acceleration_bias"),
    *POSE_SENSITIVITY_NAMES,
    *VELOCITY_SENSITIVITY_NAMES,
    *_TWO_BODY_OUTPUT_NAMES,
    *INVERSE_DYNAMICS_OUTPUT_NAMES,
    *("bearing_torque", "mass_matrix", "kinetic", "potential", "linear", "angular"),
)
"""All outputs that a prepared call can compute."""


class Prepared:
    """Callable that computes given outputs from given inputs of a pair, and that was planned, checked and compiled
    before. `HingePair.prepare` returns it.

    Call it with one array for each name in `given`, in this order. It can be copied and pickled.

    Attributes:
        given: names of the inputs, in the order of the arguments.
        outputs: names of the computed outputs.
    """

    def __init__(self, call: Call, pair: Constants, plan: Plan, workers: int, recipe: tuple[Any, ...]) -> None:
        self.given, self.outputs = tuple(call.argument_shapes), call.outputs
        self._call, self._pair, self._plan, self._workers, self._recipe = call, pair, plan, workers, recipe

    def __repr__(self) -> str:
        return f"Prepared(given={self.given}, outputs={self.outputs})"

    def __reduce__(self) -> tuple[Any, ...]:
        return prepare, self._recipe

    @property
    def source(self) -> str:
        """Generated Python code of the call, which runs if nothing is compiled."""
        return self._call.program.source

    @property
    def ufunc(self) -> np.ufunc:
        """The kernel itself, a generalised ufunc of NumPy such as "(7),(7)->(3),(3,3)". It follows NumPy's rules of
        broadcasting and casting (small integers, bool and float16 become float32), and checks no rotation. It stays
        in memory, cannot be pickled, and returns the outputs in order.

        >>> import hingepair as hp, numpy as np
        >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
        >>> f = pair.prepare("pose", outputs=("R2", "d")).ufunc
        >>> f.signature
        '(7)->(3),(3)'
        >>> R2, d = f(np.zeros((2, 5, 7)))
        >>> R2.shape
        (2, 5, 3)
        """
        return self._call.ufunc

    @property
    def llvm(self) -> str:
        """Generated LLVM code of the call, which is compiled for one state and for rows of states."""
        return self._call.llvm

    def __call__(self, *given: Any, out: Out = None) -> Any:
        """Compute the PairState of one sample or many from the inputs that the call was prepared for.

        Args:
            *given: the inputs, in the order of the attribute `given`; shape (..., 7), (..., 3), (..., 3, 3), (..., 4)
                or (...,). They broadcast.
            out: dict of arrays by output name; the results are written into them. A call that raises an error for an
                unusable argument does not change them.

        Raises:
            ArgumentError: an argument cannot be used; the error names it.
        """
        call = self._call
        if len(given) != len(self.given):
            raise ArgumentError("*given", f"{len(self.given)} arguments: {', '.join(self.given)}", f"{len(given)}")
        state = (
            call.rows(*given)
            if out is None and self._workers == 1
            else call.rows(*given, out=out, workers=self._workers)
        )
        return self._call_any_arguments(given, out) if state is None else state

    def _call_any_arguments(self, given: Sequence[Any], out: Out) -> Any:
        """Compute the PairState for arguments of any kind, such as lists and arrays of other libraries, which
        the fast paths do not take. `given` holds the values of the inputs, in the order of the names in
        `self.given`. Results are written into the arrays of the dict `out`, if given. Raise ArgumentError for
        unusable arguments.
        """
        values = dict(zip(self.given, given, strict=True))
        check_out(out, self.outputs)
        library = library_of(values)
        sample_shapes = self._call.argument_shapes
        if library is not None:  # it is not checked that attitudes are rotations
            shapes = {name: np.shape(v)[: np.ndim(v) - len(sample_shapes[name])] for name, v in values.items()}
            plan = Plan(self.outputs, *needed_steps(self._plan.steps, self.outputs), self._plan.kind)
            call = cached_call(self._pair, plan, self.given, "auto")
            return call.run_foreign(values, shapes, library, out, self._workers)
        arrays = {name: _input_array(name, value, sample_shapes[name]) for name, value in values.items()}
        shapes = {name: a.shape[: a.ndim - len(sample_shapes[name])] for name, a in arrays.items()}
        return self._call.run(arrays, shapes, out, self._workers)


def _input_array(name: str, value: Any, sample_shape: tuple[int, ...]) -> NDArray[Any]:
    """Return the value of the input `name` as an array whose last axes have the shape `sample_shape`. Raise
    ArgumentError if the value is None, and ShapeError or DtypeError if it is unusable.
    """
    if value is None:
        raise ArgumentError(name, "a value, since the call was prepared for it", None)
    return vectors(name, value, *sample_shape) if sample_shape else real_array(name, value)


def prepare(
    pair: Any,
    given: str | Iterable[str],
    outputs: Iterable[str] | None,
    sequence: str,
    gravity: ArrayLike,
    execution: Execution,
) -> Prepared:
    """Return the Prepared call that `HingePair.prepare` describes, for inputs `given` (a keyword such as "velocity",
    or names) and for the names `outputs`, or default outputs if this is None. Compile the call if the backend of
    `execution` is "auto" or "compiled". `pair` is a HingePair, `sequence` the Euler sequence of body 1. Raise
    ArgumentError for unknown names, missing inputs and missing masses; issue a DynamicsWarning for assumed masses.
    """
    names = _checked_input_names(given)
    bodies, constants = (pair.body1, pair.body2), pair.constants
    forward = any(name in FORWARD_DYNAMICS_LOAD_NAMES for name in names)
    if outputs is None and forward:
        outputs = FORWARD_DYNAMICS_OUTPUT_NAMES
    elif outputs is None and given == "inverse_dynamics":
        outputs = INVERSE_DYNAMICS_OUTPUT_NAMES
    rows = "q" in names
    if rows:
        find_sequence(sequence)
    level = sum(name in names for name in (("qd", "qdd") if rows else ("psid", "psidd")))
    output_names = default_outputs(level) if outputs is None else check_outputs(outputs, _ALLOWED_OUTPUT_NAMES)
    plan_of = functools.partial(make_plan, sequence=sequence if rows else None, has_home="home" in constants.values)
    checks = (*(() if rows else ("attitude1_check",)), *(("attitude2_check",) if "S2" in names else ()))
    plan = plan_of((*output_names, *checks), given_names=names)
    if not plan.inputs.isdisjoint(DYNAMICS_CONSTANT_NAMES):
        constants = dynamics.with_loads_and_masses(constants, bodies, gravity, plan.inputs)
    if forward:
        dynamics.check_nonsingular_mass_matrix(constants, bodies)
    if "S2" in names:
        constants = with_hinge_frames(constants)
    known_names = {*names, *constants.values}
    for name in output_names:
        of_both = names if forward or name not in _TWO_BODY_OUTPUT_NAMES else (*names, "S2")
        missing = sorted(plan_of((name,), given_names=of_both).inputs - known_names - ADDED_HINGE_FRAME_VECTOR_NAMES)
        if missing:  # a plan without q takes the results of coordinates as inputs
            needed = ", ".join("q" if one == name else one for one in missing)
            raise ArgumentError("given", f"names with {needed}, which output {name} needs", ", ".join(names))
    call = cached_call(constants, plan, names, execution.backend, shared=False)
    if execution.backend == "auto":
        call.compile()
    return Prepared(
        call, constants, plan, execution.workers, (pair, names, output_names, sequence, gravity, execution)
    )


def _checked_input_names(given: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of the inputs for which `given` (a keyword such as "velocity", or the names themselves)
    stands, as a tuple. Raise ArgumentError for unknown or repeated names, or unless exactly one of the inputs gives
    the attitude of body 1.
    """
    try:
        names = _INPUT_NAMES_BY_PREPARED_COMPUTATION_NAME[given] if isinstance(given, str) else tuple(given)
    except (KeyError, TypeError):
        raise ArgumentError(
            "given",
            f"{choices(tuple(_INPUT_NAMES_BY_PREPARED_COMPUTATION_NAME))}, or a tuple of names",
            quoted(given),
        ) from None
    for name in names:
        if name not in _ALLOWED_INPUT_NAMES:
            raise ArgumentError("given", choices(tuple(_ALLOWED_INPUT_NAMES)), quoted(name))
    attitudes = [name for name in names if name in {"q", *ATTITUDE1_AND_CHECK_STEPS_BY_INPUT_NAME}]
    if len(attitudes) != 1 or len({*names}) != len(names):
        raise ArgumentError("given", "one attitude of body 1: q, S1, quat_xyzw or quat_wxyz", quoted(names))
    return names
