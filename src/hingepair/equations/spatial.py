"""The constraint equations E1-E10, written once, as plain arithmetic on tuples of scalars.

A vector is a tuple of three scalars, a matrix a tuple of nine, row by row. A scalar is anything that adds and
multiplies: a float, a NumPy array (one component of many samples), a SymPy expression, an mpmath number. Sines and
cosines come in as values, so that each kind of number brings its own. Nothing here branches, allocates arrays or
knows a Python object other than the tuple: the same functions compile to machine code unchanged.

The letters are those of docs/concepts/notation.md: bare vectors in world axes; u1, n in body 1's axes, u2 in body
2's.

E1  R1 + S1 u1 - (R2 + S2 u2) = 0          E6  Sh = I + sin(psi) [n]x + (1 - cos psi) [n]x^2
E2  omega2 = omega1 + S1 n psi'            E7  R2 = R1 + S1 u1 - S2 u2
E3  S' = [omega]x S                        E8  v2 = v1 + S1' u1 - S2' u2
E4  omega = J(phi) phi'                    E9  a2 = v2', alpha2 = omega2'
E5  S2 = S1 Sh C                           E10 S1 = Sx(phi_x) Sy(phi_y) Sz(phi_z)
"""

from __future__ import annotations

from typing import Any, TypeAlias

Scalar: TypeAlias = Any
Vector: TypeAlias = tuple[Scalar, Scalar, Scalar]
HingeTrig: TypeAlias = tuple[Scalar, ...]  # (sin psi, 1 - cos psi); what follows is not looked at
Matrix: TypeAlias = tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]

Entries: TypeAlias = tuple[Scalar, ...]  # of a matrix, row by row

ZERO_VECTOR: Vector = (0.0, 0.0, 0.0)
"""The vector of three zeros."""
IDENTITY_MATRIX: Matrix = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
"""The identity."""
WORLD_UNIT_VECTORS: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Unit vectors along the world's axes."""


def add(a: Vector, b: Vector) -> Vector:
    """Return the sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Vector, b: Vector) -> Vector:
    """Return the difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(a: Vector, factor: Scalar) -> Vector:
    """Return the product of the vector a and a scalar."""
    return a[0] * factor, a[1] * factor, a[2] * factor


def dot(a: Vector, b: Vector) -> Scalar:
    """Return the inner product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product a x b = [a]x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def rotate(S: Matrix, u: Vector) -> Vector:
    """Return the product S u, for example a vector of body axes in world axes. S is a tuple of nine entries."""
    a, b, c, d, e, f, g, h, i = S
    x, y, z = u
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def transpose(A: Matrix) -> Matrix:
    """Return the transpose of a 3 x 3 matrix of nine entries."""
    return A[0], A[3], A[6], A[1], A[4], A[7], A[2], A[5], A[8]


def compose(A: Matrix, B: Matrix) -> Matrix:
    """Return the product A B of two 3 x 3 matrices, each a tuple of nine entries."""
    a, b, c, d, e, f, g, h, i = A
    j, k, l, m, n, o, p, q, r = B  # noqa: E741
    return (
        a * j + b * m + c * p, a * k + b * n + c * q, a * l + b * o + c * r,
        d * j + e * m + f * p, d * k + e * n + f * q, d * l + e * o + f * r,
        g * j + h * m + i * p, g * k + h * n + i * q, g * l + h * o + i * r,
    )  # fmt: skip


def matrix_from_columns(*columns: Entries) -> Entries:
    """Return the matrix with these columns, each a tuple of numbers, as a flat tuple row by row."""
    return tuple(entry for row in zip(*columns, strict=True) for entry in row)


def hinge_rotation(n: Vector, hinge_trig: HingeTrig) -> Matrix:
    """Return Rodrigues' rotation matrix Sh about the unit axis n (E6), as nine entries, where hinge_trig = (sin psi,
    1 - cos psi).
    """
    s, k = hinge_trig[0], hinge_trig[1]
    x, y, z = n
    sx, sy, sz = s * x, s * y, s * z
    kx, ky, kz = k * x, k * y, k * z
    xy, yz, zx = kx * y, ky * z, kz * x
    return (
        1 - (ky * y + kz * z), xy - sz, zx + sy,
        xy + sz, 1 - (kz * z + kx * x), yz - sx,
        zx - sy, yz + sx, 1 - (kx * x + ky * y),
    )  # fmt: skip


def attitude2(S1: Matrix, Sh: Matrix, home: Matrix) -> Matrix:
    """Return S2 = S1 Sh C as nine entries (E5), where home = C."""
    return compose(compose(S1, Sh), home)


def position2(R1: Vector, d: Vector) -> Vector:
    """Return R2 = R1 + d with d = S1 u1 - S2 u2 (E7, which is E1 solved for R2)."""
    return add(R1, d)


def angular_velocity2(omega1: Vector, axis: Vector, psid: Scalar) -> Vector:
    """Return omega2 = omega1 + S1 n psi' (E2), where axis = S1 n."""
    return add(omega1, scale(axis, psid))


