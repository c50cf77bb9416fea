"""A page on which a pair or a robot moves: one HTML file without external parts, for any browser.

three.js draws the bodies. Its code (the folder `three`, release 0.147.0, unchanged) is copied into the page, so that
the page opens from a disk without a network. The page holds the constants of the joints, the motion of the base and
the coordinates, and computes the poses of the bodies itself.
"""

from __future__ import annotations

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
from numpy.typing import ArrayLike

from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.motion.simulated import SimulatedRobotMotion
from hingepair.numeric.arrays import number_not_below_0
from hingepair.pictures.curves import check_drawable
from hingepair.pictures.motion_samples import (
    Array,
    MotionSource,
    ShownMotion,
    given_motion,
    page_motion,
    pair_of,
)
from hingepair.pictures.page_model import PageModel, model_json, pair_model, placements, robot_model
from hingepair.scenes.scene import Scene, SceneResult, scene_of_simulation
from hingepair.tables.units import SCALES, Units, UnitsLike
from hingepair.tables.whole_file import whole_file


def view(
    source: MotionSource | Mechanism | SimulatedRobotMotion,
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
    if isinstance(source, Mechanism):
        given = given_motion(source, q, t, base_motion, tau=tau)
        motion = page_motion(_motion_of_all_joints(source, given), tree_of(source).own_coordinates)
        model = robot_model(source, source.name, megabytes=megabytes)
    else:
        for name, value in (("q", q), ("t", t), ("base_motion", base_motion), ("tau", tau)):
            if value is not None:
                raise ArgumentError(name, "None, since only a robot (a Mechanism) takes a motion", quoted(value))
        source = source.scene if isinstance(source, SceneResult) else source
        source = scene_of_simulation(source) if isinstance(source, SimulatedRobotMotion) else source
        if isinstance(source, Scene) and source.mechanism is not None:
            robot = source.mechanism
            frame = None if source.frames == robot.tips else next(iter(source.frames), None)
            motion = page_motion(source, tree_of(robot).own_coordinates)
            model = robot_model(robot, source.title, frame, megabytes)
        else:
            scene = source if isinstance(source, Scene) else None
            model = pair_model(
                *((pair := pair_of(source), pair.name) if scene is None else (scene.space, scene.title))
            )
            motion = page_motion(source, model.joints)
    shown = source.in_units(units).units if isinstance(source, Scene) else Units.of(units)
    html = _page_html(model, motion, shown)
    page = Page(model.title, len(motion.t), motion.samples, motion.q.shape[1], html, tuple(model.notes))
    if path is not None:
        page.save(path, source.files if isinstance(source, Scene) else ())
    return page


def _motion_of_all_joints(robot: Mechanism, given: ShownMotion) -> ShownMotion:
    """Return the motion of a robot that is given with the coordinates of the joints that loops close, too."""
    if not robot.loops:
        return given
    if not given.samples:
        expected = "coordinates at instants, since the joints of a closed mechanism do not move one by one"
        raise ArgumentError("q", expected, None)
    if given.tau is not None:
        expected = "None for a closed mechanism, whose other joints have no motors"
        raise ArgumentError("tau", expected, quoted(given.tau))
    return given._replace(q=robot.all_coordinates(given.q))


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


def _page_html(model: PageModel, motion: ShownMotion, units: Units) -> str:
    """Return the HTML of a page: the viewer's code, the model and its motion as JSON, and the page's script."""
    check_drawable("R", motion.R)
    known = np.isfinite(motion.R).all(axis=1)
    # Positions are relative to the base's first position: a graphics processor computes with seven digits.
    origin = motion.R[known][0] if known.any() else np.zeros(3)
    stands = all(np.equal(places, places[:1]).all() for places in (motion.R, motion.S))
    places = slice(1) if stands else slice(None)
    offset, since = units.offset_of_instants(motion.t[0], motion.t[-1]) if len(motion.t) else (0.0, "")
    content = model_json(model, motion.q) | {
        "units": {si: [units.unit(si), units.factor(si)] for si in SCALES},
        "angle": [units.over(Units("deg")).unit("rad"), units.over(Units("deg")).factor("rad")],
        "since": {"offset": offset, "name": since},
        "shown": _shown_count(len(motion.t), motion.samples),
        "t": motion.t.tolist(),
        "q": _finite_numbers_json(motion.q),
        "placements": placements(motion.R[places] - origin, motion.S[places]),
        "origin": origin.tolist(),
        "qd": None if motion.qd is None else _finite_numbers_json(motion.qd),
        "base_rates": None
        if motion.base_rates is None
        else {name: _finite_numbers_json(rate[places]) for name, rate in motion.base_rates.items()},
        "tau": None if motion.tau is None else _finite_numbers_json(motion.tau),
        "readings": [
            {"name": name, "unit": unit_of(name), "values": _finite_numbers_json(values)}
            for name, values in motion.readings.items()
        ],
        "events": [
            {"name": event.name, "what": event.what, "first": event.first, "last": event.last}
            for event in motion.events
        ],
    }
    try:
        text = json.dumps(content, allow_nan=False).replace("<", "\\u003c")
    except ValueError:
        raise ArgumentError("source", "lengths that a page can show", "some whose sum overflows") from None
    names = ("page.html", "kinematics.js", "page.js", "three/LICENSE", "three/three.min.js", "three/OrbitControls.js")
    page, kinematics, script, licence, three, controls = (
        files("hingepair.pictures").joinpath(name).read_text("utf-8") for name in names
    )
    parts = {"@TITLE@": escape(model.title), "@CONTENT@": text, "@KINEMATICS@": kinematics, "@SCRIPT@": script}
    parts["@THREE@"] = f"/*\n{licence}*/\n{three}\n{controls}"
    return re.sub("@[A-Z]+@", lambda match: parts[match[0]], page)


def _finite_numbers_json(array: Array) -> list[Any]:
    """Return an array as nested lists for JSON, with None for numbers that are not finite."""
    values = array.astype(object)
    values[~np.isfinite(array)] = None
    return list(values.tolist())
