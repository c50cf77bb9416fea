"""The compiled backend: equal to NumPy wherever it is used, safe in threads, never stale, and never in the way."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.engine.backend import Execution
from hingepair.engine.llvm.ir import LANES
from hingepair.engine.loops import Loop
from hingepair.plans.pairs import SPACE, PairRequest, pair_loop
from hingepair.rotations.sequences import SEQUENCE_NAMES
from support.sparse import sparse
from support.states import coordinates, generator, pair, rotations
from support.work import HANG

U = 2.0**-53
NAMES = tuple(SPACE.levels)


def pair_of(rng, home=True):
    u1, u2, n, C = pair(rng, home)
    return hp.HingePair(u1=u1, u2=u2, n=n, home=C)


def both(one, *motion, **options):
    """The state by NumPy and by the compiled kernels, after they were seen to agree."""
    a, b = (one.forward_kinematics(*motion, backend=backend, **options) for backend in ("numpy", "compiled"))
    assert a.outputs == b.outputs
    assert a.shape == b.shape
    for name in a.outputs:
        x, y = getattr(a, name), getattr(b, name)
        assert x.dtype == y.dtype
        np.testing.assert_array_equal(np.isnan(x), np.isnan(y))
        size = np.nanmax(np.abs(x), initial=1.0)
        assert np.nanmax(np.abs(x.astype(float) - y), initial=0.0) <= 40 * np.finfo(x.dtype).eps * size, name
    return a, b


@pytest.mark.parametrize("sequence", sparse(SEQUENCE_NAMES, len(SEQUENCE_NAMES)))
def test_every_sequence(sequence):
    rng = generator(60)
    both(pair_of(rng, sequence.islower()), *coordinates(rng, 50), sequence=sequence, outputs=NAMES)


@pytest.mark.slow
@pytest.mark.parametrize("home", sparse([False, True], 2, lambda home: "home" if home else "no_home"))
@pytest.mark.parametrize("sequence", sparse(["XYZ", "zxz"], 2))
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_every_level_and_dtype(sequence, home, dtype):
    rng = generator(60)
    motion = [c.astype(dtype) for c in coordinates(rng, 50)]
    for level in (1, 2, 3):
        both(pair_of(rng, home), *motion[:level], sequence=sequence)


@pytest.mark.parametrize("name", sparse(NAMES, 7))
def test_every_output_alone(name):
    rng = generator(61)
    both(pair_of(rng), *coordinates(rng, 20), outputs=(name,))


@pytest.mark.parametrize("count", sparse([LANES + 1, 1, LANES, LANES - 1, 1000, 2, 3 * LANES], 3))
def test_every_count_around_the_block(count):
    rng = generator(62)
    one, motion = pair_of(rng), coordinates(rng, count)
    room = np.full((count + 2, 3), 7.0)
    state = one.forward_kinematics(*motion, backend="compiled", out={"R2": room[1:-1]})
    both(one, *motion)
    np.testing.assert_array_equal(room[1:-1], state.R2)
    assert (room[[0, -1]] == 7.0).all()


@pytest.mark.slow
def test_given_attitude():
    rng = generator(63)
    one, R, S = pair_of(rng), rng.normal(size=(40, 3)), rotations(rng, 40)
    v, omega, a, alpha = rng.normal(size=(4, 40, 3))
    psi, psid, psidd = rng.normal(size=(3, 40))
    body1 = hp.BodyMotion(R=R, S=S, v=v, omega=omega, a=a, alpha=alpha)
    found = [one.forward_kinematics_from_body1(body1, psi, psid, psidd, backend=b) for b in ("numpy", "compiled")]
    for name in found[0].outputs:
        np.testing.assert_allclose(*(getattr(f, name) for f in found), rtol=0, atol=200 * U)
    turned = hp.BodyMotion(R=R, S=np.asfortranarray(S), v=v, omega=omega, a=a, alpha=alpha)
    again = one.forward_kinematics_from_body1(turned, psi, psid, psidd, backend="compiled")
    np.testing.assert_array_equal(again.S2, found[1].S2)


T = generator(64).normal(size=300)
TUPLES = {
    "columns and rows": ((T[:, None], T[:7], 0.5, 0.1, T[:7], T[:, None], 1),),
    "numbers of many kinds": ((T, 1, 0.5, T, 0.25, np.float64(2), T), (1.0, 0.0, T, 1, 2, 3, T)),
    "three axes": ((T[:5, None, None], 1, T[:4, None], 0, T[:6], 0, 0.5),),
    "one that moves": ((0.1, 0.2, 0.3, 0.4, 0.5, 0.6, T),),
    "axes of one": ((T[:1], 0.2, 0.3, T[:1, None], 0.5, 0.6, 0.7), (0.0, T[:1], 1, 2, 3, 4, 5)),
    "one in each": ((0.1, 0.2, 0.3, T, 0.5, 0.6, 0.7), (1, 2, 3, 4, 5, 6, 7), (1, 2, 3, 4, 5, 6, T)),
}


@pytest.mark.parametrize("kind", sparse(TUPLES, 4))
def test_tuples_of_anything_that_broadcasts(kind):
    both(pair_of(generator(65)), *TUPLES[kind])


def test_any_layout():
    rng = generator(65)
    one = pair_of(rng)
    q, qd, qdd = coordinates(rng, 24)
    for change in (
        np.asfortranarray,
        lambda c: c[::-2],
        lambda c: c.reshape(2, 3, 4, 7).transpose(2, 0, 1, 3),
        lambda c: c.astype(">f8"),
        lambda c: np.round(c).astype(np.int16),
        lambda c: np.broadcast_to(c, (3, 24, 7)),
        lambda c: c[:0],
        lambda c: c.reshape(24, 1, 7),
        lambda c: np.frombuffer(b"x" + c.tobytes(), offset=1).reshape(24, 7),
    ):
        both(one, change(q), change(qd), change(qdd))
    both(one, q.astype(np.float32), qd)
    both(one, q, qd[0], qdd[:1])


@pytest.mark.slow
def test_batched_pairs():
    rng = generator(66)
    u1, u2, n = rng.normal(size=(3, 5, 1, 3))
    home = rotations(rng, 5)[:, None]
    many = hp.HingePair(u1=u1, u2=u2, n=n, home=home)
    motion = coordinates(rng, 37)
    _, found = both(many, *motion, outputs=NAMES)
    assert found.shape == (5, 37)
    for i in range(5):
        one = hp.HingePair(u1=u1[i, 0], u2=u2[i, 0], n=n[i, 0], home=home[i, 0])
        alone = one.forward_kinematics(*motion, outputs=NAMES, backend="compiled")
        for name in NAMES:
            np.testing.assert_array_equal(getattr(found, name)[i], getattr(alone, name))


def test_far_angles_and_no_numbers_stay_in_their_lane():
    rng = generator(67)
    one, (q, qd, qdd) = pair_of(rng), coordinates(rng, 64)
    clean = one.forward_kinematics(q, qd, qdd, backend="compiled")
    spoiled = q.copy()
    spoiled[3, 3], spoiled[17, 6], spoiled[18, 4], spoiled[40, 0] = np.nan, np.inf, 1e300, np.nan
    found = both(one, spoiled, qd, qdd)[1]
    others = np.setdiff1d(np.arange(64), [3, 17, 18, 40])
    for name in clean.outputs:
        np.testing.assert_array_equal(getattr(found, name)[others], getattr(clean, name)[others])
    assert np.isnan(found.S2[17]).any()
    assert np.isfinite(found.a2[18]).all()


@pytest.mark.slow
def test_sine_and_cosine_to_one_and_a_half_ulp():
    def terms(values):
        x = values["x"]
        return {"terms": (x.sine(), x.cosine(), x.versine())}

    rng = generator(68)
    x = np.concatenate([
        rng.uniform(-4, 4, 150), rng.uniform(-1e6, 1e6, 150), np.arange(1, 101) * (np.pi / 2),
        10.0 ** rng.uniform(-300, 0, 100), 10.0 ** rng.uniform(6, 300, 50), [0.0, 1e6, -1e6, 5e-324] * 4,
    ])  # fmt: skip
    out = np.empty((x.size, 3))
    loop = Loop("terms", terms, {"x": ()}, {"terms": (3,)})
    loop.run({"x": x}, {"terms": out}, x.shape, x.dtype, Execution("compiled", 1))
    with mpmath.workprec(1200):
        for v, got in zip(map(float, x), out.tolist(), strict=True):
            half = mpmath.sin(mpmath.mpf(v) / 2)
            for value, exact, bound in zip(
                got, (mpmath.sin(v), mpmath.cos(v), 2 * half**2), (1.5, 1.5, 3.5), strict=True
            ):
                assert abs(value - exact) <= bound * np.spacing(abs(float(exact))) + 5e-324, v


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_workers_change_nothing(backend):
    rng = generator(69)
    one, motion = pair_of(rng), coordinates(rng, 40_011)
    alone = one.forward_kinematics(*motion, backend=backend)
    for workers in (2, 3, -1):
        found = one.forward_kinematics(*motion, backend=backend, workers=workers)
        for name in found.outputs:
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))


@pytest.mark.slow
def test_threads_that_call_at_once_do_not_mix():
    rng = generator(70)
    jobs = [(pair_of(rng), coordinates(rng, 20_000)) for _ in range(6)]
    expected = [one.forward_kinematics(*motion, backend="compiled").a2 for one, motion in jobs]
    wrong: list[int] = []

    def work(i):
        one, motion = jobs[i]
        for k in range(15):
            found = one.forward_kinematics(*motion, backend="compiled", workers=1 + k % 2).a2
            if not np.array_equal(found, expected[i]):
                wrong.append(i)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(len(jobs))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def run(code, **environment):
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"HINGEPAIR_CACHE": "off"} | environment,
        timeout=HANG,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


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
    assert "llvmlite" in run(code)


@pytest.mark.slow
def test_a_fork_while_a_kernel_is_compiled_can_compile():
    code = """
