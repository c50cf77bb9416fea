"""How body 2's velocity depends on the velocities that the equations are written in (E2, E8, E9)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations import derivatives as by
from hingepair.errors import ArgumentError
from hingepair.evaluation.plan import steps_of
from hingepair.evaluation.steps import ARM_STEPS, Step
from hingepair.numeric.arrays import FloatArray
from hingepair.pair import forward_kinematics as kinematics
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import component, follow_steps, leading_shapes, read_coordinates
from hingepair.rotations.sequences import find_sequence

if TYPE_CHECKING:
    from hingepair.pair.hinge_pair import HingePair

_JACOBIAN = Step("jacobian", by.jacobian, ("turns", "d", "r2", "axis"))
_RATE = (
    Step("d_rate", by.difference_rate, ("omega1", "r1", "omega2", "r2")),
    Step("both_d", lambda *both: both, ("d", "d_rate")),
    Step("spin", lambda *all_: all_, ("omega1", "omega2", "axis")),
    Step("jacobian_rate", by.jacobian_rate, ("turns", "turn_rates", "both_d", "r2", "spin")),
)


def jacobian(pair: HingePair, body1: BodyMotion, psi: ArrayLike) -> FloatArray:
    """Body 2's velocity by the velocities of the equations: (v2, omega2) = Jac @ (v1, omega1, psi') (E8, E2).

    Args:
        body1: the motion of body 1; of it, S is used.
        psi: hinge angle [rad]; shape (...,), broadcasts against body1.

    Returns:
        Jac, world axes; shape (..., 6, 7).

    Raises:
        ArgumentError: an argument cannot be used; names it.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
    >>> pair.jacobian(hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), 0.0) @ (0, 0, 0, 0, 0, 1, 2)
    array([0., 4., 0., 0., 0., 3.])
    """
    constants = pair.constants
    values = {**motion_arrays("body1", body1, "S"), "psi": component("psi", psi)}
    shapes = {"body1": body1.shape, "psi": np.shape(psi)}
    world = Step("turns", lambda: by.WORLD, ())
    steps = (*steps_of(None, "home" in constants.values), *ARM_STEPS, world, _JACOBIAN)
    return follow_steps(steps, {"jacobian": (6, 7)}, constants, values, shapes)["jacobian"]


def acceleration_bias(pair: HingePair, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> FloatArray:
    """What velocities alone add to body 2's acceleration: (a2, alpha2) = Jac @ (a1, alpha1, psi'') + bias (E9).

    Args:
        body1: the motion of body 1; of it, S and omega are used.
        psi: hinge angle [rad]; shape (...,), broadcasts against body1.
        psid: hinge rate [rad/s]; likewise.

    Returns:
        The bias, world axes; shape (..., 6).

    Raises:
        ArgumentError: an argument cannot be used, or body1 has no omega; names it.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
    >>> body1 = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0))
    >>> pair.acceleration_bias(body1, 0.0, 2.0)
    array([-4.,  0.,  0.,  0.,  0.,  0.])
    """
    arrays = motion_arrays("body1", body1, "R", "S", "omega")
    if psid is None:
        raise ArgumentError("psid", "hinge rates", None)
    still = np.zeros(3, arrays["S1"].dtype)
    moving = BodyMotion(R=arrays["R1"], S=arrays["S1"], omega=arrays["omega1"], a=still, alpha=still)
    state = pair.forward_kinematics_from_body1(moving, psi, psid, 0.0, outputs=("a2", "alpha2"), backend="numpy")
    found = state.arrays()
    return np.concatenate([found["a2"], found["alpha2"]], axis=-1)


def coordinate_jacobian(pair: HingePair, q: ArrayLike | tuple[Any, ...], *, sequence: str = "XYZ") -> FloatArray:
    """Body 2's velocity by the rates of the seven coordinates: (v2, omega2) = Jq @ qd (E8, E2, E4).

    Args:
        q: coordinates [m, rad], in either form that forward_kinematics takes.
        sequence: the Euler sequence of body 1.

    Returns:
        Jq, world axes; shape (..., 6, 7).

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
    >>> pair.coordinate_jacobian(np.zeros(7)) @ (0, 0, 0, 0, 0, 1, 2)
    array([0., 4., 0., 0., 0., 3.])
    """
    return _by_coordinates(pair.constants, "jacobian", q, None, sequence)


def coordinate_jacobian_rate(
    pair: HingePair, q: ArrayLike | tuple[Any, ...], qd: ArrayLike | tuple[Any, ...], *, sequence: str = "XYZ"
) -> FloatArray:
    """The time derivative of coordinate_jacobian: (a2, alpha2) = Jq @ qdd + Jq' @ qd (E9).

    Args:
        q: coordinates [m, rad], in either form that forward_kinematics takes.
        qd: their time derivatives.
        sequence: the Euler sequence of body 1.

    Returns:
        Jq', world axes; shape (..., 6, 7).

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
    >>> qd = np.array((0, 0, 0, 0, 0, 0, 2.0))
    >>> pair.coordinate_jacobian_rate(np.zeros(7), qd) @ qd
    array([-4.,  0.,  0.,  0.,  0.,  0.])
    """
    if qd is None:
        raise ArgumentError("qd", "the coordinates' rates", None)
    return _by_coordinates(pair.constants, "jacobian_rate", q, qd, sequence)


def _by_coordinates(pair: Constants, result: str, q: Any, qd: Any, sequence: str) -> FloatArray:
    order = find_sequence(sequence)
    given = read_coordinates(q, qd, None, kinematics.COORDINATES)
    steps = (
        *steps_of(sequence, "home" in pair.values),
        *ARM_STEPS,
        Step("turns", order.columns, ("axes",)),
        Step("turn_rates", order.column_rates, ("axes", "phid")),
        _JACOBIAN,
        *_RATE,
    )
    values = kinematics.values_of(given)
    return follow_steps(steps, {result: (6, 7)}, pair, values, leading_shapes(given))[result]
