"""The constants of a robot's programs (T1-T10), from its record: each body in axes whose z axis is its joint's axis.

Where an axis lies along x, y or z of the body, the axes change by exact permutations; masses are added up and shifted
in exact arithmetic (T9), and rounded once.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.tree import Frame, MassProperties, Tree
from hingepair.numeric.arrays import read_only
from hingepair.plans.trees import Form

Exact: TypeAlias = list[Fraction]

_KNOWN: Final = {0.0, 1.0, -1.0}
_TINY: Final = 1e-300  # kg or kg m^2, where no matter is beyond a joint
_ROUND_OFF: Final = 64 * 2.0**-53
"""Of the inertia of all matter beyond a joint: what is left below it of a pivot is rounding."""
_PRODUCT_ROUND_OFF: Final = 16 * 2.0**-53
"""Of the largest entry: what is left of the roundings of axes that lie obliquely, and of products with them."""
_PLACE_NUMBERS: Final = 12  # of a joint, before its masses: S and u
_ROTOR_NUMBERS: Final = 4  # behind them: armature, multiplier, offset and smallest
_PERMUTED: Final = {  # columns of the body's axes: x, y and z of the program's axes
    (1.0, 0.0, 0.0): ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    (0.0, 1.0, 0.0): ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    (0.0, 0.0, 1.0): ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
}


@dataclass(frozen=True, slots=True, eq=False)
class Constants:
    """The constants of a robot's programs.

    Attributes:
        form: what programs depend on.
        names: of the joints with a coordinate of their own, in the order of q.
        numbers: the constants that are parameters, in order.
        bounds: how far each of them may be from the exact number.
        smallest: of each coordinate, the size below which a pivot D is rounding (T5); 0 where it cannot be as small.
        axes: of each body, the base first, the rotation from the program's axes to the body's own.
        prepared: what was made of this robot once, by request.
    """

    form: Form
    names: tuple[str, ...]
    numbers: tuple[float, ...]
    bounds: tuple[float, ...]
    smallest: NDArray[np.float64]
    axes: tuple[NDArray[np.float64], ...]
    prepared: dict[Any, Any] = field(default_factory=dict, repr=False)

    @property
    def may_be_singular(self) -> bool:
        """Whether a joint's own body may leave its motion without resistance."""
        return bool(self.smallest.any())


def constants_of(tree: Tree, free: bool) -> Constants:
    """Return the constants of a robot, whose base has mass where it is free."""
    axes = _axes_of_bodies(tree)
    matter = _regrouped(tree, axes, _matter_of_bodies(tree, axes, free))
    oblique = [bool((np.count_nonzero(own, axis=0) > 1).any()) for own in axes]
    smallest = _smallest_pivots(tree, axes)
    numbers = _rounded(matter[0])
    bounds = _mass_bounds(numbers, any(oblique))
    for k, joint in enumerate(tree.joints, 1):
        back = axes[joint.parent].T
        S, u = _product(back, _product(joint.S, axes[k])), _product(back, joint.u)
        multiplier, offset = (1.0, 0.0) if joint.mimic is None else joint.mimic[1:]
        place, masses = [*S.ravel().tolist(), *u.tolist()], _rounded(matter[k])
        numbers += [*place, *masses, joint.armature, multiplier, offset, smallest[k]]
        turned = oblique[k] or oblique[joint.parent]
        bounds += [_PRODUCT_ROUND_OFF * max(1.0, float(np.abs(joint.u).max())) if turned else 0.0] * len(place)
        bounds += [*_mass_bounds(masses, any(oblique)), 0.0, 0.0, 0.0, 0.0]
    known, parameters = known_and_parameters(numbers)
    kept = tuple(bound for bound, one in zip(bounds, known, strict=True) if one is None)
    form = Form(
        _cleaned(joint.name for joint in tree.joints),
        tuple(joint.parent for joint in tree.joints),
        tuple(joint.kind == "slider" for joint in tree.joints),
        _columns(tree),
        known,
    )
    by_column = np.zeros(form.dof)
    for joint, column, own in zip(tree.joints, form.columns, smallest[1:], strict=True):
        ratio = 1.0 if joint.mimic is None else joint.mimic.multiplier
        by_column[column] += own * ratio * ratio
    names = tuple(joint.name for joint in tree.coordinates)
    return Constants(form, names, parameters, kept, read_only(by_column), tuple(map(read_only, axes)))


