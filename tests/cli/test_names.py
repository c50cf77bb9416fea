"""Names that users choose: whatever is legal, nothing collides with names of ours, and every file is read back."""

from __future__ import annotations

import csv
import inspect
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import hingepair as hp
from hingepair.symbolic.expressions import constant_name_fault
from hingepair.symbolic.writing import latex_name
from support.commands import run_command
from support.near import assert_near

few = settings(
    max_examples=12,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.filter_too_much],
)

LETTERS = (
    "numpy numpy_ float parts __debug__ w0 np R2 R2_x u1_x u2_x u1 u_1 c_1 s_1 c_2 k_1 y yd y_ psid max sum print "
    "E I S _ l beta"
)
CONSTANT_NAMES = st.one_of(
    st.sampled_from(LETTERS.split()), st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,3}", fullmatch=True)
).filter(lambda name: constant_name_fault(name) is None)

PLANAR = """
planar = true
[pair]
u1 = ["{a}/2", 0.1]
u2 = [-0.25, 0.1]
[motion]
x = "{a}*t"
y = {{ t = [0, 1, 2], value = [0, 1, 0.5] }}
phi = "{b}*t**2 + sqrt(1 + t) + sqrt(1 + t)**3"
psi = "{c}*sin(3*t) + {a}"
[constants]
{a} = 0.5
{b} = 0.25
{c} = 1.5
[time]
start = 0
stop = 2
samples = 5
"""
WRITTEN = ("R2", "v2", "phi2", "alpha2")


def owners(called: set[str], names: list[str]) -> dict[str, str]:
    """Return the constant behind each name in a form: that of the name, or one that got underscores."""
    found = {name: name for name in called if name in names}
    for name in sorted(called - {*found}):
        others = (other for other in names if other not in found.values() and name.startswith(other))
        found[name] = next(other for other in others if {*name.removeprefix(other)} == {"_"})
    return found


@pytest.mark.slow(4)
@few
@given(names=st.lists(CONSTANT_NAMES, min_size=3, max_size=3, unique=True))
@example(names=["numpy", "numpy_", "parts"])
@example(names=["c_1", "k_1", "s_1"])
@example(names=["u2_x", "y", "yd"])
@example(names=["u_1", "u1", "R2_x"])
@example(names=["numpy", "N", "gamma"])
def test_formulas_hold_whatever_the_constants_are_called(names, tmp_path):
    (tmp_path / "a.toml").write_text(PLANAR.format(**dict(zip("abc", names, strict=True))))
    scene = hp.load_scene(tmp_path / "a.toml")
    form, expected = hp.derive(scene, (*names, "u2")), scene.evaluate(("q", "qd", "qdd", *WRITTEN))
    ours = {"t": expected.t, "y": expected.q[:, 1], "yd": expected.qd[:, 1], "ydd": expected.qdd[:, 1]}
    ours |= {"u2_x": -0.25, "u2_y": 0.1} | ({"u1_x": 0.25, "u1_y": 0.1} if "u1" in names else {})
    constants = dict(zip(names, (0.5, 0.25, 1.5), strict=True))
    module: dict[str, Any] = {}
    exec(form.to_python(WRITTEN), module)
    for output in WRITTEN:
        arguments = {*inspect.signature(module[output]).parameters}
        values = {called: constants[name] for called, name in owners(arguments - {*ours}, names).items()}
        found = module[output](**values, **{name: ours[name] for name in arguments & {*ours}})
        assert_near(found, getattr(expected, output), 32)

    symbols = {symbol.name for output in WRITTEN for symbol in sympy.sympify(getattr(form, output)).free_symbols}
    used = owners(symbols - {*ours}, names)
    assert {*used.values()} == {*names}
    text = form.to_text(WRITTEN, short=True, width=10**6)
    defined = re.findall(r"(?:^|; )(\w+) = ", text.replace("\N{GREEK SMALL LETTER ALPHA}", "alpha"), re.MULTILINE)
    called = [*defined, *used, *ours]
    assert len({*called}) == len({*map(latex_name, called)}) == len(called)
    for component in form.to_sympy(WRITTEN).values():
        assert {symbol.name for symbol in sympy.sympify(component).free_symbols} <= symbols


