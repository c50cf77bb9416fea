"""The package from outside: what it loads, what it exports, in which direction its modules import."""

from __future__ import annotations

import ast
import builtins
import doctest
import inspect
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import hingepair as hp

SOURCES = sorted(Path(hp.__file__).parent.rglob("*.py"))


def test_import_loads_numpy_and_no_other_package() -> None:
    code = (
        "import sys, hingepair; "
        "print(*sorted({m.partition('.')[0] for m, module in sys.modules.items() "
        "if 'site-packages' in (getattr(module, '__file__', None) or '')}))"
    )
    isolated = [sys.executable, "-c", code]
    loaded = set(subprocess.run(isolated, capture_output=True, text=True, check=True).stdout.split())
    assert "numpy" in loaded
    assert (
        loaded & {"numba", "sympy", "mpmath", "pinocchio", "scipy", "matplotlib", "rich", "typer", "click"} == set()
    )
    # What a bare interpreter loads by itself (start-up hooks of installed packages) is not ours.
    bare = [sys.executable, "-c", code.replace(", hingepair", "")]
    own = set(subprocess.run(bare, capture_output=True, text=True, check=True).stdout.split())
    assert loaded - own - {"hingepair"} == {"numpy"}


def test_everything_exported_exists_once() -> None:
    assert len(hp.__all__) == len(set(hp.__all__))
    for name in hp.__all__:
        assert getattr(hp, name).__doc__


ORDER = (
    *(
        "errors",
        "numeric",
        "equations",
        "rotations",
        "evaluation",
        "pair",
        "measured",
        "integration",
        "dynamics",
        "symbolic",
    ),
    *("formats", "validation", "scenes", "bench", "cli", "__init__"),
)
UPHILL = {("evaluation", "integration")}
"""Wings that still import one above them."""


@pytest.mark.parametrize("source", SOURCES, ids=["/".join(source.parts[-2:]) for source in SOURCES])
def test_wings_import_downwards_only(source: Path) -> None:
    package = Path(hp.__file__).parent
    own = source.relative_to(package).with_suffix("").parts[0]
    tree = ast.parse(source.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hingepair."):
            wing = (node.module or "").split(".")[1]
            assert ORDER.index(wing) <= ORDER.index(own) or (own, wing) in UPHILL, f"{own} imports {wing}"


@pytest.mark.parametrize("source", SOURCES, ids=["/".join(source.parts[-2:]) for source in SOURCES])
def test_no_assert(source: Path) -> None:
    assert not [node.lineno for node in ast.walk(ast.parse(source.read_text())) if isinstance(node, ast.Assert)]


def public_docstrings() -> Iterator[tuple[str, str]]:
    for name in hp.__all__:
        value = getattr(hp, name)
        yield name, inspect.getdoc(value) or ""
        if inspect.isclass(value):
            methods = (key for key in dir(value) if not key.startswith("_"))
            yield from ((f"{name}.{key}", inspect.getdoc(getattr(value, key)) or "") for key in methods)


def test_examples_of_public_docstrings_need_nothing_but_their_imports() -> None:
    found = 0
    for name, text in public_docstrings():
        bound = set(dir(builtins))
        for example in doctest.DocTestParser().get_examples(text):
            nodes = list(ast.walk(ast.parse(example.source)))
            bound |= {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
            imports = [a for n in nodes if isinstance(n, ast.Import | ast.ImportFrom) for a in n.names]
            bound |= {(a.asname or a.name).partition(".")[0] for a in imports}
            unknown = {n.id for n in nodes if isinstance(n, ast.Name)} - bound
            assert not unknown, (name, example.source)
            assert "from hingepair." not in example.source, name
            found += 1
    assert found > 100


def test_typed_marker_is_there() -> None:
    assert (Path(hp.__file__).parent / "py.typed").is_file()


def test_errors_are_ours_and_the_built_in_that_fits() -> None:
    with pytest.raises(hp.HingePairError) as caught:
        hp.HingePair(u1=(0, 0, 0), u2=(0, 0, 0), n=(0, 0, 0))
    error = caught.value
    assert isinstance(error, ValueError)
    assert isinstance(error, hp.AxisError)
    assert (error.name, error.expected) == ("n", "a non-zero axis")
    assert str(error) == "n: expected a non-zero axis, got (0, 0, 0)"
