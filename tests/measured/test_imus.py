"""The hinge from two inertial sensors alone: axis, point, angle, biases and clocks."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.measured.imus import ImuFit
from support.recorded import HOME, N1, U1, U2, truth

T = np.arange(600) / 100
PAIR = hp.HingePair(u1=U1, u2=U2, n=N1, home=HOME)
N2 = HOME.T @ N1
POINT = np.concatenate((U1 - (U1 @ N1) * N1, U2 - (U1 @ N1) * N2))


def felt(
    moving: float = 1.0, hinge: float = 1.0, noise: float = 0.0, seed: int = 0, t: np.ndarray = T
) -> list[np.ndarray]:
    """omega1, f1, omega2, f2 in the axes of their bodies."""
    zero = np.zeros_like(t)
    parts = [
        (np.sin(t), np.cos(t), -np.sin(t)),
        (0.3 * np.cos(2 * t), -0.6 * np.sin(2 * t), -1.2 * np.cos(2 * t)),
        (zero, zero, zero),
        *(
            (
                moving * a * np.sin(w * t + p),
                moving * a * w * np.cos(w * t + p),
                -moving * a * w * w * np.sin(w * t + p),
            )
            for a, w, p in ((1.0, 1.3, 0.0), (0.6, 2.1, 1.0), (1.0, 0.9, 1.6))
        ),
        (hinge * np.sin(2.3 * t), hinge * 2.3 * np.cos(2.3 * t), -hinge * 5.29 * np.sin(2.3 * t)),
    ]
    q, qd, qdd = (np.stack(own, axis=-1) for own in zip(*parts, strict=True))
    state = PAIR.forward_kinematics(q, qd, qdd, outputs=("S1", "omega1", "a1", "S2", "omega2", "a2"))
    g = np.array([0, 0, -9.81])
    world = ((state.S1, state.omega1), (state.S1, state.a1 - g), (state.S2, state.omega2), (state.S2, state.a2 - g))
    rng = np.random.default_rng(seed)
    exact = [np.einsum("nji,nj->ni", S, v) for S, v in world]
    return [v + k * noise * rng.standard_normal(v.shape) for v, k in zip(exact, (1, 5, 1, 5), strict=True)]


def fitted(columns: list[np.ndarray], t: np.ndarray = T, t2: np.ndarray | None = None, **options: float) -> ImuFit:
    second = hp.ImuRecording(t if t2 is None else t2, columns[2], columns[3])
    return hp.fit_imus(hp.ImuRecording(t, columns[0], columns[1]), second, **options)


def true_angle(t: np.ndarray) -> np.ndarray:
    """Psi of `felt` with the home that fits have."""
    return np.sin(2.3 * t) + hp.rotation_log(HOME @ truth(1.0)[3].T) @ N1


def scores(found: ImuFit, t: np.ndarray = T) -> dict[str, np.ndarray]:
    """Errors in standard deviations."""
    off = np.concatenate((found.pair.u1, found.pair.u2)) - POINT
    return {
        "point": off / np.concatenate((found.std["u1"], found.std["u2"])),
        "n": (found.pair.n - N1) / found.std["n"],
        "psi": (found.psi - true_angle(t)) / found.std["psi"],
    }


@pytest.mark.slow
def test_exact_readings_give_the_hinge() -> None:
    found = fitted(felt(), T + 1.7e9)
    assert found.ok
    assert np.abs(found.pair.n - N1).max() < 1e-6  # as all below: left by splines between readings
    assert np.abs(found.pair.home.T @ found.pair.n - N2).max() < 1e-6
    assert np.abs(np.concatenate((found.pair.u1, found.pair.u2)) - POINT).max() < 1e-4
    assert np.abs(found.psi - true_angle(T)).max() < 1e-4
    assert np.abs(found.psid - 2.3 * np.cos(2.3 * T)).max() < 1e-4
    assert abs(found.clock_offset) < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("moving", [1.0, 0.3])
def test_noisy_readings_with_biases_give_it_within_what_is_told(moving: float) -> None:
    all_scores: dict[str, list[np.ndarray]] = {"point": [], "n": [], "psi": []}
    for seed in range(2):
        biases = np.random.default_rng(1000 + seed).normal(size=(4, 3)) * np.array([[0.02], [0.1], [0.02], [0.1]])
        found = fitted([own + bias for own, bias in zip(felt(moving, noise=1e-2, seed=seed), biases, strict=True)])
        for name, values in scores(found).items():
            all_scores[name].append(values)
        for name, own in (("gyroscope_bias", biases[::2]), ("accelerometer_bias", biases[1::2])):
            assert np.abs((getattr(found, name) - own) / found.std[name]).max() < 4.5
    for name, values in all_scores.items():
        assert np.sqrt(np.mean(np.square(values))) < 1.6, name


@pytest.mark.slow
@pytest.mark.parametrize("still", ["moving", "hinge"])
def test_what_the_motion_does_not_show_is_not_told(still: str) -> None:
    """Body 1 at rest shows its axis by its accelerometer alone; bodies that turn as one show none."""
    found = fitted(felt(**{still: 0.0}, noise=1e-2))
    assert not found.ok
    assert {"axis", "point"} & {finding.name for finding in found.findings}
    wrong = np.abs(np.concatenate((found.pair.u1, found.pair.u2)) - POINT)
    assert (wrong < 5 * np.concatenate((found.std["u1"], found.std["u2"])) + 1e-3).all()  # m, of splines


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.05, 40.0])
def test_points_far_from_the_starts_are_found(scale: float) -> None:
    """Levers of centimetres and of tens of metres; the starts are some decimetres long."""
    columns = felt()
    for k, u in ((0, U1), (2, U2)):
        alpha = np.gradient(columns[k], T, axis=0, edge_order=2)
        turning = np.cross(columns[k], np.cross(columns[k], u)) + np.cross(alpha, u)
        columns[k + 1] = columns[k + 1] - (scale - 1) * turning
    found = fitted(columns)
    off = np.abs(np.concatenate((found.pair.u1, found.pair.u2)) - scale * POINT).max()
    assert off < 3e-3 * scale  # left by differences of the rates


@pytest.mark.slow
@pytest.mark.parametrize("late", [-0.035, 0.3])
def test_two_recordings_give_the_hinge_whatever_their_clocks(late: float) -> None:
    """Sensor 2 has other instants, and is read later than it says."""
    t2 = T[:-7] + 0.0037
    columns = [*felt(noise=1e-2)[:2], *felt(noise=1e-2, seed=1, t=t2 + late)[2:]]
    found = fitted(columns, T, t2)
    assert found.ok, found
    assert abs(found.clock_offset - late) < 4.5 * found.std["clock_offset"]
    assert found.std["clock_offset"] < 1e-3  # s, of a noise of 1e-2
    assert np.nanmax(np.abs(scores(found)["psi"])) < 6


@pytest.mark.slow
def test_clocks_that_drift_do_not_turn_the_angle() -> None:
    """Crystals 50 ppm apart for 100 s: 5 ms at the end, or 0.6 degrees at the fastest."""
    t = np.arange(10_000) / 100
    columns = [*felt(noise=1e-2, t=t)[:2], *felt(noise=1e-2, seed=1, t=t + 50e-6 * t)[2:]]
    found = fitted(columns, t)
    assert found.ok, found
    assert abs(found.clock_drift - 50e-6) < 4.5 * found.std["clock_drift"] < 20e-6
    assert np.abs(scores(found, t)["psi"]).max() < 6


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.7, 3.3])
def test_a_gap_is_left_out_and_adds_no_whole_turns(seconds: float) -> None:
    t = np.arange(1000) / 100
    columns, hidden = felt(noise=1e-2, t=t), np.abs(t - 3 - seconds / 2) <= seconds / 2
    columns[1][hidden] = np.nan
    found = fitted(columns, t)
    assert found.ok
    assert (np.isnan(found.psi) == hidden).all()
    assert found.samples == t.size - hidden.sum()
    assert "Whole turns during a gap are not seen" in " ".join(found.findings)
    assert np.nanmax(np.abs(scores(found, t)["psi"])) < 6


CONTRADICTIONS = {
    "degrees a second": lambda o1, f1, o2, f2: (np.degrees(o1), f1, np.degrees(o2), f2),
    "multiples of g": lambda o1, f1, o2, f2: (o1, f1 / 9.80665, o2, f2 / 9.80665),
    "a gyroscope 1 % off": lambda o1, f1, o2, f2: (o1, f1, 1.01 * o2, f2),
    "axes exchanged": lambda o1, f1, o2, f2: (o1, f1[:, [1, 0, 2]], o2, f2),
    "no hinge": lambda o1, f1, o2, f2: (
        o1,
        f1,
        np.random.default_rng(0).normal(size=o2.shape).cumsum(axis=0) / 9,
        f2,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_records_that_contradict_each_other_are_not_relied_on(name: str) -> None:
    found = fitted(list(CONTRADICTIONS[name](*felt(noise=1e-2))))
    assert not found.ok, found
    assert str(found).endswith("NOT RELIABLE")


def test_forces_that_no_point_explains_are_told_beside_what_the_sensors_differ_by() -> None:
    """Not beside the weight that both feel, which would hide a tenth of it."""
    columns = felt(noise=1e-2)
    columns[3] = columns[3] + 0.3 * np.sin(3.1 * T)[:, None] * (1, 0, 0)
    assert "no point is in both bodies" in fitted(columns).findings[0]
