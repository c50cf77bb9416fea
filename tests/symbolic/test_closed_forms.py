"""Closed forms: what derive gives is what papers have; test_written_forms.py compares all with the numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import sympy

import hingepair as hp
from support.commands import run_command
from support.near import U
from support.scenes import scene_of, time, toml

MODELS = Path(__file__).parents[2] / "models"
T = sympy.Symbol("t", real=True)


def test_omega1_of_the_reference_example_is_its_source_s():
    reference = hp.derive(hp.load_scene(MODELS / "reference_3d.toml"))
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


def test_constants_of_a_scene_stay_letters():
    found = hp.load_scene(MODELS / "talos_elbow.toml")
    cadence = sympy.Symbol("cadence", real=True)
    forms = hp.derive(found, ("cadence",))
    assert cadence in forms.v1.free_symbols
    assert forms.v1.subs(cadence, sympy.Rational(9, 10)) == hp.derive(found).v1


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
    scene = (MODELS / "reference_3d.toml").read_text().replace("[pair]", f"[pair]\nhome = {text}")
    home = scene_of(tmp_path, scene).pair.home
    np.testing.assert_allclose(home, expected(), rtol=4 * U, atol=2 * U)
    assert (home - np.eye(3)).any()


def test_constants_stay_letters_in_the_pair_too(tmp_path):
    path = tmp_path / "scene.toml"
    text = (MODELS / "reference_2d.toml").read_text().replace("swing = 0.8", "swing = 0.8\nreach = 0.25")
    path.write_text(re.sub(r"(?m)^u1 = .*", 'u1 = ["2*reach", "sqrt(3)*reach"]', text))
    found, reach = hp.load_scene(path), sympy.Symbol("reach", real=True)
    R2 = hp.derive(found, ("reach",)).R2
    assert R2.free_symbols == {T, reach}
    assert sympy.expand(R2.subs(reach, sympy.Rational(1, 4)) - hp.derive(found).R2) == sympy.zeros(2, 1)


def test_body_1_rests_where_psi_alone_moves(tmp_path):
    pair = toml("pair", u1=[1, 0, 0], u2=[-1, 0, 0], n=[0, 0, 1])
    found = scene_of(tmp_path, pair + toml("motion", psi="mod(3*pi, pi) + t") + time(0, 1, 2))
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
