"""Closed forms as text: the Python computes what the numbers are, the LaTeX parses, the command line writes both."""

from __future__ import annotations

import ast
import ctypes
import re
import shutil
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
import sympy

import hingepair as hp
from hingepair.symbolic.kinks import Where
from hingepair.symbolic.printers import to_latex, to_numpy_source, to_sympy_source, to_text
from hingepair.symbolic.written_forms import abbreviated
from support.commands import run_command
from support.sparse import sparse

MODELS = Path(__file__).parents[2] / "models"
REFERENCE = MODELS / "reference_3d.toml"
U = 2.0**-53
t, y = sympy.symbols("t y", real=True)


OTHERS = ("reference_2d", "truck_trailer", "satellite_panel", "talos_elbow")
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in OTHERS]
EXACT_ENOUGH = 128
"""In units of u times the largest value of the output: angles up to 200 rad and sums of 40 terms are rounded."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["reference_3d", *SLOW])
def test_forms_evaluate_to_the_numeric_results(name):
    found = hp.load_scene(MODELS / f"{name}.toml")
    outputs = tuple(found.kind.levels)
    numbers = found.evaluate(outputs)
    functions = run(hp.derive(found).to_python(outputs, found.title))
    for output in outputs:
        expected = getattr(numbers, output)
        got = functions[output](numbers.t)
        assert got.shape == expected.shape
        assert abs(got - expected).max() <= EXACT_ENOUGH * U * (abs(expected).max() or 1), output


def run(source):
    """The functions of a module that may use nothing but NumPy."""
    namespace = {}
    exec(compile(source, "forms", "exec"), namespace)
    return namespace


@pytest.mark.parametrize("symbolic", [(), ("u1", "u2", "n")], ids=["numbers", "letters"])
@pytest.mark.parametrize("planar", [pytest.param(False, marks=pytest.mark.slow), True], ids=["space", "plane"])
def test_any_motion_of_a_pair_evaluates_to_the_numeric_results(planar, symbolic):
    """Of a bare pair: functions of the coordinates and their rates, and of the letters that stayed."""
    rng = np.random.default_rng(7)
    size, names = (4, ("x", "y", "phi", "psi")) if planar else (7, closed_names())
    q, qd, qdd = rng.uniform(-2, 2, (3, 20, size))
    if planar:
        pair, symbolic = hp.PlanarPair(u1=(0.5, 0.25), u2=(-0.25, 0.1)), symbolic[:2]
    else:
        pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(0.3, -0.7, 0.2), home=HOME_MATRIX)
    forms = hp.derive(pair, symbolic)
    known = {f"{name}{'d' * i}": part[:, j] for i, part in enumerate((q, qd, qdd)) for j, name in enumerate(names)}
    known |= {
        f"{key}_{axis}": value for key in symbolic for axis, value in zip("xyz", getattr(pair, key), strict=False)
    }
    functions = run(forms.to_python(forms.names))
    state = pair.forward_kinematics(q, qd, qdd, outputs=forms.names)
    for output in forms.names:
        function = functions[output]
        got = function(*(known[key] for key in function.__code__.co_varnames[: function.__code__.co_argcount]))
        expected = getattr(state, output)
        assert got.shape == expected.shape
        assert abs(got - expected).max() <= EXACT_ENOUGH * U * abs(expected).max(), output


HOME_MATRIX = ((0, 0.6, -0.8), (0, 0.8, 0.6), (1, 0, 0))


def closed_names():
    return ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")


PLANE = hp.PlanarPair(u1=(0.5, 0.25), u2=(-0.25, 0.1))


@pytest.mark.parametrize("name", ["reference_2d", "truck_trailer"])
def test_abbreviations_are_told_before_they_are_used_and_mean_the_same(name):
    forms = hp.derive(hp.load_scene(MODELS / f"{name}.toml"))
    rows, definitions, _ = abbreviated(forms._equations(["v2"], short=True))
    meanings = {letter: meaning for definition in definitions for letter, meaning in definition.items()}
    known = {t}
    whole = {}
    for letter, meaning in meanings.items():
        assert meaning.free_symbols <= known
        known.add(sympy.Symbol(letter, real=True))
        whole[sympy.Symbol(letter, real=True)] = meaning.xreplace(whole)
    assert len(meanings) > 3
    for (_, expr), expected in zip(rows, forms.v2, strict=True):
        assert len(str(expr)) < 0.7 * len(str(expected)) or expected == 0
        assert abs((expr.xreplace(whole) - expected).subs(t, sympy.Rational(3, 10)).evalf(30)) < 1e-25


def test_powers_of_what_has_kinks_are_written():
    below = Where(t, y, 1) ** 2
    assert to_text(below) == "(y if t ≥ 0 else 1)²"
    assert to_latex(below) == r"\left(\begin{cases} y & t \ge 0 \\ 1 & \text{else} \end{cases}\right)^{2}"


ACROSS = {"u1": (1, 2, 3), "u2": (0.1, 0, 0), "n": (1, 1, 0)}


@pytest.mark.slow
@pytest.mark.parametrize("short", [False, True], ids=["full", "short"])
def test_latex_parses(short):
    """By the parser of Matplotlib, which knows this much of LaTeX; braces and environment apart from it."""
    from matplotlib.mathtext import MathTextParser

    motions = hp.load_scene(MODELS / "truck_trailer.toml"), hp.PlanarPair((1, 2), (3, 4)), hp.HingePair(**ACROSS)
    for forms in (hp.derive(value, ("u1", "u2")) for value in motions):
        first, *rows, last = forms.to_latex(("R2", "omega2"), short=short).splitlines()
        assert (first.split()[0], last) == (r"\begin{align*}", r"\end{align*}")
        assert [row.endswith(r" \\") for row in rows] == [True] * (len(rows) - 1) + [False]
        for row in rows:
            left, right = row.removesuffix(r"\\").split("&", maxsplit=1)
            MathTextParser("agg").parse(f"${left} x {right}$")


def test_python_is_numpy_only_and_vectorised():
    forms = hp.derive(hp.load_scene(REFERENCE), ("u1",))
    source = forms.to_python(("S2", "R2", "v1"), 'a "title" \\ of\n two lines')
    assert ast.get_docstring(ast.parse(source)) == "Closed forms: a title  of two lines."
    imported = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert [ast.unparse(node) for node in imported] == ["import numpy"]
    functions = run(source)
    assert functions["S2"]([[0, 1, 2]]).shape == (1, 3, 3, 3)
    assert functions["R2"](1, 0.5, np.zeros((2, 1)), [1, 2, 3]).shape == (2, 3, 3)
    assert functions["v1"](0).tolist() == [3, 3, 3]
    assert functions["v1"](np.zeros(4)).tolist() == [[3, 3, 3]] * 4


def test_python_has_no_integer_that_numpy_cannot_take():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for expr in (sympy.Integer(10) ** 600 * t, sympy.Rational(1, 10**600) * t):
            assert np.shape(eval(to_numpy_source(expr), {"numpy": np, "t": np.ones(2)})) == (2,)


def derived(*arguments):
    return run_command("derive", *arguments).stdout


def test_the_outputs_of_the_scene_are_derived(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(REFERENCE.read_text() + '\n[outputs]\nnames = ["alpha1"]\n')
    assert [line.split(" = ")[0] for line in derived(path).splitlines()] == ["alpha1_x", "alpha1_y", "alpha1_z"]


GUARDS = (
    "abs(t - 1) + max(sin(t), 0.5) - min(t, 2 - t)",
    "where(t < 1 or not t <= 1.5, t**2, -t)",
    "where(0.5 < t <= 1.5 and not (t > 1 and t < 1.25), t**3, 1)*t",
    "mod(t, 0.5)*sign(t - 1) + clip(t**2, 0.25, 1)",
    "ramp((t - 1)**2 - 0.25) + step(1 - t)*t + where((t - 1)**2 < 0, 1, t**2)",
    "where(-(t - 1)**2 < 0, t, t**3) + where(where(t < 1, t, 1 - t) > 0.5, t, t**2)",
)


@pytest.mark.slow
@pytest.mark.parametrize("text", sparse(GUARDS, 3, str))
def test_sympy_source_is_read_by_sympy(text, tmp_path):
    """And means the same, with rates and at the kinks: each value is compared with the library's."""
    lines = REFERENCE.read_text().splitlines()
    lines = [f'psi = "{text}"' if line.startswith("psi =") else line for line in lines]
    lines = ["stop = 2" if line.startswith("stop =") else line for line in lines]
    path = tmp_path / "scene.toml"
    path.write_text("\n".join("samples = 17" if line.startswith("samples =") else line for line in lines))
    found, outputs = hp.load_scene(path), ("R2", "omega2", "alpha2")
    result = found.evaluate(outputs)
    sources = hp.derive(found).to_sympy(outputs)
    for output in outputs:
        expr, expected = sympy.sympify(sources[f"{output}_y"]), getattr(result, output)[:, 1]
        got = [expr.subs("t", sympy.Rational(k, 8)).evalf() for k in range(17)]
        np.testing.assert_allclose(np.array(got, float), expected, rtol=0, atol=1e-13 * (1 + abs(expected).max()))


