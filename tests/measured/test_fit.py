"""The hinge found from two recordings: exact, noisy, with outliers, and where there is none."""

from __future__ import annotations

import functools
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import hingepair as hp
from hingepair.measured.statistics import LOSSES
from support.recorded import HOME, N1, U1, U2, bodies, recording, truth, turns

U = 2.0**-53


def errors(found: hp.HingeFit) -> np.ndarray:
    """Of u1, u2, n and home's rotation vector, from the truth in the same gauge and with the same sign; (12,)."""
    u1, u2, n, home = truth(np.sign(found.pair.n @ N1), found.gauge)
    turn = hp.rotation_log(found.pair.home @ home.T)
    return np.concatenate((found.pair.u1 - u1, found.pair.u2 - u2, found.pair.n - n, turn))


@pytest.mark.parametrize("gauge", ["closest_to_R1", "closest_to_R2"])
@pytest.mark.parametrize("turn", [1.0, 0.1, 8.0])
def test_exact_motion_gives_the_hinge_to_rounding(gauge: str, turn: float) -> None:
    made = recording(turn=turn)
    found = hp.fit(*bodies(made), gauge=gauge)
    off = np.abs(errors(found))
    assert off[6:9].max() < 8 * U / min(turn, 1)
    assert off[:6].max() < 64 * U * max(np.abs(made.R1).max(), np.abs(made.R2).max()) / min(turn, 1)
    assert off[9:].max() < 16 * U / min(turn, 1)
    assert found.ok
    assert found.findings == ()
    assert max(found.rms_position, found.rms_angle) < 64 * U


@pytest.mark.parametrize("loss", LOSSES)
def test_exact_motion_comes_to_rest(loss: str) -> None:
    """Steps that rounding makes are none, though against noise of its size they are many standard deviations."""
    for count, turn in ((60, 1.0), (400, 8.0)):
        found = hp.fit(*bodies(recording(count, turn=turn)), loss=loss)
        assert (found.ok, found.findings) == (True, ())


def test_psi_is_the_angle_that_home_and_sign_say() -> None:
    made = recording(turn=8.0)
    found = hp.fit(*bodies(made))
    state = found.pair.forward_kinematics_from_body1(bodies(made)[0], found.psi)
    assert np.abs(state.S2 - made.S2).max() < 16 * U * 10
    assert np.abs(state.R2 - made.R2).max() < 64 * U
    sign = np.sign(found.pair.n @ N1)
    assert np.ptp(found.psi - sign * made.psi) < 512 * U  # no jumps by 2 pi


@pytest.mark.slow
def test_an_angle_of_few_samples_is_as_uncertain_as_the_axis_that_they_tell() -> None:
    """Axes 150 degrees apart in both bodies, where psi = 0 moves 4 times as much as they do."""
    across = np.cross(N1, (1.0, 0.0, 0.0)) / np.linalg.norm(np.cross(N1, (1.0, 0.0, 0.0)))
    over = turns(np.radians(150) * across)
    scores = []
    for seed in range(30):
        psi = recording(24).psi
        made = recording(24, 1e-3, 5e-3, seed, Q=turns(psi[:, None] * N1) @ over)
        found = hp.fit(*bodies(made))
        off = np.angle(np.exp(1j * (np.sign(found.pair.n @ N1) * found.psi - psi)))
        scores.append(np.mean(off / found.std["psi"]))
    # All angles of a fit are off together; with the noise of samples alone, std["psi"] would be half as large.
    assert np.std(scores) == pytest.approx(1, abs=0.35)


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["soft_l1", "huber", "cauchy", "arctan"])
@pytest.mark.parametrize("kind", ["random", "swapped", "moved"])
def test_thirty_percent_of_outliers_are_survived(kind: str, loss: str) -> None:
    """Those that agree with each other, too."""
    made = recording(1000, 1e-3, 2e-3, outliers=0.3 if kind == "random" else 0.0)
    off = np.random.default_rng(5).random(1000) < 0.3
    if kind == "swapped":
        made.S2[off] = made.S2[off] @ turns((0, 0, np.pi))
    if kind == "moved":
        made.R2[off] += (0.1, 0.2, -0.3)
    found = hp.fit(*bodies(made), loss=loss)
    assert np.abs(errors(found)).max() < 1e-3  # m and rad, a noise of 700 samples
    assert found.ok
    assert "of the samples are outliers; they count little" in " ".join(found.findings)
    assert 0.25 < (found.weights < 0.1).mean() < 0.35
    assert np.isinf(found.std["psi"][found.weights < 0.1]).all()
    assert np.ptp((found.psi - np.sign(found.pair.n @ N1) * made.psi)[found.weights > 0.3]) < 0.05
    assert not hp.fit(*bodies(made)).ok


