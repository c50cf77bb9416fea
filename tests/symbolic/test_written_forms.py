"""Closed forms as text: the Python and C compute what the numbers are, the LaTeX parses, SymPy reads its source."""

from __future__ import annotations

import ast
import ctypes
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import sympy

import hingepair as hp
from hingepair.mechanism.mechanism import tree_of
from hingepair.symbolic import writing
from support.exported import ARM
from support.sparse import sparse

MODELS = Path(__file__).parents[2] / "models"
REFERENCE = MODELS / "reference_3d.toml"
U = 2.0**-53
SNAP = 1e-6
EXACT_ENOUGH = 128  # in units of u times the largest value: angles up to 200 rad and sums of 40 terms are rounded
t = sympy.Symbol("t", real=True)
HOME = ((0, 0.6, -0.8), (0, 0.8, 0.6), (1, 0, 0))


def run(source):
    """The functions of a module that may use nothing but NumPy."""
    namespace = {}
    exec(compile(source, "forms", "exec"), namespace)
    return namespace


@pytest.mark.slow
@pytest.mark.parametrize("name", ["reference_3d", "reference_2d", "truck_trailer", "satellite_panel", "talos_elbow"])
def test_forms_evaluate_to_the_numeric_results(name):
    found = hp.load_scene(MODELS / f"{name}.toml")
    outputs = tuple(found.assembly.kind.levels)
    numbers = found.evaluate(outputs)
    functions = run(hp.derive(found).to_python(outputs, found.title))
    for output in outputs:
        expected = getattr(numbers, output)
        got = functions[output](numbers.t)
        assert got.shape == expected.shape
        assert abs(got - expected).max() <= EXACT_ENOUGH * U * (abs(expected).max() or 1), output


@pytest.mark.parametrize("symbolic", [(), ("u1", "u2", "n")], ids=["numbers", "letters"])
@pytest.mark.parametrize("planar", [pytest.param(False, marks=pytest.mark.slow), True], ids=["space", "plane"])
def test_any_motion_of_a_pair_evaluates_to_the_numeric_results(planar, symbolic):
    """Of a bare pair: functions of the coordinates and their rates, and of the letters that stayed."""
    rng = np.random.default_rng(7)
    names = ("x", "y", "phi", "psi") if planar else ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")
    q, qd, qdd = rng.uniform(-2, 2, (3, 20, len(names)))
    if planar:
        pair, symbolic = hp.PlanarPair(u1=(0.5, 0.25), u2=(-0.25, 0.1), points2={"tip": (0.3, 1)}), symbolic[:2]
    else:
        pair = hp.HingePair((0.5, 0.2, 0.1), (-0.25, 0.1, 0.3), (0.3, -0.7, 0.2), HOME, points2={"tip": (1, 0, 2)})
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
        expected = state.arrays()[output]
        assert got.shape == expected.shape
        assert abs(got - expected).max() <= EXACT_ENOUGH * U * abs(expected).max(), output


def values_of(lines, known):
    """The values of labels in lines such as `R_x = R_y = k_1*s_2`, from those of symbols."""
    found, names = dict(known), {name: getattr(sympy, name) for name in ("sin", "cos", "sqrt", "exp", "pi")}
    for line in lines:
        *labels, text = line.split(" = ")
        value = sympy.sympify(text, locals=names | {key: sympy.Symbol(key) for key in found}).subs(found).evalf()
        found |= dict.fromkeys(labels, float(value))
    return found


@pytest.mark.parametrize("name", ["reference_2d", "ur5"])
def test_abbreviations_are_defined_before_they_are_used_and_mean_the_same(name):
    if name == "ur5":
        forms = hp.derive(hp.load_robot("ur5_robot", snap=SNAP), frame="tool0")
        known = {f"q_{k}": 0.3 * k for k in range(1, 7)}
    else:
        forms, known = hp.derive(hp.load_scene(MODELS / f"{name}.toml")), {"t": 0.7}
    output = "R" if name == "ur5" else "a2"
    full, short = (forms.to_text([output], short=short, width=10**6).splitlines() for short in (False, True))
    lines = [[line for line in text if " = " in line] for text in (full, short)]
    assert sum(map(len, short)) < sum(map(len, full))
    both = [values_of(text, known) for text in lines]
    for label in forms.labels(output):
        assert both[0][label] == pytest.approx(both[1][label], rel=16 * U, abs=16 * U)


