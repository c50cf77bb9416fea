"""States of robots as Pinocchio and MuJoCo write them.

                 Pinocchio                                   MuJoCo
q of a base      R1, quaternion x y z w of S1                R1, quaternion w x y z of S1
v of a base      S1^T v1, S1^T omega1 (own axes)             v1 (world axes), S1^T omega1 (own axes)
continuous       cos q, sin q, of models read from URDF      q
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.body_motion import AT_REST, BodyMotion, motion_inputs
from hingepair.mechanism.robots.computations import base_inputs
from hingepair.mechanism.tree import Tree
from hingepair.numeric.arrays import Float64Array, broadcast_shape, vectors
from hingepair.plans.arguments import Coordinates
from hingepair.rotations.matrices import matrix_to_quaternion, quaternion_to_matrix


class State(NamedTuple):
    """Configuration and velocity of a robot."""

    q: Float64Array  # coordinates; (..., dof)
    qd: Float64Array | None  # their time derivatives
    base_motion: BodyMotion | None  # pose and velocity of a free base


class Convention(NamedTuple):
    """How a package writes the state of a free base."""

    scalar_first: bool  # quaternions as w x y z
    local_velocity: bool  # v1 in the axes of the base; omega1 always is


PINOCCHIO: Final = Convention(scalar_first=False, local_velocity=True)
MUJOCO: Final = Convention(scalar_first=True, local_velocity=False)


def continuous_columns(tree: Tree) -> list[int]:
    """Return the columns in q of the continuous hinges, which Pinocchio's models of URDF have as two numbers."""
    turning = (one.kind == "hinge" and one.continuous for one in tree.coordinates)
    free = (not np.isfinite(one.position_limits).any() for one in tree.coordinates)
    return [k for k, both in enumerate(zip(turning, free, strict=True)) if all(both)]


def written_q(
    convention: Convention, q: Float64Array, base: BodyMotion | None, free: bool, turning: list[int]
) -> Float64Array:
    """Return q as a package writes it, a free base first; the columns in `turning` become cosine and sine."""
    wide = np.repeat(q, [1 + (k in turning) for k in range(q.shape[-1])], axis=-1)
    for place in np.array(turning, dtype=np.intp) + np.arange(len(turning)):
        wide[..., place], wide[..., place + 1] = np.cos(wide[..., place]), np.sin(wide[..., place])
    if not free:
        return wide
    R, S = _of_base(base, "R1", "S1")
    quat = matrix_to_quaternion(S)
    return _joined([R, quat if convention.scalar_first else np.roll(quat, -1, axis=-1), wide])


def written_v(convention: Convention, qd: Float64Array, base: BodyMotion | None, free: bool) -> Float64Array:
    """Return v as a package writes it; of a free base first v1, then omega1 in the axes of the base."""
    if not free:
        return qd
    S, v, omega = _of_base(base, "S1", "v1", "omega1")
    back = np.swapaxes(S, -1, -2)
    return _joined([_turned(back, v) if convention.local_velocity else v, _turned(back, omega), qd])


def written_a(qdd: Float64Array, base: BodyMotion | None, free: bool) -> Float64Array:
    """Return a as Pinocchio writes it; that of a free base is spatial, S1^T (a1 - omega1 x v1), then S1^T alpha1."""
    if not free:
        return qdd
    S, v, omega, a, alpha = _of_base(base, "S1", "v1", "omega1", "a1", "alpha1")
    back = np.swapaxes(S, -1, -2)
    return _joined([_turned(back, a - np.cross(omega, v)), _turned(back, alpha), qdd])


def read_state(
    convention: Convention, q: ArrayLike, v: ArrayLike | None, free: bool, dof: int, turning: list[int]
) -> State:
    """Return the State that a package has written; the columns in `turning` may be cosine and sine in q."""
    array = np.asarray(q, np.float64)
    first, width = 7 * free, array.shape[-1] if array.ndim else 0
    pairs = turning if width == first + dof + len(turning) else []
    columns = vectors("q", q, first + dof + len(pairs)).astype(np.float64)
    places = [first + k + sum(one < k for one in pairs) for k in range(dof)]  # of the joints' first columns
    rows = columns[..., places]
    for k in pairs:
        rows[..., k] = np.arctan2(columns[..., places[k] + 1], columns[..., places[k]])
    rates = None if v is None else vectors("v", v, 6 * free + dof).astype(np.float64)
    if not free:
        return State(rows, rates, None)
    S = np.asarray(quaternion_to_matrix("q", columns[..., 3:7], scalar_first=convention.scalar_first), np.float64)
    if rates is None:
        return State(rows, None, BodyMotion(R=columns[..., :3], S=S))
    linear, omega = rates[..., :3], _turned(S, rates[..., 3:6])
    velocity = _turned(S, linear) if convention.local_velocity else linear
    return State(rows, rates[..., 6:], BodyMotion(R=columns[..., :3], S=S, v=velocity, omega=omega))