@pytest.mark.slow
@pytest.mark.parametrize("body", [1, 2])
@pytest.mark.parametrize("attitudes", [True, False], ids=["body", "point"])
def test_a_frozen_tracker_is_missing(body: int, attitudes: bool) -> None:
    made = recording(1000, 1e-3, 2e-3)
    for array in (made.R1, made.S1) if body == 1 else (made.R2, made.S2):
        array[300:350] = array[300]
    body1, body2 = bodies(made)
    found = hp.fit(body1, body2 if attitudes else hp.BodyMotion(R=made.R2))
    assert found.ok
    assert np.flatnonzero(np.isnan(found.psi)).tolist() == list(range(301, 350))
    assert f"49 samples of body {body} repeat the one before" in " ".join(found.findings)


def test_a_body_at_rest_is_not_frozen() -> None:
    made = recording(400)
    R2, S2 = made.R2.copy(), made.S2.copy()
    for array in (made.R1, made.S1, R2, S2):  # both rest for a while
        array[100:150] = array[100]
    found = hp.fit(hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=R2, S=S2))
    assert (found.samples, found.findings) == (400, ())


def test_missing_samples_are_left_out_and_said() -> None:
    made = recording(500, 1e-3, 2e-3)
    R2, S1 = made.R2.copy(), made.S1.copy()
    R2[100:120] = np.nan
    S1[300, 0, 0] = np.nan
    found = hp.fit(hp.BodyMotion(R=made.R1, S=S1), hp.BodyMotion(R=R2, S=made.S2))
    assert found.samples == 479
    assert np.flatnonzero(np.isnan(found.psi)).tolist() == [*range(100, 120), 300]
    assert found.findings == ("21 of 500 samples are missing or have no weight.",)
    kept = np.isfinite(found.psi)
    weighted = hp.fit(*bodies(made), weights=kept.astype(float))
    assert (weighted.pair.n == found.pair.n).all()


T = recording(2000).t
PSI = recording(2000).psi
SLOW = np.sin(1.3 * T)
ROLL = turns(PSI[:, None] * N1)
OTHERS = {
    "ball": (
        {"Q": turns(np.stack((PSI, 0.8 * SLOW, 0.7 * np.cos(1.9 * T)), axis=-1)) @ HOME},
        "A ball joint: one point stays in both bodies",
    ),
    "two hinges": (
        {"Q": ROLL @ HOME @ turns(0.8 * SLOW[:, None] * np.array([0.0, 0.0, 1.0]))},
        "Two hinges one after the other would do",
    ),
    "two parallel hinges": (
        {"Q": ROLL @ turns(0.8 * SLOW[:, None] * N1) @ HOME, "slip": ROLL @ np.array([0.2, 0, 0]) - (0.2, 0, 0)},
        "two parallel hinges one after the other",
    ),
    "sliding hinge": ({"slip": 0.1 * SLOW[:, None] * N1}, "Body 2 slides along the axis by 0.07 m rms"),
    "screw": ({"slip": 0.02 * PSI[:, None] * N1}, "a sliding hinge, or a screw"),
    "little turning": ({"turn": 0.01, "metres": 1e-3, "radians": 2e-3}, "little relative to attitude errors of"),
}


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1e-3], ids=["exact", "noisy"])
@pytest.mark.parametrize("name", OTHERS)
def test_what_is_no_hinge_is_said_in_a_sentence(name: str, noise: float) -> None:
    kind, words = OTHERS[name]
    made = recording(2000, **{"metres": noise, "radians": 2 * noise} | kind)
    found = hp.fit(*bodies(made))
    assert not found.ok
    assert words in " ".join(found.findings)
    assert "looks" not in " ".join(found.findings)  # no mistake


