"""Texts of scenes, table by table."""

from __future__ import annotations

import copy
import json

import hingepair as hp

STILL = dict.fromkeys(("x", "y", "z", "phi_x", "phi_y", "phi_z"), 0)


def toml(table, more=None, **values):
    """A table; `more` holds values whose keys are no names of Python."""
    lines = [f"{key} = {json.dumps(value)}" for key, value in (values | (more or {})).items()]
    return "\n".join([f"[{table}]", *lines, ""])


def time(start, stop, samples):
    return toml("time", start=start, stop=stop, samples=samples)


def moved(*instants, **motion):
    """The motion of a pair, whose coordinates are 0 unless given, and (start, stop, samples)."""
    return toml("motion", STILL | motion) + time(*instants)


def logged(u1, u2, n, file="log.csv", **more):
    """A pair whose motion is in a file."""
    return toml("pair", u1=u1, u2=u2, n=n) + toml("motion", file=file, **more)


def scene_of(folder, text, name="scene.toml"):
    (folder / name).write_text(text, encoding="utf-8")
    return hp.load_scene(folder / name)


def altered(scene, **properties):
    """The scene with other values of some of its properties."""
    other = copy.copy(scene)
    other.__dict__.update(properties)
    return other
