"""`hingepair bench direct`: run time and error of forward kinematics at several batch sizes, beside alternatives."""

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
from hingepair.bench.engines import PINOCCHIO_CPP_NAME, cpp_missing_reason
from hingepair.bench.measure import (
    Method,
    Report,
    Row,
    available_methods,
    case_name,
    make_rows,
    measure_methods,
    print_progress,
    time_interleaved,
)
from hingepair.bench.peers import (
    BENCH_PAIR_ARGUMENT_BY_NAME,
    COPY_FLOOR_NAME,
    FRESH_COPY_FLOOR_NAME,
    HINGEPAIR_NAME,
    OUTPUT_NAMES_BY_LEVEL,
    make_kinematics_task,
)
from hingepair.bench.plot import MethodCurve, Panel
from hingepair.bench.truth import TRUTH_DECIMAL_DIGITS, ExactResults, hard_states, random_states
from hingepair.pair.hinge_pair import HingePair

HARD_STATE_ERROR_COLUMN_HEADING = "on hard states"  # heading of a column of the table
CONTROL_CYCLE_CASE_NAME = "one state: FK, Jacobian, bias from a quaternion"  # name of a case
PAIR_CONSTRUCTION_CASE_NAME = "construction of a pair"  # name of a case
FRESH_PROCESS_CASE_NAME_PREFIX = "a fresh process"  # beginning of the names of cases
OUTPUT_OFFSETS_CASE_NAME_PREFIX = "outputs at offsets from a cache line"  # beginning of the names of cases
OUTPUT_OFFSET_BYTES_FROM_CACHE_LINE_BY_METHOD_NAME = {
    f"{shift} bytes after a line": shift for shift in (0, 8, 16, 32)
}
"""Offsets of the outputs from a cache line [bytes], by the name of the row; NumPy's large arrays are at 16."""

_CACHE_LINE_BYTES = 64
"""Size of a cache line [bytes]."""
_NUM_RANDOM_STATES_COMPARED_WITH_EXACT = 40  # number of random states whose results are compared with the exact ones
# Explains the columns below the table.
_TABLE_COLUMNS_NOTE = (
    "a call, each: medians, kernels are compiled before; ratio: time of a sample divided by that of the first method "
    "of the case; "
    f"errors: largest of any output against {TRUTH_DECIMAL_DIGITS} digits [u * scale], on random and on hard states; "
    "inf: the method refuses a state, or its result is not finite where the exact one is"
)


def measure_kinematics(
    sizes: Sequence[int], levels: Sequence[str], repeats: int, with_cpp: bool, with_imports_and_first_calls: bool
) -> Report:
    """Measure run times and errors of forward kinematics by hingepair and other packages, at each batch size of
    `sizes` and each level of `levels` ("pose", "velocity", "acceleration"), and run times of calls of single states
    and of output arrays at several addresses. Time each call `repeats` times; return the Report. `with_cpp` compiles
    and adds Pinocchio's C++ loop; `with_imports_and_first_calls` adds imports, a run of a scene and first calls, each
    in a fresh process.

    Args:
        sizes: batch sizes.
        levels: names of levels: pose, velocity, acceleration.
        repeats: of each measurement.
        with_cpp: whether the C++ loop of Pinocchio is compiled and measured. If this fails, a note says why.
        with_imports_and_first_calls: whether imports and first calls are measured too, in fresh processes.
    """
    if with_cpp:
        print_progress("compiling Pinocchio's C++ loop (up to a minute)")
    methods, left_out = available_methods(
        peers.COMPARED_KINEMATICS_METHODS, {PINOCCHIO_CPP_NAME: cpp_missing_reason(with_cpp)}
    )
    rows = (
        measure_batches(methods, sizes, levels, repeats)
        + measure_offsets(max(sizes), levels, repeats)
        + measure_single_states(repeats)
    )
    rows += measure_fresh_processes(repeats) if with_imports_and_first_calls else []
    return Report(rows, "error", [*left_out, _TABLE_COLUMNS_NOTE], [make_error_panels(rows)])


