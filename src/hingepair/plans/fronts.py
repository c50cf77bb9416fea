"""Fronts: what is given in place of the values of a tree, traced before the tree in the same program.

A tree computes with q, the motion of its base and its loads (`plans.trees`). A front makes these values of what is
given instead, such as seven coordinates or a quaternion: each at its first access, so that what no output needs is
never traced, and what is known of the given values folds. Fronts stand one behind the other; what stands behind a
front does not know of it.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Final

from hingepair.equations.spatial import Matrix, Scalar, Vector
from hingepair.numeric.blocks import angle_terms, cosine, sine
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.attitudes import quaternion_rotation, zero_quaternion_check
from hingepair.plans.trees import TreeQuantities
from hingepair.rotations.sequences import EulerSequence, find_sequence


class Front(Mapping[str, Any]):
    """Values by name: those that this front makes, each the attribute of its name, and what is given under all other
    names.

    Args:
        given: values by name: those of a call, or the front before this one.

    Attributes:
        needs: for each value that is made, the names of what it is made of.
    """

    needs: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    def __init__(self, given: Mapping[str, Any]) -> None:
        self.given = given

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name) if name in self.needs else self.given[name]

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self.needs, *self.given)))

    def __len__(self) -> int:
        return len({*self.needs, *self.given})


def needed_names(fronts: Iterable[type[Front]], names: Iterable[str]) -> set[str]:
    """Return the names of what has to be given for values of these names, behind fronts in their order.

    >>> sorted(needed_names((SevenCoordinates, HingeAngle), ("q", "v1", "gravity")))
    ['gravity', 'q', 'qd']
    """
    found = {*names}
    for front in reversed([*fronts]):
        found = {one for name in found for one in front.needs.get(name, (name,))}
    return found


# ---- coordinates, divided into parts


class _Coordinates(Front):
    """Position and angles, given together in the arrays q, qd and qdd."""

    parts: ClassVar[Mapping[str, tuple[str, Any]]]  # for each part, the name of the array and its place there

    def __init_subclass__(cls) -> None:
        cls.needs = {name: (array,) for name, (array, _) in cls.parts.items()}

    def __getitem__(self, name: str) -> Any:
        if name not in self.parts:
            return self.given[name]
        array, place = self.parts[name]
        return self.given[array][place]


def _parts(**places: Any) -> dict[str, tuple[str, Any]]:
    """Return the parts of q at these places, and their derivatives in qd and qdd."""
    parts: dict[str, tuple[str, Any]] = {}
    for name, place in places.items():
        derivatives = ("R1", "v1", "a1") if name == "R1" else (name, f"{name}d", f"{name}dd")
        parts |= {one: (array, place) for one, array in zip(derivatives, ("q", "qd", "qdd"), strict=True)}
    return parts


class SevenCoordinates(_Coordinates):
    """R1, the Euler angles phi and psi, with their derivatives, of the coordinates of a pair in space."""

    parts: ClassVar = _parts(R1=slice(0, 3), phi=slice(3, 6), psi=6)


class FourCoordinates(_Coordinates):
    """R1, the angle phi1 and psi, with their derivatives, of the coordinates of a planar pair."""

    parts: ClassVar = _parts(R1=slice(0, 2), phi1=2, psi=3)


# ---- the motion of body 1, the base


class EulerAngles(Front):
    """Attitude, angular velocity and acceleration of body 1, given as phi, phid and phidd (E4, E10)."""

    needs: ClassVar = {"S1": ("phi",), "omega1": ("phi", "phid"), "alpha1": ("phi", "phid", "phidd")}
    sequence: ClassVar[EulerSequence]

    @lock_free_cached_property
    def _trig(self) -> tuple[Scalar, ...]:
        """Sines and cosines of the angles, in the order of the canonical sequence."""
        return angle_terms(self.sequence.angles(self.given["phi"]))

    @lock_free_cached_property
    def _axes(self) -> tuple[Scalar, ...]:
        """The entries that vary in the columns of J."""
        return self.sequence.axes(self._trig)

    @lock_free_cached_property
    def S1(self) -> Matrix:
        """Attitude of body 1."""
        return self.sequence.attitude(self._trig)

    @lock_free_cached_property
    def omega1(self) -> Vector:
        """Angular velocity of body 1."""
        return self.sequence.angular_velocity(self._axes, self.given["phid"])

    @lock_free_cached_property
    def alpha1(self) -> Vector:
        """Angular acceleration of body 1."""
        return self.sequence.angular_acceleration(self._axes, self.given["phid"], self.given["phidd"])


@functools.cache
def euler_angles(sequence: str) -> type[EulerAngles]:
    """Return the front for the Euler angles of a sequence such as "XYZ"."""
    return type(f"EulerAngles{sequence}", (EulerAngles,), {"sequence": find_sequence(sequence)})


class Quaternion(Front):
    """Attitude of body 1, given as a quaternion."""

    name: ClassVar[str]  # of the input
    places: ClassVar[tuple[int, ...]]  # of w, x, y and z

    @lock_free_cached_property
    def S1(self) -> Matrix:
        """Attitude of body 1."""
        quat = self.given[self.name]
        return quaternion_rotation(tuple(quat[k] for k in self.places))

    def __getitem__(self, name: str) -> Any:
        if name == f"{self.name}_check":  # 2 for a quaternion of zeros, else 0
            return zero_quaternion_check(self.given[self.name])
        return super().__getitem__(name)


def _quaternion(name: str, *places: int) -> type[Quaternion]:
    needs = {"S1": (name,), f"{name}_check": (name,)}
    return type(f"Quaternion_{name}", (Quaternion,), {"name": name, "places": places, "needs": needs})


QUATERNION_FRONTS: Final = {
    "quat_xyzw": _quaternion("quat_xyzw", 3, 0, 1, 2),
    "quat_wxyz": _quaternion("quat_wxyz", 0, 1, 2, 3),
}
"""Fronts by the names of quaternions, which can be given in place of S1."""


class Plane(Front):
    """Motion and loads in space, given in the plane: vectors of two components, and numbers about z (E11)."""

    _vectors: ClassVar = ("R1", "v1", "a1", "gravity", "force1", "force2")
    _rates: ClassVar = {"omega1": "phi1d", "alpha1": "phi1dd", "torque1": "torque1", "torque2": "torque2"}
    needs: ClassVar = {
        "S1": ("phi1",),
        **{name: (name,) for name in _vectors},
        **{name: (given,) for name, given in _rates.items()},
    }

    def __getitem__(self, name: str) -> Any:
        if name in self._vectors:
            x, y = self.given[name]
            return x, y, 0.0
        return (0.0, 0.0, self.given[self._rates[name]]) if name in self._rates else super().__getitem__(name)

    @lock_free_cached_property
    def S1(self) -> Matrix:
        """Attitude of body 1, turned about z by phi1."""
        s, c = sine(self.given["phi1"]), cosine(self.given["phi1"])
        return c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0


# ---- the joint


class HingeAngle(Front):
    """Coordinate and loads of a tree of one hinge, given as psi, hinge_torque and so on."""

    _numbers: ClassVar = {"q": "psi", "qd": "psid", "qdd": "psidd", "tau": "hinge_torque"}  # of a tree, one in a row
    _names: ClassVar = {"force_0": "force2", "torque_0": "torque2"}
    needs: ClassVar = {name: (given,) for name, given in (_numbers | _names).items()}

    def __getitem__(self, name: str) -> Any:
        if name in self._numbers:
            return (self.given[self._numbers[name]],)
        return self.given[self._names.get(name, name)]


class ForwardDynamics(Front):
    """Accelerations of a tree with a free base, solved for from its loads (T5, T6).

    Args:
        given: values by name.
        tree: the tree for these values.
    """

    _loads: ClassVar = ("tau", "force1", "torque1", "force_0", "torque_0")
    needs: ClassVar = dict.fromkeys(("a1", "alpha1", "qdd"), ("q", "S1", "qd", "omega1", "gravity", *_loads))

    def __init__(self, given: Mapping[str, Any], tree: TreeQuantities) -> None:
        super().__init__(given)
        self._tree = tree

    def __getitem__(self, name: str) -> Any:
        return self._tree.solved[[*self.needs].index(name)] if name in self.needs else self.given[name]
