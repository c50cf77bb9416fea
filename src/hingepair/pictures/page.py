"""A page on which the pair moves: one file that needs nothing else, for any browser.

The drawing is done by MeshCat's viewer (three.js), which Pinocchio's users know; its JavaScript is taken out of the
installed package `meshcat` and put into the page, so that the page opens from a disk without a network.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, MissingDependencyError, quoted
from hingepair.formats.model_writers import drawn_shapes
from hingepair.numeric.whole_file import whole_file
from hingepair.pair.body import Box, Cylinder, Shape, Sphere
from hingepair.pictures.frames import Array, Frames, Source, spread_frames
from hingepair.scenes.scene import Scene


def view(source: Source, path: str | os.PathLike[str] | None = None) -> Page:
    """A page on which the pair moves: bodies, hinge axis, frames and trails, with a time slider and readings.

    Args:
        source: a scene or its result, a trajectory of `integrate` or `simulate`, or a pair, which then turns through
            its limits (a whole turn where it has none).
        path: a file to write the page to, ending in .html; none unless given.

    Returns:
        The page: `.html` is its text, `.save(path)` writes it; in a notebook it shows itself.

    Raises:
        ArgumentError: what has no motion to show, or a file that cannot be written; names the argument.
        MissingDependencyError: the package meshcat is not installed.

    >>> import hingepair as hp
    >>> page = hp.view(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1)))
    >>> page
    Page(hinge_pair, frames=181)
    """
    frames = spread_frames(source)
    page = Page(frames.title, len(frames.t), frames.samples, _html(frames))
    if path is not None:
        page.save(path, [source.path] if isinstance(source, Scene) else ())
    return page


@dataclass(frozen=True, eq=False, repr=False)
class Page:
    """One HTML file that holds everything that it needs.

    Attributes:
        title: title of the motion.
        frames: number of instants that it shows.
        samples: number of instants of the motion; of more than 2,000 the page shows 2,000, spread evenly.
        html: text of the file.
    """

    title: str
    frames: int
    samples: int
    html: str

    def __repr__(self) -> str:
        return f"Page({self.title}, frames={self.shown})"

    @property
    def shown(self) -> str:
        """How many instants the page shows, and of how many where it does not show all: `2000 of 10001`."""
        return _shown(self.frames, self.samples)

    def save(self, path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> Path:
        """Write it to a file.

        Args:
            path: ends in .html.
            inputs: files that are being read from, which the path must not be.

        Raises:
            ArgumentError: another ending, or the file cannot be written; what was there before stays.
        """
        target = Path(path)
        if target.suffix.lower() not in {".html", ".htm"}:
            raise ArgumentError("path", "a file name that ends in .html", quoted(str(target)))
        with whole_file(target, inputs) as file:
            file.write(self.html.encode())
        return target

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" style="width: 100%; height: 480px; border: 0"></iframe>'


def _shown(count: int, samples: int) -> str:
    return f"{count} of {samples}" if count < samples else f"{count}"


def _html(frames: Frames) -> str:
    """The page: the viewer's code, the motion as JSON, and what brings the two together."""
    pair, (R1, S1, R2, S2) = frames.pair, (frames.bodies[name] for name in ("R1", "S1", "R2", "S2"))
    seen: Array = np.isfinite(np.concatenate([R1, R2], axis=1)).all(axis=1)
    origin = R1[seen][0] if seen.any() else np.zeros(3)  # drawn from here: a browser's numbers have seven digits
    trails = {"body1": R1 - origin, "body2": R2 - origin, "hinge": frames.hinge - origin}
    places = np.concatenate([path[seen] for path in trails.values()]) if seen.any() else np.zeros((1, 3))
    low, high = places.min(axis=0), places.max(axis=0)
    size = float(np.linalg.norm(pair.u1) + np.linalg.norm(pair.u2)) or 1.0
    one, two = drawn_shapes(pair)
    reach = max(size, *map(_reach, (*one, *two)))
    motion: dict[str, Any] = {
        "title": frames.title,
        "shown": _shown(len(frames.t), frames.samples),
        "t": frames.t.tolist(),
        "psi": _plain(frames.psi),
        "axis": pair.n.tolist(),
        "hinge": pair.u1.tolist(),
        "size": size,
        "reach": reach,
        "extent": max(float(np.linalg.norm(high - low)), reach),
        "centre": ((low + high) / 2).tolist(),
        "origin": origin.tolist(),
        "body1": {"shapes": [_drawn(shape) for shape in one], "placements": _placements(trails["body1"], S1)},
        "body2": {"shapes": [_drawn(shape) for shape in two], "placements": _placements(trails["body2"], S2)},
        "trails": {name: _plain(np.where(seen[:, None], path, 0.0)) for name, path in trails.items()},
        **{name: _plain(frames.readings[name]) for name in ("v2", "omega2") if name in frames.readings},
    }
    text = json.dumps(motion, allow_nan=False).replace("<", "\\u003c")
    page = files("hingepair.pictures").joinpath("page.html").read_text(encoding="utf-8")
    parts = {"@TITLE@": escape(frames.title), "@VIEWER@": _viewer(), "@MOTION@": text}
    return re.sub("@[A-Z]+@", lambda found: parts[found[0]], page)


def _viewer() -> str:
    """MeshCat's JavaScript, out of the installed package, which is not imported: it would load a server."""
    found = importlib.util.find_spec("meshcat")
    places = found.submodule_search_locations if found else None
    for place in places or ():
        script = Path(place) / "viewer" / "dist" / "main.min.js"
        if script.is_file():
            return script.read_text(encoding="utf-8").replace("</script", "<\\/script")
    raise MissingDependencyError("view", "the package meshcat: pip install 'hingepair[view]'", "none")


def _plain(array: Array) -> list[Any]:
    """Numbers for JSON, None for what is not finite."""
    found = array.astype(object)
    found[~np.isfinite(array)] = None
    return list(found.tolist())


def _placements(R: Array, S: Array) -> list[list[float] | None]:
    """The 4 x 4 matrices, row by row; None where one is not finite."""
    matrices = np.zeros((len(R), 4, 4))
    matrices[:, :3, :3], matrices[:, :3, 3], matrices[:, 3, 3] = S, R, 1.0
    return [m if np.isfinite(m).all() else None for m in matrices.reshape(-1, 16).tolist()]


def _reach(shape: Shape) -> float:
    """How far a shape goes from its body's reference point, at most."""
    own = shape.size / 2 if isinstance(shape, Box) else (shape.radius,)
    half = shape.length / 2 if isinstance(shape, Cylinder) else 0.0
    return float(np.linalg.norm(shape.center) + np.linalg.norm([*own, half]))


def _drawn(shape: Shape) -> dict[str, Any]:
    """A shape as the page builds it; three.js has the axis of a cylinder along y."""
    turn = np.eye(3)
    found: dict[str, Any] = {"kind": type(shape).__name__.lower()}
    if isinstance(shape, Box):
        found["size"], turn = shape.size.tolist(), shape.axes
    elif isinstance(shape, Sphere):
        found["radius"] = shape.radius
    else:
        found |= {"radius": shape.radius, "length": shape.length}
        across = np.cross(shape.axis, np.eye(3)[np.argmin(np.abs(shape.axis))])
        across /= np.linalg.norm(across)
        turn = np.stack([across, shape.axis, np.cross(across, shape.axis)], axis=1)
    found["placement"] = _placements(shape.center[None], turn[None])[0]
    return found
