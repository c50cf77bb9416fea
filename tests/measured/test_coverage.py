"""Every standard deviation of fits holds the error in 90 to 99 % of 200 runs, or a finding says that it may not.

Fewer runs are judged by what as many runs of true intervals show.

The recordings are made from SciPy's rotations and finite differences; nothing of the library is in them.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom

import hingepair as hp
from support.recorded import N1, U1, U2

RUNS, COUNT = 200, 120
HOME = Rotation.from_rotvec((0.3, -0.5, 0.2))
N2 = HOME.inv().apply(N1)
POINT = np.concatenate((U1 - (U1 @ N1) * N1, U2 - (U1 @ N1) * N2))
TOLD = re.compile("rough|depend by|not at random|hardly")
UNEQUAL = np.where(np.arange(COUNT) % 2, 4.0, 1.0)


def coloured(rng: np.random.Generator, shape: tuple[int, ...], share: float) -> np.ndarray:
    noise = rng.standard_normal(shape)
    for i in range(1, shape[0] if share else 0):
        noise[i] = share * noise[i - 1] + np.sqrt(1 - share**2) * noise[i]
    return noise


def angle(t: np.ndarray) -> np.ndarray:
    return 1.1 * np.sin(2 * t) + 0.3 * np.cos(5 * t)


def motion(t: np.ndarray, fixed: bool = False) -> tuple[np.ndarray, Rotation, np.ndarray, Rotation]:
    """R1, S1, R2, S2 without noise."""
    R1, S1 = np.zeros((t.size, 3)), Rotation.identity(t.size)
    if not fixed:
        turn = np.stack((np.sin(0.7 * t), np.cos(1.1 * t), 0.5 * np.sin(t)), axis=-1)
        R1, S1 = np.stack((np.sin(t), np.cos(t), 0.1 * t), axis=-1), Rotation.from_rotvec(turn)
    S2 = S1 * Rotation.from_rotvec(angle(t)[:, None] * N1) * HOME
    return R1, S1, R1 + S1.apply(U1) - S2.apply(U2), S2


def angle_of_zero() -> float:
    """Angle of `motion` at which psi of a fit is 0: home is the shortest turn from N2 to N1."""
    shortest, _ = Rotation.align_vectors([N1], [N2])
    return float((HOME * shortest.inv()).as_rotvec() @ N1)


def angle_on_circle(psi: np.ndarray) -> np.ndarray:
    """Angle of the point R2, counted from the x axis of body 1, which is far from N1."""
    off = Rotation.from_rotvec(psi[:, None] * N1).apply(-HOME.apply(U2))
    start = np.array((1.0, 0, 0)) - N1[0] * N1
    return np.arctan2(off @ np.cross(N1, start), off @ start)


def poses(
    seed: int,
    *,
    places: tuple[float, float] = (1e-3, 1e-3),
    attitudes: tuple[float, float] = (5e-3, 5e-3),
    fixed: bool = False,
    share: float = 0.0,
    planar: bool = False,
    sizes: np.ndarray | float = 1.0,
    gaps: bool = False,
    outliers: float = 0.0,
    late: float = 0.0,
    count: int = COUNT,
) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Instants, [R1, S1, R2, S2] and psi; the clock of body 2 is late."""
    rng = np.random.default_rng(seed)
    t = 6 / count * np.arange(count)

    R1, S1, _, _ = motion(t, fixed)
    _, _, R2, S2 = motion(t + late, fixed)
    noise = [coloured(rng, (count, 3), share) * np.reshape(sizes, (-1, 1)) for _ in range(4)]
    if planar:
        noise = [
            part * along for part, along in zip(noise, ((1, 1, 0), (1, 1, 0), (0, 0, 1), (0, 0, 1)), strict=True)
        ]
    R1, R2 = R1 + places[0] * noise[0], R2 + places[1] * noise[1]
    S1, S2 = (
        S * Rotation.from_rotvec(size * part) for S, size, part in zip((S1, S2), attitudes, noise[2:], strict=True)
    )
    made = [R1, S1.as_matrix(), R2, S2.as_matrix()]
    off = rng.random(count) < outliers
    made[2][off] += 0.5 * rng.standard_normal((off.sum(), 3))
    if gaps:
        made[2][30:45] = made[0][80:90] = np.nan
    return t, made, angle(t)


