"""Scenes whose motion is a file of samples, made for tests."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import hingepair as hp
from support import scenes
from support.states import coordinates, generator

SCENE = scenes.logged([0.5, 0.2, 0.1], [-0.25, 0.1, 0.3], [1, 2, 0], "{file}")
EULER = ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")
RATES = ("v1_x", "v1_y", "v1_z", "phid_x", "phid_y", "phid_z", "psid")
SECOND = ("a1_x", "a1_y", "a1_z", "phidd_x", "phidd_y", "phidd_z", "psidd")
BODY = ("t", "x", "y", "z", "qx", "qy", "qz", "qw", "psi")


def moving(count=12, seed=0):
    """Columns of a random motion in Euler angles, with rates that belong to nothing in particular."""
    parts = coordinates(generator(90, seed), count)
    columns = {"t": np.cumsum(generator(91, seed).uniform(0.1, 1, count))}
    for names, part in zip((EULER, RATES, SECOND), parts, strict=True):
        columns |= dict(zip(names, part.T, strict=True))
    return columns


def some(columns, *names):
    return {name: columns[name] for name in names}


def write(path, columns):
    if path.suffix == ".npz":
        np.savez(path, **columns)
    elif path.suffix == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), path)
    else:
        rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
        path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n")


def scene_of(tmp_path, columns, more="", name="log.csv"):
    if isinstance(columns, dict):
        write(tmp_path / name, columns)
    else:
        (tmp_path / name).write_bytes(columns if isinstance(columns, bytes) else columns.encode())
    (tmp_path / "my.toml").write_text(SCENE.format(file=name) + more)
    return hp.load_scene(tmp_path / "my.toml")


def logged(count, h=0.02):
    """The motion that models/logged_arm.toml states, and its derivatives from the same motion as a scene."""
    t = np.arange(count) * h
    angles = [0.5 * np.sin(t), 0.3 * np.sin(1.3 * t) - 0.4, 0.2 * np.cos(t)]
    quat = Rotation.from_euler("ZYX", np.stack(angles, axis=-1)).as_quat()
    place = (0.3 * np.sin(t), 0.2 * np.cos(0.7 * t), 1 + 0.1 * np.sin(1.3 * t))
    names = (*BODY, "phi_x", "phi_y", "phi_z")
    return dict(zip(names, (t, *place, *quat.T, 0.8 + 0.6 * np.sin(1.7 * t), *angles), strict=True))
