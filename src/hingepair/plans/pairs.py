"""What to compute of a pair: the tree with one hinge and a free base, body 1, behind fronts.

Body 2 and every point of the pair are frames of the tree. The z axis of the tree's body lies along the hinge axis.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from hingepair.engine.binding import ArrayShape
from hingepair.engine.loops import Loop
from hingepair.equations import spatial as eq
from hingepair.equations.joints import HINGE
from hingepair.equations.quantities import QUANTITIES, Quantity, sample_shape, unit_of
from hingepair.equations.spatial import add, rotate
from hingepair.equations.trees import Pose, frame_pose, turned
from hingepair.numeric.blocks import hinge_terms
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.constraints import CONSTRAINTS, ConstraintQuantities
from hingepair.plans.fronts import (
    QUATERNION_FRONTS,
    ForwardDynamics,
    FourCoordinates,
    Front,
    HingeAngle,
    Plane,
    SevenCoordinates,
    euler_angles,
    needed_names,
)
from hingepair.plans.geometry import GEOMETRY_SHAPES, Geometry
from hingepair.plans.trees import (
    BASE_SHAPES,
    FRAME_SHAPES,
    JOINT_SHAPES,
    OUTPUTS,
    PIVOT_SHAPES,
    Form,
    Output,
    TreeQuantities,
    TreeRequest,
)

# ---- points


class Point(NamedTuple):
    """A point that is fixed to body 1 or body 2 of a pair."""

    name: str
    body: int  # 1 or 2


POINT_ENDINGS: Final = {"R": "", "v": "_v", "a": "_a"}
"""Endings of the outputs of a point, after its name, by quantity."""


@functools.lru_cache(maxsize=256)
def point_outputs(points: tuple[Point, ...]) -> dict[str, Quantity]:
    """Return the quantities of the outputs of points by name.

    >>> [*point_outputs((Point("tip", 2),))], point_outputs((Point("tip", 2),))["tip_v"].unit
    (['tip', 'tip_v', 'tip_a'], 'm/s')
    """
    texts = {"R": "Position", "v": "Velocity", "a": "Acceleration"}
    return {
        point.name + ending: QUANTITIES[letter]._replace(text=f"{texts[letter]} of the point {point.name}")
        for point in points
        for letter, ending in POINT_ENDINGS.items()
    }


def unit_among(outputs: Collection[str], name: str) -> str:
    """Return the unit of an output, or of one of its components; outputs that are no quantities are of points.

    >>> unit_among(("tip_v", "omega2"), "tip_v_x"), unit_among(("tip_v", "omega2"), "omega2_x")
    ('m/s', 'rad/s')
    """
    output = name if name in outputs else name.rpartition("_")[0]
    if output in QUANTITIES or output not in outputs:
        return unit_of(name)
    return unit_of(output[-1] if output.endswith((POINT_ENDINGS["v"], POINT_ENDINGS["a"])) else "R")


# ---- the outputs


def _of_frame(letter: str, frame: int) -> Output:
    """Return the output of a frame."""
    functions: dict[str, Callable[[TreeQuantities], Any]] = {
        "R": lambda tree: add(tree.values["R1"], tree.frame_poses[frame].d),
        "d": lambda tree: tree.frame_poses[frame].d,
        "v": lambda tree: tree.frame_velocities[frame][0],
        "omega": lambda tree: tree.frame_velocities[frame][1],
        "a": lambda tree: tree.frame_accelerations[frame][0],
        "alpha": lambda tree: tree.frame_accelerations[frame][1],
    }
    return Output(OUTPUTS[letter].inputs, functions[letter])


def _given(name: str, source: str) -> Output:
    """Return the output that is a value of the tree, or the only number of one."""
    return Output((source,), lambda tree: tree.values[source] if name == source else tree.values[source][0])


def _attitude2(tree: TreeQuantities) -> Any:
    """Return S2 by Rodrigues' formula (E5, E6): what a tiny psi turns is accurate in itself, as it is not in the
    product of the rotations to the tree's axes and back.
    """
    S1, n, home = (tree.values[name] for name in ("S1", "n", "home"))
    return eq.attitude2(S1, eq.hinge_rotation(n, hinge_terms(tree.q[0])), home)


def _attitude2_without_home(tree: TreeQuantities) -> Any:
    """Return S2 where C is the identity."""
    return eq.compose(tree.values["S1"], eq.hinge_rotation(tree.values["n"], hinge_terms(tree.q[0])))


def _bearing_torque(tree: TreeQuantities) -> Any:
    """Return the torque of the hinge across its axis."""
    x, y, _ = tree.transmitted_wrenches[1][1]
    return rotate(tree.poses[1].S, (x, y, 0.0))


class PairQuantities(TreeQuantities):
    """The quantities of a tree of one hinge. What is fixed to body 2 is turned by the hinge, then with body 1: fewer
    operations, and roundings, than by the attitude of the tree's body, which kinematics of a pair do not need.
    """

    @lock_free_cached_property
    def frame_poses(self) -> list[Pose]:
        """List of the poses of all frames in world axes."""
        (base, body2), (hinge,) = self.poses, self.placements
        found = []
        for body, constants in self.frames:
            R, S = constants["R"], constants["S"]
            if body == 0:
                found.append(frame_pose(base, R, S))
                continue
            arm = rotate(base.S, rotate(hinge.S, R if hinge.turn is None else turned(hinge.turn, R)))
            found.append(Pose(eq.compose(body2.S, S), add(body2.d, arm), arm))
        return found


_FORCES: Final = OUTPUTS["tau"].inputs
_SPATIAL: Final[dict[str, Output]] = {
    **{f"{letter}2": _of_frame(letter, 0) for letter in ("R", "v", "omega", "a", "alpha")},
    "S2": Output((*OUTPUTS["S"].inputs, "n", "home"), _attitude2),
    "d": _of_frame("d", 0),
    **{name: _given(name, name) for name in ("R1", "S1", "v1", "omega1", "a1", "alpha1")},
    "psidd": _given("psidd", "qdd"),
    "hinge_torque": Output(_FORCES, lambda tree: tree.efforts()[0]),
    "hinge_force": Output(_FORCES, lambda tree: tree.joint_wrenches[0][0]),
    "hinge_moment": Output(_FORCES, lambda tree: tree.joint_wrenches[0][1]),
    "bearing_torque": Output(_FORCES, _bearing_torque),
    "angular": OUTPUTS["angular_about_origin"],
    "pivots": Output(OUTPUTS["pivots"].inputs, lambda tree: (*tree.pivots, *tree.base_pivots)),
    **{name: _given(name, name) for name in ("quat_xyzw_check", "quat_wxyz_check")},
    "jacobian": Output(OUTPUTS["jacobian"].inputs, lambda tree: tree.jacobian(False)[:42]),  # of the first frame
    **{
        name: OUTPUTS[name]
        for name in ("mass_matrix", "force1", "torque1", "kinetic", "potential", "linear", "S1_check")
    },
    "acceleration_bias": Output(("q", "S1", "qd", "omega1"), lambda tree: tree.acceleration_bias()[:6]),
}

_PHI2: Final = Output(("phi1", "psi"), lambda tree: tree.values["phi1"] + tree.values["psi"])


def _in_plane(output: Output, is_vector: bool) -> Output:
    """Return the x and y of an output that is a vector in the plane, or its z."""
    take = operator.itemgetter(0, 1) if is_vector else operator.itemgetter(2)
    return Output(output.inputs, lambda tree: take(output.compute(tree)))


# ---- pairs in space and in the plane

_VELOCITIES: Final = 7  # v1, omega1 and psi'
_BODY1: Final = ("R1", "S1", "v1", "omega1", "a1", "alpha1")  # outputs only if they are named


@dataclass(frozen=True, slots=True, eq=False)
class PairKind:
    """What can be given and asked of pairs in space, or of planar ones."""

    coordinates: tuple[str, ...]  # names of the components of q
    columns: Mapping[str, tuple[str, ...]]  # of q, qd and qdd in files and data frames
    shapes: Mapping[str, ArrayShape]  # of one sample of all that can be given or computed
    levels: Mapping[str, int | None]  # outputs of kinematics: the order from which it is a default output, or None
    planar: bool

    def __reduce__(self) -> str:  # the two kinds are compared by identity
        return "PLANE" if self.planar else "SPACE"

    def default_outputs(self, level: int) -> tuple[str, ...]:
        """Return the names of the outputs that are computed if the user names none: those of a level (0 pose, 1
        velocity, 2 acceleration) and of the levels below it.
        """
        return tuple(name for name, lowest in self.levels.items() if lowest is not None and lowest <= level)


def _sample_shapes(coordinates: int) -> dict[str, ArrayShape]:
    sizes = {"coordinates": coordinates, "velocities": _VELOCITIES, "joints": 1, "parameters": 20}
    sizes |= {"tree": 1, "loops": 0, "conditions": 0, "struts": 0}  # of mechanisms with loops and struts
    return {name: sample_shape(name, sizes) for name in QUANTITIES} | {"pivots": (_VELOCITIES,)}


def _levels(*of_body2: str) -> dict[str, int | None]:
    return {name: QUANTITIES[name].order for name in of_body2}


SPACE: Final = PairKind(
    ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi"),
    {
        "q": ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi"),
        "qd": ("v1_x", "v1_y", "v1_z", "phid_x", "phid_y", "phid_z", "psid"),
        "qdd": ("a1_x", "a1_y", "a1_z", "phidd_x", "phidd_y", "phidd_z", "psidd"),
    },
    _sample_shapes(7) | dict.fromkeys(("e1", "e2", "e1_in_2", "e2_in_2", "n_in_2"), (3,)) | {"home": (3, 3)},
    {**_levels("R2", "S2", "d", "v2", "omega2", "a2", "alpha2"), **dict.fromkeys(_BODY1)},
    planar=False,
)
"""Pairs in space."""
PLANE: Final = PairKind(
    ("x", "y", "phi", "psi"),
    {
        "q": ("x", "y", "phi", "psi"),
        "qd": ("v1_x", "v1_y", "phid", "psid"),
        "qdd": ("a1_x", "a1_y", "phidd", "psidd"),
    },
    {
        **_sample_shapes(4),
        **dict.fromkeys(("R1", "v1", "a1", "u1", "u2", "R2", "d", "v2", "a2"), (2,)),
        **dict.fromkeys(("phi2", "omega2", "alpha2", "phi1", "phi1d", "phi1dd"), ()),
    },
    _levels("R2", "phi2", "d", "v2", "omega2", "a2", "alpha2"),
    planar=True,
)
"""Planar pairs (E11)."""


# ---- the program

APPLIED_LOADS: Final = ("force1", "torque1", "force2", "torque2", "hinge_torque")
"""Names of the loads that forward dynamics take."""
FORCES: Final = ("force1", "torque1", "hinge_torque")
"""Outputs of inverse dynamics."""
ACCELERATIONS: Final = ("a1", "alpha1", "psidd")
"""Outputs of forward dynamics."""
NO_MASSES: Final = frozenset({*SPACE.levels, *PLANE.levels, "jacobian", "acceleration_bias", "S1_check"})
"""Outputs that do not depend on masses, those of points apart, unless accelerations are solved for."""
FRAME_NUMBERS: Final = sum(math.prod(tail) for tail in FRAME_SHAPES.values())
"""How many constants a frame of the tree has."""
# A hinge without a motor (armature 0) that follows none: multiplier 1, offset 0.
_KNOWN: Final = {"armature": 0.0, "multiplier": 1.0, "offset": 0.0}
_CONSTANTS: Final = [
    (name, math.prod(tail)) for one in (BASE_SHAPES, JOINT_SHAPES, PIVOT_SHAPES) for name, tail in one.items()
]
_FORM: Final = Form((0,), (HINGE,), (0,), tuple(_KNOWN.get(name) for name, count in _CONSTANTS for _ in range(count)))


def tree_parameters(numbers: Sequence[Any]) -> tuple[Any, ...]:
    """Return those of all constants of a pair's tree, or of what goes with them, that differ between pairs."""
    known = (*_FORM.known, *(None,) * (len(numbers) - len(_FORM.known)))
    return tuple(number for number, fixed in zip(numbers, known, strict=True) if fixed is None)


