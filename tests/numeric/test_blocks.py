"""Samples in blocks: every sample once, blocks that fit the cache, and the functions that run over them."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.numeric.arrays import load, split_into_blocks
from hingepair.numeric.blocks import (
    BLOCK,
    components_of,
    tabulate,
)

SHAPES = [(), (1,), (7,), (8,), (9,), (3, 5), (5, 3), (1, 20), (2, 3, 4), (4, 1, 9), (0,), (3, 0), (0, 4)]


@pytest.mark.parametrize("size", [1, 4, 8, 15, 1000])
def test_blocks_cover_every_sample_once(size: int) -> None:
    for shape in SHAPES:
        count, largest = np.zeros(shape, dtype=int), 0
        for block in split_into_blocks(shape, size):
            assert len(block) == len(shape)
            assert all(0 <= s.start < s.stop <= n for s, n in zip(block, shape, strict=True))
            count[block] += 1
            largest = max(largest, count[block].size)
        assert (count == 1).all(), shape
        assert largest <= size, shape


def test_a_component_that_broadcasts_is_loaded_where_it_differs() -> None:
    block = next(b for b in split_into_blocks((4, 6), 3) if b[0].start == 2)
    whole, row, column = np.arange(24.0).reshape(4, 6), np.arange(6.0), np.arange(4.0)[:, None]
    for component in (whole, row, column):
        part = load(component, block, np.dtype(np.float64))
        expected = np.broadcast_to(component, (4, 6))[block]
        assert np.array_equal(np.broadcast_to(part, expected.shape), expected)
    part = load(np.arange(24)[::-1].reshape(4, 6)[:, ::-1], block, np.dtype(np.float32))
    assert part.dtype == np.float32
    assert part.flags.c_contiguous
    assert load(2.5, block, np.dtype(np.float64)) == 2.5


@pytest.mark.parametrize("shape", [(), (5,), (3, 2 * BLOCK + 7), (0,)], ids=str)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_function_of_components_is_tabulated(shape: tuple[int, ...], dtype: type) -> None:
    rng = np.random.default_rng(1)
    v, s = rng.normal(size=(*shape, 2)).astype(dtype), rng.normal(size=shape[-1:] or ()).astype(dtype)

    def function(values):
        (x, y), scale = values["v"], values["s"]
        return {"swapped": (y * scale, x), "matrix": (x, y, scale, x), "sum": x + y}

    tails = {"swapped": (2,), "matrix": (2, 2), "sum": ()}
    found = tabulate(function, {"v": components_of(v), "s": s, "unused": 1.0}, tails, shape, np.dtype(dtype))
    expected = {
        "swapped": np.stack((v[..., 1] * s, v[..., 0]), axis=-1),
        "matrix": np.stack((v[..., 0], v[..., 1], np.broadcast_to(s, shape), v[..., 0]), axis=-1).reshape(
            *shape, 2, 2
        ),
        "sum": v[..., 0] + v[..., 1],
    }
    for name, array in expected.items():
        assert found[name].dtype == dtype
        assert np.array_equal(found[name], array.astype(dtype))
