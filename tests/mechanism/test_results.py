"""Results as tables and files that other tools read."""

from __future__ import annotations

import itertools
import pickle
from pathlib import Path

import numpy as np
import pandas
import pyarrow.parquet
import pytest

import hingepair as hp
from hingepair.mechanism.results import Record, result_file
from support.near import U

MODELS = Path(__file__).parents[2] / "models"


@pytest.fixture(scope="module")
def result():
    return hp.load_scene(MODELS / "landing_gear.toml").evaluate(("R2", "S2", "v2"))


def same(result, columns):
    """Every component came back to the last bit."""
    np.testing.assert_array_equal(columns["t"], result.t)
    np.testing.assert_array_equal(columns["R2_y"], result.R2[:, 1])
    np.testing.assert_array_equal(columns["S2_zx"], result.S2[:, 2, 0])
    np.testing.assert_array_equal(columns["v2_z"], result.v2[:, 2])
    np.testing.assert_array_equal(columns["psi"], result.scene.motion.source.part(slice(None), 0).psi)
    assert {"x", "y", "z", "phi_x", "phi_y", "phi_z"} <= set(columns)


def test_a_data_frame_has_a_column_a_component(result):
    frame = result.to_dataframe()
    same(result, frame)
    assert frame.attrs["units"]["v2"] == "m/s"
    assert frame.attrs["description"] == result.scene.title


def test_csv_and_parquet_are_read_back_to_the_last_bit(result, tmp_path):
    same(result, pandas.read_csv(result.save(tmp_path / "a.csv")))
    same(result, pandas.read_parquet(result.save(tmp_path / "a.parquet")))
    facts = pyarrow.parquet.read_metadata(tmp_path / "a.parquet").metadata
    assert facts[b"R2"] == b"m"


def test_npz_and_netcdf_keep_vectors_together(result, tmp_path):
    with np.load(result.save(tmp_path / "a.npz")) as arrays:
        np.testing.assert_array_equal(arrays["S2"], result.S2)
        np.testing.assert_array_equal(arrays["t"], result.t)
    import xarray

    with xarray.open_dataset(result.save(tmp_path / "a.nc"), engine="scipy") as data:
        np.testing.assert_array_equal(data.R2.sel(xyz="y"), result.R2[:, 1])
        np.testing.assert_array_equal(data.S2.values, result.S2)
        assert data.S2.dims == ("time", "xyz", "body_xyz")
        assert (data.v2.attrs["units"], data.time.attrs["units"]) == ("m/s", "s")
        assert data.v2.attrs["long_name"] == "Velocity of body 2's reference point"
        assert (data.v2.attrs["axes"], "axes" in data.psi.attrs) == ("world", False)
        assert data.attrs["description"] == result.scene.title


def in_pieces(path, record, *counts):
    with result_file(path, record.described) as add:
        for start, stop in itertools.pairwise((0, *np.cumsum(counts))):
            add(record.t[start:stop], {name: array[start:stop] for name, array in record.recorded().items()})
    return path


@pytest.mark.parametrize("kind", ["csv", "npz", "parquet", "nc"])
def test_a_file_is_the_same_in_pieces(tmp_path, kind, monkeypatch):
    monkeypatch.setattr("hingepair.mechanism.results.RESULT_ROWS_PER_BLOCK", 16)
    rng = np.random.default_rng(1)
    record = Record(np.arange(40.0), {"R2": rng.standard_normal((40, 3)), "psi": rng.standard_normal(40)}, "a walk")
    whole = record.save(tmp_path / f"whole.{kind}").read_bytes()
    assert in_pieces(tmp_path / f"pieces.{kind}", record, 16, 16, 8).read_bytes() == whole
    if kind == "parquet":
        assert pyarrow.parquet.ParquetFile(tmp_path / "pieces.parquet").num_row_groups == 3


def test_a_file_that_is_left_half_way_is_not_there(tmp_path):
    def stopped(path):
        with result_file(path) as add:
            add(np.arange(5.0), {"psi": np.zeros(5)})
            raise KeyboardInterrupt

    for kind in ("csv", "parquet"):
        with pytest.raises(KeyboardInterrupt):
            stopped(tmp_path / f"a.{kind}")
    assert not list(tmp_path.iterdir())


def test_a_missing_package_is_named(result, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(hp.errors.MissingDependencyError, match=r"hingepair\[data\]"):
        result.save(tmp_path / "a.parquet")
    assert not list(tmp_path.iterdir())


UNITS = "deg, mm, km/h, ms"


def in_those_units(result, get):
    np.testing.assert_allclose(get("t [ms]"), 1e3 * result.t, rtol=4 * U)
    np.testing.assert_allclose(get("R2_y [mm]"), 1e3 * result.R2[:, 1], rtol=4 * U)
    np.testing.assert_allclose(get("v2_z [km/h]"), 3.6 * result.v2[:, 2], rtol=4 * U)
    np.testing.assert_allclose(get("psi [deg]"), np.degrees(result.psi), rtol=4 * U)
    np.testing.assert_array_equal(get("S2_zx"), result.S2[:, 2, 0])


def test_tables_and_files_are_in_the_units_that_their_headings_name(result, tmp_path):
    frame = result.to_dataframe(units=UNITS)
    in_those_units(result, frame.__getitem__)
    assert frame.attrs["units"]["v2"] == "km/h"
    in_those_units(result, pandas.read_csv(result.save(tmp_path / "a.csv", units=UNITS)).__getitem__)
    in_those_units(result, pandas.read_parquet(result.save(tmp_path / "a.parquet", units=UNITS)).__getitem__)
    with np.load(result.save(tmp_path / "a.npz", units=UNITS)) as arrays:
        np.testing.assert_allclose(arrays["R2 [mm]"], 1e3 * result.R2, rtol=4 * U)
    import xarray

    with xarray.open_dataset(result.save(tmp_path / "a.nc", units=UNITS), engine="scipy") as data:
        np.testing.assert_allclose(data.R2, 1e3 * result.R2, rtol=4 * U)
        assert (data.R2.attrs["units"], data.v2.attrs["units"], data.time.attrs["units"]) == ("mm", "km/h", "ms")


# ---- results of one call


def test_results_of_dynamics_unpack_and_name_their_parts():
    body = hp.Body(mass=2, inertia=(1, 1, 1))
    pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body1=body, body2=body)
    still = hp.BodyMotion(S=np.eye(3), **dict.fromkeys(("R", "v", "omega", "a", "alpha"), np.zeros(3)))
    force, torque, _, _ = wrench = pair.hinge_wrench(still, 0.0, 0.0, 0.0)
    assert force is wrench.force is wrench.hinge_force
    assert torque is wrench["hinge_moment"]
    kinetic, potential = pickle.loads(pickle.dumps(pair.energy(still, 0.0, 0.0)))
    assert (kinetic, potential) == (0.0, 0.0)
    assert "potential=" in repr(pair.energy(still, 0.0, 0.0))
