"""A body 2 of which only a point is known, and clusters of markers that become bodies."""

from __future__ import annotations

import re

import numpy as np
import pytest

import hingepair as hp
from support.near import U
from support.recorded import HOME, N1, U1, U2, recording


def bodies(made) -> tuple[hp.BodyMotion, hp.BodyMotion]:
    return hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=made.R2)


def true_circle(gauge: str) -> np.ndarray:
    """u1 of the circle on which body 2's reference point runs, its axis N1."""
    lever = HOME @ U2
    centre = U1 - (lever @ N1) * N1
    return centre - (centre @ N1) * N1 if gauge == "closest_to_R1" else centre


@pytest.mark.parametrize("gauge", ["closest_to_R1", "closest_to_R2"])
def test_a_point_runs_along_a_circle_about_the_hinge(gauge: str) -> None:
    made = recording(200)
    body1, point = bodies(made)
    found = hp.fit(body1, point, gauge=gauge)
    assert found.ok
    assert found.findings == ()
    assert abs(found.pair.n @ N1) == pytest.approx(1, abs=512 * U)
    assert np.abs(found.pair.u1 - true_circle(gauge)).max() < 8192 * U  # a point tells little
    radius = np.linalg.norm(HOME @ U2 - (HOME @ U2 @ N1) * N1)
    assert np.linalg.norm(found.pair.u2 - (found.pair.u2 @ found.pair.n) * found.pair.n) == pytest.approx(
        radius, abs=8192 * U
    )
    state = found.pair.forward_kinematics_from_body1(body1, found.psi)
    assert np.abs(state.R2 - made.R2).max() < 8192 * U
    sign = np.sign(found.pair.n @ N1)
    assert np.ptp(found.psi - sign * made.psi) < 8192 * U
    assert np.isnan(found.rms_angle)
    assert [axes.get_title() for axes in hp.plot(found).axes] == ["psi", "gap"]


def test_outliers_and_missing_samples_of_a_point() -> None:
    made = recording(600, 1e-3, outliers=0.2)
    body1, point = bodies(made)
    R2 = point.R.copy()
    R2[100:110] = np.nan
    found = hp.fit(body1, hp.BodyMotion(R=R2), loss="cauchy")
    assert found.ok
    assert "% of the samples are outliers; they count little." in found.findings[0]
    assert found.samples == 590
    assert np.isnan(found.psi[100:110]).all()
    assert np.abs(found.pair.u1 - true_circle(found.gauge)).max() < 3e-3  # m, of the noise of recordings
    assert not hp.fit(body1, point).ok


SLOW = np.sin(1.3 * recording(600).t)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ({"turn": 0.02}, "The path of the point is straight within its noise"),
        ({"slip": 0.1 * SLOW[:, None] * N1}, "The point leaves the plane of the circle by"),
        ({"slip": 0.1 * SLOW[:, None] * np.array((0.0, 0.24, 0.97))}, "not at random"),
    ],
    ids=["little turning", "sliding", "two hinges"],
)
def test_what_is_no_circle_is_said(kind: dict[str, object], words: str) -> None:
    found = hp.fit(*bodies(recording(600, 1e-3, **kind)))
    assert not found.ok
    assert words in " ".join(found.findings)


CLUSTER = np.array([(0.1, 0.0, 0.0), (-0.08, 0.05, 0.01), (0.0, -0.06, 0.0), (0.0, 0.02, 0.09), (0.05, 0.05, -0.04)])


def seen(made, noise: float, seed: int = 0) -> np.ndarray:
    places = made.R1[:, None] + np.einsum("nij,mj->nmi", made.S1, CLUSTER)
    return places + noise * np.random.default_rng(seed).standard_normal(places.shape)


def test_a_cluster_is_found_with_its_poses() -> None:
    made = recording(300)
    found = hp.fit_cluster(seen(made, 1e-3))
    assert found.ok
    assert found.noise == pytest.approx(1e-3, rel=0.05)  # of 300 times 5 markers: 1 %
    apart = [np.linalg.norm(each[:, None] - each, axis=-1) for each in (found.reference, CLUSTER)]
    assert np.abs(apart[0] - apart[1]).max() < 4e-4  # m, of a noise of 1 mm
    turn = np.swapaxes(made.S1, -1, -2) @ found.body.S
    assert np.abs(hp.rotation_log(np.swapaxes(turn[:1], -1, -2) @ turn)).max() < 0.06
    assert np.abs(found.body.S[0] - np.eye(3)).max() < 0.02
    assert np.abs(found.reference.mean(axis=0)).max() <= 8 * U


def test_missing_markers_leave_the_others() -> None:
    made = recording(300)
    places = seen(made, 1e-3)
    places[np.random.default_rng(1).random((300, 5)) < 0.2] = np.nan
    places[7, :3] = 0.0  # as some recorders write what they do not see
    found = hp.fit_cluster(places, CLUSTER)
    few = (np.isfinite(places) & (places != 0)).all(axis=-1).sum(axis=1) < 3
    assert few[7]
    assert (np.isnan(found.body.R).any(axis=1) == few).all()
    assert np.sqrt(np.mean((found.body.R - made.R1)[~few] ** 2)) < 1.5e-3  # m, of the noise
    assert np.isnan(found.residuals[7, 0])
    whole = hp.fit_cluster(places)
    assert whole.ok
    assert whole.noise == pytest.approx(1e-3, rel=0.08)  # of fewer markers


