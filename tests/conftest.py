"""What every test shares: where hingepair was imported from, and the table of measured errors at the end."""

from __future__ import annotations

from collections import defaultdict

import pytest

import hingepair
from hingepair.pair.accuracy import PROMISES

LEDGER = pytest.StashKey[dict]()


def pytest_configure(config):
    config.stash[LEDGER] = defaultdict(dict)


def pytest_report_header():
    """The injected-fault test reads this line: the copy with the fault must be the one that is tested."""
    return f"hingepair: {hingepair.__file__}"


@pytest.fixture
def ledger(request):
    """record(way, output, errors): keeps the worst error of an output, in units of u * scale, for the last table."""
    measured = request.config.stash[LEDGER]
    compiled = "numba" in getattr(request.node, "callspec", request.node).__dict__.get("params", {}).values()

    def record(way, output, errors):
        way = f"{way} (c)" if compiled else way
        worst = max(map(float, errors), default=0.0)
        measured[way][output] = max(worst, measured[way].get(output, 0.0))
        return worst

    return record


@pytest.fixture(params=["numpy", "numba"])
def each_backend(request, monkeypatch):
    """Every call that does not name a backend goes to this one."""
    choose = hingepair.pair.hinge_pair.choose

    def forced(backend, workers):
        return choose(request.param if backend == "auto" else backend, workers)

    monkeypatch.setattr(hingepair.pair.hinge_pair, "choose", forced)
    return request.param


def pytest_terminal_summary(terminalreporter, config):
    measured = config.stash[LEDGER]
    if not measured:
        return
    terminalreporter.section("largest error in units of u * scale, beside the promise; (c) compiled")
    width = max(map(len, measured)) + 2
    terminalreporter.write_line("output   promise" + "".join(way.rjust(width) for way in measured))
    for name, promise in PROMISES.items():
        cells = ("-" if name not in worst else f"{worst[name]:.2f}" for worst in measured.values())
        terminalreporter.write_line(f"{name:<9}{promise.proved:>7}" + "".join(cell.rjust(width) for cell in cells))
