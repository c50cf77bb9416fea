"""Kinds of joints."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal, NamedTuple, TypeAlias

from hingepair.equations.joints import HINGE, SLIDER, Axis

JointKind: TypeAlias = Literal["fixed", "hinge", "screw", "slider"]


class Kind(NamedTuple):
    """One kind of joint."""

    turns: float  # angle of the body about the axis for one unit of q
    shifts: float | None  # displacement along the axis for one unit of q; None: the joint's pitch says it
    unit: str  # of q
    effort: str  # unit of the torque or force along q
    urdf: str | None  # its type in URDF; None where URDF has none
    pinocchio: str  # its class in Pinocchio, for an axis of any direction

    @property
    def has_pitch(self) -> bool:
        """Whether each joint says how far it shifts its body."""
        return self.shifts is None

    def axis(self, pitch: float) -> Axis:
        """Return the axis of a joint of this kind; `pitch` [m/rad] is read where the kind leaves it open."""
        return Axis(self.turns, pitch if self.shifts is None else self.shifts)


KINDS: Final[Mapping[JointKind, Kind]] = MappingProxyType(
    {
        "fixed": Kind(0.0, 0.0, "", "", "fixed", ""),  # folds into the body that carries it
        "hinge": Kind(*HINGE, "rad", "N m", "revolute", "JointModelRevoluteUnaligned"),
        "screw": Kind(1.0, None, "rad", "N m", None, "JointModelHelicalUnaligned"),
        "slider": Kind(*SLIDER, "m", "N", "prismatic", "JointModelPrismaticUnaligned"),
    }
)
