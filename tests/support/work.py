"""Work in threads and processes, when to give up on what hangs, and work measured in function calls."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

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


def in_threads(work, count):
    """Call `work` with 0, 1, ... in as many threads at once."""
    with ThreadPoolExecutor(count) as pool:
        list(pool.map(work, range(count)))


def python(code, *arguments, fails=False, **environment):
    """What code prints in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], env=os.environ | environment, capture_output=True, text=True,
        timeout=HANG, check=False,
    )  # fmt: skip
    assert (done.returncode != 0) is fails, (done.returncode, done.stderr)
    return done.stdout