def angular_acceleration2(alpha1: Vector, omega1: Vector, axis: Vector, psid: Scalar, psidd: Scalar) -> Vector:
    """Return alpha2 = alpha1 + S1 n psi'' + (omega1 x S1 n) psi' (E9: E2 differentiated), where axis = S1 n."""
    return add(alpha1, add(scale(axis, psidd), scale(cross(omega1, axis), psid)))


def point_acceleration(omega: Vector, alpha: Vector, r: Vector) -> Vector:
    """Return alpha x r + omega x (omega x r), the acceleration of a point of a body relative to the body's reference
    point. The vector r leads from the reference point to this point.
    """
    return add(cross(alpha, r), cross(omega, cross(omega, r)))


def hinge_gap(R1: Vector, r1: Vector, R2: Vector, r2: Vector) -> Vector:
    """Return the vector R1 + r1 - (R2 + r2) between the hinge points of both bodies, which is zero if the bodies
    share the hinge point (E1). r1 and r2 lead from the reference point of body 1 and of body 2 to the hinge point of
    that body, in world axes.
    """
    return subtract(add(R1, r1), add(R2, r2))


def tilt(f1: Vector, f2: Vector, h2: Vector) -> tuple[Scalar, Scalar]:
    """Return the tilt of a hinge, two numbers: the components of h1 x h2 along f1 and f2, -f2 . h2 and f1 . h2. The
    unit vectors f1 and f2 are fixed in body 1, h1 = f1 x f2 is the hinge axis in body 1, and h2 that in body 2. The
    norm is the sine of the angle between the axes, which E5 keeps at 0: E2 forbids turns about f1 and f2.
    """
    return -dot(f2, h2), dot(f1, h2)


def hinge_angle_terms(f_axes: tuple[Vector, Vector], g1: Vector, g2: Vector) -> tuple[Scalar, Scalar]:
    """Return the pair (sin psi, cos psi) times a common positive factor. f_axes = (f1, f2) are unit vectors of body 1
    across the hinge axis, and g1 and g2 those of body 2 that coincide with them at psi = 0, all in world axes.

    From Sh = S1^T S2 C^-1 (E5, E6). The factor is 1 + h1 . h2, which is 2 unless the hinge is tilted.
    Of a tilted hinge, psi is the twist about the axis.
    """
    f1, f2 = f_axes
    return dot(f2, g1) - dot(f1, g2), dot(f1, g1) + dot(f2, g2)


def unskew(W: Matrix) -> Vector:
    """Return the vector w with [w]x equal to the antisymmetric part of the matrix W, which has nine entries."""
    return (W[7] - W[5]) * 0.5, (W[2] - W[6]) * 0.5, (W[3] - W[1]) * 0.5


def angular_velocity_matrix(S: Matrix, S_dot: Matrix) -> Matrix:
    """Return the matrix [omega]x = S' S^T (E3), as nine entries, from a rotation S and its time derivative S_dot."""
    return compose(S_dot, transpose(S))


def quaternion_attitude(quat: tuple[Scalar, ...]) -> Matrix:
    """Return the rotation matrix, as nine entries, of the unit quaternion (w, x, y, z)."""
    w, x, y, z = quat
    w2, x2, y2, z2 = 2 * w, 2 * x, 2 * y, 2 * z
    return (
        1 - (y2 * y + z2 * z), x2 * y - w2 * z, x2 * z + w2 * y,
        x2 * y + w2 * z, 1 - (x2 * x + z2 * z), y2 * z - w2 * x,
        x2 * z - w2 * y, y2 * z + w2 * x, 1 - (x2 * x + y2 * y),
    )  # fmt: skip


def orthonormality_terms(S: Matrix) -> tuple[Scalar, ...]:
    """Return seven numbers, which tell how far the matrix S is from a rotation: the entries xx, yy, zz, xy, yz and zx
    of S S^T - I, then the determinant of S.
    """
    x, y, z = S[0:3], S[3:6], S[6:9]
    lengths = (dot(row, row) - 1.0 for row in (x, y, z))
    return *lengths, dot(x, y), dot(y, z), dot(z, x), dot(x, cross(y, z))


