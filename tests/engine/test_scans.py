"""Programs that are repeated in steps, against loops of Python."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.engine.loops import Loop
from hingepair.engine.scans import Scan
from support.near import U


def step(v):
    h = v["h"]
    a, b = v["x"][0], v["x"][-1]
    return {
        "next_x": (b, *(x + h * u for x, u in zip(v["x"][1:-1], v["u"], strict=True)), a),
        "before": (*v["x"], 3.0),
    }


@pytest.mark.slow
@pytest.mark.parametrize("size", [3, 7, 8, 9, 20])
@pytest.mark.parametrize("counts", [(5, 1, 1), (3, 2, 1), (2, 2, 4)], ids=str)
def test_a_scan_is_a_loop(size, counts):
    """Whole blocks of eight samples and rest; inputs of all samples, steps and stages or shared; records of both
    kinds, dense and not; components that pass to others.
    """
    loop = Loop("step", step, {"x": (size,), "u": (size - 2,), "h": ()}, {"next_x": (size,), "before": (size + 1,)})
    scan = Scan(loop, {"h": 0.5})
    rng = np.random.default_rng(1)
    records, every, stages = counts
    for samples in (1, 8, 21):
        for shape in ((samples, records, every, stages), (1, records, every, 1), (samples, 1, 1, 1)):
            start, u = rng.normal(size=(samples, size)), rng.normal(size=(*shape, size - 2))
            end = start.copy()
            before = np.full((samples, records, every, stages, size + 1), np.nan)
            recorded = np.full((size, samples, records, 1, 1), np.nan)
            arrays = {"x": end, "u": u, "before": before, "next_x": np.moveaxis(recorded, 0, -1)}
            scan.run(arrays, samples, *counts, workers=2)
            now, full = start, np.broadcast_to(u, (samples, *counts, size - 2))
            for r, s, j in np.ndindex(*counts):
                np.testing.assert_array_equal(before[:, r, s, j], np.hstack([now, np.full((samples, 1), 3.0)]))
                now = np.hstack([now[:, -1:], now[:, 1:-1] + 0.5 * full[:, r, s, j], now[:, :1]])
                if (s, j) == (every - 1, stages - 1):
                    np.testing.assert_allclose(recorded[:, :, r, 0, 0].T, now, rtol=4 * U, atol=4 * U)
            np.testing.assert_allclose(end, now, rtol=4 * U, atol=4 * U)


def test_backwards_in_memory_and_nothing_to_do():
    """Inputs and records whose strides are negative; no samples, no steps."""
    loop = Loop("sums", lambda v: {"next_x": (v["x"][0] + v["u"][0],)}, {"x": (1,), "u": (1,)}, {"next_x": (1,)})
    scan = Scan(loop, {})
    u = np.arange(5.0).reshape(1, 5, 1, 1, 1)
    x, found = np.zeros((1, 1)), np.zeros((1, 5, 1, 1, 1))
    scan.run({"x": x, "u": u[:, ::-1], "next_x": found[:, ::-1]}, 1, 5)
    np.testing.assert_array_equal(found.ravel(), [10, 10, 9, 7, 4])
    scan.run({"x": x, "u": u}, 1, 0)
    scan.run({"x": x[:0], "u": u}, 0, 5)
    assert x == 10


def test_inputs_whose_rows_are_not_side_by_side_in_memory():
    loop = Loop("sums", lambda v: {"next_x": (v["x"][0] + v["u"][1],)}, {"x": (1,), "u": (2, 2)}, {"next_x": (1,)})
    scan, x = Scan(loop, {}), np.zeros((3, 1))
    u = np.arange(12.0).reshape(3, 1, 1, 1, 2, 2).swapaxes(-1, -2)
    scan.run({"x": x, "u": u}, 3, 1)
    np.testing.assert_array_equal(x[:, 0], u[:, 0, 0, 0, 0, 1])