def test_bodies_that_are_not_joined_are_said_to_be_beside_a_clock_offset() -> None:
    t = np.arange(800) / 100
    turn = np.stack((0.3 * np.sin(1.3 * t), 0.25 * np.cos(1.7 * t), 0.4 * np.sin(0.7 * t)), axis=-1)
    moving = hp.BodyMotion(R=np.stack((0.4 * np.sin(t), 0.2 * t, 0 * t), axis=-1), S=turns(turn))
    noise = np.random.default_rng(0).standard_normal((2, 800, 3))
    standing = hp.BodyMotion(R=1e-3 * noise[0], S=turns(2e-3 * noise[1]))
    found = hp.fit(moving, standing, t=t)
    assert "They do not turn about one axis" in found.findings[0]
    assert (found.clock_offset, found.std["clock_offset"]) == (0.0, np.inf)


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_samples_show_no_hinge(count: int) -> None:
    body = hp.BodyMotion(R=np.zeros((count, 3)), S=np.tile(np.eye(3), (count, 1, 1)))
    with pytest.raises(hp.FitError, match=f"at least two samples with both poses, got {count}"):
        hp.fit(body, body)


def test_play_of_the_hinge_point_is_measured_beside_the_levers() -> None:
    found = hp.fit(*bodies(recording(2000, 1e-3, 2e-3, slip=0.01 * SLOW[:, None] * N1)))
    size, share = re.search(r"along the axis by ([\d.]+) m rms, ([\d.]+) % of the levers", found.findings[0]).groups()
    assert float(size) == pytest.approx(0.01 * np.std(SLOW), rel=0.05)  # of the digits that are shown, and noise
    lever = max(np.linalg.norm(truth(1.0)[0]), np.linalg.norm(truth(1.0)[1]))
    assert 0.3 < float(share) / (100 * float(size) / lever) <= 1.05


@pytest.mark.parametrize("noise", [0.0, 1e-3], ids=["exact", "noisy"])
@pytest.mark.parametrize(
    ("slip", "words"), [(0.0, "a fixed pair"), (0.2 * SLOW[:, None] * N1, "a sliding joint")], ids=["fixed", "slides"]
)
def test_bodies_that_do_not_turn_show_no_hinge(slip: object, words: str, noise: float) -> None:
    made = recording(2000, noise, 2 * noise, Q=HOME, slip=slip)
    with pytest.raises(hp.FitError, match=words) as caught:
        hp.fit(*bodies(made))
    assert caught.value.name == "body1, body2"


@pytest.mark.parametrize("loss", ["linear", "cauchy"])
def test_the_range_of_psi_is_that_of_good_samples(loss: str) -> None:
    made = recording(1000, 1e-3, 2e-3)
    off = [3, 500, 998]
    made.S2[off] = made.S2[off] @ turns(((1.0, 2.0, 0.5), (-2.5, 1.0, 0.0), (0.0, 2.0, -2.0)))
    found = hp.fit(*bodies(made), loss=loss)
    psi = np.sign(found.pair.n @ N1) * made.psi
    psi += np.median(found.psi - psi)  # psi = 0 is a matter of home
    assert found.psi_range == pytest.approx((psi.min(), psi.max()), abs=0.02)
    assert np.ptp(found.psi) > np.ptp(found.psi_range) + 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t": 5.0 * np.arange(300)}, r"t steps by 5 s: is it in seconds\? Milliseconds"),
        ({"metres": 1e3}, r"R2 - R1 is \d+ m long: is it in metres\? Millimetres"),
        ({}, None),
    ],
    ids=["milliseconds", "millimetres", "SI"],
)
def test_doubtful_units_are_asked_about(change: dict[str, object], words: str | None) -> None:
    made = recording(300, 1e-3, 2e-3)
    size = change.get("metres", 1.0)
    scaled = made._replace(R1=size * made.R1, R2=size * made.R2)
    found = hp.fit(*bodies(scaled), t=change.get("t", made.t))
    assert found.ok == (words is None)
    assert [bool(re.match(words, text)) for text in found.findings] == ([True] if words else [])


