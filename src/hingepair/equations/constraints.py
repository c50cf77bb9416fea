"""E1 and E2 as residuals of any two motions, and their exact first and second derivatives in time.

Plain arithmetic on tuples, as in `equations`. The hinge has a frame in either body: (e1, e2, n) fixed in body 1,
which in world axes is (f1, f2, h1), and C^-1 (e1, e2, n) fixed in body 2, in world axes (g1, g2, h2). At psi = 0 both
are one frame; whatever psi is, E2 keeps h1 and h2 one line. r_i = S_i u_i.

E2 says that body 2 turns against body 1 about h1 only. What it forbids is a turn about f1 or f2: the tilt, the
components of h1 x h2 along them.
"""

from __future__ import annotations

from hingepair.equations import spatial as eq
from hingepair.equations.derivatives import WORLD_AXES, Entries
from hingepair.equations.spatial import Scalar, Vector

Two = tuple[Scalar, Scalar]


def tilt(f1: Vector, f2: Vector, h2: Vector) -> Two:
    """Return the components of h1 x h2 along f1 and f2, -f2 . h2 and f1 . h2 (E5); 0 where the axes are parallel."""
    return -eq.dot(f2, h2), eq.dot(f1, h2)


def tilt_axes(f1: Vector, f2: Vector, h2: Vector) -> tuple[Vector, Vector]:
    """Return the axes c with tilt' = c . (omega2 - omega1): f1 and f2 themselves where the hinge is not tilted."""
    return eq.cross(f2, h2), eq.cross(h2, f1)


def relative_turn(omega1: Vector, omega2: Vector) -> Vector:
    """Return omega2 - omega1, or alpha2 - alpha1: the turning of body 2 against body 1."""
    return eq.subtract(omega2, omega1)


def tilt_rate(axes: tuple[Vector, Vector], spin: Vector) -> Two:
    """Return the tilt's rate c . (omega2 - omega1) (E2); spin = omega2 - omega1."""
    return eq.dot(axes[0], spin), eq.dot(axes[1], spin)


def tilt_bias(f: tuple[Vector, Vector], h2: Vector, omega1: Vector, omega2: Vector, spin: Vector) -> Two:
    """Return the part of the tilt's second derivative that is free of alpha: c' . (omega2 - omega1)."""
    h2_rate = eq.cross(omega2, h2)
    c1_rate = eq.add(eq.cross(eq.cross(omega1, f[1]), h2), eq.cross(f[1], h2_rate))
    c2_rate = eq.add(eq.cross(h2_rate, f[0]), eq.cross(h2, eq.cross(omega1, f[0])))
    return eq.dot(c1_rate, spin), eq.dot(c2_rate, spin)


def tilt_acceleration(axes: tuple[Vector, Vector], turn: Vector, bias: Two) -> Two:
    """Return the tilt's second derivative (E2 differentiated); turn = alpha2 - alpha1."""
    return eq.dot(axes[0], turn) + bias[0], eq.dot(axes[1], turn) + bias[1]


def slip(omega1: Vector, omega2: Vector, h2: Vector, psid: Scalar) -> Vector:
    """Return the residual of E2 where psi' is known: omega2 - omega1 - S2 C^T n psi'."""
    return eq.subtract(omega2, eq.angular_velocity2(omega1, h2, psid))


def gap_rate(v1: Vector, omega1: Vector, r1: Vector, v2: Vector, omega2: Vector, r2: Vector) -> Vector:
    """Return the residual of E1, differentiated: (R1 + r1)' - (R2 + r2)'."""
    return eq.subtract(eq.add(v1, eq.cross(omega1, r1)), eq.add(v2, eq.cross(omega2, r2)))


def gap_acceleration(a1: Vector, turned1: Vector, a2: Vector, turned2: Vector) -> Vector:
    """Return the residual of E1, differentiated twice; turned_i = r_i''."""
    return eq.subtract(eq.add(a1, turned1), eq.add(a2, turned2))


def gap_bias(omega1: Vector, r1: Vector, omega2: Vector, r2: Vector) -> Vector:
    """Return the part of the gap's second derivative that is free of a and alpha."""
    return eq.subtract(eq.cross(omega1, eq.cross(omega1, r1)), eq.cross(omega2, eq.cross(omega2, r2)))


def constraint_jacobian(r1: Vector, r2: Vector, axes: tuple[Vector, Vector]) -> Entries:
    """Return the derivative of (gap', tilt') by (v1, omega1, v2, omega2), 5 x 12."""
    lever1, lever2 = eq.skew((-r1[0], -r1[1], -r1[2])), eq.skew(r2)
    gap_rows = [
        (*unit, *lever1[3 * i : 3 * i + 3], *eq.scale(unit, -1.0), *lever2[3 * i : 3 * i + 3])
        for i, unit in enumerate(WORLD_AXES)
    ]
    zero = (0.0, 0.0, 0.0)
    tilt_rows = [(*zero, -c[0], -c[1], -c[2], *zero, *c) for c in axes]
    return tuple(entry for row in (*gap_rows, *tilt_rows) for entry in row)


def hinge_turn(f: tuple[Vector, Vector], g1: Vector, g2: Vector) -> Two:
    """Return (sin psi, cos psi) times one positive factor, from Sh = S1^T S2 C^-1 (E5, E6).

    The factor is 1 + h1 . h2, 2 on a hinge: of a tilted one, psi is the twist about the axis.
    """
    f1, f2 = f
    return eq.dot(f2, g1) - eq.dot(f1, g2), eq.dot(f1, g1) + eq.dot(f2, g2)


def hinge_rate(h1: Vector, h2: Vector, spin: Vector) -> Two:
    """Return psi' of tilted hinges too, as a fraction: (omega2 - omega1) . (h1 + h2) over 1 + h1 . h2."""
    return eq.dot(spin, eq.add(h1, h2)), 1.0 + eq.dot(h1, h2)


def hinge_acceleration(
    h: tuple[Vector, Vector], omega: tuple[Vector, Vector], spin: Vector, turn: Vector, psid: Scalar
) -> Two:
    """Return psi'' as a fraction: `hinge_rate` differentiated; turn = alpha2 - alpha1."""
    h1, h2 = h
    middle_rate = eq.add(eq.cross(omega[0], h1), eq.cross(omega[1], h2))
    numerator = eq.dot(turn, eq.add(h1, h2)) + eq.dot(spin, middle_rate)
    return numerator - psid * eq.dot(spin, eq.cross(h2, h1)), 1.0 + eq.dot(h1, h2)
