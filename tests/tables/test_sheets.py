"""Tables, units, and numbers in few characters."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from hingepair.tables.sheets import (
    Sheet,
    Shown,
    align_columns,
    cell_text,
    finite_or_none,
    instant_text,
    json_text,
    left_out_remark,
    percent,
    ruled_table,
    sheet_of,
    unit_of,
)


@pytest.mark.parametrize(
    ("share", "text"), [(0.996, "100 %"), (12.34, "1234 %"), (0.0456, "4.6 %"), (1e-7, "1e-05 %"), (0.0, "0 %")]
)
def test_percentages_have_two_digits_and_none_is_1e_2(share: float, text: str) -> None:
    assert percent(share) == text
    assert percent(np.float64(share)) == text


def test_columns_are_padded_and_lines_end_without_blanks() -> None:
    lines = [("name", "n", "word"), ("a", "10", "x"), ("long name", "2", "")]
    assert align_columns(lines, {1}) == ["name        n  word", "a          10  x", "long name   2"]
    assert align_columns(lines, ()) == ["name       n   word", "a          10  x", "long name  2"]


def test_tables_wider_than_the_line_go_on_below() -> None:
    lines = [("", "a", "bb", "ccc"), ("row", "1", "2", "3"), (), ("other", "10", "20", "300")]
    whole = ruled_table(lines)
    assert whole == ["        a  bb  ccc", "------------------", "row     1   2    3", "", "other  10  20  300"]
    assert ruled_table(lines, width=18) == whole
    parts = ruled_table(lines, width=17)
    assert parts == [
        *("        a  bb", "-------------", "row     1   2", "", "other  10  20"),
        *("", "       ccc", "----------", "row      3", "", "other  300"),
    ]
    assert "300" in "".join(ruled_table(lines, width=1))  # no cell is cut
    assert ruled_table([("k", "u", "a", "b"), ("x", "m", "1", "2")], key_column_count=2, width=8) == [
        *("k  u  a", "-------", "x  m  1", "", "k  u  b", "-------", "x  m  2"),
    ]


@pytest.mark.parametrize(
    ("skipped", "words"),
    [
        (0, ""),
        (1, " (1 of 20 samples is not finite and was left out)"),
        (3, " (3 of 20 samples are not finite and were left out)"),
    ],
)
def test_samples_that_were_left_out_are_said(skipped: int, words: str) -> None:
    assert left_out_remark(skipped, 20) == words


def test_late_instants_keep_their_digits() -> None:
    assert [instant_text(t) for t in (0.0, 1 / 3, 99999.0, -1e5, 1763746391.25)] == [
        *("0", "0.333333", "99999", "-100000.0", "1763746391.25"),
    ]


def test_reports_in_json_hold_null_where_a_number_is_not_finite() -> None:
    report = {"a": [1.0, math.nan], "b": {"c": (math.inf, 2, "x", None, True)}}
    assert json.loads(json_text(report)) == {"a": [1.0, None], "b": {"c": [None, 2, "x", None, True]}}
    assert finite_or_none(-math.inf) is None
    assert finite_or_none(0.0) == 0.0


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1 / 3, "0.333333"),
        (-0.0, "0"),
        (np.float64(2.5), "2.5"),
        (np.eye(2), "1, 0; 0, 1"),
        (np.arange(3.0), "0, 1, 2"),
        (np.zeros((3, 3)), "0, 0, 0; 0, 0, 0; 0, 0, 0"),
        (np.zeros((2, 5)), "array of shape (2, 5)"),
        (list(range(9)), "0, 1, 2, 3, 4, 5, 6, 7, 8"),
        (list(range(10)), "10 numbers"),
        ("words", "words"),
    ],
    ids=str,
)
def test_a_cell_is_short(value: object, text: str) -> None:
    assert cell_text(value) == text


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("R1_x", "m"),
        ("S1_xx", "1"),
        ("psidd", "rad/s^2"),
        ("alpha2_z", "rad/s^2"),
        ("u1", "m"),
        ("n", "1"),
        ("t", "s"),
    ],
)
def test_units_go_by_the_name(name: str, unit: str) -> None:
    assert unit_of(name) == unit


def test_sheets_have_values_and_units_and_leave_out_what_is_none() -> None:
    sheet = sheet_of("a pair", [("u1", np.arange(3.0)), ("limits", None), ("name", "door")], ("a note",))
    assert sheet == Sheet(
        "a pair", (("", "value", "unit"), ("u1", "0, 1, 2", "m"), ("name", "door", "1")), ("a note",)
    )


def test_notebooks_show_what_cannot_break_out_of_a_cell() -> None:
    class Pair(Shown):
        def _sheet(self) -> Sheet:
            return Sheet("<b>", (("h",), ("a & b",)), ("x < y",))

    assert Pair()._repr_html_() == (
        "<table><caption>&lt;b&gt;</caption><thead><tr><th>h</th></tr></thead>"
        "<tbody><tr><td>a &amp; b</td></tr></tbody></table><p>x &lt; y</p>"
    )
