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
from hingepair.kernel_cache import _SOURCES

SOURCES = sorted(Path(hp.__file__).parent.glob("*.py"))


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
    ("errors", "arrays", "report", "later"),
    ("equations", "planar_equations", "derivative_equations", "constraint_equations"),
    ("blocks", "twofold", "lengths", "rotations", "sequences", "euler", "euler_motion", "body"),
    ("differentiate", "attitude_rates"),
    ("increments", "compensated", "prefix_product", "euler_steps"),
    ("steps", "motion", "plan", "state"),
    ("kernel_rows", "kernel_math", "kernel_memory", "kernel_steps", "kernel_flat_steps", "kernels"),
    ("kernel_turns",),
    ("kernel_cache", "compiled", "backend"),
    ("evaluate", "kinematics", "constraints", "explain"),
    ("accuracy", "residual_report"),
    ("jacobians", "residuals", "sensitivities"),
    ("levers", "pair", "planar"),
    ("signals", "interpolation_error", "attitude_steps", "interval_rounding", "step_control", "step_counts"),
    ("euler_route", "scipy_route", "routes", "position"),
    ("trajectory", "trajectory_state", "integration"),
    ("expressions", "expression_size", "jets", "coordinates", "scene_file", "cross_validation"),
    ("urdf_tree", "pinocchio_twin", "pinocchio", "export_parts", "urdf_inertia", "urdf", "mjcf", "robots"),
    ("samples", "sample_file", "expression_motion", "sampled_motion", "antiderivative"),
    ("integrated_motion", "rate_expressions", "rate_file"),
    ("scene_tables", "scene", "export"),
    ("trig_sums", "form_printers", "form_inputs", "closed_forms", "form_text", "derive_cli"),
    ("summary", "bench_methods", "bench_arrays", "bench_engines", "bench_cpp", "bench_contenders", "bench_truth"),
    ("bench_plot", "bench_cold", "bench_memory", "bench", "bench_skip", "bench_spins"),
    ("bench_integrate", "bench_integrate_plot", "bench_cli", "cli", "__init__"),
)


@pytest.mark.parametrize("source", SOURCES, ids=[source.stem for source in SOURCES])
def test_modules_import_downwards_only(source: Path) -> None:
    level = {name: i for i, names in enumerate(ORDER) for name in names}
    tree = ast.parse(source.read_text())
    hints = {
        n
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for n in ast.walk(node)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node not in hints and (node.module or "").startswith("hingepair"):
            parts = [node.module.removeprefix("hingepair.")] if "." in node.module else [a.name for a in node.names]
            for part in parts:
                assert level[part] <= level[source.stem], f"{source.stem} imports {part}"


@pytest.mark.parametrize("source", SOURCES, ids=[source.stem for source in SOURCES])
def test_no_assert_and_small_enough(source: Path) -> None:
    text = source.read_text()
    tree = ast.parse(text)
    assert not [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Assert)]
    assert len(text.splitlines()) <= 300
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            docstring = ast.get_docstring(node, clean=False) or ""
            body = (node.end_lineno or 0) - node.body[0].lineno + 1 - len(docstring.splitlines())
            assert body <= 40, f"{source.stem}.{node.name}"


def test_what_the_kernels_of_integrate_compile_names_their_cache() -> None:
    """An edit of any of it must not be answered by kernels compiled before it."""
    seen, todo = set(), ["kernel_turns"]
    while todo:
        module = todo.pop()
        seen.add(module)
        source = (Path(hp.__file__).parent / f"{module}.py").read_text()
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hingepair"):
                parts = [a.name for a in node.names] if node.module == "hingepair" else [node.module.split(".")[1]]
                todo += [part for part in parts if part not in seen and part != "arrays"]  # of arrays, types alone
    assert {f"{module}.py" for module in seen} <= set(_SOURCES)


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