def all_numbers(constants: Constants) -> list[float]:
    """Return the numbers of a robot's programs, those that are folded and those that are parameters, in order."""
    numbers = iter(constants.numbers)
    return [next(numbers) if known is None else known for known in constants.form.known]


def exact_masses(tree: Tree, free: bool) -> list[Fraction]:
    """Return the exact masses and moments among a robot's numbers; 0 in place of all other numbers."""
    axes = _axes_of_bodies(tree)
    return _among_numbers(_regrouped(tree, axes, _matter_of_bodies(tree, axes, free)))


def payload_slopes(tree: Tree, free: bool, frame: Frame) -> list[list[Fraction]]:
    """Return the derivatives of a robot's numbers by the mass properties of a payload in a frame; exact (T9).

    The ten properties are the mass, the first moment m c (x, y, z) and the second moment (xx, xy, xz, yy, yz, zz)
    about the frame's origin, in the frame's axes. The numbers are linear in them.

    Returns:
        Ten rows, each as long as `all_numbers`. They are 0 for a payload of a fixed base, which moves nothing.
    """
    axes = _axes_of_bodies(tree)
    nothing = [Fraction(0)] * 10
    zero = Fraction(0)
    rows = []
    for k in range(10):
        matter = [_Matter(zero, [zero] * 3, [zero] * 9) for _ in axes]
        if frame.body or free:
            unit = [*nothing[:k], Fraction(1), *nothing[k + 1 :]]
            matter[frame.body] = _placed(_exact(frame.R), _exact(frame.S), _exact(axes[frame.body]), unit)
        rows.append(_among_numbers(_regrouped(tree, axes, matter)))
    return rows


def frame_numbers(constants: Constants, frame: Frame) -> list[float]:
    """Return R and S of a frame in the program's axes of its body, 12 numbers."""
    back = constants.axes[frame.body].T
    return [*_product(back, frame.R).tolist(), *_product(back, frame.S).ravel().tolist()]


def known_and_parameters(numbers: Iterable[float]) -> tuple[tuple[float | None, ...], tuple[float, ...]]:
    """Split numbers into those that programs fold, None in place of all others, and the others."""
    all_of = [number + 0.0 for number in numbers]  # no -0.0
    known = tuple(number if number in _KNOWN else None for number in all_of)
    return known, tuple(number for number in all_of if number not in _KNOWN)


def _columns(tree: Tree) -> tuple[int, ...]:
    """The column in q of every joint."""
    places, column = {}, 0
    for number, joint in enumerate(tree.joints, 1):
        if joint.mimic is None:
            places[number] = column
            column += 1
    return tuple(
        places[number if joint.mimic is None else joint.mimic.leader] for number, joint in enumerate(tree.joints, 1)
    )


def _cleaned(names: Iterable[str]) -> tuple[str, ...]:
    """Names that generated code can hold, each once."""
    found: list[str] = []
    for name in names:
        clean = re.sub(r"\W", "_", name, flags=re.ASCII)
        found.append(clean if clean not in found else f"{clean}_{len(found)}")
    return tuple(found)


def _axes_of_bodies(tree: Tree) -> list[NDArray[np.float64]]:
    """Return the rotation from the program's axes to its own of every body, the base first."""
    return [np.eye(3), *(_axes(joint.n) for joint in tree.joints)]


def _axes(n: NDArray[np.float64]) -> NDArray[np.float64]:
    """A rotation whose third column is a unit axis."""
    size = tuple(np.abs(n).tolist())
    if size in _PERMUTED:
        columns = np.array(_PERMUTED[size], float).T
        if n.sum() < 0:  # turned by pi about the new x axis
            columns = columns * (1.0, -1.0, -1.0)
        return columns + 0.0
    x = np.eye(3)[np.argmin(np.abs(n))]
    x = x - n * (n @ x)
    x /= np.sqrt(x @ x)
    return np.stack((x, np.cross(n, x), n), axis=1)