@pytest.mark.parametrize("given", [True, False], ids=["reference", "no reference"])
def test_markers_on_a_line_show_no_attitude(given: bool) -> None:
    made = recording(60)
    cluster = np.array([(-0.1, 0.0, 0.0), (0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.08, 0.0), (0.0, 0.0, 0.07)])
    places = made.R1[:, None] + np.einsum("nij,mj->nmi", made.S1, cluster)
    places += 1e-4 * np.random.default_rng(3).standard_normal(places.shape)
    hidden = np.arange(60) % 4 == 1
    places[hidden, 3:] = np.nan
    found = hp.fit_cluster(places, cluster if given else None)
    assert found.ok
    for array in (found.body.R, found.body.S.reshape(60, 9), found.residuals):
        assert (np.isnan(array).all(axis=1) == hidden).all()
    turn = np.swapaxes(made.S1, -1, -2)[~hidden] @ found.body.S[~hidden]
    assert np.abs(hp.rotation_log(np.swapaxes(turn[:1], -1, -2) @ turn)).max() < 0.01  # rad, of 0.1 mm on 0.1 m
    with pytest.raises(hp.FitError, match="three markers that are not on a line"):
        hp.fit_cluster(places[hidden], cluster if given else None)


@pytest.mark.parametrize("marker", range(5))
def test_the_marker_that_moved_is_named(marker: int) -> None:
    made = recording(300)
    places = seen(made, 3e-4)
    places[150:, marker] += np.einsum("nij,j->ni", made.S1[150:], (0.01, -0.012, 0.008))
    found = hp.fit_cluster(places)
    assert not found.ok
    assert found.findings[0].startswith(f"Marker {marker}, of 0 to 4, moved against the others")


@pytest.mark.slow
def test_poses_of_markers_give_the_hinge() -> None:
    made = recording(400)
    first = hp.fit_cluster(seen(made, 3e-4), CLUSTER)
    second = hp.fit_cluster(seen(made._replace(R1=made.R2, S1=made.S2), 3e-4, 1), CLUSTER)
    found = hp.fit(first.body, second.body, t=made.t)
    assert found.ok
    n = np.sign(found.pair.n @ N1) * N1
    assert (np.abs(found.pair.n - n) < 4 * found.std["n"]).all()
    assert found.std["n"].max() < 1e-3  # of markers seen to 0.3 mm


def exchanged(markers: np.ndarray, rows: slice) -> np.ndarray:
    markers[rows, :2] = markers[rows, 1::-1]
    return markers


def sliding(markers: np.ndarray) -> np.ndarray:
    markers[:, 0] += np.linspace(0, 0.05, markers.shape[0])[:, None]
    return markers


BAD_CLUSTERS = {
    "reference in millimetres": (lambda x: x, 1e3, "units differ"),
    "labels unlike the reference": (lambda x: exchanged(x, slice(None)), 1.0, "labels may be exchanged"),
    "labels exchanged in a third": (
        lambda x: exchanged(x, slice(40, 140)),
        None,
        "exchanged|One of the markers moved",
    ),
    "a marker that slides": (sliding, None, "Marker 0, of 0 to 4, moved|One of the markers moved"),
}


@pytest.mark.parametrize("markers", [3, 5])
@pytest.mark.parametrize("name", BAD_CLUSTERS)
def test_markers_that_are_not_what_they_are_taken_for_are_said(name: str, markers: int) -> None:
    change, unit, words = BAD_CLUSTERS[name]
    places = change(seen(recording(300), 1e-3)[:, :markers])
    found = hp.fit_cluster(places, None if unit is None else unit * CLUSTER[:markers])
    assert not found.ok
    assert re.search(words, " ".join(found.findings))


@pytest.mark.parametrize("rows", [slice(40, 50), slice(100, 160)], ids=["few", "a fifth"])
@pytest.mark.parametrize("given", [True, False], ids=["reference", "no reference"])
def test_samples_with_exchanged_labels_have_no_pose(rows: slice, given: bool) -> None:
    places, reference = seen(recording(300), 1e-3), CLUSTER if given else None
    right, wrong = hp.fit_cluster(places, reference), hp.fit_cluster(exchanged(places, rows), reference)
    assert wrong.ok
    assert "labels may be exchanged" in " ".join(wrong.findings)
    assert np.abs(right.reference - wrong.reference).max() < 2e-4  # m, of the noise
    lost = np.isin(np.arange(300), np.arange(300)[rows])
    assert (np.isnan(wrong.body.S).all(axis=(1, 2)) == lost).all()
    assert np.abs(right.body.S - wrong.body.S)[~lost].max() < 3e-3  # of the noise


@pytest.mark.parametrize("width", [0.1, 0.0045], ids=["wide", "nearly on a line"])
def test_poses_have_standard_deviations(width: float) -> None:
    """A rotation about the line of the markers is known in proportion to how wide they are."""
    places = np.array([(0, 0, 0), (0.1, 0, 0), (0.2, width, 0), (0.05, -width, width)])
    made, rng = recording(400), np.random.default_rng(0)
    seen = made.R1[:, None] + np.einsum("nij,mj->nmi", made.S1, places) + 5e-4 * rng.standard_normal((400, 4, 3))
    found = hp.fit_cluster(seen, places)
    turn = hp.rotation_log(found.body.S @ np.swapaxes(made.S1, -1, -2))
    assert (turn / found.std["S"]).std() == pytest.approx(1, abs=0.1)  # of 1200: 2 %
    assert ((found.body.R - made.R1) / found.std["R"]).std() == pytest.approx(1, abs=0.1)  # of 1200: 2 %
    assert found.ok == (width > 0.01)
    assert found.ok or "nearly on a line" in found.findings[0]
