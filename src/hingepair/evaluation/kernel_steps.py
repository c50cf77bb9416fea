"""The steps of a plan as the compiled kernels run them: over a block of samples in the scratch array.

Imported with Numba, that is only when the first compiled kernel is asked for.
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

from numba import njit
from numba.extending import register_jitable

from hingepair.equations import spatial as eq
from hingepair.evaluation.kernel_math import FLAGS, sines
from hingepair.evaluation.kernel_rows import LANES, OPERATIONS, ROWS

for _function in vars(eq).values():
    if isinstance(_function, FunctionType) and _function.__module__ == eq.__name__:
        register_jitable(_function)

# Rows and operations as constants of the compiled code.
_R1, _S1, _V1, _OMEGA1, _A1, _ALPHA1 = (ROWS[name] for name in ("R1", "S1", "v1", "omega1", "a1", "alpha1"))
_PHI, _PHID, _PHIDD = (ROWS[name] for name in ("phi", "phid", "phidd"))
_PSI, _PSID, _PSIDD = (ROWS[name] for name in ("psi", "psid", "psidd"))
_N, _HOME = ROWS["n"], ROWS["home"]
_TRIG, _HINGE, _AXES, _SH, _AXIS = (ROWS[name] for name in ("trig", "hinge", "axes", "Sh", "axis"))
_ALONG, _ACROSS, _AROUND = (ROWS[name] for name in ("along", "across", "around"))
_SWING, _D, _SLIDE, _REACH = (ROWS[name] for name in ("swing", "d", "slide", "reach"))
_PULL, _RELATIVE = ROWS["pull"], ROWS["relative"]
_R2, _S2, _V2, _OMEGA2, _A2, _ALPHA2 = (ROWS[name] for name in ("R2", "S2", "v2", "omega2", "a2", "alpha2"))
_SPARE = ROWS["spare"]
_TRIG_X, _TRIG_Y, _TRIG_Z, _HINGE_TERMS = (OPERATIONS.index(name) for name in ("trig_x", "trig_y", "trig_z", "hinge"))
_TAIT_BRYAN, _TAIT_BRYAN_AXES = OPERATIONS.index("tait_bryan"), OPERATIONS.index("tait_bryan_axes")
_PROPER, _PROPER_AXES = OPERATIONS.index("proper"), OPERATIONS.index("proper_axes")
_RATE1, _RATE1D = OPERATIONS.index("omega1"), OPERATIONS.index("alpha1")
_PLACE_S1, _PLACE_OMEGA1, _PLACE_ALPHA1 = (OPERATIONS.index(f"place_{name}") for name in ("S1", "omega1", "alpha1"))
_RODRIGUES, _ATTITUDE2, _ATTITUDE2_HOME = (OPERATIONS.index(name) for name in ("Sh", "S2", "S2_home"))
_SWINGING, _OFFSET, _POSITION2 = (OPERATIONS.index(name) for name in ("swing", "d", "R2"))
_AXIS_1, _RATE2, _SLIDING, _VELOCITY2 = (OPERATIONS.index(name) for name in ("axis", "omega2", "slide", "v2"))
_RATE2D, _RELATIVELY, _ACCELERATION2 = (OPERATIONS.index(name) for name in ("alpha2", "relative", "a2"))
_REACHING, _PULLING, _SLIDING_GIVEN, _PULLING_GIVEN = (
    OPERATIONS.index(name) for name in ("reach", "pull", "slide_given", "pull_given")
)


@register_jitable
def vector(s: Any, row: int, k: int) -> Any:
    """The three components of a lane."""
    return s[row + k], s[row + LANES + k], s[row + 2 * LANES + k]


@register_jitable
def matrix(s: Any, row: int, k: int) -> Any:
    """The nine components of a lane."""
    r = row + k
    return (
        s[r], s[r + LANES], s[r + 2 * LANES],
        s[r + 3 * LANES], s[r + 4 * LANES], s[r + 5 * LANES],
        s[r + 6 * LANES], s[r + 7 * LANES], s[r + 8 * LANES],
    )  # fmt: skip


@register_jitable
def _angles(s: Any, k: int) -> Any:
    """(sin, cos) of three angles; the trig rows hold (sin, cos, 1 - cos) of each."""
    t = _TRIG + k
    return (
        s[t], s[t + LANES], s[t + 3 * LANES], s[t + 4 * LANES], s[t + 6 * LANES], s[t + 7 * LANES],
    )  # fmt: skip


@register_jitable
def _hinge(s: Any, k: int) -> Any:
    """(sin, 1 - cos) of psi; the hinge rows hold (sin, cos, 1 - cos)."""
    return s[_HINGE + k], s[_HINGE + 2 * LANES + k]


@register_jitable
def _rate_axes(s: Any, k: int) -> Any:
    a = _AXES + k
    return s[a], s[a + LANES], s[a + 2 * LANES], s[a + 3 * LANES], s[a + 4 * LANES]


@register_jitable
def put_vector(s: Any, row: int, k: int, v: Any) -> None:
    """Write the three components of a lane."""
    s[row + k], s[row + LANES + k], s[row + 2 * LANES + k] = v


@register_jitable
def _put_matrix(s: Any, row: int, k: int, m: Any) -> None:
    put_vector(s, row, k, m[0:3])
    put_vector(s, row + 3 * LANES, k, m[3:6])
    put_vector(s, row + 6 * LANES, k, m[6:9])


@register_jitable
def _put_axes(s: Any, k: int, axes: Any) -> None:
    a = _AXES + k
    s[a], s[a + LANES], s[a + 2 * LANES], s[a + 3 * LANES], s[a + 4 * LANES] = axes


@register_jitable
def _place(s: Any, row: int, count: int, place: Any, sign: float) -> None:
    """Rename the axes of a vector or matrix: component i becomes sign * component place[i]."""
    for k in range(count * LANES):
        s[_SPARE + k] = s[row + k]
    for i in range(count):
        for k in range(LANES):
            s[row + i * LANES + k] = sign * s[_SPARE + place[i] * LANES + k]


@njit(fastmath=FLAGS, forceinline=True)
def body1(s: Any, operation: int, place: Any) -> None:
    """One step of body 1 from its Euler angles (E4, E10), for a block."""
    if operation == _TRIG_X:
        sines(s, _PHI, _TRIG)
    elif operation == _TRIG_Y:
        sines(s, _PHI + LANES, _TRIG + 3 * LANES)
    elif operation == _TRIG_Z:
        sines(s, _PHI + 2 * LANES, _TRIG + 6 * LANES)
    elif operation == _TAIT_BRYAN:
        for k in range(LANES):
            _put_matrix(s, _S1, k, eq.tait_bryan_attitude(_angles(s, k)))
    elif operation == _PROPER:
        for k in range(LANES):
            _put_matrix(s, _S1, k, eq.proper_euler_attitude(_angles(s, k)))
    elif operation == _TAIT_BRYAN_AXES:
        for k in range(LANES):
            _put_axes(s, k, eq.tait_bryan_axes(_angles(s, k)))
    elif operation == _PROPER_AXES:
        for k in range(LANES):
            _put_axes(s, k, eq.proper_euler_axes(_angles(s, k)))
    elif operation == _RATE1:
        for k in range(LANES):
            put_vector(s, _OMEGA1, k, eq.angular_velocity1(_rate_axes(s, k), vector(s, _PHID, k)))
    elif operation == _RATE1D:
        for k in range(LANES):
            rates, changes = vector(s, _PHID, k), vector(s, _PHIDD, k)
            put_vector(s, _ALPHA1, k, eq.angular_acceleration1(_rate_axes(s, k), rates, changes))
    elif operation == _PLACE_S1:
        _place(s, _S1, 9, place, 1.0)
    elif operation == _PLACE_OMEGA1:
        _place(s, _OMEGA1, 3, place[9:], float(place[12]))
    elif operation == _PLACE_ALPHA1:
        _place(s, _ALPHA1, 3, place[9:], float(place[12]))


@njit(fastmath=FLAGS, forceinline=True)
def pose2(s: Any, operation: int) -> None:
    """One step of body 2's pose (E5-E7), for a block."""
    if operation == _HINGE_TERMS:
        sines(s, _PSI, _HINGE)
    elif operation == _RODRIGUES:
        for k in range(LANES):
            _put_matrix(s, _SH, k, eq.hinge_rotation(vector(s, _N, k), _hinge(s, k)))
    elif operation == _ATTITUDE2:
        for k in range(LANES):
            _put_matrix(s, _S2, k, eq.compose(matrix(s, _S1, k), matrix(s, _SH, k)))
    elif operation == _ATTITUDE2_HOME:
        for k in range(LANES):
            _put_matrix(s, _S2, k, eq.attitude2(matrix(s, _S1, k), matrix(s, _SH, k), matrix(s, _HOME, k)))
    elif operation == _SWINGING:
        for k in range(LANES):
            across, around = vector(s, _ACROSS, k), vector(s, _AROUND, k)
            put_vector(s, _SWING, k, eq.swing(across, around, _hinge(s, k), s[_HINGE + LANES + k]))
    elif operation == _OFFSET:
        for k in range(LANES):
            put_vector(s, _D, k, eq.offset(matrix(s, _S1, k), vector(s, _ALONG, k), vector(s, _SWING, k)))
    elif operation == _POSITION2:
        for k in range(LANES):
            put_vector(s, _R2, k, eq.position2(vector(s, _R1, k), vector(s, _D, k)))