def _product(A: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
    """A B of which products with 0 and 1 are exact; no -0.0."""
    if B.ndim == 1:
        return _product(A, B[:, None])[:, 0]
    found = A[:, :1] * B[:1] + A[:, 1:2] * B[1:2] + A[:, 2:] * B[2:]
    return np.asarray(found + 0.0)


# ---- masses


class _Matter:
    """Mass, first and second moment of a body about its reference point, program's axes, exact."""

    def __init__(self, m: Fraction, h: Exact, N: Exact) -> None:
        self.m, self.h, self.N = m, h, N

    def add(self, m: Fraction, h: Exact, N: Exact) -> None:
        """Add matter."""
        self.m += m
        self.h = [x + y for x, y in zip(self.h, h, strict=True)]
        self.N = [x + y for x, y in zip(self.N, N, strict=True)]


def _matter_of(body: MassProperties, axes: NDArray[np.float64]) -> _Matter:
    """Return the matter of a body, whose properties are in its own axes."""
    c, inertia, P = (_exact(array) for array in (body.center_of_mass, body.inertia, axes))
    m = Fraction(body.mass)
    half = (inertia[0] + inertia[4] + inertia[8]) / 2
    N = [(half if i == j else 0) - (inertia[3 * i + j] + inertia[3 * j + i]) / 2 for i in range(3) for j in range(3)]
    N = [N[3 * i + j] + m * c[i] * c[j] for i in range(3) for j in range(3)]
    back = _transposed(P)
    return _Matter(m, _times(back, [m * x for x in c]), _conjugated(back, N))


def _matter_of_bodies(tree: Tree, axes: Sequence[NDArray[np.float64]], free: bool) -> list[_Matter]:
    """Return the matter of every body, the base first, as the robot has it."""
    zero = MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))
    bodies = [tree.base if free else zero, *(joint.body for joint in tree.joints)]
    return [_matter_of(body, own) for body, own in zip(bodies, axes, strict=True)]


def _placed(R: Exact, S: Exact, axes: Exact, properties: Exact) -> _Matter:
    """Return the matter of a payload from its ten mass properties in a frame, which is at R, S in the body's axes."""
    m, h = properties[0], _times(S, properties[1:4])
    xx, xy, xz, yy, yz, zz = properties[4:]
    N = _conjugated(S, [xx, xy, xz, xy, yy, yz, xz, yz, zz])
    N = [N[3 * i + j] + h[i] * R[j] + R[i] * h[j] + m * R[i] * R[j] for i in range(3) for j in range(3)]
    back = _transposed(axes)
    return _Matter(m, _times(back, [x + m * y for x, y in zip(h, R, strict=True)]), _conjugated(back, N))


def _regrouped(tree: Tree, axes: Sequence[NDArray[np.float64]], matter: list[_Matter]) -> list[_Matter]:
    """Return the matter of every body, the base first; what moves with two bodies is the parent's (T9)."""
    for k in range(len(tree.joints), 0, -1):
        joint, own = tree.joints[k - 1], matter[k]
        S = _exact(_product(axes[joint.parent].T, _product(joint.S, axes[k])))
        parent = matter[joint.parent]
        if joint.kind == "slider":
            parent.add(Fraction(0), [Fraction(0)] * 3, _conjugated(S, own.N))
            own.N = [Fraction(0)] * 9
            continue
        u, w = _exact(_product(axes[joint.parent].T, joint.u)), [S[2], S[5], S[8]]
        m, along, spread = own.m, own.h[2], own.N[8]
        parent.add(
            m,
            [m * u[i] + along * w[i] for i in range(3)],
            [
                m * u[i] * u[j] + along * (u[i] * w[j] + w[i] * u[j]) + spread * w[i] * w[j]
                for i in range(3)
                for j in range(3)
            ],
        )
        own.m, own.h[2], own.N[8] = Fraction(0), Fraction(0), Fraction(0)
    return matter


