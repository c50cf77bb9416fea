"""The compiled equations of a robot in a simulation: what its state means, and the derivative of the state."""

from __future__ import annotations

from typing import Any

import numpy as np

from hingepair.engine.backend import execution_of
from hingepair.engine.calls import Call
from hingepair.engine.loops import Loop
from hingepair.engine.results import Results
from hingepair.mechanism.computations import RobotComputation
from hingepair.mechanism.constants import robot_constants
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.plans.simulation import MOTION, state_loop
from hingepair.plans.trees import request_loop

_BASE_INPUTS = ("S1", "omega1", "a1", "alpha1")  # inputs of programs of a base that rests or moves as given


class RobotPrograms:
    """Compiled equations of a robot whose base is held or moves as given or, with `has_momenta`, is free or pinned.

    Args:
        robot: the robot.
        base: "fixed", "free", "pinned" or "moving".
        links: links on which wrenches act.
        gravity: acceleration of free fall [m/s^2].
        backend: as for `simulate`.
    """

    def __init__(
        self, robot: Mechanism, base: str, links: tuple[str, ...], gravity: tuple[float, ...], backend: str
    ) -> None:
        self.has_momenta = base in ("free", "pinned")
        self._backend, self._gravity = execution_of(backend, 1).backend, gravity
        frames = tuple(tree_of(robot).known_frame("wrenches", link) for link in links)
        constants = robot_constants(tree_of(robot), robot.base == "free")
        loads = tuple(range(len(frames)))
        self._computation = RobotComputation(constants, ("qdd",), self.has_momenta, frames, loads, None)
        form, request = self._computation.form, self._computation.request
        matrices = ("mass_matrix", "bias_forces", *(("jacobian",) if frames else ()))
        if self.has_momenta:
            pinned, blank = base == "pinned", request._replace(outputs=())
            self._motion = self._call(state_loop(form, blank, pinned, MOTION), ("state", "S0"))
            terms = state_loop(form, blank, pinned, (*MOTION, "centre", *matrices))
            rates = state_loop(form, blank, pinned, ("rates",))
            self._terms = self._call(terms, ("state", "S0"))
        else:
            without_loads = request._replace(outputs=matrices, loaded=())
            self._terms = self._call(request_loop(form, without_loads), ("q", "qd", *_BASE_INPUTS))
            rates = request_loop(form, request)
        of_links = [f"{kind}_{k}" for k in loads for kind in ("force", "torque")]
        needed = {name for name, _ in rates.inputs}
        given = ("state", "S0", "tau", "force1", "torque1") if self.has_momenta else ("q", "qd", "tau", *_BASE_INPUTS)
        self._rates = self._call(rates, tuple(name for name in (*given, *of_links) if name in needed))
        self._links, self._loads = len(frames), ("force1", "torque1", *of_links)
        self._no_force: dict[int, Array] = {}  # zeros, by the number of instants

    def motion(self, states: Array, S0: Array) -> Any:
        """Return R1, S1, v1 and omega1 of a free or pinned base, by name."""
        return _run(self._motion, {"state": states, "S0": S0})

    def terms(self, **inputs: Array) -> tuple[Any, Array]:
        """Return the mass matrix and bias forces, of a free or pinned base also its motion and the centre of mass
        from R1, by name; and the Jacobians of the loaded links, (n, links, 6, velocities).
        """
        found = _run(self._terms, inputs)
        M = found["mass_matrix"]
        shape = (len(M), self._links, 6, M.shape[-1])
        return found, found["jacobian"].reshape(shape) if self._links else np.zeros(shape)

    def rates(self, inputs: dict[str, Array], on_bodies: tuple[Array, Array] | None) -> Array:
        """Return the derivative of the state of a free or pinned base, otherwise q''.

        Args:
            inputs: state, S0 and tau; otherwise q, qd, tau, S1, omega1, a1 and alpha1.
            on_bodies: force1 and torque1, shape (n, 6), and loads on links, shape (n, links, 6); None: no loads.
        """
        n = len(inputs["tau"])
        if on_bodies is None:
            loads = dict.fromkeys(self._loads, self._no_force.setdefault(n, np.zeros((n, 3))))
        else:
            base, wrenches = on_bodies
            loads = {"force1": base[:, :3], "torque1": base[:, 3:]}
            for k in range(self._links):
                loads |= {f"force_{k}": wrenches[:, k, :3], f"torque_{k}": wrenches[:, k, 3:]}
        found: Array = _run(self._rates, inputs | loads)
        return found

    def _call(self, loop: Loop, given: tuple[str, ...]) -> Call:
        """Return the call of a loop with the arguments `given`, as far as it has them; other inputs are constants."""
        known: dict[str, Any] = {**self._computation.known, "gravity": self._gravity}
        shapes = dict(loop.inputs)
        given = tuple(name for name in given if name in shapes)
        return Call(
            loop, {name: shapes[name] for name in given},
            {name: known[name] for name in shapes if name not in given},
            None if len(loop.outputs) == 1 else Results, backend=self._backend, shared=True,
        )  # fmt: skip


def _run(call: Call, values: dict[str, Array]) -> Any:
    """Return the results of a call for those of the values that are its arguments."""
    arrays = {name: np.ascontiguousarray(values[name], np.float64) for name in call.argument_shapes}
    results = call.rows(*arrays.values())
    if results is not None:
        return results
    return call.run(
        arrays, {name: array.shape[: array.ndim - len(call.argument_shapes[name])] for name, array in arrays.items()}
    )
