"""Tables, units, and numbers in few characters."""

from __future__ import annotations

from hingepair.tables.sheets import Sheet, Shown


def test_notebooks_show_what_cannot_break_out_of_a_cell() -> None:
    class Pair(Shown):
        def _sheet(self) -> Sheet:
            return Sheet("<b>", (("h",), ("a & b",)), ("x < y",))

    assert Pair()._repr_html_() == (
        "<table><caption>&lt;b&gt;</caption><thead><tr><th>h</th></tr></thead>"
        "<tbody><tr><td>a &amp; b</td></tr></tbody></table><p>x &lt; y</p>"
    )
