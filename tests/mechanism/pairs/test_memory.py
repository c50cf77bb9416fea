"""Peak memory: inputs, outputs and 10 MB, whatever the backend, the dtype, the layout and the number of threads."""

from __future__ import annotations

import functools
import tracemalloc

import numpy as np
import pytest

import hingepair as hp
from support.states import generator

pytestmark = pytest.mark.slow

SAMPLES = 430_000  # three components of a copy are more than the room
ROOM = 10_000_000


@functools.cache
def numbers(parts):
    return tuple(generator(90).normal(size=(parts, SAMPLES, 7)))


def rows(motion):
    return motion


def columns(motion):
    return tuple(tuple(np.ascontiguousarray(c[:, i]) for i in range(7)) for c in motion)


def strided(motion):
    return tuple(np.repeat(c, 2, axis=1)[:, ::2] for c in motion)


def mixed(motion):
    return (motion[0].astype(np.float32), *motion[1:])


def as_dtype(dtype):
    def convert(motion):
        return tuple((100 * c if np.dtype(dtype).kind == "i" else c).astype(dtype) for c in motion)

    convert.__name__ = np.dtype(dtype).str
    return convert


FOREIGN = as_dtype(">f8")
FORMS = (FOREIGN, rows, columns, strided, mixed)
FORMS += tuple(map(as_dtype, (np.float32, np.int32)))


def extra(call):
    """Bytes at the highest point of a call beyond what was there and what it returns."""
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        state = call()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return peak - before - sum(array.nbytes for array in state.arrays().values())


LEVELS = ("pose", "velocity", "acceleration")
CASES = [(backend, rows, "acceleration", 1) for backend in ("numpy", "compiled")]
CASES += [("numpy", form, "velocity" if form is mixed else "pose", 1) for form in FORMS]
CASES += [("compiled", form, "velocity" if form is mixed else "pose", 1) for form in (columns, mixed)]
CASES += [(backend, form, "pose", 2) for backend in ("numpy", "compiled") for form in (rows, FOREIGN)]


@pytest.mark.parametrize(("backend", "form", "level", "workers"), CASES, ids=lambda c: getattr(c, "__name__", str(c)))
def test_coordinates_take_inputs_outputs_and_ten_megabytes(backend, form, level, workers):
    parts = LEVELS.index(level) + 1
    pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
    pair.forward_kinematics(np.zeros((2, 7)), backend=backend)  # loads what it needs
    motion = form(numbers(parts))
    assert extra(lambda: pair.forward_kinematics(*motion, backend=backend, workers=workers)) <= ROOM