import os, threading, time
import numpy as np, hingepair as hp
pair = hp.HingePair(u1=(1, 0, 0), u2=(0, 1, 0), n=(0, 0, 1))
q = np.ones((9, 7))
def work():
    for names in ("R2",), ("S2",), ("d",), ("R2", "S2"), ("R2", "d"), ("S2", "d"):
        pair.forward_kinematics(q, outputs=names, backend="compiled")
thread = threading.Thread(target=work)
thread.start()
for k in range(5):
    time.sleep(0.05)
    child = os.fork()
    if not child:
        pair.forward_kinematics(q, outputs=("S1",), backend="compiled")
        os._exit(0)
    print(os.waitpid(child, 0)[1])
thread.join()
"""
    assert run(code).split() == ["0"] * 5


@pytest.mark.slow
def test_a_kernel_serves_all_pairs_of_the_same_build():
    """Its constants come with each call, whatever they are; what is 0 or 1 is another build."""
    rng = generator(72)
    motion = coordinates(rng, 30)
    one, other = pair_of(rng), pair_of(rng)
    loop = pair_loop(PairRequest(SPACE.default_outputs(2), ("q", "qd", "qdd"), sequence="XYZ"))
    loop.program.cache_clear()
    both(one, *motion)
    programs = loop.program.cache_info().currsize
    both(other, *motion)
    assert loop.program.cache_info().currsize == programs
    both(hp.HingePair(u1=other.u1, u2=(0, 0, 0), n=other.n, home=other.home), *motion)
    assert loop.program.cache_info().currsize == programs + 1


@pytest.mark.slow
def test_one_sample_rounds_as_many_do():
    """By whichever way it goes, at the first call and at the next: (1, 7), integers, and one of a batch."""
    rng = generator(73)
    many = rng.normal(size=(40, 7)) * 90
    for own in [pair_of(rng) for _ in range(5)]:
        whole = own.forward_kinematics(many, outputs=NAMES[:3], backend="compiled")
        whole_ints = own.forward_kinematics(many.astype(int).astype(float), outputs=NAMES[:3], backend="compiled")
        for expected, rows in ((whole, many), (whole_ints, many.astype(int))):
            for i in range(len(rows)):
                for one in (rows[i], rows[i : i + 1]):
                    found = own.forward_kinematics(one, outputs=NAMES[:3], backend="compiled")
                    for name in NAMES[:3]:
                        np.testing.assert_array_equal(
                            getattr(found, name).ravel(), getattr(expected, name)[i].ravel()
                        )