def _ten(own: _Matter) -> Exact:
    """Return mass, first moment, second moment: ten numbers."""
    N = own.N
    return [own.m, *own.h, N[0], N[1], N[2], N[4], N[5], N[8]]


def _rounded(own: _Matter) -> list[float]:
    return [float(x) for x in _ten(own)]


def _among_numbers(matter: Sequence[_Matter]) -> Exact:
    """Return the masses of all bodies, the base first, in their places among a robot's numbers; 0 in all others."""
    before, behind = [Fraction(0)] * _PLACE_NUMBERS, [Fraction(0)] * _ROTOR_NUMBERS
    joints = (part for own in matter[1:] for part in (*before, *_ten(own), *behind))
    return [*_ten(matter[0]), *joints]


def _exact(array: NDArray[np.float64]) -> Exact:
    return [Fraction(x) for x in array.ravel().tolist()]


def _times(A: Exact, v: Exact) -> Exact:
    return [_inner((A[3 * i + k], v[k]) for k in range(3)) for i in range(3)]


def _transposed(A: Exact) -> Exact:
    return [A[3 * j + i] for i in range(3) for j in range(3)]


def _conjugated(A: Exact, N: Exact) -> Exact:
    """A N A^T."""
    T = [_inner((A[3 * i + k], N[3 * k + j]) for k in range(3)) for i in range(3) for j in range(3)]
    return [_inner((T[3 * i + k], A[3 * j + k]) for k in range(3)) for i in range(3) for j in range(3)]


def _inner(pairs: Iterable[tuple[Fraction, Fraction]]) -> Fraction:
    """The sum of products; most of them are 0."""
    return sum((a * b for a, b in pairs if a and b), Fraction(0))


def _mass_bounds(numbers: Sequence[float], oblique: bool) -> list[float]:
    """How far the mass properties of a body may be from the exact ones: rounded once, or by axes that are rounded."""
    size = _PRODUCT_ROUND_OFF * max(map(abs, numbers)) if oblique else 0.0
    return [float(np.spacing(abs(number))) / 2 + size for number in numbers]


def _smallest_pivots(tree: Tree, axes: Sequence[NDArray[np.float64]]) -> list[float]:
    """Of every joint, the size below which a pivot D is rounding (T5); 0 where it cannot be as small.

    What resists is at most all matter beyond the joint, stretched out, and at least that of its own body and rotor.
    """
    count = len(tree.joints) + 1
    mass, moment, spread = ([0.0] * count for _ in range(3))
    for k, body in enumerate([tree.base, *(joint.body for joint in tree.joints)]):
        lever = float(np.abs(body.center_of_mass).sum())
        mass[k] = abs(body.mass)
        moment[k] = mass[k] * lever
        spread[k] = moment[k] * lever + float(np.abs(body.inertia).max())
    found = [0.0] * count
    for k in range(count - 1, 0, -1):
        joint = tree.joints[k - 1]
        p, slides = joint.parent, joint.kind == "slider"
        reach = float(np.abs(joint.u).sum())
        if slides and np.isfinite(joint.position_limits).all():
            reach += float(np.abs(joint.position_limits).max())
        smallest = _ROUND_OFF * (mass[k] if slides else spread[k])
        own = joint.body.mass if slides else _resistance(joint.body, axes[k][:, 2])
        found[k] = 0.0 if own + joint.armature > smallest else max(smallest, _TINY)
        mass[p] += mass[k]
        moment[p] += moment[k] + mass[k] * reach
        spread[p] += spread[k] + 2 * reach * moment[k] + mass[k] * reach * reach
    return found


def _resistance(body: MassProperties, n: NDArray[np.float64]) -> float:
    """Inertia of a body about an axis through its reference point."""
    across = np.cross(n, body.center_of_mass)
    return float(n @ body.inertia @ n + body.mass * (across @ across))
