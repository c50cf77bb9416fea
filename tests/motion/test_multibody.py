"""Problems A02, A03 and A04 of the IFToMM library of benchmarks, against references that share no code with this."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import multibody as mb
from support.near import TIGHT, U

SHORT = {
    "four-bars": (lambda: mb.four_bars(3, np.linspace(0, 3, 61)), 1e-10),  # past two change points
    "squeezer": (lambda: mb.andrews(np.linspace(0, 0.01, 21)), 1e-11),
    "bricard": (lambda: mb.bricard(np.linspace(0, 2, 41)), 1e-10),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORT)
def test_motions_are_those_of_the_reference(name):
    make, tolerance = SHORT[name]
    problem = make()
    motion = mb.simulated(problem, 1e-12)
    assert len(motion.t) == len(problem.t)
    assert np.abs(problem.seen(motion) - problem.reference()).max() < tolerance
    energy = motion.energy()
    work = problem.tau * (motion.q[:, 0] - motion.q[0, 0])
    assert np.ptp(energy.kinetic + energy.potential - work) < TIGHT * np.ptp(energy.kinetic)


@pytest.mark.slow
def test_the_squeezer_ends_where_it_is_published_to_end():
    squeezer = mb.andrews(np.array([0, 0.03]))
    start = squeezer.mechanism.forward_dynamics(squeezer.q0, (0,), (mb.TORQUE,), gravity=(0, 0, 0)).qdd
    assert abs(start[0] / mb.FIRST_ACCELERATION - 1) < 64 * U
    end = squeezer.seen(mb.simulated(squeezer, 1e-12))[-1]
    assert np.abs(end - [*mb.END.values()]).max() < 2e-9  # from which the reference of the test above differs, too
