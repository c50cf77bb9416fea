"""Every engine of `bench rollouts` makes the same steps."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.bench import engines
from hingepair.bench import rollouts as bench
from hingepair.bench.robots import load_models

METHODS = [method for method in bench.METHODS if method.name != engines.PINOCCHIO_CPP]


@pytest.mark.slow
@pytest.mark.parametrize("workload", [bench.MOTION, bench.GRADIENT])
def test_engines_agree(workload):
    for method in METHODS:
        if method.package:
            pytest.importorskip(method.package)
    case = bench.robot_case("ur5_robot", workload, METHODS, 5, 20)
    assert len(case.jobs) == (4 if workload == bench.MOTION else 2)
    assert set(case.samples.values()) == {100}
    assert max(case.errors.values()) < 1e-12


def test_other_motions_are_seen():
    task = bench.make_task(bench.MOTION, *load_models("ur5_robot"), 5, 2)
    found = bench.hingepair_job(task._replace(tau=0 * task.tau))()[0]
    assert np.abs(found - bench.pinocchio_job(task)()[0]).max() > 1e-6
