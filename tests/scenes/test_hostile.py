"""Hostile texts: scenes, expressions and URDF, thousands of them under limits of memory and work.

Only a result or an error of the library may come out, after so many function calls at most. The texts are made from
seeds (hostile.py), so that a finding can be looked at again:

    PYTHONPATH=tests python -m support.hostile KIND SEED 1
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import hingepair as hp
from support import hostile
from support.work import HANG

TESTS = Path(__file__).parents[1]
FEW = {"expression": 60, "scene": 12, "urdf": 150}
MANY = {"expression": 400, "scene": 100, "urdf": 1_500}


@pytest.mark.slow
@pytest.mark.parametrize("kind", FEW)
def test_a_few_hostile_texts(kind):
    found, refused = hostile.findings(kind, 10**6, FEW[kind])
    assert not found
    assert refused > 0


@pytest.mark.slow(4)
@pytest.mark.parametrize("kind", MANY)
def test_many_hostile_texts(kind):
    """In a process of its own with 3 GiB of addresses: what hangs, crashes or eats memory is found out."""
    paths = os.pathsep.join((str(Path(hp.__file__).parents[1]), str(TESTS)))
    environment = dict(os.environ, PYTHONPATH=paths, PYTHONWARNINGS="error")
    command = [sys.executable, "-m", "support.hostile", kind, "0", str(MANY[kind])]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=2 * HANG, check=False)
    assert done.returncode == 0, (done.returncode, done.stderr[-2000:])
    *found, last = map(json.loads, done.stdout.splitlines())
    assert not found
    assert last["done"] == MANY[kind]
    assert 0.2 * MANY[kind] < last["refused"] < MANY[kind]
    assert "Traceback" not in done.stderr
