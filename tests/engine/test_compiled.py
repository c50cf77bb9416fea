"""The compiled backend: equal to NumPy wherever it is used, safe in threads, never stale, and never in the way."""

from __future__ import annotations

import numpy as np
import pytest

from support.hinged import pair_of
from support.sparse import sparse
from support.states import coordinates, generator, pair
from support.work import in_threads, python


@pytest.mark.slow
def test_threads_that_call_at_once_do_not_mix():
    rng = generator(70)
    jobs = [(pair_of(pair(rng)), coordinates(rng, 20_000)) for _ in range(6)]
    expected = [one.forward_kinematics(*motion, backend="compiled").a2 for one, motion in jobs]

    def work(i):
        one, motion = jobs[i]
        for k in range(15):
            found = one.forward_kinematics(*motion, backend="compiled", workers=1 + k % 2).a2
            np.testing.assert_array_equal(found, expected[i])

    in_threads(work, len(jobs))


HARMS = {
    "not installed": "sys.modules['llvmlite'] = None\n",
    "OSError": "import llvmlite.binding as b; b.parse_assembly = lambda *_: (_ for _ in ()).throw(OSError('x'))\n",
    "SyntaxError": "import llvmlite.binding as b; b.initialize_native_target = lambda: compile('(', '', 'exec')\n",
    "RuntimeError": "import llvmlite.binding as b; b.get_host_cpu_name = lambda: [].pop()\n",
}


@pytest.mark.slow
@pytest.mark.parametrize("harm", sparse(HARMS, 4))
@pytest.mark.parametrize("q", sparse(["np.ones(7)", "np.ones((9, 7))"], 2))
@pytest.mark.parametrize("backend", ["compiled"])
def test_without_llvmlite_compiled_is_an_error_of_ours(harm, q, backend):
    code = f"""
import sys
import numpy as np, hingepair as hp
{HARMS[harm]}
try:
    hp.HingePair(u1=(1, 0, 0), u2=(0, 1, 0), n=(0, 0, 1)).forward_kinematics({q}, backend="{backend}")
except (hp.errors.MissingDependencyError, hp.errors.CompilationError) as error:
    print(error)
"""
    assert "llvmlite" in python(code, HINGEPAIR_CACHE="off")