def measure_batches(
    methods: Sequence[Method], sizes: Sequence[int], levels: Sequence[str], repeats: int
) -> list[Row]:
    """Measure run times and errors of the given methods at every level of `levels` ("pose", "velocity",
    "acceleration") and every batch size of `sizes`, and time each call `repeats` times; return a list of table rows.
    A method computes at most its `max_samples` samples of a batch.
    """
    rng = np.random.default_rng(20)
    pair = HingePair(**BENCH_PAIR_ARGUMENT_BY_NAME)
    rows: list[Row] = []
    for level in levels:
        num_levels, outputs = list(OUTPUT_NAMES_BY_LEVEL).index(level) + 1, OUTPUT_NAMES_BY_LEVEL[level]
        random, hard = (
            method_errors(pair, methods, ExactResults(BENCH_PAIR_ARGUMENT_BY_NAME, states, outputs))
            for states in (
                random_states(rng, _NUM_RANDOM_STATES_COMPARED_WITH_EXACT, num_levels),
                hard_states(rng, num_levels),
            )
        )
        extra_columns = {name: {HARD_STATE_ERROR_COLUMN_HEADING: value} for name, value in hard.items()}
        rows_by_size = {}
        for size in sorted(sizes, reverse=True):  # the largest first: what is measured of small ones is warm
            print_progress(f"{level}, N = {size:,}: {repeats} repeats")
            task = make_kinematics_task(pair, random_states(rng, size, num_levels), outputs)
            rows_by_size[size] = measure_methods(
                case_name(level, size), methods, task.first_samples, size, repeats, random, extra_columns
            )
        rows += [row for size in sizes for row in rows_by_size[size]]
    return rows


def measure_offsets(size: int, levels: Sequence[str], repeats: int) -> list[Row]:
    """Measure run times of batches of `size` states whose output arrays begin at several byte offsets from a cache
    line, and of plain copying, at each named level; return a list of table rows, which is empty if `size` is 1.
    """
    rng, pair, rows = np.random.default_rng(22), HingePair(**BENCH_PAIR_ARGUMENT_BY_NAME), []
    make_job = peers.hingepair_job_maker(backend="compiled", workers=1)
    for level in levels if size > 1 else ():  # the outputs of one state are new arrays
        num_offsets = len(OUTPUT_OFFSET_BYTES_FROM_CACHE_LINE_BY_METHOD_NAME)
        print_progress(f"{level}, N = {size:,}, outputs at {num_offsets} offsets: {repeats} repeats")
        task = make_kinematics_task(
            pair, random_states(rng, size, list(OUTPUT_NAMES_BY_LEVEL).index(level) + 1), OUTPUT_NAMES_BY_LEVEL[level]
        )
        jobs = {COPY_FLOOR_NAME: peers.copy_job(task)}
        for name, shift in OUTPUT_OFFSET_BYTES_FROM_CACHE_LINE_BY_METHOD_NAME.items():
            buffers = {output: allocate_at_offset(array.shape, shift) for output, array in task.buffers.items()}
            jobs[name] = make_job(task._replace(buffers=buffers))
        rows += make_rows(
            case_name(f"{OUTPUT_OFFSETS_CASE_NAME_PREFIX}: {level}", size), time_interleaved(jobs, repeats), size
        )
    return rows


