"""Closed forms: what derive gives is what physics.vector derives, what papers have, and what the numbers are."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy

import hingepair as hp
from hingepair.scenes.subject import Subject
from hingepair.symbolic.exact import exact, exact_axis
from support.commands import run_command

MODELS = Path(__file__).parents[2] / "models"
INSTANTS = (sympy.Rational(1, 3), sympy.Rational(7, 5))
T = sympy.Symbol("t", real=True)
DIGITS = 30


def scene(tmp_path, name="reference_3d", **changes):
    """A model with some lines changed."""
    lines = (MODELS / f"{name}.toml").read_text().splitlines()
    for key, value in changes.items():
        found = [i for i, line in enumerate(lines) if line.startswith(f"{key} = ")]
        if found:
            lines[found[0]] = f"{key} = {value}"
        else:
            lines.insert(lines.index("[pair]") + 1, f"{key} = {value}")
    path = tmp_path / "scene.toml"
    path.write_text("\n".join(lines))
    return hp.load_scene(path)


@pytest.fixture(scope="module")
def reference():
    return hp.derive(hp.load_scene(MODELS / "reference_3d.toml"))


def at(matrix, instant):
    return sympy.Matrix(matrix).subs(T, instant).evalf(DIGITS)


def largest(matrix):
    return max(abs(entry) for entry in matrix)


def test_omega1_of_the_reference_example_is_its_source_s(reference):
    sin, cos, half = sympy.sin, sympy.cos, sympy.Rational(5, 2)
    assert tuple(reference.omega1) == (
        3 + 5 * sin(T),
        cos(3 * T) - half * sin(2 * T) - half * sin(4 * T),
        sin(3 * T) + half * cos(4 * T) + half * cos(2 * T),
    )


def test_a_planar_pair_gives_e11():
    pair = hp.PlanarPair(u1=(0.5, 0.25), u2=(-0.25, 0.1))
    forms = hp.derive(pair, ("u1", "u2"))
    x, y, phi, psi = (sympy.Function(name, real=True)(T) for name in ("x", "y", "phi", "psi"))
    u1x, u1y, u2x, u2y = sympy.symbols("u1_x u1_y u2_x u2_y", real=True)
    s1, c1, s2, c2 = sympy.sin(phi), sympy.cos(phi), sympy.sin(phi + psi), sympy.cos(phi + psi)
    R2 = sympy.Matrix([x + c1 * u1x - s1 * u1y - c2 * u2x + s2 * u2y, y + s1 * u1x + c1 * u1y - s2 * u2x - c2 * u2y])
    for k, output in enumerate((forms.R2, forms.v2, forms.a2)):
        assert sympy.expand(R2.diff((T, k)) - output) == sympy.zeros(2, 1)
    assert (forms.phi2, forms.omega2, forms.alpha2) == tuple((phi + psi).diff((T, k)) for k in range(3))


def physics_vector(found):
    """Body 2 by SymPy's own mechanics: frames turned one after the other, points carried along."""
    from sympy.physics.vector import Point, ReferenceFrame, dynamicsymbols

    t = dynamicsymbols._t
    motion = [expr.subs(T, t) for expr in found.expressions.values()]
    world, body1, turned, body2 = map(ReferenceFrame, ("N", "A", "H", "B"))
    body1.orient_body_fixed(world, motion[3:6], found.sequence)
    pair = found.pair
    turned.orient_axis(body1, vector(exact_axis(pair.n.tolist()), body1), motion[6])
    home = sympy.Matrix(3, 3, [exact(value) for value in pair.home.ravel().tolist()])
    body2.orient_explicit(turned, home)
    origin, point1, hinge, point2 = map(Point, ("O", "P", "Q", "R"))
    origin.set_vel(world, 0)
    point1.set_pos(origin, vector(motion[:3], world))
    point1.set_vel(world, point1.pos_from(origin).dt(world))
    hinge.set_pos(point1, vector([exact(value) for value in pair.u1.tolist()], body1))
    point2.set_pos(hinge, -vector([exact(value) for value in pair.u2.tolist()], body2))
    hinge.v2pt_theory(point1, world, body1)
    point2.v2pt_theory(hinge, world, body2)
    point1.set_acc(world, point1.vel(world).dt(world))
    hinge.a2pt_theory(point1, world, body1)
    point2.a2pt_theory(hinge, world, body2)
    vectors = {
        "R1": point1.pos_from(origin),
        "R2": point2.pos_from(origin),
        "d": point2.pos_from(point1),
        "v1": point1.vel(world),
        "v2": point2.vel(world),
        "a1": point1.acc(world),
        "a2": point2.acc(world),
        "omega1": body1.ang_vel_in(world),
        "omega2": body2.ang_vel_in(world),
        "alpha1": body1.ang_acc_in(world),
        "alpha2": body2.ang_acc_in(world),
    }
    found = {name: value.to_matrix(world) for name, value in vectors.items()}
    found |= {"S1": world.dcm(body1), "S2": world.dcm(body2)}
    return {name: matrix.subs(t, T) for name, matrix in found.items()}


def vector(parts, frame):
    return parts[0] * frame.x + parts[1] * frame.y + parts[2] * frame.z


