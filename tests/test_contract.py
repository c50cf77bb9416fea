"""The contract: what can be asked of pairs and robots, each once, held against 60 digits.

Every row of the table in `support.asked` is asked of both backends, one state and a batch, plain and prepared, in
every layout and type that arrays of samples may have.
"""

from __future__ import annotations

import copy
import functools
import warnings

import numpy as np
import pytest

import hingepair as hp
from support.asked import CHECKED, COUNT, ROWS, U, arrays_of, asked, errors_of, inputs_of, prepared, subject_of

labels = pytest.mark.parametrize("label", ROWS)
backends = pytest.mark.parametrize("backend", ["numpy", "compiled"])


@backends
@labels
def test_values_are_those_of_sixty_digits(label, backend):
    """Of many states, of each alone, and the same by `prepare`."""
    row = ROWS[label]
    ways = {"method": functools.partial(asked, label, backend=backend)}
    if len(row.prepared) > 1:
        ways["prepared"] = prepared(label, backend)
    for way, ask in ways.items():
        many = ask(inputs_of(row))
        single = [ask(inputs_of(row, k)) for k in CHECKED]
        for name, error in errors_of(label, {name: value[CHECKED] for name, value in many.items()}).items():
            assert error <= 1, (way, "many", name)
        for name, error in errors_of(label, {name: np.stack([one[name] for one in single]) for name in many}).items():
            assert error <= 1, (way, "one by one", name)


# ---- layouts, types, outputs


LAYOUTS = {
    "lists": lambda x: x.tolist(),
    "strided": lambda x: np.repeat(x, 2, axis=0)[::2],
    "backwards": lambda x: x[::-1].copy()[::-1],
    "fortran": np.asfortranarray,
    "big-endian": lambda x: x.astype(">f8"),
    "unaligned": lambda x: np.frombuffer(b"?" + x.tobytes(), "b")[1:].view(x.dtype).reshape(x.shape),
    "two axes": lambda x: x.reshape(3, 7, *x.shape[1:]),
    "one axis more": lambda x: x[None],
}


def near(found, expected, bound, unit=U):
    """Whether results agree, in units of the largest component of each output."""
    assert found.keys() == expected.keys()
    for name, value in found.items():
        size = float(np.abs(expected[name]).max(initial=0.0))
        assert np.abs(value - expected[name]).max(initial=0.0) <= bound * unit * size, name


@labels
def test_the_layout_of_samples_does_not_matter(label):
    row = ROWS[label]
    given = inputs_of(row)
    expected = asked(label, given, backend="numpy")
    for backend in ("numpy", "compiled"):
        for layout in LAYOUTS.values():
            laid = {name: layout(value) for name, value in given.items()}
            before = copy.deepcopy(laid)
            found = asked(label, laid, backend=backend)
            near(
                {name: found[name].reshape(value.shape) for name, value in expected.items()}, expected, 2 * row.bound
            )
            for name, value in laid.items():
                np.testing.assert_array_equal(value, before[name])


@backends
@labels
def test_samples_are_broadcast(label, backend):
    """All but one input of a single state; and none at all of an input without samples."""
    row = ROWS[label]
    given = inputs_of(row)
    for last in given:
        mixed = {name: value if name == last else value[0] for name, value in given.items()}
        full = {name: np.array(np.broadcast_to(value, given[name].shape)) for name, value in mixed.items()}
        expected = asked(label, full, backend="numpy")
        found = asked(label, mixed, backend=backend)
        near(
            {name: np.broadcast_to(value, expected[name].shape) for name, value in found.items()},
            expected,
            2 * row.bound,
        )
    empty = asked(label, inputs_of(row, slice(0)), backend=backend)
    assert {name: value.shape for name, value in empty.items()} == {
        name: (0, *value.shape[1:]) for name, value in expected.items()
    }


