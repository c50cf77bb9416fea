"""Numbers in doubtful units: what is told, and what is not."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.tables.suspicions import suspicions


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (1.0, "t steps by 1 s: is it in seconds? Milliseconds become seconds by 1e-3 * t."),
        (10.0, "t steps by 10 s: is it in seconds? Milliseconds become seconds by 1e-3 * t."),
        (5000.0, "t steps by 5e+03 s: is it in seconds? Microseconds become seconds by 1e-6 * t."),
        (5e6, "t steps by 5e+06 s: is it in seconds? Nanoseconds become seconds by 1e-9 * t."),
        (0.005 / 86400, "t steps by 5.79e-08 s: is it in seconds? Days become seconds by 86400 * t."),
    ],
    ids=["1 ms", "10 ms", "us", "ns", "days"],
)
def test_instants_in_other_units_are_suspicious(step: float, words: str) -> None:
    t = 3.0 + step * np.arange(50)
    t[20] = np.nan
    assert suspicions("instants", "t", t) == [words]


@pytest.mark.parametrize("step", [0.9, 0.1, 0.005, 1e-4, 2e-6])
def test_seconds_are_not(step: float) -> None:
    """A gap of minutes changes nothing: the usual step counts."""
    t = 1.7e9 + step * np.arange(50)
    t[30:] += 600.0
    assert suspicions("instants", "t", t) == []


@pytest.mark.parametrize("span", [13.0, 90.0, 180.0, 720.0])
def test_angles_of_many_turns_that_may_be_degrees_are_suspicious(span: float) -> None:
    angles = np.append(np.linspace(-span / 2, span / 2, 30), np.nan)
    (sentence,) = suspicions("angle", "psi", angles)
    assert sentence.startswith(f"psi spans {span:.3g} rad, {span / (2 * np.pi):.3g} turns: is it in radians?")
    assert "numpy.radians(psi)" in sentence


@pytest.mark.parametrize("span", [0.0, 1.6, 2 * np.pi, 12.5, 721.0, 1e4])
def test_hinges_and_wheels_are_not(span: float) -> None:
    """Where an angle stands does not matter, only how much of it there is."""
    assert suspicions("angle", "psi", 1000.0 + np.linspace(0, span, 30)) == []
    assert suspicions("angle", "psi", np.full(3, np.nan)) == []


def test_bodies_far_apart_are_suspicious() -> None:
    assert suspicions("distance", "R2 - R1", np.array([np.nan, 40.0, 60.0, 1e5])) == [
        "R2 - R1 is 60 m long: is it in metres? Millimetres become metres by the factor 1e-3."
    ]
    assert suspicions("distance", "R2 - R1", np.array([0.4, 0.6, 1e5])) == []
    assert suspicions("distance", "R2 - R1", np.array([np.nan])) == []
