"""Findings: sentences on what the numbers of a fit do not say, such as what the motion did not show."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any, Final

import numpy as np

from hingepair.tables.sheets import Sheet, Shown, align_columns, json_text
from hingepair.tables.units import Units

RANDOM_CORRELATION = 0.5  # of neighbouring residuals; above, they are not noise
_QUANTITY: Final = re.compile(r"(-?[\d.]+(?:e[-+]?\d+)?) (mm|m|deg|rad)(?![\w/^])")  # not of rates
_IN_SI: Final = {"m": ("m", 1.0), "mm": ("m", 1e-3), "rad": ("rad", 1.0), "deg": ("rad", np.pi / 180)}


class Finding(str):
    """A sentence of a report on a fit, with what it was judged by.

    Attributes:
        name: what was judged, such as "axis".
        value: what was found of it.
        limit: the value above which it is a finding.
        severity: "serious" if a number of the fit may be wrong by more than its standard deviations, or "note".
    """

    name: str
    value: float
    limit: float
    severity: str

    def __new__(
        cls, name: str, value: float = np.nan, limit: float = 0.0, text: str = "", *, harmless: bool = False
    ) -> Finding:
        """Make a finding of its sentence `text`; a `harmless` one is a note."""
        made = super().__new__(cls, text or name)
        made.name, made.value, made.limit = name, float(value), float(limit)
        made.severity = "note" if harmless else "serious"
        return made

    def text(self, units: Units) -> str:
        """Return the sentence with its lengths and angles in other units, where these are named.

        >>> Finding("axis", 0.04, 0.03, "The axis is known to 2.3 deg only.").text(Units("rad, mm"))
        'The axis is known to 0.04 rad only.'
        """

        def converted(found: re.Match[str]) -> str:
            si, factor = _IN_SI[found[2]]
            wanted = units.over(Units(found[2]))  # stays unless another one is named
            if wanted.unit(si) == found[2]:
                return found[0]
            return f"{float(found[1]) * factor * wanted.factor(si):.2g} {wanted.unit(si)}"

        return _QUANTITY.sub(converted, self)

    @property
    def is_note(self) -> bool:
        """Whether the fit can be relied on in spite of it."""
        return self.severity == "note"


def notes(name: str, sentences: Iterable[str]) -> list[Finding]:
    """Return sentences that leave a fit reliable as findings."""
    return [Finding(name, 1, 0, sentence, harmless=True) for sentence in sentences]


def exceeded(*findings: Finding) -> list[Finding]:
    """Return the findings whose values are above their limits, or NaN."""
    return [finding for finding in findings if not finding.value <= finding.limit]


def is_reliable(findings: Iterable[Finding]) -> bool:
    """Return whether no finding says that a number may be wrong by more than its standard deviations."""
    return all(finding.is_note for finding in findings)


def memory_finding(lag: int, what: str) -> Finding:
    """Return a note that residuals are correlated over `lag` samples, too long for the recording; of 0 it is none."""
    text = f"What is left of {what} is correlated over {lag} samples and more, too long relative to the whole "
    return Finding("memory", lag, 0, text + "recording: the standard deviations are rough.", harmless=True)


def few_samples_finding(count: int, least: int) -> Finding:
    """Return a finding that standard deviations are rough, exceeded if there are fewer samples than `least`."""
    text = f"Of {count} samples, the standard deviations are no more than a hint."
    return Finding("samples", least - count, 0, text)


class Judged:
    """Base of the results of fits, which have findings."""

    __slots__ = ()
    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """Whether no finding says that a number may be wrong by more than its standard deviations."""
        return is_reliable(self.findings)


class Report(Judged, Shown):
    """Base of the results of fits that are printed, shown in notebooks as a table, and written as JSON."""

    __slots__ = ()
    samples: int
    _sheet: Callable[..., Sheet]  # the table, with sentences below it
    _numbers: Callable[[], dict[str, Any]]  # of the JSON report

    def printed(self, sheet: Sheet) -> str:
        """Return the text of a table with the verdict."""
        title, rows, sentences = sheet
        return "\n".join((title, *align_columns(rows, ()), *sentences, "ok" if self.ok else "NOT RELIABLE"))

    def __str__(self) -> str:
        return self.printed(self._sheet())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.samples} samples, {'ok' if self.ok else 'not ok'})"

    def to_json(self) -> str:
        """Return a report as JSON text, in SI units. Numbers that are not finite become null."""
        report = {"ok": self.ok, "samples": self.samples, **self._numbers(), "findings": list(self.findings)}
        return json_text(report)
