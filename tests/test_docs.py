"""The documentation: its code runs and prints what the pages say, and the reference has every public name."""

from __future__ import annotations

import ast
import contextlib
import importlib
import inspect
import io
import re
import shlex
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import hingepair as hp
from hingepair.mechanism.pairs.accuracy import PROMISED_BOUND_BY_OUTPUT
from support.commands import run_command

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
TEXTS = [
    ROOT / "README.md",
    ROOT / "models" / "README.md",
    *sorted(DOCS.glob("*.md")),
    *sorted(DOCS.glob("[!_a]*/*.md")),  # not those that Sphinx makes
]


# ---- the code of a page: Python blocks, commands and files, run from the first to the last

_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_FILE_NAME = re.compile(r"Save this as `([^`\n]+)`:\n\n\Z")
_COMMAND = re.compile(r"^\$ (hingepair .*)\n((?:(?!\$ ).*\n)*)", re.MULTILINE)


class Step(NamedTuple):
    """One piece of code of a page."""

    kind: str
    """"python", "command" or "file"."""
    code: str
    """Source, command line, or content of the file."""
    expected: str
    """Output that the page shows; of a file its name."""
    line: int
    """Number of the line of the page on which the code starts."""


def page_steps(page: Path) -> list[Step]:
    """Return the steps of a page in their order.

    A step is a block of Python, whose output is the block of text behind it; or a command of a console block; or a
    block behind the sentence "Save this as `NAME`:", which is a file.
    """
    text = page.read_text(encoding="utf-8")
    steps: list[Step] = []
    end_of_python = -1
    for block in _FENCE.finditer(text):
        language, code = block[1], block[2]
        line = text.count("\n", 0, block.start(2)) + 1
        if name := _FILE_NAME.search(text, 0, block.start()):
            steps.append(Step("file", code, name[1], line))
        elif language == "python":
            steps.append(Step("python", code, "", line))
            end_of_python = block.end()
        elif language == "text" and block.start() == end_of_python + 2:
            steps[-1] = steps[-1]._replace(expected=code)
        elif language == "console":
            steps += (Step("command", command[1], command[2], line) for command in _COMMAND.finditer(code))
    return steps


def run_page(page: Path) -> Iterator[tuple[Step, str]]:
    """Run the steps of a page in the working directory, the Python blocks in one namespace.

    Yields:
        Each step that shows output, and what it printed. Lines that the page leaves out by a line "..." are left out
        of what a command printed.
    """
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for step in page_steps(page):
        if step.kind == "file":
            Path(step.expected).write_text(step.code, encoding="utf-8")
        elif step.kind == "python":
            printed = io.StringIO()
            source = "\n" * (step.line - 1) + step.code
            with contextlib.redirect_stdout(printed):
                exec(compile(source, str(page), "exec"), namespace)
            yield step, printed.getvalue()
        else:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # lines of standard error, which pages do not show
                printed = run_command(*shlex.split(step.code)[1:]).stdout
            yield step, _shortened(printed, step.expected)


def _shortened(printed: str, expected: str) -> str:
    """Return the expected text where the printed one has all its lines in order; else the printed one."""
    pattern = "(?:.*\n)*".join(map(re.escape, expected.split("...\n")))
    return expected if re.fullmatch(pattern, printed) else printed


def name_of(page: Path) -> str:
    """Return the path of a page in the repository."""
    return page.relative_to(ROOT).as_posix()


WITH_CODE = [page for page in TEXTS if any(step.kind != "file" for step in page_steps(page))]


@pytest.mark.slow(20)
@pytest.mark.parametrize("page", WITH_CODE, ids=name_of)
def test_code_prints_what_the_page_says(page, tmp_path, monkeypatch):
    if "import dask" in page.read_text(encoding="utf-8"):
        pytest.importorskip("dask", reason="the extra dask is not installed")
    (tmp_path / "models").symlink_to(DOCS.parent / "models")
    monkeypatch.chdir(tmp_path)
    for step, printed in run_page(page):
        assert printed == step.expected, f"line {step.line} of {page.name}"


def test_the_reference_has_every_public_name_once():
    page = (DOCS / "reference.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^   hingepair\.(\w+)$", page, re.MULTILINE)) == sorted(hp.__all__)


def test_the_classes_of_results_exist():
    page = (DOCS / "reference.md").read_text(encoding="utf-8")
    for module, name in re.findall(r"^   (hingepair\.[\w.]+)\.(\w+)$", page, re.MULTILINE):
        assert hasattr(importlib.import_module(module), name), f"{module}.{name}"


@pytest.mark.parametrize("page", TEXTS, ids=name_of)
def test_names_of_the_package_exist(page):
    for name in set(re.findall(r"\bhp\.([a-zA-Z]\w*)", page.read_text(encoding="utf-8"))):
        assert hasattr(hp, name), name


def calls_of(page: Path) -> list[ast.Call]:
    """Return the calls of hp, robot and pair that stand between the lines of a page, `such as robot.energy(q)`."""
    found = []
    for code in re.findall(r"(?<!`)`([^`\n]+\))`", page.read_text(encoding="utf-8")):
        try:
            tree = ast.parse(code)
        except SyntaxError:
            continue
        found += [one for one in ast.walk(tree) if isinstance(one, ast.Call) and isinstance(one.func, ast.Attribute)]
    return found


@pytest.mark.parametrize("page", TEXTS, ids=name_of)
def test_calls_in_the_text_fit_the_signatures(page):
    owners = {"hp": (hp,), "robot": (hp.Mechanism,), "pair": (hp.HingePair, hp.PlanarPair)}
    for call in calls_of(page):
        arguments = [ast.unparse(argument) for argument in call.args]
        name = call.func.attr
        owner = next((one for one in owners.get(ast.unparse(call.func.value), ()) if hasattr(one, name)), None)
        if owner is None or "..." in arguments:
            continue
        function = getattr(owner, name)
        if hasattr(function, "dispatch") and arguments[0] == "robot":
            function = function.dispatch(hp.Mechanism)
        own = [] if owner is hp or inspect.ismethod(function) else ["self"]
        inspect.signature(function).bind(*own, *arguments, **{one.arg: None for one in call.keywords if one.arg})


@pytest.mark.parametrize("page", TEXTS, ids=name_of)
def test_links_lead_to_files_and_headings(page):
    text = page.read_text(encoding="utf-8")
    links = re.findall(r"\]\((?!https?:)([^)#\s]*)#?([^)\s]*)\)", text)
    for link, heading in (*links, *((file, "") for file in re.findall(r'<img src="([^"]*)"', text))):
        target = page.parent / link if link else page
        assert target.exists(), link
        if heading:
            headings = re.findall("^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            anchors = [re.sub(r"[^\w -]", "", one).lower().replace(" ", "-") for one in headings]
            assert heading in anchors, f"{link}#{heading}"


@pytest.mark.parametrize("output", PROMISED_BOUND_BY_OUTPUT)
def test_the_table_of_accuracy_is_the_promise(output):
    promise = PROMISED_BOUND_BY_OUTPUT[output]
    row = f"| {output} | {promise.proved} | {promise.seen} | {promise.scale} |"
    assert row in (DOCS / "concepts" / "accuracy.md").read_text(encoding="utf-8")