class PairRequest(NamedTuple):
    """What is computed of a pair, and from what."""

    outputs: tuple[str, ...]
    given: tuple[str, ...]  # names of the arguments
    planar: bool = False
    sequence: str | None = None  # of the Euler angles, where q is given
    points: tuple[Point, ...] = ()  # of the pair; frames of the tree behind that of body 2, in this order
    varied: tuple[int, ...] = ()  # places of the constants that differ from sample to sample
    by_geometry: bool = False  # whether the constants are made of the geometry, which is given
    has_home: bool = True  # whether C differs from the identity

    @property
    def fronts(self) -> tuple[type[Front], ...]:
        """The fronts before the tree, in the order of tracing."""
        found: list[type[Front]] = []
        if self.planar:
            found = [*([FourCoordinates] if "q" in self.given else []), Plane]
        elif "q" in self.given:
            found = [SevenCoordinates, euler_angles(self.sequence or "XYZ")]
        else:
            found = [QUATERNION_FRONTS[name] for name in self.given if name in QUATERNION_FRONTS]
        found.append(HingeAngle)
        if self.by_geometry:
            found.append(Geometry)
        return (*found, ForwardDynamics) if self.solves else tuple(found)

    @property
    def solves(self) -> bool:
        """Whether accelerations are solved for, because loads are given."""
        return any(name in APPLIED_LOADS for name in self.given)

    @property
    def tree(self) -> TreeRequest:
        """What the tree has beside the hinge: a frame of body 2, one for each point, and the loads on body 2."""
        frames = (1, *(point.body - 1 for point in self.points))
        known = (None,) * FRAME_NUMBERS * len(frames)
        return TreeRequest((), True, frames, known, (0,) if self.solves else (), varied=self.varied)

    def inputs(self) -> dict[str, ArrayShape]:
        """Return the shape of one sample of each input that the outputs need, by name."""
        fronts, names, constants = self.fronts, set[str](), False
        for name in self.outputs:
            if name in self.given:
                names.add(name)
            elif self._is_of_both(name):
                names |= needed_names(fronts, CONSTRAINTS[name][0])
            else:
                names |= needed_names(fronts, _output(self, name).inputs)
                constants = True
        shapes = {**(PLANE if self.planar else SPACE).shapes}
        if self.by_geometry:
            shapes |= {**GEOMETRY_SHAPES, "least_axis": (3,)}
        if constants and self.by_geometry:
            shapes["points"] = (3 * len(self.points),)
            names |= needed_names(fronts, ("numbers",)) - ({"points"} if not self.points else set())
        elif constants:
            frames = 1 + len(self.points)
            shapes["constants"] = (_FORM.known.count(None) + FRAME_NUMBERS * frames,)
            shapes["samples"] = (len(self.varied),)
            names |= {"constants", "samples"} if self.varied else {"constants"}
        return {name: shapes[name] for name in sorted(names)}

    def _is_of_both(self, name: str) -> bool:
        """Return whether an output is one of two given motions; psi and its rates may be given."""
        return name in CONSTRAINTS and ("S2" in self.given or not name.startswith("psi"))

    def compute(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return the outputs by name, each a scalar or a flat tuple of components, from the inputs by name."""
        values = given
        for front in self.fronts:
            if front is Geometry:
                values = Geometry(values, [point.body for point in self.points])
            elif front is ForwardDynamics:
                values = ForwardDynamics(values, self._quantities(values))
            else:
                values = front(values)
        found: dict[str, Any] = {}
        constraints, tree = ConstraintQuantities(values), None
        for name in self.outputs:
            if name in self.given:
                found[name] = given[name]
            elif self._is_of_both(name):
                found[name] = CONSTRAINTS[name][1](constraints)
            else:
                tree = tree or self._quantities(values)
                found[name] = _output(self, name).compute(tree)
        return found

    def _quantities(self, values: Mapping[str, Any]) -> PairQuantities:
        return PairQuantities(_FORM, self.tree, values)


def _output(request: PairRequest, name: str) -> Output:
    """Return how an output is computed; one that nothing computes has to be given."""
    if request.planar and name == "phi2":
        return _PHI2
    points = {
        point.name + ending: (letter, place)
        for place, point in enumerate(request.points, 1)
        for letter, ending in POINT_ENDINGS.items()
    }
    if name in points:
        found = _of_frame(*points[name])
    elif name == "S2" and not request.has_home:
        return Output((*OUTPUTS["S"].inputs, "n"), _attitude2_without_home)
    elif name in _SPATIAL:
        found = _SPATIAL[name]
    else:
        return Output((name,), lambda tree: tree.values[name])
    if not request.planar:
        return found
    spatial, planar = ((3,), (2,)) if name in points else (SPACE.shapes[name], PLANE.shapes[name])
    return found if spatial == planar else _in_plane(found, planar == (2,))


@functools.lru_cache(maxsize=1024)
def pair_loop(request: PairRequest) -> Loop:
    """Return the cached `Loop` that computes a request over samples."""
    shapes = {**(PLANE if request.planar else SPACE).shapes, **point_shapes(request.points, request.planar)}
    outputs = {name: shapes[name] for name in request.outputs}
    return Loop("state", request.compute, request.inputs(), outputs, form=request)


def point_shapes(points: tuple[Point, ...], planar: bool) -> dict[str, ArrayShape]:
    """Return the shape of one sample of each output of points."""
    return dict.fromkeys(point_outputs(points), (2,) if planar else (3,))
