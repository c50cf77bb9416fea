"""The steps of motion whose turns are all about z (E11), as the compiled kernels run them; see `kernel_steps`.

A planar pair takes the same steps: its third components are rows that nothing reads.
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

from numba import njit
from numba.extending import register_jitable

from hingepair.equations import planar
from hingepair.equations import spatial as eq
from hingepair.evaluation.kernel_math import FLAGS, sines
from hingepair.evaluation.kernel_rows import LANES, OPERATIONS, ROWS
from hingepair.evaluation.kernel_steps import matrix, put_vector, vector

for _function in vars(planar).values():
    if isinstance(_function, FunctionType) and _function.__module__ == planar.__name__:
        register_jitable(_function)

_PHI1, _PHI1D, _PHI1DD, _PHI2 = (ROWS[name] for name in ("phi1", "phi1d", "phi1dd", "phi2"))
_PSI, _PSID, _PSIDD, _HINGE = (ROWS[name] for name in ("psi", "psid", "psidd", "hinge"))
_TURN1, _TURN2, _N, _HOME = (ROWS[name] for name in ("turn1", "turn2", "n", "home"))
_R1, _U1, _U2, _ARM1, _ARM2 = (ROWS[name] for name in ("R1", "u1", "u2", "r1", "r2"))
_S1, _S2, _V1, _V2, _A1, _A2 = (ROWS[name] for name in ("S1", "S2", "v1", "v2", "a1", "a2"))
_OMEGA1, _OMEGA2, _ALPHA1, _ALPHA2 = (ROWS[name] for name in ("omega1", "omega2", "alpha1", "alpha2"))
_SINES1, _TURN, _TURN_HOME, _ANGLE2 = (OPERATIONS.index(name) for name in ("turn1", "turn2", "turn2_home", "phi2"))
_ATTITUDE1, _ATTITUDE2, _ARM_1, _ARM_2 = (OPERATIONS.index(f"flat_{name}") for name in ("S1", "S2", "r1", "r2"))
_RATE1, _RATE2, _RATE1D, _RATE2D = (
    OPERATIONS.index(f"flat_{name}") for name in ("omega1", "omega2", "alpha1", "alpha2")
)
_OFFSET, _D = OPERATIONS.index("flat_d"), ROWS["d"]
_VELOCITY2, _ACCELERATION2, _FRAME = (OPERATIONS.index(f"flat_{name}") for name in ("v2", "a2", "frame"))
_PLANAR_FRAME = OPERATIONS.index("planar_frame")


@register_jitable
def _plane(s: Any, row: int, k: int) -> Any:
    return s[row + k], s[row + LANES + k]


@register_jitable
def _put_turn(s: Any, k: int, turn: Any) -> None:
    s[_TURN2 + k], s[_TURN2 + LANES + k] = turn


@register_jitable
def _put_attitude(s: Any, row: int, turn: int) -> None:
    """The four components of a turn about z that move; the others stand in the frame."""
    for k in range(LANES):
        m = planar.flat_attitude(_plane(s, turn, k))
        s[row + k], s[row + LANES + k], s[row + 3 * LANES + k], s[row + 4 * LANES + k] = m[0], m[1], m[3], m[4]


@register_jitable
def _put_frame(s: Any, one: float) -> None:
    """What is zero or one all the time: turns about z leave z alone."""
    for k in range(2 * LANES):
        for row in (_OMEGA1, _OMEGA2, _ALPHA1, _ALPHA2):
            s[row + k] = 0.0 * one
    for k in range(LANES):
        for row in (_S1, _S2):
            for i in (2, 5, 6, 7):
                s[row + i * LANES + k] = 0.0 * one
            s[row + 8 * LANES + k] = one


@register_jitable
def _put_planar_frame(s: Any, one: float) -> None:
    """What a planar pair does not say: n = e_z, and no third coordinate."""
    for k in range(LANES):
        for row in (_R1, _V1, _A1, _U1, _U2):
            s[row + 2 * LANES + k] = 0.0 * one
        s[_N + 2 * LANES + k] = one


@njit(fastmath=FLAGS, forceinline=True)
def flat(s: Any, operation: int) -> None:
    """One step, for a block."""
    if operation == _SINES1:
        sines(s, _PHI1, _TURN1)
    elif operation == _TURN:
        for k in range(LANES):
            hinge = s[_HINGE + k], s[_HINGE + 2 * LANES + k]
            _put_turn(s, k, planar.flat_turn(_plane(s, _TURN1, k), hinge, vector(s, _N, k)))
    elif operation == _TURN_HOME:
        for k in range(LANES):
            hinge = s[_HINGE + k], s[_HINGE + 2 * LANES + k]
            n, home = vector(s, _N, k), matrix(s, _HOME, k)
            _put_turn(s, k, planar.flat_turn_home(_plane(s, _TURN1, k), hinge, n, home))
    elif operation == _ANGLE2:
        for k in range(LANES):
            s[_PHI2 + k] = planar.planar_rate(s[_PHI1 + k], s[_PSI + k])
    elif operation == _ATTITUDE1:
        _put_attitude(s, _S1, _TURN1)
    elif operation == _ATTITUDE2:
        _put_attitude(s, _S2, _TURN2)
    elif operation == _ARM_1:
        for k in range(LANES):
            put_vector(s, _ARM1, k, planar.flat_rotate(_plane(s, _TURN1, k), vector(s, _U1, k)))
    elif operation == _ARM_2:
        for k in range(LANES):
            put_vector(s, _ARM2, k, planar.flat_rotate(_plane(s, _TURN2, k), vector(s, _U2, k)))
    elif operation == _OFFSET:
        for k in range(LANES):
            put_vector(s, _D, k, eq.subtract(vector(s, _ARM1, k), vector(s, _ARM2, k)))
    elif operation == _FRAME:
        _put_frame(s, 1.0)
    elif operation == _PLANAR_FRAME:
        _put_planar_frame(s, 1.0)
    else:
        _rates(s, operation)


@njit(fastmath=FLAGS, forceinline=True)
def _rates(s: Any, operation: int) -> None:
    """One step of velocities or accelerations, for a block."""
    if operation == _RATE1:
        for k in range(LANES):
            s[_OMEGA1 + 2 * LANES + k] = planar.flat_spin1(s[_PHI1D + k])[2]
    elif operation == _RATE2:
        for k in range(LANES):
            s[_OMEGA2 + 2 * LANES + k] = planar.flat_spin2(s[_PHI1D + k], vector(s, _N, k), s[_PSID + k])[2]
    elif operation == _VELOCITY2:
        for k in range(LANES):
            v1, r1, r2 = vector(s, _V1, k), vector(s, _ARM1, k), vector(s, _ARM2, k)
            put_vector(s, _V2, k, planar.flat_velocity2(v1, s[_PHI1D + k], r1, vector(s, _OMEGA2, k), r2))
    elif operation == _RATE1D:
        for k in range(LANES):
            s[_ALPHA1 + 2 * LANES + k] = planar.flat_spin1(s[_PHI1DD + k])[2]
    elif operation == _RATE2D:
        for k in range(LANES):
            s[_ALPHA2 + 2 * LANES + k] = planar.flat_spin2(s[_PHI1DD + k], vector(s, _N, k), s[_PSIDD + k])[2]
    elif operation == _ACCELERATION2:
        for k in range(LANES):
            a1, r1, r2 = vector(s, _A1, k), vector(s, _ARM1, k), vector(s, _ARM2, k)
            omega2, alpha2 = vector(s, _OMEGA2, k), vector(s, _ALPHA2, k)
            a2 = planar.flat_acceleration2(a1, s[_PHI1D + k], s[_PHI1DD + k], r1, omega2, alpha2, r2)
            put_vector(s, _A2, k, a2)
