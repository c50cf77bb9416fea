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
)


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
