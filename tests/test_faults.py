"""The suite proves itself: each injected fault must turn the laws red, and the unharmed copy must be green."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hingepair

TESTS = Path(__file__).parent
PACKAGE = Path(hingepair.__file__).parent
LAWS = ["test_laws.py", "test_accuracy.py", "test_shapes.py", "test_rotation_laws.py"]

# What is wrong: (file, text that stands there exactly once, what it becomes).
FAULTS = {
    "a sign in E2": (
        "equations.py",
        "return add(omega1, scale(axis, psid))",
        "return subtract(omega1, scale(axis, psid))",
    ),
    "Sh transposed in E5": (
        "equations.py",
        "return compose(compose(S1, Sh), home)",
        "return compose(compose(S1, transpose(Sh)), home)",
    ),
    "home transposed in E5": (
        "equations.py",
        "return compose(compose(S1, Sh), home)",
        "return compose(compose(S1, Sh), transpose(home))",
    ),
    "omega1 x n psi' dropped in E9": (
        "equations.py",
        "add(scale(axis, psidd), scale(cross(omega1, axis), psid))",
        "scale(axis, psidd)",
    ),
    "u1 and u2 swapped": (
        "plan.py",
        """("S1", "u1")),
    Step("r2", eq.rotate, ("S2", "u2")),""",
        """("S1", "u2")),
    Step("r2", eq.rotate, ("S2", "u1")),""",
    ),
    "psi reduced modulo 2 pi in double": (
        "blocks.py",
        "half = sine(0.5 * psi)",
        "psi = psi % (2 * math.pi)\n    half = sine(0.5 * psi)",
    ),
    "1 - cos psi for the versine": (
        "blocks.py",
        "return sine(psi), 2 * half * half",
        "return sine(psi), 1 - cosine(psi)",
    ),
    "d computed as R2 - R1": (
        "plan.py",
        """Step("r2", eq.rotate, ("S2", "u2")),
    Step("d", eq.subtract, ("r1", "r2")),
    Step("R2", eq.position2, ("R1", "d")),""",
        """Step("r2", eq.rotate, ("S2", "u2")),
    Step("lever", eq.subtract, ("r1", "r2")),
    Step("R2", eq.position2, ("R1", "lever")),
    Step("d", eq.subtract, ("R2", "R1")),""",
    ),
    "spatial for classical acceleration, going to Pinocchio": (
        "pinocchio_twin.py",
        "_to_body(S, a - np.cross(omega, v))",
        "_to_body(S, a)",
    ),
    "spatial for classical acceleration, coming back": (
        "pinocchio.py",
        "pin.getFrameClassicalAcceleration(",
        "pin.getFrameAcceleration(",
    ),
    "centripetal acceleration dropped in E9": (
        "equations.py",
        "add(cross(alpha, r), cross(omega, cross(omega, r)))",
        "cross(alpha, r)",
    ),
    "wxyz for xyzw": (
        "motion.py",
        'quaternion_to_matrix("quat_xyzw", quat_xyzw, scalar_first=False)',
        'quaternion_to_matrix("quat_xyzw", quat_xyzw, scalar_first=True)',
    ),
    "wxyz for xyzw, going to Pinocchio": (
        "pinocchio_twin.py",
        "np.roll(quat_wxyz, -1, axis=-1)",
        "quat_wxyz",
    ),
}


def inject(package, fault):
    """Put a fault into a copy of the package."""
    file, old, new = fault
    path = package / file
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{file}: the text to harm stands there {text.count(old)} times, not once:\n{old}"
    path.write_text(text.replace(old, new), encoding="utf-8")


def run_laws(copy, *options):
    """Exit code and output of the laws, run against a copy of the package; fails if another one was imported."""
    environment = dict(os.environ, PYTHONPATH=str(copy), PYTHONDONTWRITEBYTECODE="1")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-m",
        "law",
        "-k",
        "not numba",
        "-x",
        "-p",
        "no:cacheprovider",
        "--color=no",
        *options,
    ]
    done = subprocess.run(
        [*command, *(str(TESTS / name) for name in LAWS)],
        cwd=TESTS.parent, env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    imported = re.search(r"^hingepair: (.*)$", done.stdout, re.MULTILINE)
    assert imported, done.stdout + done.stderr
    assert Path(imported[1]).is_relative_to(copy), f"{imported[1]} was tested, not the copy in {copy}"
    return done.returncode, done.stdout


@pytest.fixture
def copy(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "hingepair", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


@pytest.mark.slow
def test_without_a_fault_the_laws_hold(copy):
    code, output = run_laws(copy)
    assert code == pytest.ExitCode.OK, output


@pytest.mark.parametrize("name", FAULTS)
def test_fault_still_fits_the_source(name, copy):
    """Fast: a fault whose text has gone is found out by every run of the tests, not only by the slow ones."""
    inject(copy / "hingepair", FAULTS[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_fault_is_found(name, copy, record_property, capsys):
    inject(copy / "hingepair", FAULTS[name])
    code, output = run_laws(copy)
    assert code == pytest.ExitCode.TESTS_FAILED, f"{name}: the laws did not notice\n{output}"
    killer = re.search(r"^FAILED .*?(\w+\.py::\S+)", output, re.MULTILINE)
    assert killer, output
    record_property("killed_by", killer[1])
    with capsys.disabled():
        print(f"\n  {name} -> {killer[1]}")
