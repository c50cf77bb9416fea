"""Memory of results that nobody holds any more is used again, and no other."""

from __future__ import annotations

import gc

import numpy as np
import pytest

from hingepair.engine import outputs as memory
from support.work import in_threads


def address(array):
    return array.__array_interface__["data"][0]


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_memory_is_used_again_once_every_view_is_gone(dtype):
    count = 2 * memory.MIN_REUSED_BYTES // np.dtype(dtype).itemsize
    first = memory.empty((count,), np.dtype(dtype))
    first[:] = 1.0
    place, view = address(first), first[5:10].reshape(5, 1)
    del first
    gc.collect()
    other = memory.empty((count,), np.dtype(dtype))
    other[:] = 2.0
    assert address(other) != place
    assert (view == 1.0).all()
    del view
    gc.collect()
    assert address(memory.empty((count,), np.dtype(dtype))) == place


@pytest.mark.slow
def test_what_is_kept_is_bounded():
    arrays = [memory.empty((200_000 + k,), np.dtype(np.float64)) for k in range(60)]
    del arrays
    gc.collect()
    assert len(memory._free) <= 32
    large = [memory.empty((10**7 + k,), np.dtype(np.float64)) for k in range(3)]  # 80 MB each
    del large
    gc.collect()
    assert sum(block.size for block in memory._free) <= 160_000_000
    huge = memory.empty((3, 10**7), np.dtype(np.float64))
    assert huge.flags.owndata
    small = memory.empty((10,), np.dtype(np.float64))
    assert small.flags.owndata


def test_threads_never_share_a_block():
    def work(number):
        for _ in range(200):
            array = memory.empty((150_000,), np.dtype(np.float64))
            array[::5000] = number
            assert (array[::5000] == number).all()

    in_threads(work, 4)
