"""`hingepair bench direct`: run time against error at every size, beside what a user would pick instead."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from hingepair.bench import peers
from hingepair.bench.measure import Job, Report, Row, Target, Tell, measured, rows_of
from hingepair.bench.peers import CONSTANTS, LEVELS, Way, room_for
from hingepair.bench.plot import Curve, Panel
from hingepair.bench.truth import DIGITS, Motion, Truth, hard_states, random_states
from hingepair.pair.hinge_pair import HingePair

HARD = "on hard states"
CYCLE = "one state: FK, Jacobian, bias from a quaternion"
MADE = "a pair made"
STARTS = "a fresh process"

_COMPARED = 40  # random states, compared with the exact ones
_NOTE = (
    "a call, each: medians, kernels compiled before; ratio: of a sample's time, against the first way of a case; "
    f"errors: largest of any output against {DIGITS} digits [u * scale], on random and on hard states; "
    "inf: refuses one, or has no finite result where there is one"
)


def direct(sizes: Sequence[int], levels: Sequence[str], repeats: int, cpp: bool, cold: bool, tell: Tell) -> Report:
    """All ways at all sizes beside the copy floor; single states; with `cold`, the first seconds of a process."""
    if cpp:
        tell("compiling Pinocchio's C++ loop (up to a minute)")
    ways, left_out = peers.ways(cpp)
    rows = batches(ways, sizes, levels, repeats, tell) + singles(repeats, tell)
    rows += starts(repeats, tell) if cold else []
    notes = [*(f"left out: {line}" for line in left_out), _NOTE]
    return Report(rows, "error", targets(rows), notes, [panels(rows)])


def batches(ways: Sequence[Way], sizes: Sequence[int], levels: Sequence[str], repeats: int, tell: Tell) -> list[Row]:
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
        found = {}
        for size in sorted(sizes, reverse=True):  # the largest first: what is measured of small ones is warm
            motion, room = random_states(rng, size, parts), room_for(outputs, size)
            counts = {way.name: min(size, way.most) for way in ways if size >= way.least}
            jobs = {way.name: _job(way, pair, motion, room, counts[way.name]) for way in ways if way.name in counts}
            tell(f"{level}, N = {size:,}: {len(jobs)} ways, {repeats} repeats")
            more = {name: {HARD: value} for name, value in hard.items()}
            found[size] = measured(case_of(level, size), jobs, repeats, counts, random, more)
        rows += [row for size in sizes for row in found[size]]
    return rows


def case_of(level: str, size: int) -> str:
    """The name of a case."""
    return f"{level}, N = {size:,}"


def _job(way: Way, pair: HingePair, motion: Motion, room: peers.Room, count: int) -> Job:
    return way.make(pair, tuple(c[:count] for c in motion), {name: array[:count] for name, array in room.items()})


def errors(pair: HingePair, ways: Iterable[Way], truth: Truth) -> dict[str, float]:
    """Each way's largest error, in units of u * scale; infinite where it refuses a state."""
    found = {}
    for way in ways:
        room = {name: np.full_like(a, np.nan) for name, a in room_for(truth.outputs, len(truth.exact)).items()}
        try:
            with np.errstate(all="ignore"):
                results = way.make(pair, truth.motion, room)()
        except ValueError:
            results = room
        if way.name not in {peers.FLOOR, peers.FRESH_FLOOR}:
            found[way.name] = truth.error(results)
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
            up, floor = "" if found else "largest error [u * scale]", times.get(peers.FLOOR)
            found.append(Panel(cases[-1], "run time [ns a sample]", up, curves, floor and floor[0], most=10.0))
    return found


def singles(repeats: int, tell: Tell) -> list[Row]:
    """What one state costs beside forward kinematics: a pair made, and a control cycle from a quaternion."""
    tell(f"one state: a pair made, a control cycle; {repeats} repeats")
    pair = HingePair(**CONSTANTS)
    rng = np.random.default_rng(21)
    R, quat, v, omega = (rng.normal(size=k) for k in (3, 4, 3, 3))
    given = R, quat / np.sqrt(quat @ quat), v, omega, 0.3, -0.7
    plain = {key: value for key, value in CONSTANTS.items() if key != "home"}
    jobs = {"Pinocchio": peers.pinocchio_cycle(pair, *given), peers.OURS: peers.our_cycle(pair, *given)}
    return [
        *measured(CYCLE, jobs, repeats),
        *measured(MADE, {peers.OURS: lambda: HingePair(**plain)}, repeats),
    ]