def allocate_at_offset(shape: tuple[int, ...], offset_bytes: int) -> NDArray[np.float64]:
    """Return a float64 array of ones with the given shape, whose data begins `offset_bytes`, a multiple of 8, after
    the start of a cache line.

    Every memory page of the array has been written to.
    """
    count = math.prod(shape)
    memory = np.ones(count + 2 * _CACHE_LINE_BYTES // 8)
    start = (-memory.ctypes.data % _CACHE_LINE_BYTES + offset_bytes) // 8
    return memory[start : start + count].reshape(shape)


def method_errors(pair: HingePair, methods: Iterable[Method], exact_results: ExactResults) -> dict[str, float]:
    """Compute the states of `exact_results` by each method; return a dict from the method's name to its largest error
    in units of u * scale, the unit roundoff times the scale of the output. The error is inf if the method raises a
    ValueError or a result is not finite. Methods that only copy are left out.
    """
    largest_errors = {}
    for method in methods:
        task = make_kinematics_task(pair, exact_results.motion, exact_results.outputs)
        try:
            with np.errstate(all="ignore"):
                results = method.make_job(task)()
        except ValueError:
            results = {name: np.full_like(array, np.nan) for name, array in task.buffers.items()}
        if method.name not in {COPY_FLOOR_NAME, FRESH_COPY_FLOOR_NAME}:
            named = results if isinstance(results, dict) else dict(zip(exact_results.outputs, results, strict=True))
            largest_errors[method.name] = exact_results.largest_error(named)
    return largest_errors


def make_error_panels(rows: Sequence[Row]) -> list[Panel]:
    """Return a list of the picture's panels, one for each level, made from the table rows. A panel shows two points
    for each method that is drawn: its errors on random and on hard states against its minimum run time for the last
    batch size of the rows.

    Run times are the minima of the repeats: medians change order when other programs run beside the benchmark.
    """
    drawn = {method.name for method in peers.COMPARED_KINEMATICS_METHODS if method.in_picture}
    panels: list[Panel] = []
    for level in OUTPUT_NAMES_BY_LEVEL:
        cases = [row.case for row in rows if row.case.startswith(f"{level},")]
        times = {
            row.method: (row.min_seconds / row.count * 1e9, row) for row in rows if cases and row.case == cases[-1]
        }
        curves = [
            MethodCurve(
                name, [(ns, row.error), (ns, row.extra_columns[HARD_STATE_ERROR_COLUMN_HEADING])], second_is_hard=True
            )
            for name, (ns, row) in times.items()
            if name in drawn and row.error is not None
        ]
        if curves:
            y_label, floor = "" if panels else "largest error [u * scale]", times.get(COPY_FLOOR_NAME)
            panels.append(Panel(cases[-1], "run time [ns a sample]", y_label, curves, floor and floor[0], max_y=10.0))
    return panels


def measure_single_states(repeats: int) -> list[Row]:
    """Measure the run times of the construction of a HingePair, and of a control cycle of one state by hingepair and
    Pinocchio, `repeats` times each; return a list of table rows.
    """
    print_progress(f"one state: construction of a pair, a control cycle; {repeats} repeats")
    pair = HingePair(**BENCH_PAIR_ARGUMENT_BY_NAME)
    rng = np.random.default_rng(21)
    R, quat, v, omega = (rng.normal(size=k) for k in (3, 4, 3, 3))
    state = R, quat / np.sqrt(quat @ quat), v, omega, 0.3, -0.7
    plain = {key: value for key, value in BENCH_PAIR_ARGUMENT_BY_NAME.items() if key != "home"}
    jobs = {
        "Pinocchio": peers.pinocchio_cycle_job(pair, *state),
        HINGEPAIR_NAME: peers.hingepair_cycle_job(pair, *state),
    }
    construction_times = time_interleaved({HINGEPAIR_NAME: lambda: HingePair(**plain)}, repeats)
    cycle_times = time_interleaved(jobs, repeats)
    return make_rows(CONTROL_CYCLE_CASE_NAME, cycle_times) + make_rows(
        PAIR_CONSTRUCTION_CASE_NAME, construction_times
    )


# Code of a process that runs {before}, and prints the time from {timed} to its end [s].
_RUN_TIME_PRINTING_CODE_TEMPLATE = """
import atexit, sys, time
{before}
atexit.register(lambda start: print(time.perf_counter() - start, file=sys.stderr), time.perf_counter())
{timed}
"""
# Code that makes a pair and the arguments of calls of {sizes} samples.
_PAIR_AND_STATES_CODE_TEMPLATE = """
import numpy as np
import hingepair as hp
pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
rng = np.random.default_rng(0)
calls = [(rng.normal(size=(n, 7) if n > 1 else 7), rng.normal(size=(n, 7) if n > 1 else 7)) for n in {sizes}]
"""
# The scene that a process runs.
_TIMED_SCENE_TOML = """
pair = {u1 = [0.5, 0.2, 0.1], u2 = [-0.25, 0.1, 0.3], n = [1, 0, 0]}
motion = {x = "3*t", y = "3*t", z = "3*t", phi_x = "3*t", phi_y = "t", phi_z = "5*t", psi = "10*t"}
time = {start = 0, stop = 10, samples = 10001}
"""
# names of cases
IMPORT_CASE_NAME, RUN_CASE_NAME = (
    f"{FRESH_PROCESS_CASE_NAME_PREFIX}: import",
    f"{FRESH_PROCESS_CASE_NAME_PREFIX}: hingepair run, reference scene",
)
ONE_LARGE_CALL_SEQUENCE_NAME = "1 x 200,000"  # name of the sequence of one large call
# Batch sizes of sequences of calls, by the name of the sequence.
BATCH_SIZES_OF_CALLS_BY_SEQUENCE_NAME = {
    ONE_LARGE_CALL_SEQUENCE_NAME: [200_000],
    "1,000 x 1": [1] * 1000,
    "2,000 x 20": [20] * 2000,
    "300 x 1,000": [1000] * 300,
    "20 x 10,000": [10_000] * 20,
    "3 x 1,000,000": [1_000_000] * 3,
    "1 x 100,000 among 200 x 1": [1] * 100 + [100_000] + [1] * 100,
}
# Backends that the sequences of calls are measured with.
BACKEND_NAMES_OF_CALL_SEQUENCES = ("auto", "numpy", "compiled")


def measure_fresh_processes(repeats: int) -> list[Row]:
    """Measure the run times of imports, of the command `hingepair run` and of sequences of calls, `repeats` times,
    each in a fresh Python process; return a list of table rows. Raise a CalledProcessError if a process fails.
    """
    num_sequences = len(BATCH_SIZES_OF_CALLS_BY_SEQUENCE_NAME)
    print_progress(f"fresh processes: imports and {num_sequences} sequences of calls, {repeats} repeats")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(_TIMED_SCENE_TOML, encoding="utf-8")
        run = _RUN_TIME_PRINTING_CODE_TEMPLATE.format(
            before=f"sys.argv = ['hingepair', 'run', {str(scene)!r}]",
            timed="from hingepair.cli.main import main; main()",
        )
        codes = {
            IMPORT_CASE_NAME: {
                name: _RUN_TIME_PRINTING_CODE_TEMPLATE.format(before="", timed=f"import {name}")
                for name in ("numpy", "hingepair")
            },
            RUN_CASE_NAME: {HINGEPAIR_NAME: run},
        }
        for name, sizes in BATCH_SIZES_OF_CALLS_BY_SEQUENCE_NAME.items():
            calls = {
                backend: f"for q, qd in calls: pair.forward_kinematics(q, qd, backend={backend!r})"
                for backend in BACKEND_NAMES_OF_CALL_SEQUENCES
            }
            before = _PAIR_AND_STATES_CODE_TEMPLATE.format(sizes=sizes)
            codes[f"{FRESH_PROCESS_CASE_NAME_PREFIX}: {name}"] = {
                b: _RUN_TIME_PRINTING_CODE_TEMPLATE.format(before=before, timed=call) for b, call in calls.items()
            }
        environment = os.environ | {"PYTHONPYCACHEPREFIX": folder, "PYTHONDONTWRITEBYTECODE": ""}
        for code in (
            run,
            *codes[f"{FRESH_PROCESS_CASE_NAME_PREFIX}: {ONE_LARGE_CALL_SEQUENCE_NAME}"].values(),
        ):  # an unmeasured run compiles the modules to bytecode
            _run_fresh_process(code, environment)
        rows = []
        for case, methods in codes.items():
            times = [
                {name: _run_fresh_process(code, environment) for name, code in methods.items()}
                for _ in range(repeats)
            ]
            rows += make_rows(case, {name: [one[name] for one in times] for name in methods})
    return rows


def _run_fresh_process(code: str, environment: dict[str, str]) -> float:
    """Run Python code in a fresh process whose environment variables are those of the mapping `environment`. Return
    the last number that the code prints to standard error, its run time [s], as a float. Raise a CalledProcessError
    if the process fails.
    """
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    return float(process.stderr.split()[-1])
