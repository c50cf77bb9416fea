"""The options that methods of pairs and robots share, typed once.

A method takes `**options: Unpack[Options]`; `with_options` shows each option in its signature, so that `help` and
editors list them, with their defaults.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, Final, TypeAlias, TypedDict, TypeVar

from numpy.typing import ArrayLike, NDArray

from hingepair.errors import nearest
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.plans.arguments import Coordinates

Out: TypeAlias = Mapping[str, NDArray[Any]] | NDArray[Any] | None
"""Arrays by output name, into which results are written; where there is one output, also one array."""
Wrenches: TypeAlias = Mapping[str, tuple[ArrayLike, ArrayLike]] | None
"""(force, torque) by link or frame, world axes, at its origin [N, N m]; shape (..., 3) each, or the number 0."""
DEFAULT_GRAVITY: Final = (0.0, 0.0, -9.81)  # m/s^2, world axes


class Options(TypedDict, total=False):
    """Options of methods; each method has some of them."""

    outputs: Iterable[str] | None
    sequence: str
    gravity: ArrayLike
    wrenches: Wrenches
    joint_loads: bool | None
    base_motion: BodyMotion | None
    out: Out
    workers: int
    backend: str


class FurtherOptions(Options, total=False):
    """Those that other methods have as arguments, too."""

    frames: str | Iterable[str] | None
    force1: ArrayLike
    torque1: ArrayLike


RUN_OPTIONS: Final = ("workers", "backend")  # options of a call without arrays to write into
OUT_OPTIONS: Final = ("out", *RUN_OPTIONS)
EULER_OPTIONS: Final = ("outputs", "sequence", *OUT_OPTIONS)
GRAVITY_OPTIONS: Final = ("gravity", *OUT_OPTIONS)
BASE_OPTIONS: Final = ("base_motion", *OUT_OPTIONS)  # of a robot, whose base may move
WEIGHT_OPTIONS: Final = ("gravity", *BASE_OPTIONS)
WRENCHES_OPTIONS: Final = ("outputs", "wrenches", *WEIGHT_OPTIONS)
DYNAMICS_OPTIONS: Final = ("joint_loads", *WRENCHES_OPTIONS)
FORWARD_OPTIONS: Final = ("force1", "torque1", *DYNAMICS_OPTIONS)  # forces move a free base
BOUNDS_OPTIONS: Final = ("frames", "outputs", "gravity", "base_motion")
ROLLOUT_OPTIONS: Final = ("gravity", "wrenches", "joint_loads", "base_motion", "out", "workers")
LOOP_OPTIONS: Final = ("gravity", "wrenches", "base_motion", "backend")  # of the wrenches in loops


class SearchOptions(TypedDict, total=False):
    """Options of inverse kinematics."""

    frame: str | None
    direction: Any
    axis: Any
    relative_to: str | Mapping[str, str] | None
    centre_of_mass: Any
    coordinates: Mapping[str, ArrayLike] | None
    q0: Coordinates | None
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


def with_options(*names: str, **defaults: Any) -> Callable[[Method], Method]:
    """Return a decorator that shows options in the signature of a method, which takes them as `**options`; `defaults`
    are those that differ from other methods'. So a method hands its options to `ask` in one word, and `help` shows
    them all.
    """
    shown = {**defaults, **_DEFAULTS, **defaults}

    def decorate(method: Method) -> Method:
        signature = inspect.signature(method)
        *own, last = signature.parameters.values()
        types = method.__globals__[last.annotation.removeprefix("Unpack[").removesuffix("]")].__annotations__
        options = [
            inspect.Parameter(
                one, inspect.Parameter.KEYWORD_ONLY, default=value, annotation=types[one].__forward_arg__
            )
            for one, value in shown.items()
            if one in {*names, *defaults} - signature.parameters.keys()
        ]
        method.__signature__ = signature.replace(parameters=[*own, *options])  # type: ignore[attr-defined]
        return method

    return decorate


def check_options(method: str, options: Mapping[str, Any], accepted: Collection[str]) -> None:
    """Refuse an option that a method does not have, as Python does.

    Raises:
        TypeError: an unknown option.
    """
    for name in options:
        if name not in accepted:
            near = nearest(name, accepted)
            raise TypeError(f"{method}() got an unexpected keyword argument {name!r}{near}")