@backends
@labels
def test_float32_stays_and_integers_become_float64(label, backend):
    row = ROWS[label]
    single = {name: value.astype(np.float32) for name, value in inputs_of(row).items()}
    found = asked(label, single, backend=backend)
    assert {value.dtype for value in found.values()} == {np.dtype(np.float32)}
    double = {name: value.astype(float) for name, value in single.items()}
    if "S" in double:
        double["S"] = hp.project_to_rotation(double["S"])
    near(found, asked(label, double), 4 * row.bound, 2.0**-24)
    whole = {name: np.rint(3 * value).astype(int) for name, value in inputs_of(row).items()}
    if "S" in whole:
        whole["S"] = np.broadcast_to(np.eye(3, dtype=int)[[1, 2, 0]], (COUNT, 3, 3))
    found = asked(label, whole, backend=backend)
    near(found, asked(label, {name: value.astype(float) for name, value in whole.items()}), 2 * row.bound)
    assert {value.dtype for value in found.values()} == {np.dtype(float)}


@backends
@labels
def test_outputs_are_written_where_they_are_wanted(label, backend):
    row = ROWS[label]
    given = inputs_of(row)
    subject = subject_of(row)
    expected = asked(label, given, backend=backend)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hp.DynamicsWarning)
        plain = row.ask(subject, given, backend=backend)
        for workers in (1, 2):
            for room in (lambda x: np.full(x.shape, np.nan), lambda x: np.full((2, *x.shape), np.nan).T[..., 0].T):
                if isinstance(plain, np.ndarray):
                    out = room(plain)
                    assert row.ask(subject, given, backend=backend, workers=workers, out=out) is out
                    found = {"": out}
                else:
                    out = {name: room(value) for name, value in plain.arrays().items()}
                    result = row.ask(subject, given, backend=backend, workers=workers, out=out)
                    assert all(np.shares_memory(value, out[name]) for name, value in result.arrays().items())
                    found = arrays_of(result)
                near(found, expected, row.bound)


@backends
@labels
def test_what_is_not_finite_stays_in_its_sample(label, backend):
    row = ROWS[label]
    given = inputs_of(row)
    expected = asked(label, given, backend=backend)
    others = np.arange(COUNT) != 5
    for spoiled in given:
        poisoned = {name: value.copy() for name, value in given.items()}
        poisoned[spoiled][5] = np.nan
        found = asked(label, poisoned, backend=backend)
        near({k: v[others] for k, v in found.items()}, {k: v[others] for k, v in expected.items()}, row.bound)


@backends
@pytest.mark.parametrize("frames", ["tool0", ("tool0",), ("ee_link", "tool0")], ids=str)
def test_a_frame_by_its_name_has_no_axis_of_frames_and_those_of_a_tuple_have_one(frames, backend):
    robot, q = hp.load_robot("ur5_robot"), np.random.default_rng(3).uniform(-1, 1, (3, 5, 6))
    axis = () if isinstance(frames, str) else (len(frames),)
    state = robot.forward_kinematics(*q, frames=frames, backend=backend)
    f = robot.prepare(
        ("q", "qd"), frames=frames, outputs=("R", "S", "jacobian", "acceleration_bias"), backend=backend
    )
    found = {"R": f(*q[:2]).R, **{name: getattr(state, name) for name in ("S", "alpha")}}
    found |= {name: getattr(f(*q[:2]), name) for name in ("jacobian", "acceleration_bias")}
    found["jacobian_rate"] = robot.jacobian_rate(*q[:2], frames, backend=backend)
    tails = {"R": (3,), "S": (3, 3), "alpha": (3,), "acceleration_bias": (6,)}
    for name, array in found.items():
        assert array.shape == (5, *axis, *tails.get(name, (6, 6))), name
    for J in (robot.jacobian(q[0], frames, backend=backend), found["jacobian"]):
        assert J.shape == (5, *axis, 6, 6)
    alone = robot.forward_kinematics(*q, frames="tool0", backend=backend)
    assert state["tool0"].R.shape == alone["tool0"].R.shape == alone.R.shape == (5, 3)
    near({"R": state["tool0"].R}, {"R": alone.R}, 4)
    assert robot.error_bounds(q[0], frames=frames)["R"].shape == (5, *axis)
    hand = robot.forward_kinematics(q[0, 0], frames=frames)
    solved = robot.prepare("inverse_kinematics", frames=frames)(hand.R, hand.S, q[0, 0])
    assert solved.position_error.shape == axis
