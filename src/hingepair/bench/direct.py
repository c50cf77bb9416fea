"""`hingepair bench direct`: run time against error at every size, beside what a user would pick instead."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from math import hypot
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from hingepair.bench import peers
from hingepair.bench.measure import Job, Row, Target, measured
from hingepair.bench.peers import LEVELS, Way, room_for
from hingepair.bench.plot import Curve, Panel
from hingepair.bench.truth import Motion, Truth, hard_states, random_states
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.validation.pinocchio_twin import to_pinocchio

ERROR = "error"
HARD = "on hard states"
CYCLE = "one state: FK, Jacobian, bias from a quaternion"
MADE = "a pair made"
STARTS = "a fresh process"

_COMPARED = 40  # random states, compared with the exact ones

_LENGTH = hypot(3, 1, 1, 1)
_A, _B, _C, _D = 3 / _LENGTH, 1 / _LENGTH, -1 / _LENGTH, 1 / _LENGTH
CONSTANTS: dict[str, Any] = {
    "u1": [0.5, 0.2, 0.1],
    "u2": [-0.25, 0.1, 0.3],
    "n": [1.0, 2.0, -0.5],
    "home": [
        [1 - 2 * (_C * _C + _D * _D), 2 * (_B * _C - _A * _D), 2 * (_B * _D + _A * _C)],
        [2 * (_B * _C + _A * _D), 1 - 2 * (_B * _B + _D * _D), 2 * (_C * _D - _A * _B)],
        [2 * (_B * _D - _A * _C), 2 * (_C * _D + _A * _B), 1 - 2 * (_B * _B + _C * _C)],
    ],
}


def direct(
    ways: Sequence[Way], sizes: Sequence[int], levels: Sequence[str], repeats: int, tell: Callable[[str], None]
) -> list[Row]:
    """All ways at all sizes, interleaved with the copy floor; a way with a limit is given fewer samples."""
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
        block = [row for row in rows if cases and row.case == cases[-1]]
        curves = [
            Curve(row.method, [(_nanoseconds(row), row.error), (_nanoseconds(row), row.more[HARD])], hard=True)
            for row in block
            if row.method in drawn and row.error is not None
        ]
        floor = next((_nanoseconds(row) for row in block if row.method == peers.FLOOR), None)
        if curves:
            up = "largest error [u * scale]" if not found else ""
            found.append(Panel(cases[-1], "run time [ns a sample]", up, curves, floor, most=10.0))
    return found


def _nanoseconds(row: Row) -> float:
    return row.least / row.count * 1e9


def singles(repeats: int, tell: Callable[[str], None]) -> list[Row]:
    """What one state costs beside forward kinematics: a pair made, and a control cycle from a quaternion."""
    tell(f"one state: a pair made, a control cycle; {repeats} repeats")
    pair = HingePair(**CONSTANTS)
    rng = np.random.default_rng(21)
    R, quat, v, omega = (rng.normal(size=k) for k in (3, 4, 3, 3))
    quat /= np.sqrt(quat @ quat)
    psi, psid = 0.3, -0.7
    plain = {key: value for key, value in CONSTANTS.items() if key != "home"}
    jobs = {"Pinocchio": _pinocchio_cycle(pair, R, quat, v, omega, psi, psid)}
    jobs[peers.OURS] = _our_cycle(pair, R, quat, v, omega, psi, psid)
    return [
        *measured(CYCLE, jobs, repeats),
        *measured(MADE, {peers.OURS: lambda: HingePair(**plain)}, repeats),
    ]


def _our_cycle(pair: HingePair, *given: Any) -> Job:
    names = ("R2", "S2", "v2", "omega2", "jacobian", "acceleration_bias")
    cycle = pair.prepare(("R1", "quat_xyzw", "v1", "omega1", "psi", "psid"), outputs=names)

    def run() -> Any:
        state = cycle(*given)
        return state.R2, state.S2, state.v2, state.omega2, state.jacobian, state.acceleration_bias

    return run


def _pinocchio_cycle(pair: HingePair, R: Any, quat: Any, v: Any, omega: Any, psi: float, psid: float) -> Job:
    import pinocchio as pin

    twin = to_pinocchio(pair)
    model, data, frame = twin.model, twin.data, twin.body2_frame
    body1 = BodyMotion.from_quaternion_xyzw(R=R, quat_xyzw=quat, v=v, omega=omega)
    rates = twin.velocity(body1, psi, psid)
    q, still = np.array([*R, *quat, psi]), np.zeros(7)

    def run() -> Any:
        pin.forwardKinematics(model, data, q, rates, still)
        placement = pin.updateFramePlacement(model, data, frame)
        twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        pin.computeJointJacobians(model, data)
        jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        bias = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        return (
            placement.translation,
            placement.rotation,
            twist.linear,
            twist.angular,
            jacobian,
            bias.linear,
            bias.angular,
        )

    return run


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


def starts(repeats: int, tell: Callable[[str], None]) -> list[Row]:
    """The first seconds of a process: imports, a scene, sequences of calls by each backend; each in a fresh one."""
    tell(f"fresh processes: imports and {len(SEQUENCES)} sequences of calls, {repeats} repeats")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(_SCENE, encoding="utf-8")
        imports = {name: _CLOCK.format(f"import {name}") for name in ("numpy", "hingepair")}
        cases = {
            "import": imports,
            "hingepair run, reference scene": {"hingepair": _RUN.format(scene=str(scene))},
            **{
                name: {backend: _FIRST.format(sizes=sizes, backend=backend) for backend in BACKENDS}
                for name, sizes in SEQUENCES.items()
            },
        }
        times: dict[str, dict[str, list[float]]] = {
            case: {name: [] for name in codes} for case, codes in cases.items()
        }
        bytecode = os.environ | {"PYTHONPYCACHEPREFIX": folder, "PYTHONDONTWRITEBYTECODE": ""}
        for repeat in range(repeats + 1):
            for case, codes in cases.items():
                for name, code in codes.items():
                    if repeat or case not in SEQUENCES:  # the first time round, modules are compiled to bytecode
                        times[case][name].append(_inside(code, bytecode))
    times = {case: {n: t[-repeats:] for n, t in found.items()} for case, found in times.items()}
    return [
        Row(
            f"{STARTS}: {case}",
            name,
            1,
            median(taken),
            min(taken),
            median(own / base for own, base in zip(taken, next(iter(found.values())), strict=True)),
        )
        for case, found in times.items()
        for name, taken in found.items()
    ]


def _inside(code: str, environment: dict[str, str]) -> float:
    """The seconds that a fresh process prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    return float(done.stdout)


