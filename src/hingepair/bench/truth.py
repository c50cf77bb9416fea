"""How far each way of `bench direct` is from 50 digits, on ordinary states and on hard ones."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hingepair.bench.methods import LEVELS, PARTS, Method, Motion, converted
from hingepair.pair.accuracy import error_ratios, euler_rate_sizes, output_scales
from hingepair.pair.hinge_pair import HingePair

DIGITS = 50
_PHI_Y, _PSI = 4, 6
_ANGLES = slice(3, 7)


def worst_errors(methods: Iterable[Method], pair: HingePair, motion: Motion, level: str) -> dict[str, float]:
    """Each way's largest error of any output, in units of u * scale of its dtype; by the way's name.

    States that the dtype cannot hold are left out. Infinite where a way refuses the states, or gives something that
    is not finite for one of them.
    """
    truths: dict[Any, tuple[Motion, dict[str, NDArray[Any]]]] = {}
    errors = {}
    for method in methods:
        if method.dtype not in truths:
            given = _fitting(motion, method.dtype)
            truths[method.dtype] = given, _exact(pair, given, level)
        given, exact = truths[method.dtype]
        scales = _scales(pair, given)
        try:
            with np.errstate(all="ignore"):
                found = method.prepare(pair, given)()
        except ValueError:
            errors[method.name] = math.inf
            continue
        ratios = [
            error_ratios(name, found[name], exact[name], scales[name], method.dtype)[1] for name in LEVELS[level]
        ]
        errors[method.name] = max(float(np.nanmax(ratio)) for ratio in ratios)
    return errors


def random_states(rng: np.random.Generator, count: int, parts: int) -> Motion:
    """Ordinary states: so many of q, qd, qdd, of shape (count, 7)."""
    return tuple(rng.normal(size=(parts, count, 7)))


def hard_states(rng: np.random.Generator, parts: int) -> Motion:
    """States at which such computations go wrong: each an ordinary one but for what is said here."""
    quarter = math.pi / 2
    changes: list[tuple[Any, Any, float]] = [(_PSI, psi, 1.0) for psi in (1e-160, 1e-9, -1e-5, 0.0)]
    changes += [(_PSI, psi, 1.0) for psi in (math.pi, math.pi - 1e-9, math.pi + 1e-9, 1e5, -1e16, 1e300)]
    changes += [(_PHI_Y, angle, 1.0) for angle in (quarter, -quarter, quarter - 1e-9, quarter + 1e-9)]
    changes += [(_ANGLES, (quarter, 2 * quarter, -quarter, 4 * quarter), 1.0)]
    changes += [(_ANGLES, angle, 1.0) for angle in (1e-9, 1e6, 1e16)]
    changes += [(slice(0, 3), (far, -far / 3, far), 1.0) for far in (1e8, 1e15)]
    changes += [(slice(0, 0), (), rate) for rate in (0.0, 1e-60, 1e20, 1e100)]
    motion = rng.normal(size=(3, len(changes), 7))
    for sample, (index, value, rate) in enumerate(changes):
        motion[0, sample, index] = value
        motion[1, sample] *= rate
        motion[2, sample] *= rate * rate
    return tuple(motion[:parts])


def _fitting(motion: Motion, dtype: DTypeLike) -> Motion:
    """The states of a dtype that are finite in it, the squares of their rates too."""
    with np.errstate(over="ignore"):
        given = converted(motion, dtype)
        keep = np.logical_and.reduce([np.isfinite(c).all(axis=1) for c in given])
        for rates in given[1:2]:
            keep &= (np.abs(rates) < 1e-3 * math.sqrt(np.finfo(np.dtype(dtype)).max)).all(axis=1)
    return tuple(c[keep] for c in given)


def _exact(pair: HingePair, motion: Motion, level: str) -> dict[str, NDArray[Any]]:
    """The outputs to 50 digits, rounded to doubles at the end: the plan's steps over mpmath numbers."""
    import mpmath

    from hingepair.evaluation.plan import make_plan

    def numbers(row: Any) -> tuple[Any, ...]:
        return tuple(mpmath.mpf(float(x)) for x in row)

    with mpmath.workdps(DIGITS):
        n = numbers(pair.n)
        constants = {key: numbers(getattr(pair, key).ravel()) for key in ("u1", "u2", "home")}
        length = mpmath.sqrt(sum(x * x for x in n))
        constants["n"] = tuple(x / length for x in n)
        plan = make_plan(LEVELS[level], "XYZ", True, (_angle_terms, _hinge_terms))
        found: dict[str, list[Any]] = {name: [] for name in LEVELS[level]}
        for sample in zip(*motion, strict=True):
            values: dict[str, Any] = dict(constants)
            for names, seven in zip(PARTS, map(numbers, sample), strict=False):
                values |= dict(zip(names, (seven[:3], seven[3:6], seven[6]), strict=True))
            plan.run(values)
            for name, parts in found.items():
                parts.append([float(x) for x in values[name]])
    return {name: np.array(p).reshape(-1, *((3, 3) if name == "S2" else (3,))) for name, p in found.items()}


def _angle_terms(phi: Any) -> tuple[Any, ...]:
    import mpmath

    return tuple(f(angle) for angle in phi for f in (mpmath.sin, mpmath.cos))


def _hinge_terms(psi: Any) -> tuple[Any, Any]:
    import mpmath

    return mpmath.sin(psi), 2 * mpmath.sin(psi / 2) ** 2


def _scales(pair: HingePair, motion: Motion) -> dict[str, NDArray[np.float64]]:
    q, qd, qdd = (*motion, None, None)[:3]
    W1, A1 = euler_rate_sizes(None if qd is None else qd[:, 3:6], None if qdd is None else qdd[:, 3:6])
    linear: dict[str, Any] = {name: c[:, :3] for name, c in (("R1", q), ("v1", qd), ("a1", qdd)) if c is not None}
    hinge: dict[str, Any] = {name: c[:, 6] for name, c in (("psid", qd), ("psidd", qdd)) if c is not None}
    return output_scales(u1=pair.u1, u2=pair.u2, W1=W1, A1=A1, **linear, **hinge)
