"""`hingepair bench direct`: run time against error at every size, beside what a user would pick instead."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hingepair.bench import peers
from hingepair.bench.engines import CPP, cpp_missing
from hingepair.bench.measure import (
    Report,
    Row,
    Way,
    compared,
    interleaved,
    present,
    rows_of,
    tell,
)
from hingepair.bench.peers import CONSTANTS, FLOOR, FRESH_FLOOR, LEVELS, OURS, task_of
from hingepair.bench.plot import Curve, Panel
from hingepair.bench.truth import DIGITS, Truth, hard_states, random_states
from hingepair.pair.hinge_pair import HingePair

HARD = "on hard states"
CYCLE = "one state: FK, Jacobian, bias from a quaternion"
MADE = "a pair made"
STARTS = "a fresh process"
OFFSETS = "outputs that begin behind a cache line"
SHIFTS = {f"{shift} bytes behind a line": shift for shift in (0, 8, 16, 32)}
"""Bytes from a cache line to the beginning of each output, by the name of the row; NumPy's large arrays have 16."""

_LINE = 64  # bytes of a cache line
_COMPARED = 40  # random states, compared with the exact ones
_NOTE = (
    "a call, each: medians, kernels compiled before; ratio: of a sample's time, against the first way of a case; "
    f"errors: largest of any output against {DIGITS} digits [u * scale], on random and on hard states; "
    "inf: refuses one, or has no finite result where there is one"
)


def direct(sizes: Sequence[int], levels: Sequence[str], repeats: int, cpp: bool, cold: bool) -> Report:
    """Measure all ways at all sizes beside the copy floor, outputs at several offsets, and single states.

    With `cold`, the first seconds of a process too.
    """
    if cpp:
        tell("compiling Pinocchio's C++ loop (up to a minute)")
    ways, left_out = present(peers.WAYS, {CPP: cpp_missing(cpp)})
    rows = batches(ways, sizes, levels, repeats) + offsets(max(sizes), levels, repeats) + singles(repeats)
    rows += starts(repeats) if cold else []
    return Report(rows, "error", [*left_out, _NOTE], [panels(rows)])


def batches(ways: Sequence[Way], sizes: Sequence[int], levels: Sequence[str], repeats: int) -> list[Row]:
    """All ways at all sizes, interleaved; a way with a limit is given fewer samples."""
    rng = np.random.default_rng(20)
    pair = HingePair(**CONSTANTS)
    rows: list[Row] = []
    for level in levels:
        parts, outputs = list(LEVELS).index(level) + 1, LEVELS[level]
        random, hard = (
            errors(pair, ways, Truth(CONSTANTS, states, outputs))
            for states in (random_states(rng, _COMPARED, parts), hard_states(rng, parts))
        )
        more = {name: {HARD: value} for name, value in hard.items()}
        found = {}
        for size in sorted(sizes, reverse=True):  # the largest first: what is measured of small ones is warm
            tell(f"{level}, N = {size:,}: {repeats} repeats")
            task = task_of(pair, random_states(rng, size, parts), outputs)
            found[size] = compared(case_of(level, size), ways, task.first, size, repeats, random, more)
        rows += [row for size in sizes for row in found[size]]
    return rows


def offsets(size: int, levels: Sequence[str], repeats: int) -> list[Row]:
    """Measure batches into outputs that begin at several offsets from a cache line, beside the copy floor."""
    rng, pair, rows = np.random.default_rng(22), HingePair(**CONSTANTS), []
    into = peers.ours(backend="compiled", workers=1)
    for level in levels if size > 1 else ():  # the outputs of one state are new arrays
        tell(f"{level}, N = {size:,}, outputs at {len(SHIFTS)} offsets: {repeats} repeats")
        task = task_of(pair, random_states(rng, size, list(LEVELS).index(level) + 1), LEVELS[level])
        jobs = {FLOOR: peers.copies(task)}
        for name, shift in SHIFTS.items():
            room = {output: array_at(array.shape, shift) for output, array in task.room.items()}
            jobs[name] = into(task._replace(room=room))
        rows += rows_of(case_of(f"{OFFSETS}: {level}", size), interleaved(jobs, repeats), size)
    return rows