@pytest.mark.slow
@pytest.mark.parametrize("short", [False, True], ids=["full", "short"])
@pytest.mark.parametrize("which", ["scene", "plane", "space", "leg"])
def test_latex_parses(which, short):
    """By the parser of Matplotlib, which knows this much of LaTeX; braces and environment apart from it."""
    from matplotlib.mathtext import MathTextParser

    value, outputs = {
        "scene": (hp.load_scene(MODELS / "truck_trailer.toml"), ("R2", "omega2")),
        "plane": (hp.PlanarPair((1, 2), (3, 4)), ("R2", "omega2", "a2")),
        "space": (hp.HingePair((1, 2, 3), (0.1, 0, 0), (1, 1, 0)), ("R2", "omega2")),
        "leg": (hp.load_robot("solo12"), ("R", "jacobian", "v")),
    }[which]
    forms = hp.derive(value, frame="FL_FOOT") if which == "leg" else hp.derive(value, ("u1", "u2"))
    text = forms.to_latex(outputs, short=short)
    *_, first, body = re.split(r"(\\begin\{align\*\}  % .*\n)", text)
    rows = body.removesuffix("\n\\end{align*}\n").split(" \\\\\n")
    assert first.startswith(r"\begin{align*}")
    for row in rows:
        left, right = row.split("&", maxsplit=1)
        MathTextParser("agg").parse(f"${left} x {right}$")


def test_angles_in_degrees_stay_fractions_of_pi(tmp_path):
    text = re.sub(r"(?m)^psi = .*$", 'psi = "deg(85)*sin(t)"', REFERENCE.read_text())
    (tmp_path / "scene.toml").write_text(text)
    assert r"\frac{17 \pi" in hp.derive(hp.load_scene(tmp_path / "scene.toml")).to_latex(["omega2"])


@pytest.mark.parametrize(
    ("name", "latex"), [("phi_x", r"\phi_{x}"), ("u1_x", "u_{1,x}"), ("Jomega_x4", r"J^{\omega}_{x4}")]
)
def test_names_become_letters_with_indices(name, latex):
    assert writing._latex_name(name) == latex


def test_python_is_numpy_only_and_vectorised():
    forms = hp.derive(hp.load_scene(REFERENCE), ("u1",))
    source = forms.to_python(("S2", "R2", "v1"), 'a "title" \\ of\n two lines')
    assert ast.get_docstring(ast.parse(source)) == "Closed forms: a title  of two lines."
    imported = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert [ast.unparse(node) for node in imported] == ["import numpy"]
    functions = run(source)
    assert functions["S2"]([[0, 1, 2]]).shape == (1, 3, 3, 3)
    assert functions["R2"](1, 0.5, np.zeros((2, 1)), [1, 2, 3]).shape == (2, 3, 3)
    assert functions["v1"](np.zeros(4)).tolist() == [[3, 3, 3]] * 4


GUARDS = (
    "abs(t - 1) + max(sin(t), 0.5) - min(t, 2 - t)",
    "where(t < 1 or not t <= 1.5, t**2, -t)",
    "where(0.5 < t <= 1.5 and not (t > 1 and t < 1.25), t**3, 1)*t",
    "mod(t, 0.5)*sign(t - 1) + clip(t**2, 0.25, 1)",
    "ramp((t - 1)**2 - 0.25) + step(1 - t)*t + where((t - 1)**2 < 0, 1, t**2)",
)


@pytest.mark.slow
@pytest.mark.parametrize("text", sparse(GUARDS, 3, str))
def test_sympy_source_is_read_by_sympy(text, tmp_path):
    """And means the same, with rates, between the kinks."""
    changed = {"psi": f'"{text}"', "start": 0.05, "stop": 1.95, "samples": 20}
    scene = REFERENCE.read_text()
    for key, value in changed.items():
        scene = re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", scene)
    path = tmp_path / "scene.toml"
    path.write_text(scene)
    found, outputs = hp.load_scene(path), ("R2", "omega2", "alpha2")
    result = found.evaluate(outputs)
    sources = hp.derive(found).to_sympy(outputs)
    for output in outputs:
        expr, expected = sympy.sympify(sources[f"{output}_y"]), getattr(result, output)[:, 1]
        got = [expr.subs("t", sympy.Float(instant, 30)).evalf() for instant in result.t]
        np.testing.assert_allclose(np.array(got, float), expected, rtol=0, atol=64 * U * (1 + abs(expected).max()))


