"""Work measured in function calls, which are as many on every machine, and when to give up on what hangs."""

from __future__ import annotations

import contextlib
import sys

HANG = 3000
"""Seconds that nothing takes unless it hangs: a hundred times what the slowest takes that is waited for so."""


class TooMuchWorkError(BaseException):
    """More function calls than a test allows."""


@contextlib.contextmanager
def bounded_calls(most):
    """Raise TooMuchWorkError in this thread at the first function call, of Python or C, past so many.

    Yields:
        A list whose only item is the number of calls so far.
    """
    count = [0]

    def counted(_frame, event, _argument):
        if event in {"call", "c_call"}:
            count[0] += 1
            if count[0] > most:
                sys.setprofile(before)
                raise TooMuchWorkError(f"more than {most} function calls")

    before = sys.getprofile()
    sys.setprofile(counted)
    try:
        yield count
    finally:
        sys.setprofile(before)