def test_letters_of_sympy_s_own_names_are_symbols():
    """`gamma` alone would be read as a function, `S` as a class."""
    expr = sum(sympy.Symbol(name, real=True) for name in ("gamma", "S", "speed")) * sympy.exp(t)
    read = sympy.sympify(to_sympy_source(expr))
    assert {symbol.name for symbol in read.free_symbols} == {"gamma", "S", "speed", "t"}
    assert {type(symbol) for symbol in read.free_symbols} == {sympy.Symbol}
    assert str(sympy.sympify(hp.derive(PLANE).to_sympy(["omega2"])["omega2"]).doit()) == (
        "Derivative(phi(t), t) + Derivative(psi(t), t)"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "motion",
    ["", "[dynamics]\nbase = 'fixed'\npsi_0 = 0.1\n[time]\nstart = 0\nstop = 1\nsamples = 3\n"],
    ids=["none", "simulated"],
)
def test_a_pair_without_expressions_of_t_is_as_exact_as_it_is_written(motion, tmp_path):
    path = tmp_path / "pair.toml"
    path.write_text(
        "[pair]\nu1 = ['cos(pi/6)', 0, 0]\nu2 = [0, 0, 0]\nn = [0, 0, 1]\n"
        "home = { axis = [1, 0, 0], deg = 90 }\n[pair.body2]\nmass = 2\ninertia = [1, 1, 1]\n" + motion
    )
    lines = derived(path, "--outputs", "d,S2").splitlines()
    assert "d_x = 1/2 √3 k_1 k_2" in lines
    assert {"k_1 = cos φ_z", "k_2 = cos φ_y"} <= {*lines}


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("which", ["pair", "kinks", "robot"])
def test_c_computes_what_python_computes(which, tmp_path):
    """One state, compiled as C99 without a warning."""
    if which == "robot":
        forms, names, arguments = hp.derive(hp.load_scene(MODELS / "excavator.toml")), ("R", "v"), ()
    else:
        text = REFERENCE.read_text()
        if which == "kinks":
            kinks = "abs(t - 1) + max(sin(t), 0.5) - min(t, 0.2) + mod(t, 0.3) + where(t < 0.4, 1, t)"
            text = re.sub(r"(?m)^psi = .*$", f'psi = "{kinks}"', text)
        (tmp_path / "scene.toml").write_text(text)
        forms, names, arguments = hp.derive(hp.load_scene(tmp_path / "scene.toml")), ("R2", "v2"), (0.7,)
    (tmp_path / "forms.c").write_text(forms.to_c(names, "a */ title"))
    library = tmp_path / "forms.so"
    options = ("-std=c99", "-Wall", "-Werror", "-shared", "-fPIC")
    subprocess.run(["cc", *options, "-o", library, tmp_path / "forms.c", "-lm"], check=True)
    compiled, module = ctypes.CDLL(str(library)), run(forms.to_python(names))
    for name in names:
        out = (ctypes.c_double * 3)()
        if which == "robot":
            rows = [np.linspace(0.1, 0.9, len(forms.q)) + k for k in range(1 + (name == "v"))]
            getattr(compiled, name)(*(row.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for row in rows), out)
            expected = module[name](*rows)
        else:
            getattr(compiled, name)(*map(ctypes.c_double, arguments), out)
            expected = module[name](*arguments)
        np.testing.assert_allclose(out, expected, rtol=0, atol=64 * U * np.abs(expected).max())