@njit(fastmath=FLAGS, forceinline=True)
def rates2(s: Any, operation: int) -> None:
    """One step of body 2's velocities (E2, E8) or accelerations (E9), for a block."""
    if operation == _AXIS_1:
        for k in range(LANES):
            put_vector(s, _AXIS, k, eq.rotate(matrix(s, _S1, k), vector(s, _N, k)))
    elif operation == _RATE2:
        for k in range(LANES):
            omega2 = eq.angular_velocity2(vector(s, _OMEGA1, k), vector(s, _AXIS, k), s[_PSID + k])
            put_vector(s, _OMEGA2, k, omega2)
    elif operation == _SLIDING:
        for k in range(LANES):
            across, around = vector(s, _ACROSS, k), vector(s, _AROUND, k)
            slide = eq.slide(matrix(s, _S1, k), across, around, _hinge(s, k), s[_HINGE + LANES + k])
            put_vector(s, _SLIDE, k, slide)
    elif operation == _VELOCITY2:
        for k in range(LANES):
            v1, omega1, d, slide = (vector(s, _V1, k), vector(s, _OMEGA1, k), vector(s, _D, k), vector(s, _SLIDE, k))
            put_vector(s, _V2, k, eq.velocity2(v1, omega1, d, slide, s[_PSID + k]))
    else:
        _accelerations2(s, operation)


