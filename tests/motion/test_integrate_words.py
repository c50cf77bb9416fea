"""What `integrate`, its results and integrated scenes say of themselves, and of what they cannot use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.spins import U

MODELS = Path(__file__).parents[2] / "models"
PAIR = hp.HingePair(u1=(0.3, -0.2, 0.5), u2=(0.1, 0.7, -0.4), n=(1, 2, -2))
T = np.linspace(0, 1, 11)


def test_a_callable_may_return_one_value_for_all_times():
    motion = hp.integrate(PAIR, T, lambda _: (1.0, 2.0, 3.0), lambda _: 0.5)
    same = hp.integrate(PAIR, T, (1.0, 2.0, 3.0), 0.5)
    np.testing.assert_allclose(motion.S2, same.S2, rtol=0, atol=8 * U)


def test_a_misspelt_name_is_told_all_that_there_is():
    motion = hp.integrate(PAIR, T, (0, 0, 1), np.cos, outputs=("R2",))
    assert {"R2", "S1", "psi", "error_estimate", "euler_angles", "save"} <= set(dir(motion))
    assert not {"S2", "recorded", "of_buffer"} & set(dir(motion))
    with pytest.raises(AttributeError, match=f"has no 'R3'; it has {', '.join(dir(motion))}$"):
        _ = motion.R3


def test_results_are_short_to_read():
    """No arrays; the estimate of the error only once it is known, since it costs as much as the integration."""
    motion = hp.integrate(PAIR, T, (0, 0, 1), np.cos, outputs=("R2", "S2"))
    assert repr(motion) == "Trajectory(magnus6, steps=10, samples=11, t=0..1, outputs=(R2, S2))"
    known = f"error_estimate={motion.error_estimate:.2g}, "
    assert repr(motion) == f"Trajectory(magnus6, steps=10, samples=11, t=0..1, {known}outputs=(R2, S2))"
    flat = hp.integrate(hp.PlanarPair((1, 0), (0, 1)), T, 1.0, np.cos, outputs=())
    assert repr(flat) == "PlanarTrajectory(magnus6, steps=10, samples=11, t=0..1, outputs=())"
    result = hp.load_scene(MODELS / "reference_3d.toml").evaluate(("R2",))
    assert repr(result) == (
        f"SceneResult(samples={len(result.t)}, t={result.t[0]:g}..{result.t[-1]:g}, state={result.state!r})"
    )


@pytest.mark.parametrize(
    ("model", "origin"), [("spinning_satellite", "integrated from rates"), ("gyro_log", "integrated from rates")]
)
def test_scenes_that_have_no_coordinates_say_what_they_have(model, origin):
    with pytest.raises(hp.ArgumentError) as caught:
        hp.derive(hp.load_scene(MODELS / f"{model}.toml"))
    wanted = "a scene whose motion is coordinates as expressions in t"
    assert str(caught.value) == f"motion: expected {wanted}, got one whose motion is {origin}"


def test_scenes_of_samples_say_so(tmp_path):
    (tmp_path / "log.csv").write_text("t,x,y,z,phi_x,phi_y,phi_z,psi\n0,0,0,0,0,0,0,0\n1,0,0,0,0,0,0,1\n")
    (tmp_path / "my.toml").write_text(
        '[pair]\nu1 = [1, 0, 0]\nu2 = [0, 1, 0]\nn = [0, 0, 1]\n[motion]\nfile = "log.csv"\n'
    )
    with pytest.raises(hp.ArgumentError, match="got one whose motion is samples in a file"):
        _ = hp.load_scene(tmp_path / "my.toml").expressions


def test_milliseconds_are_no_seconds():
    pair = hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1))
    stamps = 1_700_000_000_000 + 10 * np.arange(5)
    with pytest.raises(
        hp.ArgumentError, match=r"t: expected seconds, such as \(t - t\[0\]\) \* 1e-3 of milliseconds"
    ):
        hp.integrate(pair, stamps, (0, 0, 1), 0.5)
    assert hp.integrate(pair, np.arange(5), (0, 0, 1), 0.5).psi[-1] == 2


@pytest.mark.parametrize("kind", [np.int64, "datetime64[ns]"])
def test_stamps_of_clocks_are_counted_from_the_first_without_rounding(kind):
    pair = hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1))
    steps = 10_000_000 + np.random.default_rng(3).integers(-3_000_000, 3_000_000, 200)
    stamps = (1_700_000_000_123_456_789 + np.cumsum(steps)).astype(kind)
    t = np.cumsum(steps) * 1e-9 - steps[0] * 1e-9
    omega1 = np.stack([np.sin(t), np.cos(2 * t), 0.5 * t], axis=-1)
    found, expected = (hp.integrate(pair, own, omega1, np.cos(t)) for own in (stamps, t))
    np.testing.assert_allclose(found.t, t, rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.S1, expected.S1, rtol=0, atol=1e-14)
    with pytest.raises(hp.ArgumentError, match="t: expected instants that increase, got sample 3 the same stamp"):
        hp.integrate(pair, stamps[[0, 1, 2, 2, 4]], (0, 0, 1), 0.5)
