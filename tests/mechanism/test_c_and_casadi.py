"""Prepared calls in C and CasADi: compiled sources and callbacks compute what the calls compute."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess

import numpy as np
import pytest

import hingepair as hp
from support.near import U, assert_near
from support.trees import Robot, random_model, record_of

RNG = np.random.default_rng(11)
ROBOT = Robot(record_of(random_model(2, 4)))
PAIR = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 2, 0))
CALLS = {
    "torques": ROBOT.prepare("inverse_dynamics", outputs=("tau",)),
    "accelerations": ROBOT.prepare("forward_dynamics", outputs=("qdd",)),
    "matrix": ROBOT.prepare("mass_matrix"),
    "pair": PAIR.prepare("acceleration"),
    "attitude": PAIR.prepare(("S1", "psi"), outputs=("S2", "S1")),
    "derivatives": ROBOT.prepare("inverse_dynamics_derivatives"),
}


def arguments(call):
    given = {"S1": hp.rotation_exp(RNG.normal(size=3)), "psi": 0.7}
    width = 7 if "R2" in call.outputs else ROBOT.dof
    return [given[name] if name in given else RNG.normal(size=width) for name in call.given]


def results(found):
    return [*found.arrays().values()] if hasattr(found, "arrays") else [found]


def compiled(source, name, folder):
    """The function of this name out of a source, by the machine's C compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.fail("no C compiler: what to_c writes is compiled here")
    (folder / "it.c").write_text(source)
    flags = ["-O2", "-std=c99", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-Wno-unused-parameter"]
    command = [compiler, *flags, "-o", str(folder / "it.so"), str(folder / "it.c"), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    return getattr(ctypes.CDLL(str(folder / "it.so")), name)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CALLS)
def test_c_computes_what_the_call_computes(kind, tmp_path):
    call = CALLS[kind]
    given, double = arguments(call), ctypes.POINTER(ctypes.c_double)
    wanted = results(call(*given))
    source = call.to_c("it")
    for name, array in zip((*call.given, *call.outputs), (*given, *wanted), strict=True):
        assert f" * {name}[{math.prod(np.shape(array))}]" in source
    arrays = [np.ascontiguousarray(one, float) for one in given] + [np.full(np.shape(one), np.nan) for one in wanted]
    compiled(source, "it", tmp_path)(*(one.ctypes.data_as(double) for one in arrays))
    for found, one in zip(arrays[len(given) :], wanted, strict=True):
        np.testing.assert_allclose(found, one, rtol=0, atol=64 * U * np.abs(one).max())


def test_c_refuses_names_and_what_has_no_program():
    for name in ("", "a b", "3d", "x;", 1, "tête", "double", "sin", "_x"):
        with pytest.raises(hp.ArgumentError) as error:
            CALLS["torques"].to_c(name)
        assert error.value.name == "name"
    many = hp.HingePair(u1=np.ones((3, 3)), u2=(0, 0, 0), n=(0, 0, 1)).prepare("pose")
    with pytest.raises(hp.ArgumentError) as error:
        many.to_c("many")
    assert error.value.name == "to_c"


@pytest.mark.parametrize("kind", CALLS)
def test_casadi_computes_calls_and_their_jacobians(kind):
    import casadi

    call = CALLS[kind]
    f, given = call.casadi("it"), arguments(call)
    shown = [np.asarray(one, float) if np.ndim(one) > 1 else np.reshape(one, (-1, 1)) for one in given]
    found = f(*shown)
    for one, wanted in zip(found if len(call.outputs) > 1 else [found], results(call(*given)), strict=True):
        assert_near(np.array(one).reshape(wanted.shape), wanted, 64)
    symbols = [casadi.MX.sym(name, *one.shape) for name, one in zip(call.given, shown, strict=True)]
    last = f(*symbols)[-1] if len(call.outputs) > 1 else f(*symbols)
    J = np.array(casadi.Function("J", symbols, [casadi.jacobian(last, symbols[0])])(*shown))
    h, columns = 2.0**-17, []
    for k in range(shown[0].size):
        step = np.zeros(shown[0].size)
        step[k] = h
        step = step.reshape(shown[0].shape, order="F")
        ends = [f(shown[0] + side * step, *shown[1:]) for side in (1, -1)]
        high, low = (np.array(one[-1] if len(call.outputs) > 1 else one).ravel(order="F") for one in ends)
        columns.append((high - low) / (2 * h))
    np.testing.assert_allclose(J, np.transpose(columns), rtol=0, atol=h * h * (1 + abs(J).max()))