def judge(scores: dict[str, list[np.ndarray]], told: list[bool]) -> None:
    """Errors in standard deviations by quantity and run; runs in which a finding tells are left out."""
    untold = ~np.array(told)
    if untold.sum() < untold.size // 4:
        return
    for name, each in scores.items():
        z = np.array(each)[untold]
        tries = len(z) * min(z.shape[1], 2)  # at least two components of a vector err on their own
        low, high = binom.ppf((0.001, 0.999), tries, 0.95) / tries
        assert min(low, 0.9) <= np.nanmean(np.where(np.isnan(z), np.nan, np.abs(z) < 1.96)) <= max(high, 0.99), name


LOOSE = {"places": (0.0, 3e-3), "attitudes": (0.0, 0.03)}
MOVING = "tag beside a moving body"
KINDS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "equal": ({}, {}),
    "weights": ({"sizes": UNEQUAL}, {"weights": 1e4 / UNEQUAL**2}),
    "weights, outliers": ({"sizes": UNEQUAL, "outliers": 0.1}, {"weights": 1e-4 / UNEQUAL**2, "loss": "cauchy"}),
    "weights, gaps": ({"sizes": UNEQUAL, "gaps": True}, {"weights": 1e6 / UNEQUAL**2}),
    "tag beside a base at rest": ({"fixed": True} | LOOSE, {}),
    MOVING: (LOOSE, {"noise1": (0, 0), "noise2": (3e-3, 0.03)}),
    "noise given, weights": (
        {"attitudes": (0.02, 0.01), "sizes": UNEQUAL},
        {"noise1": (1e-3, 0.02), "noise2": (1e-3, 0.01), "weights": 1 / UNEQUAL**2},
    ),
}

FEW: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {  # 80 runs each, 40 with clocks
    "planar, weights": ({"planar": True, "sizes": UNEQUAL}, {"weights": 1 / UNEQUAL**2}),
    "planar, outliers": ({"planar": True, "outliers": 0.1}, {"loss": "cauchy"}),
    "coloured": ({"share": 0.5}, {}),
    "coloured, outliers": ({"share": 0.5, "outliers": 0.1}, {"loss": "cauchy"}),
    "clocks, weights": ({"late": 0.02, "sizes": UNEQUAL}, {"weights": 1 / UNEQUAL**2}),
    "clocks, gaps": ({"late": 0.02, "gaps": True}, {}),
    "gaps, coloured": ({"gaps": True, "share": 0.5}, {}),
    "split unknown": ({"attitudes": (2e-3, 0.02)}, {}),
    "noise given, outliers": (
        {"attitudes": (0.02, 0.01), "outliers": 0.1},
        {"noise1": (1e-3, 0.02), "noise2": (1e-3, 0.01), "loss": "cauchy"},
    ),
}


@pytest.mark.proof
@pytest.mark.parametrize(
    ("name", "what"),
    [
        *((name, "body") for name in (*KINDS, *FEW)),
        ("equal", "point"),
        (MOVING, "point"),
        ("clocks, gaps", "point"),
        ("weights, outliers", "point"),
    ],
)
def test_errors_of_a_fit_are_within_its_intervals(name: str, what: str) -> None:
    judge_fits(name, what, RUNS if name in KINDS else 40 if "clocks" in name else 80)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "what"),
    [("equal", "body"), ("equal", "point"), (MOVING, "body"), ("tag beside a base at rest", "body")],
)
def test_errors_of_a_few_fits_are_within_their_intervals(name: str, what: str) -> None:
    judge_fits(name, what, 25)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["body", "point"])
@pytest.mark.parametrize("count", [10, 16])
def test_errors_of_short_recordings_are_within_their_intervals(count: int, what: str) -> None:
    judge_fits("equal", what, 100, count)


