"""The suite proves itself: each injected fault must turn the laws red, and the unharmed copy must be green."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import hingepair

TESTS = Path(__file__).parent
PACKAGE = Path(hingepair.__file__).parent
# What is wrong: (file, text that stands there exactly once, what it becomes).
FAULTS = {
    # equations
    "a sign in E2": (
        "equations/spatial.py",
        "return add(omega1, scale(axis, psid))",
        "return subtract(omega1, scale(axis, psid))",
    ),
    "Sh transposed in E5": (
        "equations/spatial.py",
        "return compose(compose(S1, Sh), home)",
        "return compose(compose(S1, transpose(Sh)), home)",
    ),
    "home transposed in E5": (
        "equations/spatial.py",
        "return compose(compose(S1, Sh), home)",
        "return compose(compose(S1, Sh), transpose(home))",
    ),
    "omega1 x n psi' dropped in E9": (
        "equations/spatial.py",
        "add(scale(axis, psidd), scale(cross(omega1, axis), psid))",
        "scale(axis, psidd)",
    ),
    "centripetal acceleration dropped in E9": (
        "equations/spatial.py",
        "return subtract(scale(pull, psid * psid), scale(slide, psidd))",
        "return scale(slide, 0 - psidd)",
    ),
    "Coriolis acceleration halved in E9": ("equations/spatial.py", "scale(slide, 2 * psid)", "scale(slide, psid)"),
    "a sign in Sx Sy Sz": ("equations/spatial.py", "cx * sz + ss * cz", "cx * sz - ss * cz"),
    "a sign in Sx Sy Sx": ("equations/spatial.py", "cc * cz - sx * sz", "cc * cz + sx * sz"),
    "a sign in J' phi'": (
        "equations/spatial.py",
        "rates[2] + (turn[2] + phid[0] * y)",
        "rates[2] + (turn[2] - phid[0] * y)",
    ),
    "u1 and u2 swapped": (
        "pair/constants.py",
        '"u1": numbers[:3], "u2": numbers[3:]',
        '"u1": numbers[3:], "u2": numbers[:3]',
    ),
    "the hinge turns the lever backwards": ("evaluation/steps.py", '("n", "arm")', '("arm", "n")'),
    "d computed as R2 - R1": (
        "evaluation/steps.py",
        """Step("d", eq.offset, ("S1", "along", "swing")),
    Step("R2", eq.position2, ("R1", "d")),
    Step("axis",""",
        """Step("lever", eq.offset, ("S1", "along", "swing")),
    Step("R2", eq.position2, ("R1", "lever")),
    Step("d", eq.subtract, ("R2", "R1")),
    Step("axis",""",
    ),
    # numbers
    "psi reduced modulo 2 pi in double": (
        "numeric/blocks.py",
        "s, c = sine(psi), cosine(psi)",
        "psi = psi % (2 * math.pi)\n    s, c = sine(psi), cosine(psi)",
    ),
    "1 - cos psi for the versine": ("numeric/blocks.py", "np.where(c > 0, s * s / (1 + c), 1 - c)", "1 - c"),
    "lengths without scaling": (
        "numeric/unit_vectors.py",
        "return tuple(np.ldexp(np.ldexp(component, half), -exponent - half) for component in v), exponent",
        "return v, 0 * exponent + 0 * half",
    ),
    "levers in plain doubles": (
        "numeric/twofold.py",
        "error + (self.high * other.low + self.low * other.high)",
        "0.0 * error",
    ),
    # conventions
    "wxyz for xyzw": (
        "pair/body_motion.py",
        'quaternion_to_matrix("quat_xyzw", quat_xyzw, scalar_first=False)',
        'quaternion_to_matrix("quat_xyzw", quat_xyzw, scalar_first=True)',
    ),
    "extrinsic taken for intrinsic": (
        "rotations/sequences.py",
        "name.upper()[::-1] if name.islower() else name",
        "name.upper()",
    ),
    "left-handed sequences taken for right-handed": (
        "rotations/sequences.py",
        "sign = 1 if (axes[1] - axes[0]) % 3 == 1 else -1",
        "sign = 1",
    ),
    "a sign in J^-1": (
        "equations/spatial.py",
        "return axes[0] * omega[2] - axes[1] * omega[1]",
        "return axes[0] * omega[2] + axes[1] * omega[1]",
    ),
    "the commutator of magnus4 the other way round": (
        "integration/methods.py",
        "scale(cross(w1, w2), h * h",
        "scale(cross(w2, w1), h * h",
    ),
    "a sign in an inner commutator of magnus6": ("integration/methods.py", "-1 / 60)", "1 / 60)"),
    "the outer commutator of magnus6 dropped": (
        "integration/methods.py",
        "scale(outer, 1 / 240)",
        "scale(outer, 0.0)",
    ),
    "the two exponentials exchanged": (
        "integration/methods.py",
        "quaternion_product(quaternion_exp(second), quaternion_exp(first))",
        "quaternion_product(quaternion_exp(first), quaternion_exp(second))",
    ),
    "products in the order of time backwards": (
        "integration/stepping.py",
        '{"own": combine(v["own"], v["before"])}',
        '{"own": combine(v["before"], v["own"])}',
    ),
    "the first angle of a proper sequence half a turn off": (
        "rotations/euler.py",
        "(order.sign * S[3], -order.sign * S[6])",
        "(S[3], -S[6])",
    ),
    "lock read off the wrong element": (
        "rotations/euler.py",
        "(canonical[3], canonical[6])",
        "(canonical[3], canonical[7])",
    ),
    "psi turns body 2 of a planar pair backwards": ("equations/planar.py", "s + (c * sine - s", "s - (c * sine - s"),
    # rotations
    "rotation_log by the arc cosine of the trace": (
        "rotations/matrices.py",
        "2 * np.arctan2(length, quat[..., 0]) / length",
        "np.arccos(np.clip((np.trace(matrix, axis1=-2, axis2=-1) - 1) / 2, -1, 1)) / length",
    ),
    "no pivot in the quaternion of a matrix": (
        "rotations/matrices.py",
        "pivot = np.argmax(",
        "pivot = 0 * np.argmax(",
    ),
    "long rotation vectors cut to a double": (
        "rotations/matrices.py",
        "(s + (c * more - s * lack), k + (s * more + c * lack))",
        "(s, k)",
    ),
    "the nearest rotation as the SVD rounds it": (
        "rotations/matrices.py",
        "S = _nearer(S, work /",
        "_nearer(S, work /",
    ),
    "a reflection accepted": ("rotations/matrices.py", 'tolerance) | (out["volume"] < 0)', "tolerance)"),
    "matrices not checked": ("rotations/matrices.py", "2 * TOLERANCE[dtype.itemsize]\n    bad", "9.0\n    bad"),
    # frames
    "spatial for classical acceleration, going to Pinocchio": (
        "validation/pinocchio_twin.py",
        "_to_body(S, a - np.cross(omega, v))",
        "_to_body(S, a)",
    ),
    "spatial for classical acceleration, coming back": (
        "validation/cross_validate.py",
        "pin.getFrameClassicalAcceleration(",
        "pin.getFrameAcceleration(",
    ),
    "wxyz for xyzw, going to Pinocchio": (
        "validation/pinocchio_twin.py",
        "np.roll(quat_wxyz, -1, axis=-1)",
        "quat_wxyz",
    ),
    "free-flyer velocity in world axes": (
        "validation/pinocchio_twin.py",
        "_joined(_to_body(S, v), _to",
        "_joined(v, _to",
    ),
    "u2 not turned by home in Pinocchio's frame": (
        "validation/pinocchio_twin.py",
        "-(home @ pair.u2)",
        "-np.array(pair.u2)",
    ),
}

# Faults of what is compiled alone: killed by the compiled laws, from a kernel cache of their own.
KERNEL_FAULTS = {
    "cosine's sign by sine's quadrant": ("evaluation/kernel_math.py", "((quadrant + 1) & 2)", "(quadrant & 2)"),
    "pi/2 in one part": ("evaluation/kernel_math.py", "6.123233995736766e-17", "0.0"),
    "1 - cos psi for the versine, compiled": (
        "evaluation/kernel_math.py",
        "drop if (quadrant & 3) == 0 else 1.0 - cos",
        "1.0 - cos",
    ),
    "far angles not repaired": ("evaluation/kernel_math.py", "far |= not abs(x) <= _REACH", "far |= abs(x) > 1e307"),
    "everything may be reordered": ("evaluation/kernel_math.py", 'FLAGS = {"contract", "nsz"}', "FLAGS = True"),
    "psi'' for psi' in a step": (
        "evaluation/kernel_steps.py",
        "eq.velocity2(v1, omega1, d, slide, s[_PSID + k])",
        "eq.velocity2(v1, omega1, d, slide, s[_PSIDD + k])",
    ),
    "components of a vector stored in another order": (
        "evaluation/kernel_memory.py",
        "width * (j % rows)",
        "width * ((j + 1) % rows)",
    ),
    "renamed axes without their sign": ("evaluation/kernel_steps.py", "= sign * s[_SPARE", "= s[_SPARE"),
    "extrinsic angles in the order of the letters": (
        "evaluation/kernel_rows.py",
        "rows[::-1] if backward else rows",
        "rows",
    ),
}

LAWS = (
    *(
        "pair/test_laws.py",
        "pair/test_accuracy.py",
        "evaluation/test_shapes.py",
        "rotations/test_rotation_laws.py",
        "rotations/test_rotation_bounds.py",
    ),
    *("pair/test_border.py", "pair/test_levers.py", "integration/test_integrate.py"),
)
COMPILED_LAWS = ("evaluation/test_compiled.py", "pair/test_accuracy.py")


def inject(package, fault):
    """Put a fault into a copy of the package."""
    file, old, new = fault
    path = package / file
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{file}: the text to harm stands there {text.count(old)} times, not once:\n{old}"
    path.write_text(text.replace(old, new), encoding="utf-8")


def run_laws(copy, files, which):
    """Exit code and output of the laws, run against a copy of the package; fails if another one was imported."""
    environment = dict(
        os.environ, PYTHONPATH=str(copy), PYTHONDONTWRITEBYTECODE="1", NUMBA_CACHE_DIR=str(copy / "cache")
    )
    options = ["-m", "law", "-k", which, "-x", "-p", "no:cacheprovider", "--color=no"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *(str(TESTS / name) for name in files)],
        cwd=TESTS.parent, env=environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    imported = re.search(r"^hingepair: (.*)$", done.stdout, re.MULTILINE)
    assert imported, done.stdout + done.stderr
    assert Path(imported[1]).is_relative_to(copy), f"{imported[1]} was tested, not the copy in {copy}"
    return done.returncode, done.stdout


def numpy_laws(copy):
    return run_laws(copy, LAWS, "not numba")


def compiled_laws(copy):
    return run_laws(copy, COMPILED_LAWS, "numba or test_compiled")


def copied(folder):
    shutil.copytree(PACKAGE, folder / "hingepair", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture
def copy(tmp_path):
    return copied(tmp_path)


def laws_against(name, folder):
    """What the laws say of a copy of the package with a fault."""
    inject(copied(folder) / "hingepair", (FAULTS | KERNEL_FAULTS)[name])
    return compiled_laws(folder) if name in KERNEL_FAULTS else numpy_laws(folder)


@pytest.fixture(scope="session")
def verdicts(request, tmp_path_factory):
    """By fault, what the laws say: futures, of which as many run at once as there are cores."""
    asked = [item.callspec.params["name"] for item in request.session.items if item.name.startswith("test_fault_is")]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        folders = {name: tmp_path_factory.mktemp("fault") for name in asked}
        yield {name: pool.submit(laws_against, name, folder) for name, folder in folders.items()}
        pool.shutdown(cancel_futures=True)


@pytest.mark.slow
@pytest.mark.parametrize("laws", [numpy_laws, compiled_laws])
def test_without_a_fault_the_laws_hold(laws, copy):
    code, output = laws(copy)
    assert code == pytest.ExitCode.OK, output


def test_there_are_faults_of_every_kind():
    assert len(FAULTS) + len(KERNEL_FAULTS) >= 40
    assert not FAULTS.keys() & KERNEL_FAULTS.keys()


@pytest.mark.parametrize("name", FAULTS | KERNEL_FAULTS)
def test_fault_still_fits_the_source(name, copy):
    """Fast: a fault whose text has gone is found out by every run of the tests, not only by the slow ones."""
    inject(copy / "hingepair", (FAULTS | KERNEL_FAULTS)[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS | KERNEL_FAULTS)
def test_fault_is_found(name, verdicts, record_property, capsys):
    code, output = verdicts[name].result()
    assert code == pytest.ExitCode.TESTS_FAILED, f"{name}: the laws did not notice\n{output}"
    killer = re.search(r"^FAILED .*?(\w+\.py::\S+)", output, re.MULTILINE)
    assert killer, output
    record_property("killed_by", killer[1])
    with capsys.disabled():
        print(f"\n  {name} -> {killer[1]}")
