"""Proof of the elementary functions: their errors at all angles and sizes, against 60 digits."""

from __future__ import annotations

import functools
import math

import mpmath
import numpy as np
import pytest

from hingepair.bench.truth import DIGITS
from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.engine.trace import arc_tangent, hypotenuse, square_root
from hingepair.numeric.bounded import SINE_ULPS, bounded_class

# By function: of traced values, of long doubles (to find the samples that are worth 60 digits), and of 60 digits;
# then the largest error in units of the last place. NumPy promises 4 of its arctan2.
FUNCTIONS = {
    "sin": (lambda x, _: x.sine(), lambda x, _: np.sin(x), lambda x, _: mpmath.sin(x), SINE_ULPS),
    "cos": (lambda x, _: x.cosine(), lambda x, _: np.cos(x), lambda x, _: mpmath.cos(x), SINE_ULPS),
    "versine": (
        lambda x, _: x.versine(),
        lambda x, _: 2 * np.sin(x / 2) ** 2,
        lambda x, _: 2 * mpmath.sin(x / 2) ** 2,
        4.5,
    ),
    "sqrt": (lambda x, _: square_root(x), lambda x, _: np.sqrt(x), lambda x, _: mpmath.sqrt(x), 0.5),
    "arctan2": (
        lambda x, y: arc_tangent(y, x),
        lambda x, y: np.arctan2(y, x),
        lambda x, y: mpmath.atan2(y, x),
        4.0,
    ),
    "hypot": (hypotenuse, np.hypot, mpmath.hypot, 1.0),
}
RANGES = {"to 3": (-9, 0.5), "to 1e6": (0, 6), "to 1e9": (6, 9), "to 1e15": (9, 15), "beyond 1e15": (15, 300)}


def numbers(rng, powers, dtype):
    """Numbers of all sizes in a range, and those next to multiples of pi/2 and to where the versine changes over."""
    low, high = powers[0], min(powers[1], 38 if dtype is np.float32 else 300)
    spread = 10.0 ** rng.uniform(low, high, 100_000)
    quarters = np.rint(10.0 ** rng.uniform(max(low, 0), min(high, 15), 50_000)) * (np.pi / 2)
    changes = quarters + rng.choice((-1, 1), quarters.size) * np.arccos(0.7)
    x = np.concatenate((spread, quarters, changes, closest_to_quarters()))
    x = x[(x >= 10.0**low) & (x <= 10.0**high)]
    return (x * rng.choice((-1, 1), x.size)).astype(dtype)


@functools.cache
def closest_to_quarters():
    """Doubles m 2^e that are closer to a multiple of pi/2 than all with smaller m: convergents of a fraction."""
    found = []
    with mpmath.workdps(400):
        for e in range(-52, 971):
            rest, m, before = mpmath.ldexp(1, e) * 2 / mpmath.pi, 1, 0
            while m < 2**53:
                found.append(math.ldexp(m, e))
                rest = 1 / (rest - mpmath.floor(rest))
                m, before = int(mpmath.floor(rest)) * m + before, m
    return np.array(found)


@pytest.mark.proof
@pytest.mark.parametrize("powers", RANGES.values(), ids=RANGES)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_errors_of_functions(name, backend, dtype, powers):
    """None is beyond its units in the last place, nor beyond the bound that the equations give a sine."""
    traced, long, exactly, ulps = FUNCTIONS[name]
    rng = np.random.default_rng(5)
    x = numbers(rng, powers, dtype)
    x, y = (abs(x) if name == "sqrt" else x), rng.permutation(x)
    loop = Loop("f", lambda v: {"z": traced(v["x"], v["y"])}, {"x": (), "y": ()}, {"z": ()})
    got = np.empty_like(x)
    loop.run({"x": x, "y": y}, {"z": got}, x.shape, x.dtype, Execution(backend, 1))
    bounded = getattr(bounded_class(x.dtype), {"sin": "sine", "cos": "cosine"}.get(name, name), None)
    with np.errstate(all="ignore"):
        truth = long(x.astype(np.longdouble), y.astype(np.longdouble))
        off = np.abs(got - truth) / np.spacing(np.abs(truth).astype(dtype))
        bounds = bounded(bounded_class(x.dtype)(x.astype(float))).error if bounded else np.full(x.size, np.inf)
    off = np.where(np.isfinite(off), off, 0.0)  # a length may overflow
    with mpmath.workdps(DIGITS):
        for k in {*np.argsort(-off)[:200].tolist(), *rng.integers(x.size, size=200).tolist()}:
            exact = exactly(mpmath.mpf(float(x[k])), mpmath.mpf(float(y[k])))
            if abs(exact) > np.finfo(dtype).max:
                continue
            error, ulp = abs(mpmath.mpf(float(got[k])) - exact), float(np.spacing(dtype(abs(exact))))
            far = abs(x[k]) > 1e6 and bounded  # reduced by a multiple of pi/2 to 2^-88
            assert error <= ulps * ulp + (2.0**-88 if far else 0), (x[k], y[k], float(error / ulp))
            assert error <= bounds[k], (x[k], float(error), bounds[k])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sin", "cos", "versine"])
def test_errors_of_compiled_sines(name):
    test_errors_of_functions(name, "compiled", np.float64, RANGES["to 1e6"])
