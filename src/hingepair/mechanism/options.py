"""The options that methods of pairs and robots share, typed once.

A method takes `**options: Unpack[Options]`; `with_options` shows each option in its signature, so that `help` and
editors list them, with their defaults.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, TypeAlias, TypedDict, TypeVar

from numpy.typing import ArrayLike, NDArray

from hingepair.errors import nearest
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.plans.arguments import Coordinates
from hingepair.plans.pairs import SPACE

Out: TypeAlias = Mapping[str, NDArray[Any]] | NDArray[Any] | None
"""Arrays by output name, into which results are written; where there is one output, also one array."""
Wrenches: TypeAlias = Mapping[str, tuple[ArrayLike, ArrayLike]] | None
"""(force, torque) by link or frame, world axes, at its origin [N, N m]; shape (..., 3) each, or the number 0."""
DEFAULT_GRAVITY: Final = SPACE.gravity  # (0, 0, -9.81) m/s^2, world axes


class RunOptions(TypedDict, total=False):
    """How a call is computed."""

    workers: int
    backend: str


class OutOptions(RunOptions, total=False):
    """How a call is computed, and where its results go."""

    out: Out


class OutputOptions(OutOptions, total=False):
    """Options of a call with a choice of outputs."""

    outputs: Iterable[str] | None


class EulerOptions(OutputOptions, total=False):
    """Options of a call that takes Euler angles."""

    sequence: str


class GravityOptions(OutOptions, total=False):
    """Options of a call that depends on gravity."""

    gravity: ArrayLike


class BaseOptions(OutOptions, total=False):
    """Options of a robot, whose base may move."""

    base_motion: BodyMotion | None


class JacobianOptions(BaseOptions, total=False):
    """Options of what is computed of frames."""

    frames: str | Iterable[str] | None


class FrameOptions(JacobianOptions, total=False):
    """Options of the motion of frames."""

    outputs: Iterable[str] | None


class WeightOptions(BaseOptions, total=False):
    """Options of a robot under gravity."""

    gravity: ArrayLike


class WrenchOptions(WeightOptions, total=False):
    """Options of a robot under gravity and wrenches."""

    wrenches: Wrenches
    outputs: Iterable[str] | None


class DynamicsOptions(WrenchOptions, total=False):
    """Options of a robot's dynamics."""

    joint_loads: bool | None


class ForwardOptions(DynamicsOptions, total=False):
    """Options of forward dynamics, in which forces move a free base."""

    force1: ArrayLike
    torque1: ArrayLike


class LoopOptions(TypedDict, total=False):
    """Options of the wrenches in loops."""

    gravity: ArrayLike
    wrenches: Wrenches
    base_motion: BodyMotion | None
    backend: str


class SearchOptions(TypedDict, total=False):
    """Options of inverse kinematics."""

    frame: str | None
    direction: Any
    axis: Any
    relative_to: str | Mapping[str, str] | None
    centre_of_mass: Any
    coordinates: Mapping[str, ArrayLike] | None
    q0: Coordinates | None
    held: str | Iterable[str]
    base: str
    limits: bool | ArrayLike
    prefer: str | Coordinates | None
    position_tolerance: float
    angle_tolerance: float
    base_motion: BodyMotion | None
    seed: int
    workers: int


SEARCH_DEFAULTS: Final[dict[str, Any]] = {
    **dict.fromkeys(("frame", "direction")),
    "axis": (0, 0, 1),
    **dict.fromkeys(("relative_to", "centre_of_mass", "coordinates", "q0")),
    "held": (),
    "base": "hold",
    "limits": True,
    "prefer": None,
    "position_tolerance": 1e-9,
    "angle_tolerance": 1e-9,
    "base_motion": None,
    "seed": 0,
    "workers": 1,
}
"""Defaults of inverse kinematics, in the order of signatures."""
_DEFAULTS: Final[dict[str, Any]] = {
    "frames": None,
    "outputs": None,
    "sequence": "XYZ",
    "gravity": DEFAULT_GRAVITY,
    "wrenches": None,
    "joint_loads": None,
    "force1": 0,
    "torque1": 0,
    "base_motion": None,
    "out": None,
    "workers": 1,
    "backend": "auto",
}
"""Defaults, in the order of signatures."""

Method = TypeVar("Method", bound=Callable[..., Any])


def with_options(**defaults: Any) -> Callable[[Method], Method]:
    """Return a decorator that shows, in the signature of a method, the options that the annotation of its `**options`
    names; `defaults` are those that differ from other methods'.
    """

    def decorate(method: Method) -> Method:
        signature = inspect.signature(method)
        *own, last = signature.parameters.values()
        name = last.annotation.removeprefix("Unpack[").removesuffix("]")
        annotations = method.__globals__[name].__annotations__
        kind = inspect.Parameter.KEYWORD_ONLY
        shown = [
            inspect.Parameter(one, kind, default=value, annotation=annotations[one].__forward_arg__)
            for one, value in {**defaults, **_DEFAULTS, **defaults}.items()
            if one in annotations
        ]
        method.__signature__ = signature.replace(parameters=[*own, *shown])  # type: ignore[attr-defined]
        return method

    return decorate


def check_options(method: str, options: Mapping[str, Any], accepted: type) -> None:
    """Refuse an option that a method does not have, as Python does.

    Raises:
        TypeError: an unknown option.
    """
    for name in options:
        if name not in accepted.__annotations__:
            near = nearest(name, accepted.__annotations__)
            raise TypeError(f"{method}() got an unexpected keyword argument {name!r}{near}")
