"""The suite proves itself: each injected fault turns a known test red, which is green without it."""

from __future__ import annotations

import ast
import os
import re

import pytest

from support.faults import FAULTS
from support.harm import run

forking = pytest.mark.skipif(not hasattr(os, "fork"), reason="each fault has a forked process of its own")


def test_faults_still_fit_the_source():
    """Fast: a fault whose text has gone is found out by every run of the tests, not only by the slow ones."""
    late = [text for fault in FAULTS.values() if (text := misfit(fault))]
    assert not late, "\n".join(late)


def misfit(fault):
    """What is wrong with a fault, or nothing."""
    try:
        ast.parse(fault.harmed(), fault.file)
    except (AssertionError, SyntaxError) as error:
        return str(error)


@forking
@pytest.mark.slow
def test_without_a_fault_the_killers_pass():
    """In the same kind of process, one of each folder: in this one they all pass."""
    killers = {fault.killer.partition("/")[0]: fault.killer for fault in FAULTS.values()}
    code, output = run(None, sorted(killers.values()))
    assert code == pytest.ExitCode.OK, output


@forking
@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_fault_is_found(name, record_property):
    fault = FAULTS[name]
    code, output = run(fault, [fault.killer])
    killer = re.search(r"^FAILED tests/(.*?)(?: - .*)?$", output, re.MULTILINE)
    assert code == pytest.ExitCode.TESTS_FAILED, f"{name}: {fault.killer} did not notice\n{output}"
    assert killer, f"{name}: {fault.killer} broke before it could fail\n{output}"
    record_property("fault", (name, killer[1]))