_FIRST = """
import time
import numpy as np
import hingepair as hp
pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
rng = np.random.default_rng(0)
calls = [(rng.normal(size=(n, 7) if n > 1 else 7), rng.normal(size=(n, 7) if n > 1 else 7)) for n in {sizes}]
start = time.perf_counter()
for q, qd in calls:
    pair.forward_kinematics(q, qd, backend={backend!r})
print(time.perf_counter() - start)
"""
_CLOCK = "import time; start = time.perf_counter(); {}; print(time.perf_counter() - start)"
_SCENE = """
[pair]
u1 = [0.5, 0.2, 0.1]
u2 = [-0.25, 0.1, 0.3]
n = [1, 0, 0]
[motion]
x = "3*t"
y = "3*t"
z = "3*t"
phi_x = "3*t"
phi_y = "t"
phi_z = "5*t"
psi = "10*t"
[time]
start = 0
stop = 10
samples = 10001
"""
_RUN = """
import contextlib, io, sys, time
start = time.perf_counter()
from hingepair.cli.main import main
sys.argv = ["hingepair", "run", {scene!r}]
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    main()
print(time.perf_counter() - start)
"""
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


def starts(repeats: int, tell: Tell) -> list[Row]:
    """The first seconds of a process: imports, a scene, sequences of calls by each backend; each in a fresh one."""
    tell(f"fresh processes: imports and {len(SEQUENCES)} sequences of calls, {repeats} repeats")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(_SCENE, encoding="utf-8")
        run = _RUN.format(scene=str(scene))
        codes = {IMPORT: {name: _CLOCK.format(f"import {name}") for name in ("numpy", "hingepair")}}
        codes[RUN] = {peers.OURS: run}
        for name, sizes in SEQUENCES.items():
            own = {backend: _FIRST.format(sizes=sizes, backend=backend) for backend in BACKENDS}
            codes[f"{STARTS}: {name}"] = own
        bytecode = os.environ | {"PYTHONPYCACHEPREFIX": folder, "PYTHONDONTWRITEBYTECODE": ""}
        for code in (run, _FIRST.format(sizes="[1]", backend="compiled")):  # modules are compiled to bytecode
            _inside(code, bytecode)
        rows = []
        for case, ways in codes.items():
            times: dict[str, list[float]] = {name: [] for name in ways}
            for _ in range(repeats):
                for name, code in ways.items():
                    times[name].append(_inside(code, bytecode))
            rows += rows_of(case, times)
    return rows


def _inside(code: str, environment: dict[str, str]) -> float:
    """The seconds that a fresh process prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    return float(done.stdout)


def targets(rows: Sequence[Row]) -> list[Target]:
    """What the rows say of each target, as far as they were measured."""
    by = {(row.case, row.method): row for row in rows}
    found: list[Target] = []

    def take(what: str, case: str, way: str, unit: str, size: float, target: float) -> None:
        if (case, way) in by:
            found.append(Target(what, by[case, way].seconds / size, target, unit))

    def compare(what: str, case: str, way: str, beside: str, target: float, least: bool) -> None:
        if (case, way) in by and (case, beside) in by:
            a, b = by[case, way].ratio, by[case, beside].ratio
            found.append(Target(what, b / a if least else a / b, target, f"x {beside}", least))

    one, hundred, many = (case_of("velocity", size) for size in (1, 100, 1_000_000))
    take("one state", one, peers.OURS, "us", 1e-6, 5.0)
    compare("one state, prepared", one, peers.PREPARED, peers.PYTHON_LOOP, 1.0, False)
    take("one state with Jacobian and bias, prepared", CYCLE, peers.OURS, "us", 1e-6, 10.0)
    take("100 samples", hundred, peers.FRESH, "us", 1e-6, 12.0)
    take("100 samples, prepared", hundred, peers.PREPARED, "us", 1e-6, 12.0)
    take("10,000 samples", case_of("velocity", 10_000), peers.OURS, "ms", 1e-3, 0.16)
    for level in LEVELS:
        what, case = f"{level} of a million", case_of(level, 1_000_000)
        compare(what, case, peers.OURS, peers.FLOOR, 1.3, False)
        compare(what, case, peers.OURS, peers.PYTHON_LOOP, 180.0, True)
        compare(what, case, peers.OURS, peers.CPP, 12.0, True)
    compare("velocity of a million, fresh", many, peers.FRESH, peers.PYTHON_LOOP, 90.0, True)
    compare("velocity of a million, fresh", many, peers.FRESH, peers.FRESH_FLOOR, 1.3, False)
    for name in SEQUENCES:
        cases = [(f"{STARTS}: {name}", backend) for backend in BACKENDS]
        if not by.keys() >= {*cases}:
            continue
        auto, numpy, compiled = (by[case].seconds for case in cases)
        if name == FIRST_CALL:
            found.append(Target(f"first call, {name}: over NumPy", auto - numpy, 0.05, "s"))
        found.append(Target(f"calls {name}: over 2 x the better", auto - 2 * min(numpy, compiled), 0.05, "s"))
    take("HingePair(...)", MADE, peers.OURS, "us", 1e-6, 60.0)
    compare("import", IMPORT, "hingepair", "numpy", 1.3, False)
    take("hingepair run, reference scene", RUN, peers.OURS, "s", 1.0, 1.0)
    return found