@pytest.mark.slow
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


# ---- frames of robots


def oblique_robot(seed):
    """Hinges and sliders in series with oblique axes, some parallel to the one before, and a tool."""
    rng = np.random.default_rng(seed)
    pairs = []
    n, home = rng.standard_normal(3), np.eye(3)
    for k in range(5):
        if rng.random() < 0.4:
            n = home.T @ n * rng.choice((-1, 1))  # parallel to the joint before
            home = hp.rodrigues(n, rng.choice((0.0, 0.3, np.pi / 2)))  # about its own axis
        else:
            n, home = rng.standard_normal(3), hp.rodrigues(rng.standard_normal(3), rng.uniform(-3, 3))
        kind = hp.Slider if rng.random() < 0.3 else hp.HingePair
        u1, u2 = rng.uniform(-1, 1, (2, 3))
        pairs.append(kind(u1=u1, u2=u2 * (k % 2), n=n, home=home, name=f"joint{k}"))
    turn = hp.rodrigues(rng.standard_normal(3), 0.5)
    return hp.Mechanism(pairs, name="oblique").with_frame("tool", "joint4", R=rng.uniform(-1, 1, 3), S=turn)


MIMIC = ARM.replace('<mimic joint="elbow"/>', '<mimic joint="elbow" multiplier="-2" offset="0.25"/>')

ROBOTS = {
    "ur5": lambda: (hp.load_robot("ur5_robot", snap=SNAP), "tool0"),
    "panda's finger": lambda: (hp.load_robot("panda"), "panda_leftfinger"),
    "solo12": lambda: (hp.load_robot("solo12"), "FL_FOOT"),
    "followers": lambda: (hp.Mechanism.from_urdf(MIMIC), "tool"),
    **{f"oblique {seed}": lambda seed=seed: (oblique_robot(seed), "tool") for seed in (0, 3)},
}


def states(robot, count=40, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (2, count, robot.dof))


def reach(robot):
    return 1 + sum(np.abs(joint.u).sum() + 3 * (joint.kind == "slider") for joint in tree_of(robot).joints)


@pytest.mark.slow
@pytest.mark.parametrize("which", ROBOTS)
def test_the_generated_module_computes_what_the_robot_computes(which):
    robot, frame = ROBOTS[which]()
    module = run(hp.derive(robot, frame=frame).to_python())
    q, qd = states(robot)
    state = robot.forward_kinematics(q, qd, frames=(frame,))[frame]
    size, rate = reach(robot), 3 * len(tree_of(robot).joints)
    for values, expected, scale in (
        (module["R"](q), state.R, size),
        (module["S"](q), state.S, 1),
        (module["jacobian"](q), robot.jacobian(q, frame), size),
        (module["v"](q, qd), state.v, size * rate),
        (module["omega"](q, qd), state.omega, rate),
    ):
        assert values.shape == expected.shape
        assert np.abs(values - expected).max() <= 64 * U * scale


def test_a_leg_has_its_textbook_jacobian_and_says_what_does_not_move_it():
    text = hp.derive(hp.load_robot("solo12"), frame="FR_FOOT").to_text(["jacobian"], short=True)
    for expected in (
        "the other joints do not",
        "Jomega_x4 = 1\n",
        "Jomega_y5 = Jomega_y6 = c_4\n",
        "Jomega_z5 = Jomega_z6 = s_4\n",
        "k_1 = 0.16*c_56\n",
        "Jv_x6 = -k_1\n",
        "Jv_x4 = Jomega_x5 = Jomega_x6 = Jomega_y4 = Jomega_z4 = 0\n",
    ):
        assert expected in text


def test_what_rounding_left_is_taken_for_zero():
    pair = hp.HingePair(u1=(1, 1e-17, 0), u2=(0, 0, 0), n=(0, 0, 1), name="a")
    forms = hp.derive(hp.Mechanism([pair]))
    assert list(forms.R) == [1, 0, 0]
    small = hp.HingePair(u1=(1, 1e-14, 0), u2=(0, 0, 0), n=(0, 0, 1), name="a")
    assert hp.derive(hp.Mechanism([small])).R[1] == sympy.Rational(1, 10**14)
