"""Tables, units, and numbers in few characters."""

from __future__ import annotations

import json
import math

from hingepair.tables.sheets import (
    Sheet,
    Shown,
    finite_or_none,
    instant_text,
    json_text,
    ruled_table,
)


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


def test_late_instants_keep_their_digits() -> None:
    assert [instant_text(t) for t in (0.0, 1 / 3, 99999.0, -1e5, 1763746391.25)] == [
        *("0", "0.333333", "99999", "-100000.0", "1763746391.25"),
    ]


def test_reports_in_json_hold_null_where_a_number_is_not_finite() -> None:
    report = {"a": [1.0, math.nan], "b": {"c": (math.inf, 2, "x", None, True)}}
    assert json.loads(json_text(report)) == {"a": [1.0, None], "b": {"c": [None, 2, "x", None, True]}}
    assert finite_or_none(-math.inf) is None
    assert finite_or_none(0.0) == 0.0


def test_notebooks_show_what_cannot_break_out_of_a_cell() -> None:
    class Pair(Shown):
        def _sheet(self) -> Sheet:
            return Sheet("<b>", (("h",), ("a & b",)), ("x < y",))

    assert Pair()._repr_html_() == (
        "<table><caption>&lt;b&gt;</caption><thead><tr><th>h</th></tr></thead>"
        "<tbody><tr><td>a &amp; b</td></tr></tbody></table><p>x &lt; y</p>"
    )
