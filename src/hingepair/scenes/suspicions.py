"""Suspicions of units in a scene: of the numbers as its file has them, and of functions of time.

What each quantity is judged by stands in `hingepair.tables.suspicions`; here it is found.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hingepair.numeric.arrays import Float64Array
from hingepair.tables.suspicions import DEGREES_IN_SCENES, suspicions

if TYPE_CHECKING:
    from hingepair.scenes.motions.functions import FunctionsOfTime

MAX_JUDGED: Final = 101
"""Number of instants at which a motion is judged, evenly spread."""

_ANGLES, _RATES, _LENGTHS = "written angles", "written rates", "written lengths"
_KIND_BY_KEY: Final[Mapping[str, str]] = {
    **dict.fromkeys(
        ("phi", "phi_x", "phi_y", "phi_z", "psi", "phi_0", "psi_0", "q_0", "rest", "stops", "rad", "rpy"), _ANGLES
    ),
    **dict.fromkeys(("omega1_0", "qd_0", "rate_limit", "friction_rate"), _RATES),
    **dict.fromkeys(("u1", "u2", "centre_of_mass", "center", "box", "sphere", "cylinder", "length"), _LENGTHS),
}
"""Quantities of the keys of a scene, wherever they stand."""
_FUNCTION_KINDS: Final[Mapping[str, str]] = {_ANGLES: "turning", _RATES: "rate"}
"""Quantity of samples of a function, by the quantity of its numbers."""


def file_suspicions(values: Mapping[str, Any], limits: Mapping[str, Sequence[float]]) -> Iterator[str]:
    """Yield a sentence for each number of a scene's tables that is probably in another unit, but one alone on
    lengths, of which a scene in millimetres has many. Texts are left out: what is computed is in radians, and
    functions are judged by their samples.

    Args:
        values: the tables of the file.
        limits: limits of the hinges, by the names of their angles.
    """
    for name, own in limits.items():
        yield from suspicions(_ANGLES, f"limits of {name}", own, radians=DEGREES_IN_SCENES)
    said = set()
    for found, name, numbers in _judged_numbers("", values, {**_KIND_BY_KEY, **dict.fromkeys(limits, _ANGLES)}):
        kind = "assembled angles" if name.startswith("mechanism.at.") else found
        doubts = suspicions(kind, name, numbers, radians=DEGREES_IN_SCENES)
        yield from doubts if kind not in said else ()
        said |= {_LENGTHS} if doubts and kind == _LENGTHS else set()


def _judged_numbers(
    path: str, values: Mapping[str, Any], kinds: Mapping[str, str]
) -> Iterator[tuple[str, str, list[float]]]:
    """Yield (quantity, path + key with its tables, numbers) for each key of `kinds` in nested tables."""
    for key, value in values.items():
        name = f"{path}{key}"
        parts = value if isinstance(value, list) else [value]
        if key in {"constants", "outputs"}:
            continue
        if key in kinds and isinstance(value, dict) and "value" in value:  # way points
            parts = value["value"] if isinstance(value["value"], list) else []
        elif all(isinstance(part, dict) for part in parts):
            for i, part in enumerate(parts):
                place = name if part is value else f"{name}.{part['name']}" if "name" in part else f"{name}[{i}]"
                yield from _judged_numbers(f"{place}.", part, kinds)
            continue
        numbers = [part for part in parts if isinstance(part, int | float) and not isinstance(part, bool)]
        if key in kinds and numbers and not (values.get("kind") == "slider" and kinds[key] in _FUNCTION_KINDS):
            yield kinds[key], name, numbers


def function_suspicions(
    functions: FunctionsOfTime, t: Float64Array, step: float, hinges: Iterable[str]
) -> Iterator[str]:
    """Yield a sentence for each expression in t whose samples at the instants t are probably in another unit, and one
    on the `step` [s] of [time] if an angle usually turns by a radian or more in it. The functions of the named hinges
    are angles.
    """
    kinds = {**_KIND_BY_KEY, **dict.fromkeys(hinges, _ANGLES)}
    samples, rates = functions.rows(t, 1)
    turned = [step * np.median(np.abs(rate)) for name, rate in rates.items() if kinds.get(name) == _ANGLES]
    if max(turned, default=0.0) >= 1.0:
        yield from suspicions("instants", "t", step * np.arange(len(t)))
    for name, values in samples.items():
        kind = kinds.get(name, "")
        if kind in _FUNCTION_KINDS and isinstance(functions.table.values.get(name), str):
            turning = np.asarray(rates[name])
            is_uniform = kind == _ANGLES and np.ptp(values) > 0 and np.ptp(turning) == 0  # such as "360*t"
            kind = kind if np.ptp(values) == 0 else _FUNCTION_KINDS[kind]
            doubts = suspicions(kind, f"motion.{name}", values, radians=DEGREES_IN_SCENES)
            if is_uniform and not doubts:
                doubts = suspicions(_RATES, f"the rate of motion.{name}", turning, radians=DEGREES_IN_SCENES)
            yield from doubts