def targets(rows: Sequence[Row]) -> list[Target]:
    """What the rows say of each target, as far as they were measured."""
    by = {(row.case, row.method): row for row in rows}
    found: list[Target] = []

    def take(what: str, mine: tuple[str, str], unit: str, size: float, target: float) -> None:
        if mine in by:
            found.append(Target(what, by[mine].seconds / size, target, unit))

    def compare(what: str, case: str, way: str, beside: str, target: float, least: bool) -> None:
        if (case, way) in by and (case, beside) in by:
            a, b = by[case, way].ratio, by[case, beside].ratio
            found.append(Target(what, b / a if least else a / b, target, f"x {beside}", least))

    one, many = case_of("velocity", 1), 1_000_000
    take("one state", (one, peers.OURS), "us", 1e-6, 5.0)
    compare("one state, prepared", one, peers.PREPARED, peers.PYTHON_LOOP, 1.0, False)
    take("one state with Jacobian and bias, prepared", (CYCLE, peers.OURS), "us", 1e-6, 10.0)
    take("100 samples", (case_of("velocity", 100), peers.FRESH), "us", 1e-6, 12.0)
    take("100 samples, prepared", (case_of("velocity", 100), peers.PREPARED), "us", 1e-6, 12.0)
    take("10,000 samples", (case_of("velocity", 10_000), peers.OURS), "ms", 1e-3, 0.16)
    for level in LEVELS:
        case = case_of(level, many)
        compare(f"{level} of a million", case, peers.OURS, peers.FLOOR, 1.3, False)
        compare(f"{level} of a million", case, peers.OURS, peers.PYTHON_LOOP, 180.0, True)
        compare(f"{level} of a million", case, peers.OURS, peers.CPP, 12.0, True)
    compare("velocity of a million, fresh", case_of("velocity", many), peers.FRESH, peers.PYTHON_LOOP, 90.0, True)
    compare("velocity of a million, fresh", case_of("velocity", many), peers.FRESH, peers.FRESH_FLOOR, 1.3, False)
    for name in SEQUENCES:
        auto, *others = (by.get((f"{STARTS}: {name}", backend)) for backend in BACKENDS)
        best = min((row.seconds for row in others if row is not None), default=None)
        if auto is None or best is None:
            continue
        if name == FIRST_CALL and others[0] is not None:
            found.append(Target(f"first call, {name}: over NumPy", auto.seconds - others[0].seconds, 0.05, "s"))
        beyond = auto.seconds - 2 * best
        found.append(Target(f"calls {name}: over 2 x the better", beyond, 0.05, "s"))
    take("HingePair(...)", (MADE, peers.OURS), "us", 1e-6, 60.0)
    compare("import", f"{STARTS}: import", "hingepair", "numpy", 1.3, False)
    take("hingepair run, reference scene", (f"{STARTS}: hingepair run, reference scene", peers.OURS), "s", 1.0, 1.0)
    return found