def read_in_order(S: np.ndarray, shift: int) -> np.ndarray:
    """Attitudes whose quaternions were written as wxyz and read as xyzw, or, of -1, the other way round."""
    return Rotation.from_quat(np.roll(Rotation.from_matrix(S).as_quat(), shift, axis=-1)).as_matrix()


Y_UP = np.array(((1.0, 0, 0), (0, 0, 1), (0, -1, 0)))
TRANSPOSED = functools.partial(np.swapaxes, axis1=-1, axis2=-2)
WXYZ, XYZW = (functools.partial(read_in_order, shift=shift) for shift in (1, -1))
MISTAKES = {  # what is said, and what was done to the recording
    "body2.R looks like millimetres": {"R2": lambda R: 1e3 * R},
    "body1.R looks like millimetres": {"R1": lambda R: 1e3 * R},
    "body2.S looks like quaternions wxyz that were read as xyzw": {"S2": WXYZ},
    "body2.S looks like quaternions xyzw that were read as wxyz": {"S2": XYZW},
    "body1.S and body2.S look like quaternions wxyz": {"S1": WXYZ, "S2": WXYZ},
    "body2.S looks like rotations from world": {"S2": TRANSPOSED},
    "body1.S looks like rotations from world": {"S1": TRANSPOSED},
    "body2 looks as if y were up in its world": {"R2": lambda R: R @ Y_UP.T, "S2": lambda S: Y_UP @ S},
}


@pytest.mark.slow
@pytest.mark.parametrize("words", MISTAKES)
def test_the_mistake_that_hides_a_hinge_is_named(words: str) -> None:
    made = recording(1000, 1e-3, 2e-3)
    changed = {name: change(getattr(made, name)) for name, change in MISTAKES[words].items()}
    found = hp.fit(*bodies(made._replace(**changed)))
    assert not found.ok
    assert words in " ".join(found.findings)


def test_a_recording_in_the_plane_does_not_tell_the_noise_of_its_angles():
    rng, t = np.random.default_rng(6), np.arange(300) / 10
    phi, psi = 0.6 * np.sin(0.2 * t), 0.4 * np.sin(0.35 * t)
    second = hp.PlanarPair((-2.5, 0), (4, 0.1)).forward_kinematics((t, 0.1 * t, phi, psi))
    places = (np.stack((t, 0.1 * t), axis=-1), second.R2)
    columns = {
        f"{c}{k}": R[:, i] + 0.01 * rng.normal(size=300) for k, R in enumerate(places, 1) for i, c in enumerate("xy")
    }
    columns |= {f"phi_z{k}": a + 0.002 * rng.normal(size=300) for k, a in enumerate((phi, second.phi2), 1)}
    recording = hp.read_recording({"t": t, **columns})
    fit = hp.fit(recording.body1, recording.body2)
    assert fit.ok
    assert np.abs(fit.pair.u2 - (4, 0.1, 0)).max() < 5 * fit.std["u2"].max()
    assert any("the attitudes do not tell their noise" in sentence for sentence in fit.findings)


@pytest.mark.slow
@pytest.mark.parametrize(("turns_a_second", "radians", "ok"), [(0.05, 0.02, True), (0.2, 0.02, False)])
def test_noise_and_outliers_are_no_turns_in_a_gap(turns_a_second: float, radians: float, ok: bool) -> None:
    """Of 0.2 and 0.8 turns in a gap of four seconds, where noise from sample to sample is faster than the hinge."""
    t = np.arange(4000) / 200
    made = recording(4000, 1e-3, radians, outliers=0.1, Q=turns(2 * np.pi * turns_a_second * t[:, None] * N1))
    R2 = made.R2.copy()
    R2[1600:2400] = np.nan
    body1, body2 = hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=R2, S=made.S2)
    found = hp.fit(body1, body2, t=t, clock_offset=0, loss="cauchy")
    assert found.ok == ok
    assert [finding.name for finding in found.findings if "turns" in finding.name] == ["turns in a gap"] * (not ok)


