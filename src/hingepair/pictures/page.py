"""A page on which a pair or a robot moves: one HTML file without external parts, for any browser.

three.js draws the bodies. Its code (the folder `three`, release 0.147.0, unchanged) is copied into the page, so that
the page opens from a disk without a network. The page holds the constants of the joints, the motion of the base and
the coordinates, and computes the poses of the bodies itself.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, printable, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.tree import Joint
from hingepair.numeric.arrays import number_not_below_0
from hingepair.pictures.curves import check_drawable
from hingepair.pictures.moving import Array, Moving, Shown, moving, shown_rows
from hingepair.pictures.page_model import PageModel, model_json, pair_model, placements, robot_model
from hingepair.tables.units import SCALES, Units, UnitsLike
from hingepair.tables.whole_file import whole_file


def view(
    source: Shown,
    path: str | os.PathLike[str] | None = None,
    q: ArrayLike | None = None,
    t: ArrayLike | None = None,
    base_motion: BodyMotion | None = None,
    meshes: float = 4.0,
    tau: ArrayLike | None = None,
    units: UnitsLike = None,
) -> Page:
    """Return an HTML page on which a pair, a robot, a scene or a trajectory moves, with a slider for each joint.

    A body is drawn with the meshes, boxes, cylinders and spheres that the URDF file or the pair defines for it. A
    body without them is drawn with simple shapes: rods from joint to joint, a drum at a hinge, a prism at a
    prismatic joint. For a motion, the page also has a time slider and shows the path of the coordinate frame that is
    selected on the page. For the motion of a pair, it also shows the paths of both reference points and of the hinge
    point.

    Args:
        source: a robot; a scene or its result; a trajectory of `integrate` or `simulate`; or a pair. For a pair, the
            hinge angle moves from its lower to its upper limit and back, or through a whole turn if the pair has no
            limits. For a PlanarPair, give `pair.to_spatial()`.
        path: file to write the page to, ending in .html; by default no file is written.
        q: coordinates of a robot at T instants [rad or m]; shape (T, dof), in the order of `robot.names`, or a table
            with a column for each of these names. By default the page of a robot has no motion, only sliders; a
            mechanism with closed loops needs q.
        t: instants of q [s]; shape (T,), not decreasing; by default 30 per second.
        base_motion: BodyMotion with the position R and the attitude S of a robot's base, at one instant or at the T
            instants of q. By default the base rests at the origin.
        meshes: size [MB] that the meshes of a robot may take on the page; larger ones are simplified. 0: no meshes.
            They need trimesh, which the extra `robots` installs; what is not drawn is in `page.notes`.
        tau: torques and forces of the joints at the instants of q [N m or N], in the forms of q; the page shows them
            against the limits.
        units: units of the numbers on the page in place of SI units and of degrees for hinges, such as "deg, mm"; by
            default those of the scene.

    Returns:
        A Page. Its attribute `html` is the text of the page, and its method `save(path)` writes it. A notebook
        displays the page. `print` shows the number of instants of the motion as `frames`, or, if there is no motion,
        the number of sliders as `joints`.

    Raises:
        ArgumentError: the source is of another kind; q, t, base_motion,
            tau or units cannot be used; or the file cannot be written. The error names the argument.

    >>> import hingepair as hp
    >>> hp.view(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1)))
    Page(hinge_pair, frames=181)
    >>> hp.view(hp.load_robot("panda"))  # a slider for each of 7 hinges, and one for both fingers
    Page(panda, joints=8)
    """
    megabytes = number_not_below_0("meshes", meshes)
    shown = moving(source, q, t, base_motion, tau=tau)
    scene, subject = shown.scene, shown.subject
    if isinstance(subject, Mechanism):
        if subject.loops and tau is not None:
            expected = "None for a closed mechanism, whose other joints have no motors"
            raise ArgumentError("tau", expected, quoted(tau))
        tree = tree_of(subject)
        own = () if scene is None or scene.frames == subject.tips else scene.frames
        frame = next((name for name in own if tree.known_frame("frame", name).body), None)  # the first that moves
        model, joints = robot_model(subject, shown.title, frame, megabytes), tree.own_coordinates
    else:
        model = pair_model(subject, shown.title)
        joints = tuple(model.joints)
    columns = Units.of(units) if scene is None else scene.in_units(units).units
    content, positions = _motion_json(shown, joints, columns)
    html = _page_html(model, content | model_json(model, positions))
    page = Page(model.title, len(content["t"]), len(shown.t), len(joints), html, tuple(model.notes))
    if path is not None:
        page.save(path, () if scene is None else scene.files)
    return page


@dataclass(frozen=True, eq=False, repr=False)
class Page:
    """A page that shows a pair or a robot, as one HTML file that needs no other file and no network."""

    #: title of the motion
    title: str
    #: number of instants that it shows; 0 where there is no motion
    frames: int
    #: number of instants of the motion; of more than 2,000 the page shows 2,000, spread evenly, and those at which a
    #: joint is furthest beyond a limit
    samples: int
    #: number of joints that have a slider
    joints: int
    #: text of the file
    html: str
    #: sentences about meshes that are not drawn
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"Page({self.title}, {f'frames={self.shown}' if self.frames else f'joints={self.joints}'})"

    @property
    def shown(self) -> str:
        """Number of instants on the page, as text, such as `2000 of 10001` if the motion has more."""
        return _shown_count(self.frames, self.samples)

    def save(self, path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> Path:
        """Write the page to a file, and return its path.

        Args:
            path: file to write; ends in .html or .htm.
            inputs: files that are being read, which must not be overwritten.

        Raises:
            ArgumentError: the ending is another one, or the file cannot be written; an existing file is kept.
        """
        if not isinstance(path, str | os.PathLike):
            raise ArgumentError("path", "a file name (the motion of a robot is given as q=)", quoted(path))
        target = Path(path)
        if target.suffix.lower() not in {".html", ".htm"}:
            raise ArgumentError("path", "a file name that ends in .html", quoted(str(target)))
        with whole_file(target, inputs) as file:
            file.write(self.html.encode())
        return target

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" style="width: 100%; height: 480px; border: 0"></iframe>'


def _shown_count(count: int, samples: int) -> str:
    """Return the number of shown instants as text, such as `100`, or `2000 of 10001` if the motion has more."""
    return f"{count} of {samples}" if count < samples else f"{count}"


def _motion_json(shown: Moving, joints: Sequence[Joint], units: Units) -> tuple[dict[str, Any], Array]:
    """Return what a page holds of a motion, and the coordinates of all joints, at evenly spread instants and those at
    which a joint is furthest beyond a limit. The events are those of all samples.
    """
    robot = shown.subject if isinstance(shown.subject, Mechanism) else None
    q, tau = shown.coordinates(shown.source.part(slice(max(len(shown.t), 1)), 0))[0][: len(shown.t)], None
    if robot is not None and not robot.loops:
        tau = shown.tau()
    rows, events = shown_rows(shown.t, q, tau, joints)
    t, known = shown.t[rows], shown.source.part(rows if len(rows) else slice(1), min(shown.source.level, 1))
    q, *rates = (own[: len(t)] for own in shown.coordinates(known))
    base = known.base_motion
    R, S = (np.zeros((1, 3)), np.eye(3)[None]) if base is None else (np.asarray(base.R), np.asarray(base.S))
    check_drawable("R", R)
    finite = np.isfinite(R).all(axis=1)
    # Positions are relative to the base's first position: a graphics processor computes with seven digits.
    origin = R[finite][0] if finite.any() else np.zeros(3)
    stands = all(np.equal(places, places[:1]).all() for places in (R, S))
    places = slice(1) if stands else slice(None)
    offset, since = units.offset_of_instants(t[0], t[-1]) if len(t) else (0.0, "")
    degrees = units.over(Units("deg"))
    own_rates = {
        name: _json(np.zeros((1, 3)) if base is None else np.asarray(getattr(base, name))[places])
        for name in ("v", "omega")
        if rates
    }
    forces: dict[str, Any] = {}
    if robot is not None and rates and tree_of(robot).struts:
        found = robot.struts(*known.arguments()[:2])
        forces = {name: _json(np.broadcast_to(strut.force, t.shape)) for name, strut in found.items()}
    return {
        "units": {si: [units.unit(si), units.factor(si)] for si in SCALES},
        "angle": [degrees.unit("rad"), degrees.factor("rad")],
        "since": {"offset": offset, "name": since},
        "shown": _shown_count(len(t), len(shown.t)),
        "t": t.tolist(),
        "q": _json(q),
        "placements": placements(R[places] - origin, S[places]),
        "origin": origin.tolist(),
        "qd": _json(rates[0]) if rates else None,
        "base_rates": own_rates or None,
        "tau": None if tau is None else _json(tau[rows]),
        "strut_forces": forces,
        "events": [event._asdict() for event in events],
    }, q


def _page_html(model: PageModel, content: dict[str, Any]) -> str:
    """Return the HTML of a page: the viewer's code, the model and its motion as JSON, and the page's script."""
    try:
        text = json.dumps(content, allow_nan=False).replace("<", "\\u003c")
    except ValueError:
        raise ArgumentError("source", "lengths that a page can show", "some whose sum overflows") from None
    names = ("page.html", "kinematics.js", "page.js", "three/LICENSE", "three/three.min.js", "three/OrbitControls.js")
    page, kinematics, script, licence, three, controls = (
        files("hingepair.pictures").joinpath(name).read_text("utf-8") for name in names
    )
    parts = {"@TITLE@": escape(printable(model.title)), "@CONTENT@": text, "@KINEMATICS@": kinematics}
    parts |= {"@SCRIPT@": script, "@THREE@": f"/*\n{licence}*/\n{three}\n{controls}"}
    return re.sub("@[A-Z]+@", lambda match: parts[match[0]], page)


def _json(array: Array) -> list[Any]:
    """Return an array as nested lists for JSON, with None for numbers that are not finite."""
    values = array.astype(object)
    values[~np.isfinite(array)] = None
    return list(values.tolist())
