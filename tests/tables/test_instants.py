"""Instants of recordings: exact differences, kinds told by type, faults named, gaps cut."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.tables.instants import elapsed_seconds, increasing_seconds, instants_of, split_at_gaps
from support.near import U

STEP_NS = 5_000_001


def test_nanoseconds_since_1970_lose_nothing() -> None:
    t = 1_700_000_000_123_456_789 + STEP_NS * np.arange(5)
    for stamps in (t, t.astype("datetime64[ns]"), t.astype(np.uint64)):
        seconds, _ = increasing_seconds("t", stamps)
        assert np.abs(seconds - STEP_NS * 1e-9 * np.arange(5)).max() <= 2e-18  # s: half a unit in the last place


def test_months_begin_on_their_first_day() -> None:
    for read in (increasing_seconds, elapsed_seconds):
        seconds, _ = read("t", np.array(["2026-01", "2026-02", "2026-03"], "datetime64[M]"))
        assert seconds.tolist() == [0, 31 * 86400, 59 * 86400]
    assert instants_of("t", np.array(["2026", "2027"], "datetime64[Y]"))[1] == pytest.approx(365 * 86400, rel=2 * U)
    with pytest.raises(
        hp.errors.DtypeError, match=r"t: expected a timedelta64 of weeks or shorter units, got timedelta64\[M\]"
    ):
        elapsed_seconds("t", np.arange(3).astype("timedelta64[M]"))


@pytest.mark.parametrize("zone", ["UTC", "Europe/Berlin"])
def test_stamps_of_pandas_with_a_time_zone_are_instants(zone: str) -> None:
    pandas = pytest.importorskip("pandas")
    t = pandas.date_range("2026-10-25T00:30", periods=4, freq="30min", tz=zone)  # an hour comes twice in Berlin
    for stamps in (t, pandas.Series(t)):
        assert (
            increasing_seconds("t", stamps)[0].tolist() == instants_of("t", stamps).tolist() == [0, 1800, 3600, 5400]
        )


def test_other_stamps_of_the_same_clock_count_from_the_same_instant() -> None:
    t = np.datetime64("2026-11-21T10:00:00.000000000") + np.arange(4) * np.timedelta64(STEP_NS, "ns")
    _, first = increasing_seconds("t", t)
    seconds, _ = elapsed_seconds("to", t[2:].astype("datetime64[ns]"), first)
    assert seconds[0] == pytest.approx(2 * STEP_NS * 1e-9, rel=U)
    with pytest.raises(hp.errors.DtypeError, match="to: expected datetime64, got float seconds"):
        elapsed_seconds("to", [0.1], first)


def test_pieces_are_cut_where_samples_are_missing() -> None:
    t = np.concatenate((np.arange(10) * 0.01, 0.5 + np.arange(10) * 0.01))
    known = np.ones(20, dtype=bool)
    known[3:5] = False  # 30 ms: bridged
    known[13:18] = False  # 60 ms: a gap
    found = split_at_gaps(t, known, 0.05)
    assert [piece.tolist() for piece in found] == [[0, 1, 2, 5, 6, 7, 8, 9], [10, 11, 12], [18, 19]]
    assert len(split_at_gaps(t, known, 0.05, min_samples=4)) == 1


def test_slow_recordings_are_not_all_gaps() -> None:
    t = np.arange(20.0)
    assert len(split_at_gaps(t, np.ones(20, dtype=bool), 0.05)) == 1