def tait_bryan_attitude(trig: tuple[Scalar, ...]) -> Matrix:
    """Return the rotation matrix Sx Sy Sz (E10), as nine entries, where trig = (sin, cos) of the first, second and
    third angle: six numbers.
    """
    sx, cx, sy, cy, sz, cz = trig
    ss, cs = sx * sy, cx * sy
    return (
        cy * cz, -(cy * sz), sy,
        cx * sz + ss * cz, cx * cz - ss * sz, -(sx * cy),
        sx * sz - cs * cz, sx * cz + cs * sz, cx * cy,
    )  # fmt: skip


def proper_euler_attitude(trig: tuple[Scalar, ...]) -> Matrix:
    """Return the rotation matrix Sx Sy Sx of proper Euler angles, as nine entries, where trig = (sin, cos) of the
    first, second and third angle: six numbers.
    """
    sx, cx, sy, cy, sz, cz = trig
    sc, cc = sx * cy, cx * cy
    return (
        cy, sy * sz, sy * cz,
        sx * sy, cx * cz - sc * sz, -(cx * sz) - sc * cz,
        -(cx * sy), sx * cz + cc * sz, cc * cz - sx * sz,
    )  # fmt: skip


def tait_bryan_axes(trig: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
    """Return (b_y, b_z, c_x, c_y, c_z), the entries that vary in the columns (e_x, b, c) of the matrix J for Sx Sy
    Sz, where omega = J phi' (E4). `trig` holds (sin, cos) of the first, second and third angle: six numbers.
    """
    sx, cx, sy, cy = trig[0:4]
    return cx, sx, sy, -(sx * cy), cx * cy


def proper_euler_axes(trig: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
    """Return (b_y, b_z, c_x, c_y, c_z), the entries that vary in the columns (e_x, b, c) of the matrix J for Sx Sy
    Sx, where omega = J phi' (E4). `trig` holds (sin, cos) of the first, second and third angle: six numbers.
    """
    sx, cx, sy, cy = trig[0:4]
    return cx, sx, cy, sx * sy, -(cx * sy)


def angular_velocity1(axis_components: tuple[Scalar, ...], phid: Vector) -> Vector:
    """Return omega1 = J phi' (E4). axis_components is the result of `tait_bryan_axes` or `proper_euler_axes`."""
    by, bz, cx, cy, cz = axis_components
    return phid[0] + cx * phid[2], by * phid[1] + cy * phid[2], bz * phid[1] + cz * phid[2]


def scaled_third_rate(axis_components: tuple[Scalar, ...], omega: Vector) -> Scalar:
    """Return the component of omega along e_x x b, where b is the second column of J (E4): phi_z' times cos phi_y, or
    in proper Euler sequences phi_z' times -sin phi_y. axis_components is the result of `tait_bryan_axes` or
    `proper_euler_axes`.
    """
    return axis_components[0] * omega[2] - axis_components[1] * omega[1]


def euler_rates1(axis_components: tuple[Scalar, ...], omega: Vector, third_rate: Scalar) -> Vector:
    """Return the Euler-angle rates phi' = J^-1 omega (E4) from omega and the known rate of the third angle.
    axis_components is the result of `tait_bryan_axes` or `proper_euler_axes`.

    The axis b gives phi_y', the rest gives phi_x'.
    """
    return (
        omega[0] - axis_components[2] * third_rate,
        axis_components[0] * omega[1] + axis_components[1] * omega[2],
        third_rate,
    )


def angular_acceleration1(axis_components: tuple[Scalar, ...], phid: Vector, phidd: Vector) -> Vector:
    """Return alpha1 = J phi'' + J' phi' (E4 differentiated). axis_components is the result of `tait_bryan_axes` or
    `proper_euler_axes`.

    The axis b turns with phi_x' e_x, the axis c with phi_x' e_x + phi_y' b, so
    J' phi' = (phi_x' e_x) x b phi_y' + (phi_x' e_x + phi_y' b) x c phi_z'.
    """
    by, bz, cx, cy, cz = axis_components
    y, z = by * phid[1], bz * phid[1]
    turn = cross((phid[0], y, z), (cx * phid[2], cy * phid[2], cz * phid[2]))
    rates = angular_velocity1(axis_components, phidd)
    return rates[0] + turn[0], rates[1] + (turn[1] - phid[0] * z), rates[2] + (turn[2] + phid[0] * y)


def euler_axes(axis_components: tuple[Scalar, ...]) -> tuple[Vector, Vector, Vector]:
    """Return the columns of J (E4), the axes of the three Euler angles, as three vectors. axis_components is the
    result of `tait_bryan_axes` or `proper_euler_axes`.
    """
    by, bz, cx, cy, cz = axis_components
    return (1.0, 0.0, 0.0), (0.0, by, bz), (cx, cy, cz)
