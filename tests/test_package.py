"""The package from outside: what it loads, what it exports, in which direction its modules import."""

from __future__ import annotations

import ast
import builtins
import doctest
import functools
import graphlib
import inspect
import pickle
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import hingepair as hp
from hingepair.engine.llvm.object_cache import TRACED_PACKAGES
from support.work import python

PACKAGE = Path(hp.__file__).parent
SOURCES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.slow
def test_kinematics_of_a_pair_load_numpy_and_no_other_package() -> None:
    code = (
        "import sys, hingepair; hingepair.HingePair((1, 0, 0), (0, 0, 0), (0, 0, 1)); "
        "print(*sorted({m.partition('.')[0] for m, module in sys.modules.items() "
        "if 'site-packages' in (getattr(module, '__file__', None) or '')}))"
    )
    loaded = set(python(code).split())
    assert "numpy" in loaded
    assert (
        loaded & {"llvmlite", "sympy", "mpmath", "pinocchio", "scipy", "matplotlib", "rich", "typer", "click"}
        == set()
    )
    # What a bare interpreter loads by itself (start-up hooks of installed packages) is not ours.
    own = set(python("import sys;" + code.partition(";")[2].partition(";")[2]).split())
    assert loaded - own - {"hingepair"} == {"numpy"}


def test_no_package_takes_the_name_of_a_function() -> None:
    """To import a package would put it where the function was."""
    rooms = {source.stem for source in PACKAGE.glob("*.py")} | {folder.name for folder in PACKAGE.iterdir()}
    assert not rooms & set(hp.__all__)


def test_everything_exported_exists_once() -> None:
    assert len(hp.__all__) == len(set(hp.__all__))
    for name in hp.__all__:
        assert getattr(hp, name).__doc__


PACKAGES_IN_IMPORT_ORDER = (
    *(
        "errors",
        "equations",
        "numeric",
        "tables",
        "engine",
        "rotations",
        "urdf",
        "plans",
        "inverse_kinematics",
        "rollouts",
    ),
    *("mechanism", "measured", "motion", "symbolic", "formats"),
    *("validation", "scenes", "pictures", "bench", "cli"),
)
"""A package imports only packages that precede it."""

OUTSIDE = {"hingepair", "hingepair.__main__"}
"""Above all packages."""


def module_of(source: Path) -> str:
    return ".".join(source.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_of(source): source for source in SOURCES}


class Facts(NamedTuple):
    """What a module's text says.

    Attributes:
        imports: modules of the package, in functions too.
        made: private names that it makes.
        read: attributes and imported names.
        asserts: their lines.
    """

    imports: set[str]
    made: set[str]
    read: set[str]
    asserts: list[int]


@functools.cache
def facts_of(module: str) -> Facts:
    facts = Facts(set(), set(), set(), [])
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        facts.made.update(name for name in names_made_by(node) if re.match("_[^_]", name))
        match node:
            case ast.ImportFrom(module=other, names=names):
                facts.read.update(one.name for one in names)
                if (other or "").startswith("hingepair"):
                    rooms = {f"{other}.{one.name}" for one in names}
                    facts.imports.update(rooms & MODULES.keys() or {str(other)})
            case ast.Import(names=names):
                facts.imports.update({one.name for one in names} & MODULES.keys())
            case ast.Attribute(attr=name):
                facts.read.add(name)
            case ast.Assert(lineno=line):
                facts.asserts.append(line)
    return facts


def names_made_by(node: ast.AST) -> Iterator[str]:
    match node:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            yield name
        case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
            yield name
        case ast.Constant(value=str(name)):  # __slots__
            yield name


def imports_of_modules() -> dict[str, set[str]]:
    return {module: facts_of(module).imports - {"hingepair"} for module in MODULES if module not in OUTSIDE}


def imports_of_packages() -> set[tuple[str, str]]:
    """Pairs of packages of which the first imports the second."""
    pairs = ((m.split(".")[1], other.split(".")[1]) for m, those in imports_of_modules().items() for other in those)
    return {(package, other) for package, other in pairs if package != other}


@pytest.mark.slow
def test_imports_run_downwards_and_in_no_circle() -> None:
    graphlib.TopologicalSorter(imports_of_modules()).prepare()
    below = imports_of_packages()
    for own, other in below:
        assert PACKAGES_IN_IMPORT_ORDER.index(other) < PACKAGES_IN_IMPORT_ORDER.index(own), f"{own} imports {other}"


def test_what_programs_are_traced_from_imports_nothing_else() -> None:
    """Kernels are found on disk by the sources of these packages."""
    below = {other for own, other in imports_of_packages() if own in TRACED_PACKAGES}
    assert below <= {*TRACED_PACKAGES, "errors"}


CONTRIBUTING = PACKAGE.parents[1] / "CONTRIBUTING.md"


def test_files_that_contributors_are_told_of_exist() -> None:
    text = CONTRIBUTING.read_text()
    files = set(re.findall(r"`((?:src|tests|docs|models)/[\w./]*|\.ci/run|[\w.]+\.(?:md|cff|toml))`", text))
    assert len(files) > 30
    assert sorted(name for name in files - {"docs/_build"} if not (CONTRIBUTING.parent / name).exists()) == []
    for folder in (path for path in PACKAGE.iterdir() if (path / "__init__.py").exists()):
        assert f"`{folder.name}/`" in text, folder.name


def test_no_module_reads_private_names_of_another() -> None:
    somewhere = set().union(*(facts_of(module).made for module in MODULES))
    for module in MODULES:
        own = facts_of(module)
        assert not (own.read & somewhere) - own.made, module


def test_no_assert() -> None:
    assert not {module: facts_of(module).asserts for module in MODULES if facts_of(module).asserts}


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
            bound |= {n.arg for n in nodes if isinstance(n, ast.arg)}
            bound |= {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
            imports = [a for n in nodes if isinstance(n, ast.Import | ast.ImportFrom) for a in n.names]
            bound |= {(a.asname or a.name).partition(".")[0] for a in imports}
            unknown = {n.id for n in nodes if isinstance(n, ast.Name)} - bound
            assert not unknown, (name, example.source)
            assert "from hingepair." not in example.source, name
            found += 1
    assert found > 100


def test_typed_marker_is_there() -> None:
    assert (PACKAGE / "py.typed").is_file()


def test_a_listing_of_the_package_shows_its_public_names_alone():
    assert {name for name in dir(hp) if not name.startswith("__")} == {*hp.__all__}


@pytest.mark.parametrize(
    "error",
    [
        hp.ArgumentError("q", "numbers", 3),
        hp.errors.MissingDependencyError("backend", "llvmlite", "none"),
        hp.errors.CompilationError("kernel", "no code"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_of_another_process_arrives(error):
    """Where it cannot be loaded, `multiprocessing.Pool` waits for ever."""
    found = pickle.loads(pickle.dumps(error))
    assert type(found) is type(error)
    assert str(found) == str(error)
    assert vars(found) == vars(error)