HOME = "[[0, 0.6, -0.8], [0, 0.8, 0.6], [1, 0, 0]]"
ORACLE = {
    "reference": {},
    "ZXZ": {"home": HOME, "n": "[1, -2, 2]", "sequence": '"ZXZ"', "psi": '"t**2 + sin(t)"'},
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes", [pytest.param(ORACLE["reference"], marks=pytest.mark.proof), ORACLE["ZXZ"]], ids=ORACLE
)
def test_every_form_is_that_of_sympys_own_mechanics(changes, tmp_path):
    lines = dict(changes)
    sequence = lines.pop("sequence", None)
    found = scene(tmp_path, **lines)
    if sequence:
        path = tmp_path / "scene.toml"
        path.write_text(path.read_text().replace("[motion] ", f"[motion]\nsequence = {sequence}\n#"))
        found = hp.load_scene(path)
        assert found.sequence == "ZXZ"
    forms, truth = hp.derive(found), physics_vector(found)
    assert set(truth) == set(forms.names)
    for (name, expected), instant in itertools.product(truth.items(), INSTANTS):
        value = at(expected, instant)
        assert largest(at(getattr(forms, name), instant) - value) <= 10 ** (5 - DIGITS) * (1 + largest(value)), name


def test_constants_of_a_scene_stay_letters():
    found = hp.load_scene(MODELS / "talos_elbow.toml")
    cadence = sympy.Symbol("cadence", real=True)
    forms = hp.derive(found, ("cadence",))
    assert cadence in forms.v1.free_symbols
    assert forms.v1.subs(cadence, sympy.Rational(9, 10)) == hp.derive(found).v1
    with pytest.raises(hp.ArgumentError, match="symbolic: expected names out of u1, u2, n, cadence, got 'speed'"):
        hp.derive(found, ("speed",))


@pytest.mark.parametrize("name", ["numpy", "u1_x", "R2_x", "long"])
def test_a_letter_is_called_otherwise_than_what_formulas_name(name, tmp_path):
    text = (MODELS / "reference_2d.toml").read_text().replace("swing", name)
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(hp.ArgumentError, match=f"symbolic: expected .*, got '{name}'"):
        hp.derive(hp.load_scene(tmp_path / "scene.toml"), (name, "u1"))


TURNS = {
    "degrees": ("{ axis = [1, -2, 3], deg = 77 }", lambda: hp.rodrigues((1, -2, 3), np.deg2rad(77))),
    "radians": ("{ axis = [0.3, 0, -1e-7], rad = 2 }", lambda: hp.rodrigues((0.3, 0, -1e-7), 2)),
    "a tiny angle": ("{ axis = [0, 1, 1e-9], rad = 1e-40 }", lambda: hp.rodrigues((0, 1, 1e-9), 1e-40)),
    "rpy": ("{ rpy = [0.1, -2, 3] }", lambda: hp.euler_to_matrix((0.1, -2, 3), "xyz")),
    "rpy in degrees": ("{ rpy_deg = [30, 45, -110] }", lambda: hp.euler_to_matrix(np.deg2rad((30, 45, -110)), "xyz")),
}


@pytest.mark.parametrize(("text", "expected"), TURNS.values(), ids=TURNS)
def test_turns_of_a_file_are_rotations_by_the_same_numbers(text, expected, tmp_path):
    home = scene(tmp_path, home=text).pair.home
    np.testing.assert_allclose(home, expected(), rtol=4 * 2.0**-53, atol=2 * 2.0**-53)
    assert (home - np.eye(3)).any()


def test_constants_stay_letters_in_the_pair_too(tmp_path):
    path = tmp_path / "scene.toml"
    text = (MODELS / "reference_2d.toml").read_text().replace("swing = 0.8", "swing = 0.8\nreach = 0.25")
    path.write_text(re.sub(r"(?m)^u1 = .*", 'u1 = ["2*reach", "sqrt(3)*reach"]', text))
    found, reach = hp.load_scene(path), sympy.Symbol("reach", real=True)
    R2 = hp.derive(found, ("reach",)).R2
    assert R2.free_symbols == {T, reach}
    assert sympy.expand(R2.subs(reach, sympy.Rational(1, 4)) - hp.derive(found).R2) == sympy.zeros(2, 1)
    other = replace(found, subject=Subject(hp.PlanarPair(u1=(1, 2), u2=(3, 4))))
    assert not hp.derive(other, ("reach",)).R2.has(reach)


def test_body_1_rests_where_psi_alone_moves(tmp_path):
    (tmp_path / "s.toml").write_text(
        '[pair]\nu1 = [1, 0, 0]\nu2 = [-1, 0, 0]\nn = [0, 0, 1]\n[motion]\npsi = "mod(3*pi, pi) + t"\n'
        "[time]\nstart = 0\nstop = 1\nsamples = 2\n"
    )
    found = hp.load_scene(tmp_path / "s.toml")
    assert tuple(hp.derive(found).R2) == (sympy.cos(T) + 1, sympy.sin(T), 0)
    assert hp.derive(found).to_text("R2") == "R2_x = cos(t) + 1\nR2_y = sin(t)\nR2_z = 0\n"
    assert found.expressions["x"] == 0


def test_a_fixed_base_gives_the_short_form(tmp_path):
    """Nothing of body 1 but where it stands: one wave of psi."""
    path = tmp_path / "gate.toml"
    path.write_text(
        "[pair]\nu1 = [0, 0, 1]\nu2 = [-0.5, 0, 0]\nn = [0, 1, 0]\nbody2 = { mass = 1, inertia = [1, 1, 1] }\n"
        "[dynamics]\nbase = 'fixed'\nR1_0 = [2, 0, 0]\n[time]\nstop = 1\nsamples = 2\n"
    )
    assert run_command("derive", path, "--outputs", "R2,v2").stdout.splitlines() == [
        "R2_x = cos(psi)/2 + 2",
        "R2_z = 1 - sin(psi)/2",
        "v2_x = -psid*sin(psi)/2",
        "v2_z = -psid*cos(psi)/2",
        "R2_y = v2_y = 0",
    ]
