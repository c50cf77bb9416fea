"""The classes of joints beside the `HingePair`: the slider and the screw.

A further kind is a name in `kinds.JointKind`, a row of `kinds.KINDS`, and a class beside `Slider`, which stands in
`RobotJoint`, `JOINT_CLASSES` and `DEFAULT_NAMES`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import ClassVar, Final, Protocol, TypeAlias, TypedDict, Unpack, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.kinds import JointKind
from hingepair.mechanism.options import check_options
from hingepair.mechanism.pairs.hinge_pair import HingePair, checked_limits
from hingepair.mechanism.pairs.subject import check_single_pair
from hingepair.numeric.arrays import Frozen, call_text, finite_number, set_frozen
from hingepair.tables.sheets import Sheet, Shown, sheet_of


class JointOptions(TypedDict, total=False):
    """What a joint of a robot has beside its geometry, as a `HingePair` has it."""

    limits: ArrayLike | None
    body1: Body | None
    body2: Body | None
    torque_limit: float | None
    rate_limit: float | None


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class _JointOfRobot(Frozen, Shown):
    """Two rigid bodies and the joint between them: the fields of a `HingePair`, and its checks."""

    u1: NDArray[np.float64]
    u2: NDArray[np.float64]
    n: NDArray[np.float64]
    home: NDArray[np.float64]
    name: str
    limits: tuple[float, float] | None
    body1: Body | None
    body2: Body | None
    torque_limit: float | None
    rate_limit: float | None

    _default_name: ClassVar[str]

    def __init__(
        self,
        u1: ArrayLike,
        u2: ArrayLike,
        n: ArrayLike,
        home: ArrayLike | None = None,
        name: str | None = None,
        **options: Unpack[JointOptions],
    ) -> None:
        check_options(type(self).__name__, options, _FIELDS)
        limits = checked_limits(options.pop("limits", None))  # may be lengths
        checked = HingePair(u1, u2, n, home, self._default_name if name is None else name, **options)
        check_single_pair(checked)
        set_frozen(self, **{field: getattr(checked, field) for field in _FIELDS} | {"limits": limits})

    def __repr__(self) -> str:
        return call_text(self, *(field.name for field in fields(self)))

    def _sheet(self) -> Sheet:
        """Return what notebooks show."""
        shown = [field.name for field in fields(self) if field.name not in ("name", "body1", "body2")]
        values = [(field, getattr(self, field)) for field in shown]
        masses = (("mass1", self.body1 and self.body1.mass), ("mass2", self.body2 and self.body2.mass))
        return sheet_of(self.name, [*values, *masses])


_JointOfRobot.__init__.__qualname__ = "Slider.__init__"  # in Python's messages; a Screw has its own
_FIELDS = tuple(field.name for field in fields(_JointOfRobot))  # in the order of a HingePair's arguments


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class Slider(_JointOfRobot):
    """Two rigid bodies joined by a slider (prismatic joint), R2 = R1 + S1 (u1 + n q) - S2 u2 and S2 = S1 home, where
    q is the displacement along n [m].

    It is a joint of a `Mechanism`. Arguments not listed, and attributes, are those of a `HingePair`. Reports and
    exports show the limits; methods do not enforce them.

    Args:
        u1: vector from the reference point of body 1 to where a point P of body 2 is at q = 0, body-1 axes [m]; shape
            (3,).
        u2: vector from the reference point of body 2 to the point P, body-2 axes [m]; shape (3,).
        n: direction in which body 2 moves, body-1 axes; any non-zero length, stored at unit length; shape (3,).
        limits: lower and upper limit of q [m]; shape (2,).
        torque_limit: largest magnitude of the motor's force [N]; URDF calls it effort.
        rate_limit: largest magnitude of the rate q' [m/s].

    >>> import hingepair as hp
    >>> lift = hp.Slider(u1=(0, 0, 0.5), u2=(0, 0, 0), n=(0, 0, 2), name="lift", limits=(0, 1.5))
    >>> lift.n.tolist(), lift.limits
    ([0.0, 0.0, 1.0], (0.0, 1.5))
    """

    _default_name: ClassVar[str] = "slider"


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class Screw(_JointOfRobot):
    """Two rigid bodies joined by a screw: body 2 turns about the axis n by q [rad] and moves along it by `pitch` q,
    R2 = R1 + S1 (u1 + n pitch q) - S2 u2 and S2 = S1 Sh(n, q) home.

    It is a joint of a `Mechanism`. Arguments not listed, and attributes, are those of a `HingePair`. The torque of
    inverse dynamics is that of a motor about the axis. URDF and MJCF have no screws.

    Args:
        u1: vector from the reference point of body 1 to a point of the axis, body-1 axes [m]; shape (3,).
        u2: vector from the reference point of body 2 to the point of body 2 that is there at q = 0, body-2 axes [m];
            shape (3,).
        pitch: displacement along n for one radian [m/rad], not 0. A thread with the lead p per turn has p / (2 pi), a
            left-handed one -p / (2 pi).

    >>> import hingepair as hp, math
    >>> spindle = hp.Screw((0, 0, 0), (0, 0, 0), (0, 0, 1), pitch=0.005 / (2 * math.pi), name="spindle")
    >>> lift = hp.Mechanism([spindle])
    >>> print(lift.forward_kinematics([2 * math.pi])["spindle"].R.round(6))
    [0.    0.    0.005]
    """

    pitch: float
    _default_name: ClassVar[str] = "screw"

    def __init__(
        self,
        u1: ArrayLike,
        u2: ArrayLike,
        n: ArrayLike,
        pitch: float,
        home: ArrayLike | None = None,
        name: str | None = None,
        **options: Unpack[JointOptions],
    ) -> None:
        # super() does not work in a class whose slots are made afterwards.
        _JointOfRobot.__init__(self, u1, u2, n, home, name, **options)
        checked = finite_number("pitch", pitch)
        if not checked:
            raise ArgumentError("pitch", "a number other than 0 (a HingePair has none)", pitch)
        set_frozen(self, pitch=checked)


DEFAULT_NAMES: Final = ("hinge_pair", "slider", "screw")
"""Names of joints that were given none."""
RobotJoint: TypeAlias = HingePair | Slider | Screw
"""What a robot is made of."""


@runtime_checkable
class JointOfSeveral(Protocol):
    """A joint of several coordinates, such as a ball joint: joints in series with bodies of no mass between them."""

    def in_series(self) -> Sequence[RobotJoint]:
        """Return the joints, from body 1 to body 2."""


JOINT_CLASSES: Final[Mapping[JointKind, type[RobotJoint]]] = MappingProxyType(
    {"hinge": HingePair, "slider": Slider, "screw": Screw}
)
"""Classes by the kind of joint."""
