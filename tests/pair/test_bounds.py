"""The accuracy contract on many states: in 60 digits, and many more in extended precision."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.bench import truth as reference
from hingepair.bench.truth import OUTPUTS
from hingepair.pair.accuracy import PROMISED_BOUND_BY_OUTPUT
from hingepair.rotations.sequences import SEQUENCE_NAMES
from support import extended, states, truths
from support.truths import BOUNDS, ORDINARY

BACKENDS = ("numpy", "compiled")


def require(truth, found, ledger, way, bounds):
    worst = {name: ledger(way, name, truth.errors(name, np.asarray(found[name]))) for name in truth.values}
    late = {name: value for name, value in worst.items() if not value <= bounds[name]}
    assert not late, f"beyond the promise, in units of u * scale: {late}"


def outputs_of(state):
    return {name: getattr(state, name) for name in OUTPUTS}


def rounded(numbers, dtype):
    return None if numbers is None else np.asarray(numbers, float).astype(dtype)


@pytest.fixture(scope="module", params=[np.float64, np.float32], ids=["float64", "float32"])
def many(request):
    """States of pairs, by Euler angles of many sequences and by a given attitude."""
    dtype, by_angles, by_attitude = request.param, [], []
    # All sequences in one dtype; the kinds of sequences in the other.
    for k, sequence in enumerate(SEQUENCE_NAMES[:: 1 if dtype is np.float64 else 5] + ("XYZ",) * 4):
        rng = states.generator(14, k)
        constants = tuple(rounded(c, dtype) for c in states.pair(rng, home=k % 3 > 0 and dtype is np.float64))
        motion = [rounded(c, dtype) for c in states.coordinates(rng, 4)]
        by_angles.append((constants, motion, sequence, truths.from_euler(constants, *motion, sequence=sequence)))
    for k in range(8):
        rng = states.generator(15, k)
        constants = tuple(rounded(c, dtype) for c in states.pair(rng, home=k % 3 > 0 and dtype is np.float64))
        pieces = [rounded(c, dtype) for c in states.body1(rng, 8)]
        hinge = [rounded(c, dtype) for c in rng.normal(size=(3, 8))]
        by_attitude.append((constants, pieces, hinge, reference.from_attitude(constants, pieces, *hinge)))
    return dtype, by_angles, by_attitude


@pytest.mark.slow(3)
def test_states_in_sixty_digits(many, ledger):
    """Both backends in one test: most of its time computes the truth."""
    dtype, by_angles, by_attitude = many
    name = np.dtype(dtype).name
    for backend in BACKENDS:
        for (u1, u2, n, home), motion, sequence, truth in by_angles:
            pair = hp.HingePair(u1=u1, u2=u2, n=n, home=home)
            state = pair.forward_kinematics(*motion, sequence=sequence, outputs=OUTPUTS, backend=backend)
            assert state.R2.dtype == dtype
            require(truth, outputs_of(state), ledger, f"angles {name[5:]} {backend}", ORDINARY)
        for (u1, u2, n, home), pieces, hinge, truth in by_attitude:
            pair = hp.HingePair(u1=u1, u2=u2, n=n, home=home)
            body1 = hp.BodyMotion(**dict(zip(("R", "S", "v", "omega", "a", "alpha"), pieces, strict=True)))
            state = pair.forward_kinematics_from_body1(body1, *hinge, outputs=OUTPUTS, backend=backend)
            assert state.R2.dtype == dtype
            require(truth, outputs_of(state), ledger, f"given {name[5:]} {backend}", ORDINARY)


def _plain(rng, count):
    """Ordinary states, each of a pair of its own."""
    u1, u2, n = rng.normal(size=(3, count, 3))
    constants = u1, u2, n * 10 ** rng.uniform(-3, 3, (count, 1)), states.rotations(rng, 1)[0]
    return constants, states.coordinates(rng, count)


def _hinge_alone(rng, count):
    """u1 = 0 and body 1 at rest: the scale has one term."""
    constants, (q, qd, qdd) = _plain(rng, count)
    q[:, :3], qd[:, :6], qdd[:, :6] = 0, 0, 0
    return (np.zeros(3), *constants[1:3], None), (q, qd, qdd)


def _sparse(rng, count):
    """Many zeros, and many angles that are multiples of pi/2: few terms, and those large."""
    (u1, u2, n, home), (q, qd, qdd) = _plain(rng, count)
    u1, u2 = u1 * (rng.random((count, 3)) < 0.6), u2 * (rng.random((count, 3)) < 0.6)
    qd, qdd = qd * (rng.random((count, 7)) < 0.4), qdd * (rng.random((count, 7)) < 0.3)
    right = np.pi / 2 * rng.integers(-2, 3, (count, 4))
    q[:, 3:] = np.where(rng.random((count, 4)) < 0.3, right, q[:, 3:])
    return (u1, u2, n, home), (q, qd, qdd)


KINDS = {"plain": _plain, "hinge alone": _hinge_alone, "sparse": _sparse}


def errors(truth, constants, motion, outputs, backend):
    """The errors of each output, in units of u * scale."""
    u1, u2, n, home = constants
    pair = hp.HingePair(u1=u1, u2=u2, n=n, home=home)
    state = pair.forward_kinematics(*motion, outputs=outputs, backend=backend)
    return {name: truth.errors(name, np.asarray(getattr(state, name))) for name in outputs}


def test_the_two_oracles_agree():
    """Extended precision and 60 digits: to a tenth of u * scale."""
    assert extended.WIDE, "this test needs a long double of 64 bits"
    for k, make in enumerate(KINDS.values()):
        (u1, u2, n, home), motion = make(states.generator(16, k), 4)
        truth = extended.Extended((u1, u2, n, home), *motion)
        for i in range(4):
            own = tuple(c if c is None or c.shape in {(3,), (3, 3)} else c[i] for c in (u1, u2, n, home))
            exact = truths.from_euler(own, *(c[i : i + 1] for c in motion))
            for name in OUTPUTS:
                coarse = truth.value(name)[i]
                high = coarse.astype(float)
                gap = abs(exact.values[name][0] - high - (coarse - high).astype(float))
                assert float(gap.max()) <= 0.1 * 2.0**-53 * truth.scales[name][i], name


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_forty_thousand_states(kind, ledger):
    """Both backends in one test: most of its time computes the truth."""
    assert extended.WIDE, "this test needs a long double of 64 bits"
    for k in range(5):
        constants, motion = KINDS[kind](states.generator(17, k), 8000)
        truth = extended.Extended(constants, *motion)
        for backend in BACKENDS:
            for name, found in errors(truth, constants, motion, OUTPUTS, backend).items():
                worst = ledger(f"{kind}, 4e4 {backend}", name, found)
                assert worst <= BOUNDS[name], (name, backend)


SEARCHED = [(output, [*KINDS][(k + shift) % 3]) for k, output in enumerate(OUTPUTS) for shift in (0, 1)]


@pytest.mark.slow
@pytest.mark.parametrize(("output", "kind"), SEARCHED)
@pytest.mark.parametrize("backend", BACKENDS)
def test_states_that_are_searched_for(backend, output, kind, ledger):
    """The worst of many states, varied again and again: a bound for every state must outlast the search."""
    rng = states.generator(18)
    count, kept = 1000, 100
    constants, motion = KINDS[kind](rng, count)
    for _ in range(10):
        truth = extended.Extended(constants, *motion)
        found = errors(truth, constants, motion, (output,), backend)[output]
        worst = ledger("searched", output, found)
        assert worst <= PROMISED_BOUND_BY_OUTPUT[output].proved
        assert worst <= 1.5 * PROMISED_BOUND_BY_OUTPUT[output].seen  # half as much again would be news
        chosen = np.concatenate([np.argsort(-found)[:kept], rng.integers(0, count, count - kept)])
        size = 10.0 ** rng.uniform(-16, -0.5, (count, 1)) * (np.arange(count) >= kept)[:, None]  # the worst stay
        constants, motion = (tuple(_varied(rng, c, chosen, size) for c in group) for group in (constants, motion))


def _varied(rng, numbers, chosen, size):
    """Some samples again, a part of their numbers changed by up to `size`, relatively."""
    if numbers is None or numbers.shape[0] != len(chosen):
        return numbers
    changed = rng.random((len(chosen), numbers.shape[1])) < 0.4
    return numbers[chosen] * (1 + size * changed * rng.normal(size=changed.shape))