def judge_fits(name: str, what: str, runs: int, count: int = COUNT) -> None:
    """Fit so many recordings of a kind, and judge the errors."""
    made, told = (KINDS | FEW)[name]
    made = made | {"count": count}
    if what == "point":
        told = {key: value for key, value in told.items() if not key.startswith("noise")}
    scores: dict[str, list[np.ndarray]] = {}
    findings = []
    for seed in range(runs):
        t, (R1, S1, R2, S2), psi = poses(seed, **made)
        more = {"t": t} if "late" in made else {}
        body2 = hp.BodyMotion(R=R2) if what == "point" else hp.BodyMotion(R=R2, S=S2)
        found = hp.fit(hp.BodyMotion(R=R1, S=S1), body2, **told, **more)
        sign = np.sign(found.pair.n @ N1)
        true = {"u1": POINT[:3], "n": sign * N1} | ({} if what == "point" else {"u2": POINT[3:]})
        for key, value in true.items():
            scores.setdefault(key, []).append((getattr(found.pair, key) - value) / np.maximum(found.std[key], 1e-300))
        true_psi = angle_on_circle(psi) if what == "point" else psi + angle_of_zero()
        turned = np.angle(np.exp(1j * (sign * found.psi - true_psi)))
        turned[found.gap > 0.05] = np.nan  # angles of outliers are excepted
        scores.setdefault("psi", []).append(turned / found.std["psi"])
        if "late" in made:
            off = (found.clock_offset - made["late"]) / found.std["clock_offset"]
            scores.setdefault("clock_offset", []).append(np.array([off]))
        # Of coloured noise every short recording is doubted; its intervals are wide enough all the same.
        findings.append("share" not in made and (not found.ok or bool(TOLD.search(" ".join(found.findings)))))
    judge(scores, findings)


@pytest.mark.proof
@pytest.mark.parametrize("markers", [3, 5])
@pytest.mark.parametrize("given", [True, False], ids=["reference", "no reference"])
def test_noise_of_a_cluster_is_within_what_so_many_markers_tell(markers: int, given: bool) -> None:
    places = np.array([(0.1, 0, 0), (-0.1, 0.05, 0.02), (0, -0.07, 0), (0.03, 0, 0.1), (0.05, 0.08, -0.06)])[:markers]
    scores, findings = [], []
    for seed in range(RUNS):
        _, (R1, S1, *_), _ = poses(seed, places=(0, 0), attitudes=(0, 0))
        noise = 1e-3 * np.random.default_rng(seed).standard_normal((COUNT, markers, 3))
        found = hp.fit_cluster(R1[:, None] + np.einsum("nij,mj->nmi", S1, places) + noise, places if given else None)
        free = COUNT * (3 * markers - 6)
        scores.append(np.array([(found.noise / 1e-3 - 1) * np.sqrt(2 * free)]))
        findings.append(not found.ok)
    judge({"noise": scores}, findings)


def felt(t: np.ndarray) -> list[np.ndarray]:
    """omega1, force1, omega2, force2 without noise, each in the axes of its body."""
    h = 1e-3  # s
    before, now, after = (motion(t + step) for step in (-h, 0, h))
    columns = []
    for k in (0, 2):
        acceleration = (before[k] - 2 * now[k] + after[k]) / h**2
        columns.append((before[k + 1].inv() * after[k + 1]).as_rotvec() / (2 * h))
        columns.append(now[k + 1].inv().apply(acceleration + np.array((0, 0, 9.81))))
    return columns


@pytest.mark.proof
@pytest.mark.parametrize("late", [0.0, 0.02])
def test_errors_from_inertial_sensors_are_within_the_intervals(late: float) -> None:
    t = 0.025 * np.arange(200)
    psi = angle(t) + angle_of_zero()
    scores: dict[str, list[np.ndarray]] = {"axis": [], "point": [], "psi": [], "clock": []}
    findings = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        exact = [*felt(t)[:2], *felt(t + late)[2:]]
        omega1, force1, omega2, force2 = (
            column + size * rng.standard_normal(column.shape)
            for column, size in zip(exact, (0.01, 0.05, 0.01, 0.05), strict=True)
        )
        imus = hp.ImuRecording(t, omega1, force1), hp.ImuRecording(t, omega2, force2)
        found = hp.fit_imus(*imus)
        sign = np.sign(found.pair.n @ N1)
        scores["axis"].append((found.pair.n - sign * N1) / found.std["n"])
        off = np.concatenate((found.pair.u1, found.pair.u2)) - POINT
        scores["point"].append(off / np.concatenate((found.std["u1"], found.std["u2"])))
        turned = sign * found.psi - psi
        turned -= 2 * np.pi * np.round(np.nanmedian(turned) / (2 * np.pi))
        scores["psi"].append((turned / found.std["psi"])[::20])
        scores["clock"].append(np.array([(found.clock_offset - late) / found.std["clock_offset"]]))
        findings.append(not found.ok)
    assert not any(findings)
    judge(scores, findings)
