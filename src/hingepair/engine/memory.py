"""Memory of large results, used again once nobody holds them.

New memory costs as much as the computation: the operating system clears each page at its first use, and the C library
gives large blocks back at once. So the memory of the last few results is kept, at most 160 MB.
"""

from __future__ import annotations

import collections
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_SMALLEST, _LARGEST = 1_000_000, 40_000_000  # bytes: below, new memory is quick; above, too much would be kept
_free: Final[collections.deque[NDArray[np.uint8]]] = collections.deque(maxlen=4)  # the oldest falls out


class _Lease:
    """Owner of a block, from which NumPy makes arrays; returns the block when the last of them is gone."""

    def __init__(self, block: NDArray[np.uint8]) -> None:
        self._block = block
        address = block.__array_interface__["data"][0]
        self.__array_interface__ = {"shape": block.shape, "typestr": "|u1", "data": (address, False), "version": 3}

    def __del__(self) -> None:
        _free.append(self._block)


def empty(count: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return an uninitialised array (count,), whose memory may be that of a former result."""
    size = count * dtype.itemsize
    if not _SMALLEST <= size <= _LARGEST:
        return np.empty(count, dtype)
    for _ in range(len(_free)):
        try:
            block = _free.popleft()
        except IndexError:  # another thread was quicker
            break
        if block.size == size:
            return np.asarray(_Lease(block)).view(dtype)
        _free.append(block)
    return np.asarray(_Lease(np.empty(size, np.uint8))).view(dtype)