JOINT_NAMES = st.one_of(
    st.sampled_from(
        [
            *"aSRvdqt",
            *["omega", "tau", "qd", "time", "xyz", "force1", "R_tip", "nan", "allow_pickle", "description"],
        ]
    ),
    st.sampled_from(["shoulder, left", "a;b", "#a", 'say "hi"', "it's", "a/b", "c\\d", "$x^", "</script>", "%s {x}"]),
    st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=4),
)
ARM = """
[[joint]]
name = {a}
u1 = [0, 0, 1]
u2 = [0, 0, 0]
n = [0, 1, 0]
body2 = {{ mass = 3, inertia = [1, 1, 1], centre_of_mass = [1, 0, 0] }}
[[joint]]
name = {b}
u1 = [1, 0, 0]
u2 = [0, 0, 0]
n = [0, 1, 0]
parent = {a}
body2 = {{ mass = 3, inertia = [1, 1, 1], centre_of_mass = [1, 0, 0] }}
"""
MOVED = """
[motion]
{a} = "t**2"
{b} = "1 + t"
[time]
start = 0
stop = 1
samples = 5
"""


@pytest.mark.proof
@few
@given(names=st.lists(JOINT_NAMES, min_size=2, max_size=2, unique=True))
@example(names=["shoulder, left", "a;b"])
@example(names=["a", "S"])
@example(names=["R", "omega"])
@example(names=["q", "time"])
@example(names=["allow_pickle", "xyz"])
@example(names=["R_tip", "tip"])
def test_a_motion_is_written_and_read_whatever_the_joints_are_called(names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for file in tmp_path.iterdir():
        file.unlink()
    a, b = names
    quoted = {"a": json.dumps(a, ensure_ascii=False), "b": json.dumps(b, ensure_ascii=False)}
    Path("a.toml").write_text((ARM + MOVED).format(**quoted), encoding="utf-8")
    try:
        scene = hp.load_scene("a.toml")
    except hp.SceneError as error:
        if "joints of other names" in str(error):
            return
        raise
    t, moved = scene.t, {a: scene.t**2, b: 1 + scene.t}
    for ending in (".csv", ".npz", ".nc", ".parquet"):
        run_command("run", "a.toml", "--out", f"all{ending}")
        run_command("run", "a.toml", "--outputs", "q,qd,qdd", "--out", f"log{ending}")
    with open("all.csv", encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    assert len({*heading}) == len(heading) == len(rows[0])
    for name, values in moved.items():
        np.testing.assert_array_equal([float(row[heading.index(name)]) for row in rows], values)
    with np.load("all.npz") as arrays:
        np.testing.assert_array_equal(arrays[a], moved[a])
    for ending in (".csv", ".npz", ".parquet"):
        Path("log.toml").write_text(ARM.format(**quoted) + f"[motion]\nfile = 'log{ending}'\n", encoding="utf-8")
        found = hp.load_scene("log.toml").evaluate(("q", "qd"))
        np.testing.assert_array_equal(found.t, t)
        np.testing.assert_array_equal(
            found.q, np.stack([moved[name] for name in hp.load_scene("a.toml").mechanism.names], axis=1)
        )
    run_command("forces", "a.toml", "--out", "forces.csv")
    printed = json.loads(run_command("run", "a.toml", "--outputs", cell(f"R_{b}"), "--json").stdout)
    assert [*printed["outputs"]] == [f"R_{b}_{axis}" for axis in "xyz"]


def cell(name: str) -> str:
    """Return a name as one cell of a line of a .csv file, as --outputs takes it."""
    return '"{}"'.format(name.replace('"', '""'))
