"""What every test shares: each backend in turn, kernels that are kept, the longest tests first."""

from __future__ import annotations

import atexit
import gc
import os

import pytest

# Tests run side by side: threads of linear algebra would wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hingepair.engine.llvm import native

PROCESSORS = {"haswell": "+fma", "x86-64": ""}  # with AVX2 and without AVX: LLVM's names and features


def pytest_addoption(parser):
    parser.addoption("--processor", choices=PROCESSORS, help="compile kernels for a processor with fewer features")
    parser.addoption("--renew-golden", action="store_true", help="write the files of tests/golden again")


def pytest_configure(config):
    if processor := config.getoption("--processor"):
        native.host_processor = lambda: (processor, PROCESSORS[processor])
    gc.disable()
    if "HINGEPAIR_CACHE" not in os.environ:  # one for all workers, and for what they run; kept for the next run
        os.environ["HINGEPAIR_CACHE"] = str(config.cache.mkdir("kernels"))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """Where all is run; what is named on the command line, or printed, does not wait for workers to start."""
    whole = config.args_source is config.ArgsSource.TESTPATHS and not config.option.keyword
    return min(os.cpu_count() or 1, 4) if whole and config.option.capture != "no" else 0


def pytest_collection_modifyitems(config, items):
    """The longest first, or one worker waits for another at the end; proofs only where they are asked for."""
    if "proof" not in config.option.markexpr:
        proofs = {item for item in items if item.get_closest_marker("proof")}
        config.hook.pytest_deselected(items=[*proofs])
        items[:] = [item for item in items if item not in proofs]
    marks = {item: item.get_closest_marker("proof") or item.get_closest_marker("slow") for item in items}
    items.sort(key=lambda item: marks[item].args if marks[item] else (), reverse=True)


def pytest_collection_finish():
    """What is loaded by now stays: to look at it again and again for what may go took a tenth of the time."""
    gc.enable()
    gc.freeze()
    atexit.register(gc.unfreeze)  # or libraries say at the end what was never freed
    gc.set_threshold(20_000, 50, 50)


@pytest.fixture(params=["compiled", pytest.param("numpy", marks=pytest.mark.slow)])
def each_backend(request, monkeypatch):
    """Every call that names no backend goes to this one; in the fast tests to the one that users' calls take."""
    from hingepair.mechanism import requests
    from hingepair.mechanism.pairs import hinge_pair

    execution_of = hinge_pair.execution_of

    def forced(backend, workers):
        return execution_of(request.param if backend == "auto" else backend, workers)

    for module in (hinge_pair, requests):
        monkeypatch.setattr(module, "execution_of", forced)
    return request.param
