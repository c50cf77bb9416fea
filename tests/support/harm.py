"""hingepair with a fault in it: one module's text changed as it is imported, in a process of its own."""

from __future__ import annotations

import functools
import gc
import multiprocessing
import os
import sys
import tempfile
from importlib.machinery import PathFinder, SourceFileLoader
from pathlib import Path
from typing import NamedTuple

import hypothesis
import pytest
from hypothesis import Phase

from support.work import HANG

TESTS = Path(__file__).parents[1]
PACKAGE = TESTS.parent / "src" / "hingepair"
TOOLS = [
    "hypothesis.extra.numpy",
    "mpmath",
    "numpy",
    "pandas",
    "pinocchio",
    "pytest",
    "sympy.physics.vector",
    "typer.testing",
]
TOOLS += ["scipy.interpolate", "scipy.linalg", "scipy.optimize", "scipy.spatial.transform"]


class Fault(NamedTuple):
    """A text that stands exactly once in a file of the package, what it becomes, and a test that notices."""

    file: str
    old: str
    new: str
    killer: str

    def harmed(self) -> str:
        """The text of the file with the fault in it."""
        text = (PACKAGE / self.file).read_text(encoding="utf-8")
        count = text.count(self.old)
        assert count == 1, f"{self.file}: the text to harm stands there {count} times, not once:\n{self.old}"
        return text.replace(self.old, self.new)


class _Finder:
    """Finds the module of a fault in front of all other finders."""

    def __init__(self, fault):
        self.fault = fault
        self.module = ".".join(("hingepair", *Path(fault.file).with_suffix("").parts))

    def find_spec(self, name, path, target=None):
        if name != self.module:
            return None
        spec = PathFinder.find_spec(name, path, target)
        spec.loader = _Loader(name, spec.origin, self.fault)
        return spec


class _Loader(SourceFileLoader):
    def __init__(self, name, path, fault):
        super().__init__(name, path)
        self.fault = fault

    def get_code(self, _):
        return compile(self.fault.harmed(), self.path, "exec", dont_inherit=True)


def _run(answer, fault, tests, compiled):
    """In the new process: the tests, with the fault; sends the exit code and what pytest printed."""
    gc.freeze()
    os.chdir(TESTS.parent)
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    sys.pycache_prefix, sys.dont_write_bytecode = compiled, False
    if fault is not None:
        sys.meta_path.insert(0, _Finder(fault))
    # What fails is enough: the least that does is not looked for
    hypothesis.settings.register_profile("harmed", phases=[Phase.explicit, Phase.generate])
    hypothesis.settings.load_profile("harmed")
    options = ["-q", "-x", "-o", "addopts=", "-p", "no:cacheprovider", "--color=no", "--tb=native"]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # the tools are loaded already
    with tempfile.TemporaryFile("w+") as output:
        for number in (1, 2):
            os.dup2(output.fileno(), number)
        code = int(pytest.main([*options, *(str(TESTS / test) for test in tests)]))
        sys.stdout.flush()
        output.seek(0)
        answer.send((code, output.read()))


@functools.cache
def _compiled():
    """A folder for what Python compiles, which is the same for all faults but for one module."""
    return tempfile.TemporaryDirectory()


def run(fault, tests):
    """Exit code and output of some tests of hingepair with a fault in it, or with none.

    The process is forked from one that has loaded the tools, but not hingepair.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(TOOLS)
    receive, send = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(send, fault, tests, _compiled().name))
    process.start()
    send.close()
    try:
        found = receive.recv() if receive.poll(HANG) else (None, f"no answer in {HANG} s")
    except EOFError:
        found = None, "the process died"
    process.kill()
    process.join()
    return found


if __name__ == "__main__":  # python tests/support/harm.py FILE OLD NEW TEST...: which test notices?
    print(run(Fault(*sys.argv[1:4], ""), sys.argv[4:])[1])
