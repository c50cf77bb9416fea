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


FORMS = {
    "rows": lambda c: c,
    "columns": lambda c: tuple(np.ascontiguousarray(c[:, i]) for i in range(7)),
    "strided": lambda c: np.repeat(c, 2, axis=1)[:, ::2],
    **{dtype: lambda c, dtype=dtype: (100 * c).astype(dtype) for dtype in ("f4", ">f8", "i4")},
}


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


CASES = [(backend, "rows", "acceleration", 1) for backend in ("numpy", "compiled")]
CASES += [("numpy", form, "pose", 1) for form in FORMS] + [("compiled", "columns", "pose", 1)]
CASES += [(backend, form, "pose", 2) for backend in ("numpy", "compiled") for form in ("rows", ">f8")]


@pytest.mark.parametrize(("backend", "form", "level", "workers"), CASES)
def test_coordinates_take_inputs_outputs_and_ten_megabytes(backend, form, level, workers):
    pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
    pair.forward_kinematics(np.zeros((2, 7)), backend=backend)  # loads what it needs
    motion = [FORMS[form](c) for c in numbers(3 if level == "acceleration" else 1)]
    assert extra(lambda: pair.forward_kinematics(*motion, backend=backend, workers=workers)) <= ROOM