def array_at(shape: tuple[int, ...], shift: int) -> NDArray[np.float64]:
    """Return an array, every page of it touched, that begins so many bytes behind a cache line: a multiple of 8."""
    count = math.prod(shape)
    memory = np.ones(count + 2 * _LINE // 8)
    start = (-memory.ctypes.data % _LINE + shift) // 8
    return memory[start : start + count].reshape(shape)


def case_of(what: str, size: int) -> str:
    """The name of a case."""
    return f"{what}, N = {size:,}"


def errors(pair: HingePair, ways: Iterable[Way], truth: Truth) -> dict[str, float]:
    """Each way's largest error, in units of u * scale; infinite where it refuses a state."""
    found = {}
    for way in ways:
        task = task_of(pair, truth.motion, truth.outputs)
        try:
            with np.errstate(all="ignore"):
                results = way.make(task)()
        except ValueError:
            results = {name: np.full_like(array, np.nan) for name, array in task.room.items()}
        if way.name not in {FLOOR, FRESH_FLOOR}:
            named = results if isinstance(results, dict) else dict(zip(truth.outputs, results, strict=True))
            found[way.name] = truth.error(named)
    return found


def panels(rows: Sequence[Row]) -> list[Panel]:
    """The picture: error against run time at the largest size of each level, ordinary states and hard ones.

    The smallest times of the repeats: beside other work, medians of neighbouring points trade places.
    """
    drawn = {way.name for way in peers.WAYS if way.drawn}
    found: list[Panel] = []
    for level in LEVELS:
        cases = [row.case for row in rows if row.case.startswith(f"{level},")]
        times = {row.method: (row.least / row.count * 1e9, row) for row in rows if cases and row.case == cases[-1]}
        curves = [
            Curve(name, [(ns, row.error), (ns, row.more[HARD])], hard=True)
            for name, (ns, row) in times.items()
            if name in drawn and row.error is not None
        ]
        if curves:
            up, floor = "" if found else "largest error [u * scale]", times.get(FLOOR)
            found.append(Panel(cases[-1], "run time [ns a sample]", up, curves, floor and floor[0], most=10.0))
    return found


def singles(repeats: int) -> list[Row]:
    """What one state costs beside forward kinematics: a pair made, and a control cycle from a quaternion."""
    tell(f"one state: a pair made, a control cycle; {repeats} repeats")
    pair = HingePair(**CONSTANTS)
    rng = np.random.default_rng(21)
    R, quat, v, omega = (rng.normal(size=k) for k in (3, 4, 3, 3))
    given = R, quat / np.sqrt(quat @ quat), v, omega, 0.3, -0.7
    plain = {key: value for key, value in CONSTANTS.items() if key != "home"}
    jobs = {"Pinocchio": peers.pinocchio_cycle(pair, *given), OURS: peers.our_cycle(pair, *given)}
    made = interleaved({OURS: lambda: HingePair(**plain)}, repeats)
    return rows_of(CYCLE, interleaved(jobs, repeats)) + rows_of(MADE, made)


_TIMED = """
import atexit, sys, time
{before}
atexit.register(lambda start: print(time.perf_counter() - start, file=sys.stderr), time.perf_counter())
{timed}
"""
_PAIR = """
import numpy as np
import hingepair as hp
pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
rng = np.random.default_rng(0)
calls = [(rng.normal(size=(n, 7) if n > 1 else 7), rng.normal(size=(n, 7) if n > 1 else 7)) for n in {sizes}]
"""
_CALLS = "for q, qd in calls: pair.forward_kinematics(q, qd, backend={backend!r})"
_SCENE = """
pair = {u1 = [0.5, 0.2, 0.1], u2 = [-0.25, 0.1, 0.3], n = [1, 0, 0]}
motion = {x = "3*t", y = "3*t", z = "3*t", phi_x = "3*t", phi_y = "t", phi_z = "5*t", psi = "10*t"}
time = {start = 0, stop = 10, samples = 10001}
"""
_RUN = "from hingepair.cli.main import main; main()"
IMPORT, RUN = f"{STARTS}: import", f"{STARTS}: hingepair run, reference scene"
FIRST_CALL = "1 x 200,000"
SEQUENCES = {
    FIRST_CALL: "[200_000]",
    "1,000 x 1": "[1] * 1000",
    "2,000 x 20": "[20] * 2000",
    "300 x 1,000": "[1000] * 300",
    "20 x 10,000": "[10_000] * 20",
    "3 x 1,000,000": "[1_000_000] * 3",
    "1 x 100,000 among 200 x 1": "[1] * 100 + [100_000] + [1] * 100",
}
BACKENDS = ("auto", "numpy", "compiled")


def starts(repeats: int) -> list[Row]:
    """The first seconds of a process: imports, a scene, sequences of calls by each backend; each in a fresh one."""
    tell(f"fresh processes: imports and {len(SEQUENCES)} sequences of calls, {repeats} repeats")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(_SCENE, encoding="utf-8")
        run = _TIMED.format(before=f"sys.argv = ['hingepair', 'run', {str(scene)!r}]", timed=_RUN)
        codes = {
            IMPORT: {name: _TIMED.format(before="", timed=f"import {name}") for name in ("numpy", "hingepair")},
            RUN: {OURS: run},
        }
        for name, sizes in SEQUENCES.items():
            calls = {backend: _CALLS.format(backend=backend) for backend in BACKENDS}
            before = _PAIR.format(sizes=sizes)
            codes[f"{STARTS}: {name}"] = {b: _TIMED.format(before=before, timed=call) for b, call in calls.items()}
        own = os.environ | {"PYTHONPYCACHEPREFIX": folder, "PYTHONDONTWRITEBYTECODE": ""}
        for code in (run, *codes[f"{STARTS}: {FIRST_CALL}"].values()):  # modules are compiled to bytecode
            _seconds_in(code, own)
        rows = []
        for case, ways in codes.items():
            times = [{name: _seconds_in(code, own) for name, code in ways.items()} for _ in range(repeats)]
            rows += rows_of(case, {name: [one[name] for one in times] for name in ways})
    return rows


def _seconds_in(code: str, environment: dict[str, str]) -> float:
    """The seconds that a fresh process says last."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    return float(done.stderr.split()[-1])
