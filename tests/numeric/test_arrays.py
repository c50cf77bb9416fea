"""The border: tables by the names of their columns, what could be either of two things, short messages."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import hingepair as hp
from support.states import generator

NAMES = ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")
RATES = ("v1_x", "v1_y", "v1_z", "phid_x", "phid_y", "phid_z", "psid")
PAIR = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 2, 3))
FLAT = hp.PlanarPair(u1=(0.5, 0.1), u2=(-0.25, 0.1))
EYE = np.eye(3)


class Table:
    """What is used of a data frame of whichever package."""

    def __init__(self, columns, values):
        self.columns, self.values = columns, np.asarray(values, float)

    def to_numpy(self):
        return self.values

    def __getitem__(self, column):
        return Table([column], self.values[:, self.columns.index(column)])

    def __array__(self, dtype=None, copy=None):
        return self.values

    @property
    def shape(self):
        return self.values.shape


def shuffled(names, values, ending=""):
    order = generator(61, len(names)).permutation(len(names))
    return Table([f"{names[i]}{ending}" for i in order], values[:, order])


@pytest.mark.parametrize(("rate", "acceleration"), [("", ""), ("_dot", "_ddot"), ("d", "dd")])
def test_columns_of_a_table_go_by_their_names(rate, acceleration):
    q, qd, qdd = generator(60).normal(size=(3, 5, 7))
    tables = shuffled(NAMES, q), shuffled(NAMES, qd, rate), shuffled(NAMES, qdd, acceleration)
    found, expected = (PAIR.forward_kinematics(*rows, backend="numpy").a2 for rows in (tables, (q, qd, qdd)))
    assert np.array_equal(found, expected)
    flat = shuffled(("x", "y", "phi", "psi"), q[:, :4])
    found, expected = (FLAT.forward_kinematics(rows, backend="numpy").R2 for rows in (flat, q[:, :4]))
    assert np.array_equal(found, expected)


@pytest.mark.parametrize(
    "columns", [NAMES, ("t", *NAMES), (*NAMES, "psid"), (*NAMES, *RATES[1:])], ids=["", "t", "psid", "some rates"]
)
def test_positions_are_not_taken_for_rates(columns):
    """Columns x, y, z, ... are rates only where a table has nothing else: then they can be nothing else."""
    table = Table(list(columns), np.ones((5, len(columns))))
    if columns == NAMES:
        PAIR.forward_kinematics(np.zeros((5, 7)), table)
        return
    with pytest.raises(hp.ArgumentError, match=r"^qd: expected the columns v1_x, .*psid or x_dot, .* got "):
        PAIR.forward_kinematics(np.zeros((5, 7)), table)


@pytest.mark.parametrize("count", range(5, 10))
@pytest.mark.parametrize("kind", [tuple, list])
def test_a_nested_tuple_of_states_is_rows_or_refused(count, kind):
    """Seven states of seven could be seven coordinates as well; arrays in a tuple are coordinates."""
    rows = generator(63).normal(size=(count, 7))
    nested = tuple(kind(row) for row in rows.tolist())
    if count == 7:
        with pytest.raises(hp.ShapeError, match=r"q: expected an array of states .* could be either"):
            PAIR.forward_kinematics(nested)
        forms = tuple(rows), np.swapaxes(rows, 0, 1)
    else:
        forms = nested, rows
    one, other = (PAIR.forward_kinematics(form, backend="numpy").R2 for form in forms)
    assert np.array_equal(one, other)
    flat = tuple(kind(row) for row in rows[:, :4].tolist())
    if count == 5:
        assert np.array_equal(FLAT.forward_kinematics(flat).R2, FLAT.forward_kinematics(rows[:, :4]).R2)
        with pytest.raises(hp.ShapeError, match=r"q: expected an array of states .* could be either"):
            FLAT.forward_kinematics(flat[:4])


def test_a_list_of_as_many_arrays_as_numbers_is_refused():
    """[x, y, ..., psi] with seven samples was read as seven states."""
    arm = hp.Mechanism([dataclasses.replace(PAIR, name=name) for name in "abc"])
    for compute, count in ((PAIR.forward_kinematics, 7), (FLAT.forward_kinematics, 4), (arm.forward_kinematics, 3)):
        rows = list(generator(64).normal(size=(count, count)))
        with pytest.raises(hp.ShapeError, match=r"^q: expected an array of states .* could be either"):
            compute(rows)
        compute(np.array(rows))
        compute([row.tolist() for row in rows])
        compute([*rows, rows[0]])