class StateConventions:
    """Methods that write and read states as other packages do."""

    __slots__ = ()

    _tree: Tree
    base: str

    def to_pinocchio_state(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        base_motion: BodyMotion | None = None,
        *,
        cos_sin: bool = False,
    ) -> tuple[Float64Array, Float64Array | None]:
        """Return q and v as Pinocchio writes them. For a free base, q begins with R1 and the quaternion (x, y, z, w)
        of S1, and v with v1 and omega1 in the axes of the base.

        Args:
            base_motion: R, S, v and omega of a free base.
            cos_sin: hinges without limits become two numbers, cosine and sine, as in models that Pinocchio reads from
                URDF files.

        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot", base="free")
        >>> q, v = robot.to_pinocchio_state([0.1] * 6, [0.2] * 6)
        >>> q.shape, v.shape
        ((13,), (12,))
        """
        turning = continuous_columns(self._tree) if cos_sin else []
        return self._written(PINOCCHIO, q, qd, base_motion, turning)

    def to_mujoco_state(
        self, q: Coordinates, qd: Coordinates | None = None, base_motion: BodyMotion | None = None
    ) -> tuple[Float64Array, Float64Array | None]:
        """Return qpos and qvel as MuJoCo writes them, for joints in the order of `names`. For a free base, qpos
        begins with R1 and the quaternion (w, x, y, z) of S1, and qvel with v1 in world axes and omega1 in the axes of
        the base.
        """
        return self._written(MUJOCO, q, qd, base_motion, [])

    def from_pinocchio_state(self, q: ArrayLike, v: ArrayLike | None = None) -> State:
        """Return (q, qd, base_motion) of a state that Pinocchio has written; base_motion is None unless the base is
        free. Hinges without limits may be cosine and sine in Pinocchio's q.

        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot", base="free")
        >>> state = robot.from_pinocchio_state([0, 0, 1, 0, 0, 0, 1] + [0.1] * 6)
        >>> state.q.shape, state.base_motion.R.tolist()
        ((6,), [0.0, 0.0, 1.0])
        """
        turning = continuous_columns(self._tree)
        return read_state(PINOCCHIO, q, v, self.base == "free", len(self._tree.coordinates), turning)

    def from_mujoco_state(self, qpos: ArrayLike, qvel: ArrayLike | None = None) -> State:
        """Return (q, qd, base_motion) of a state that MuJoCo has written, for joints in the order of `names`;
        base_motion is None unless the base is free.
        """
        return read_state(MUJOCO, qpos, qvel, self.base == "free", len(self._tree.coordinates), [])

    def _written(
        self,
        convention: Convention,
        q: Coordinates,
        qd: Coordinates | None,
        base_motion: BodyMotion | None,
        turning: list[int],
    ) -> tuple[Float64Array, Float64Array | None]:
        """Return q and, if qd is given, v as a package writes them, cosine and sine in the columns `turning` of q."""
        free = self.base == "free"
        check_base(base_motion, free)
        rates = None if qd is None else self._tree.rows("qd", qd)
        written = written_q(convention, self._tree.rows("q", q), base_motion, free, turning)
        if rates is None:
            return written, None
        return written, written_v(convention, rates, base_motion, free)


def check_base(base: Any, free: bool) -> None:
    """Refuse what is no BodyMotion, or one of a base that is not free."""
    if base is not None and not (free and isinstance(base, BodyMotion)):
        expected = "a BodyMotion" if free else "None, since the base is not free"
        raise ArgumentError("base_motion", expected, type(base).__name__)


def _of_base(base: BodyMotion | None, *names: str) -> list[Float64Array]:
    """Return parts of the motion of a free base; one that has a pose alone is at rest."""
    found = {**motion_inputs("base1", AT_REST), **base_inputs(base, names)}
    return [np.asarray(found[name], np.float64) for name in names]


def _turned(S: Float64Array, v: Float64Array) -> Float64Array:
    rotated: Float64Array = (S @ v[..., None])[..., 0]
    return rotated


def _joined(parts: list[Float64Array]) -> Float64Array:
    """Return parts joined along the last axis, with their leading axes broadcast."""
    base = np.broadcast_shapes(*(part.shape[:-1] for part in parts[:-1]))
    shape = broadcast_shape({"base_motion": base, "q": parts[-1].shape[:-1]})
    return np.concatenate([np.broadcast_to(part, (*shape, part.shape[-1])) for part in parts], axis=-1)