@pytest.mark.slow
def test_turns_that_samples_do_not_show_are_not_relied_on() -> None:
    """Of 21 turns a second at 40 Hz, and of 3.2 turns in a gap of four seconds."""
    t = 0.025 * np.arange(400)
    for turns_a_second, hidden in ((21.0, slice(0, 0)), (0.8, slice(100, 260))):
        Q = turns(2 * np.pi * turns_a_second * t[:, None] * N1)
        made = recording(400, 1e-3, 2e-3, Q=Q)
        R2 = made.R2.copy()
        R2[hidden] = np.nan
        found = hp.fit(hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=R2, S=made.S2), t=t, clock_offset=0)
        assert not found.ok
        assert next(finding.name for finding in found.findings if finding.severity == "serious").startswith("turns")


@pytest.mark.slow
def test_the_variances_are_told_apart_where_attitudes_are_rough() -> None:
    """Noise of attitudes times levers is twelve times as large as that of positions."""
    ratios = []
    for seed in range(10):
        found = hp.fit(*bodies(recording(1000, 1e-3, 3e-2, seed)))
        ratios.append((found.noise_position / (np.sqrt(2) * 1e-3), found.noise_angle / (np.sqrt(2) * 3e-2)))
    rms = np.sqrt(np.mean((np.array(ratios) - 1) ** 2, axis=0))
    assert rms[0] < 0.12
    assert rms[1] < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("fixed", [True, False], ids=["body 1 at rest", "body 1 moving"])
def test_noise_of_attitudes_belongs_to_the_body_that_has_it(fixed: bool) -> None:
    """Levers of a body whose attitudes are noisy come out short: here those of body 2."""
    scores = []
    for seed in range(8):
        made, noise = recording(2000, seed=seed), np.random.default_rng(seed).standard_normal((2, 2000, 3))
        R1, S1 = (0 * made.R1, np.eye(3) + 0 * made.S1) if fixed else (made.R1, made.S1)
        S2 = np.swapaxes(made.S1, -1, -2) @ made.S2
        R2 = R1 + np.einsum("nij,nj->ni", S1, U1 - S2 @ U2) + 3e-3 * noise[0]
        known = {} if fixed else {"noise1": (1e-6, 1e-6), "noise2": (3e-3, 0.03)}
        body2 = hp.BodyMotion(R=R2, S=S1 @ S2 @ turns(0.03 * noise[1]))
        found = hp.fit(hp.BodyMotion(R=R1, S=S1), body2, **known)
        u1, u2, *_ = truth(np.sign(found.pair.n @ N1))
        scores.append([(found.pair.u1 - u1) / found.std["u1"], (found.pair.u2 - u2) / found.std["u2"]])
    assert np.abs(np.mean(scores, axis=0)).max() < 4 / np.sqrt(12)
    assert np.mean(np.square(scores)) < 2


@pytest.mark.slow
@pytest.mark.parametrize("point", [False, True], ids=["body", "point"])
def test_the_noise_of_short_recordings_is_what_repeated_ones_show(point: bool) -> None:
    """Eight samples have hardly more numbers than the hinge: what is left of them is less than their noise."""
    squares = []
    for seed in range(100):
        body1, body2 = bodies(recording(8, 1e-3, 0.0 if point else 2e-3, seed))
        found = hp.fit(body1, hp.BodyMotion(R=body2.R) if point else body2)
        squares.append((found.noise_position / 1e-3) ** 2)
        if not point:
            squares[-1] = (squares[-1], (found.noise_angle / 2e-3) ** 2)
    assert np.abs(np.mean(squares, axis=0) / 2 - 1).max() < 0.15  # of 100 times some ten numbers: 4 %


@pytest.mark.parametrize("loss", ["soft_l1", "huber", "cauchy", "arctan"])
def test_outliers_are_not_counted_as_noise(loss: str) -> None:
    found = hp.fit(*bodies(recording(1000, 1e-3, 2e-3, outliers=0.2)), loss=loss)
    assert found.noise_position == pytest.approx(np.sqrt(2) * 1e-3, rel=0.08)  # medians of 800 samples, 200 far off
    assert found.noise_angle == pytest.approx(np.sqrt(2) * 2e-3, rel=0.08)