@njit(fastmath=FLAGS, forceinline=True)
def _accelerations2(s: Any, operation: int) -> None:
    """One step of body 2's accelerations, or of what a given attitude does its own way."""
    if operation == _RATE2D:
        for k in range(LANES):
            alpha1, omega1, axis = vector(s, _ALPHA1, k), vector(s, _OMEGA1, k), vector(s, _AXIS, k)
            alpha2 = eq.angular_acceleration2(alpha1, omega1, axis, s[_PSID + k], s[_PSIDD + k])
            put_vector(s, _ALPHA2, k, alpha2)
    elif operation == _REACHING:
        for k in range(LANES):
            put_vector(s, _REACH, k, eq.rotate(matrix(s, _S1, k), vector(s, _SWING, k)))
    elif operation == _SLIDING_GIVEN:
        for k in range(LANES):
            put_vector(s, _SLIDE, k, eq.cross(vector(s, _AXIS, k), vector(s, _REACH, k)))
    elif operation == _PULLING:
        for k in range(LANES):
            put_vector(s, _PULL, k, eq.rotate(matrix(s, _S1, k), vector(s, _SWING, k)))
    elif operation == _PULLING_GIVEN:
        for k in range(LANES):
            put_vector(s, _PULL, k, eq.cross(vector(s, _SLIDE, k), vector(s, _AXIS, k)))
    elif operation == _RELATIVELY:
        for k in range(LANES):
            slide, pull = vector(s, _SLIDE, k), vector(s, _PULL, k)
            put_vector(s, _RELATIVE, k, eq.relative_acceleration(slide, pull, s[_PSID + k], s[_PSIDD + k]))
    elif operation == _ACCELERATION2:
        for k in range(LANES):
            a1, omega1, alpha1 = vector(s, _A1, k), vector(s, _OMEGA1, k), vector(s, _ALPHA1, k)
            d, slide, relative = vector(s, _D, k), vector(s, _SLIDE, k), vector(s, _RELATIVE, k)
            put_vector(s, _A2, k, eq.acceleration2(a1, omega1, alpha1, d, slide, s[_PSID + k], relative))
