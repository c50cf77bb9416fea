"""The quantities of pairs and robots: what a name stands for, its unit, the shape of a sample, and its order.

A digit names a body: R1 is the R of body 1, of a robot that of its base. Names without a digit are those of frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple, TypeAlias

POSE, VELOCITY, ACCELERATION = 0, 1, 2  # orders of derivatives

Shape: TypeAlias = tuple[int | str, ...]


class Quantity(NamedTuple):
    """What one name stands for."""

    text: str
    unit: str = "1"
    # Of one sample, of one frame, in space. Words are numbers of a robot: coordinates, velocities (six more of a free
    # base), joints, and inertial parameters.
    shape: Shape = ()
    order: int = POSE  # highest time derivative of the coordinates that it needs
    unit_of_joints: str = ""  # where coordinates are those of joints of several kinds; "": the same unit


_V: Final[Shape] = (3,)  # of vectors
_COORDINATES: Final[Shape] = ("coordinates",)  # of q and what goes with it; 7 in a pair
_JACOBIAN_UNIT: Final = "m or 1, then 1 or 0"


def _of_body(k: int) -> dict[str, Quantity]:
    """Return the quantities of body k of a pair (1 or 2) by name; those of body 1 are also the base's of a robot."""
    point = f"body {k}'s reference point"
    return {
        f"R{k}": Quantity(f"Reference point of body {k}", "m", _V),
        f"S{k}": Quantity(f"Rotation of body {k}, body to world", "1", (3, 3)),
        f"v{k}": Quantity(f"Velocity of {point}", "m/s", _V, VELOCITY),
        f"omega{k}": Quantity(f"Angular velocity of body {k}", "rad/s", _V, VELOCITY),
        f"a{k}": Quantity(f"Classical acceleration of {point}", "m/s^2", _V, ACCELERATION),
        f"alpha{k}": Quantity(f"Angular acceleration of body {k}", "rad/s^2", _V, ACCELERATION),
        f"u{k}": Quantity(f"Hinge point from {point}, body axes", "m", _V),
        f"force{k}": Quantity(f"Force on body {k} at its reference point", "N", _V, ACCELERATION),
        f"torque{k}": Quantity(f"Torque on body {k} about its reference point", "N m", _V, ACCELERATION),
    }


QUANTITIES: Final[dict[str, Quantity]] = {
    "t": Quantity("Time", "s"),
    # ---- coordinates
    "q": Quantity("Coordinates", "1", _COORDINATES, POSE, "rad or m"),
    "qd": Quantity("Time derivatives of q", "1", _COORDINATES, VELOCITY, "rad/s or m/s"),
    "qdd": Quantity("Second time derivatives of q", "1", _COORDINATES, ACCELERATION, "rad/s^2 or m/s^2"),
    **dict.fromkeys(("x", "y", "z"), Quantity("Coordinate of R1", "m")),
    "phi": Quantity("Euler angles of body 1", "rad", _V),
    "phid": Quantity("Time derivatives of phi", "rad/s", _V, VELOCITY),
    "phidd": Quantity("Second time derivatives of phi", "rad/s^2", _V, ACCELERATION),
    "phi2": Quantity("Angle of body 2, phi + psi", "rad"),
    "psi": Quantity("Hinge angle", "rad"),
    "psid": Quantity("Hinge rate", "rad/s", (), VELOCITY),
    "psidd": Quantity("Acceleration of the hinge angle", "rad/s^2", (), ACCELERATION),
    "quat_xyzw": Quantity("Quaternion of S1, scalar last", "1", (4,)),
    "quat_wxyz": Quantity("Quaternion of S1, scalar first", "1", (4,)),
    **{
        f"{name}_check": Quantity(f"How far {name} is from an attitude")
        for name in ("S1", "S2", "quat_xyzw", "quat_wxyz")
    },
    # ---- bodies of a pair
    **_of_body(2),
    "d": Quantity("Vector from R1 to R2, or to R of a frame; a large R1 does not reduce its accuracy", "m", _V),
    **_of_body(1),
    "n": Quantity("Hinge axis, body-1 axes", "1", _V),
    "limits": Quantity("Smallest and largest hinge angle", "rad"),
    "rate_limit": Quantity("Largest hinge rate", "rad/s"),
    "torque_limit": Quantity("Largest torque of the motor", "N m"),
    "mass": Quantity("Mass", "kg"),
    # ---- constraints of the hinge
    "gap": Quantity("R1 + S1 u1 - (R2 + S2 u2)", "m", _V),
    "gap_rate": Quantity("Time derivative of gap", "m/s", _V, VELOCITY),
    "gap_acceleration": Quantity("Second time derivative of gap", "m/s^2", _V, ACCELERATION),
    "tilt": Quantity("Cross product of the hinge axes of both bodies", "rad", (2,)),
    "tilt_angle": Quantity("Angle between the hinge axes of both bodies", "rad"),
    "tilt_rate": Quantity("Time derivative of tilt", "rad/s", (2,), VELOCITY),
    "tilt_acceleration": Quantity("Second time derivative of tilt", "rad/s^2", (2,), ACCELERATION),
    # ---- forces of a pair
    "hinge_torque": Quantity("Torque of body 1 on body 2 about the hinge axis", "N m", (), ACCELERATION),
    "hinge_force": Quantity("Force of body 1 on body 2 at the hinge point", "N", _V, ACCELERATION),
    "hinge_moment": Quantity("Torque of body 1 on body 2 about the hinge point", "N m", _V, ACCELERATION),
    "bearing_torque": Quantity("Torque across the hinge axis, which the bearing carries", "N m", _V, ACCELERATION),
    **{
        f"{part}_torque": Quantity(f"Part of hinge_torque: {part}", "N m", (), ACCELERATION)
        for part in ("motor", "spring", "damper", "friction", "stop")
    },
    # ---- pairs and robots, whose base is body 1
    "gravity": Quantity("Acceleration of free fall", "m/s^2", _V),
    "jacobian": Quantity("Jacobian of velocity and angular velocity", "1", (6, "velocities"), POSE, _JACOBIAN_UNIT),
    "jacobian_in_frame": Quantity("Jacobian in the axes of the frame", "1", (6, "velocities"), POSE, _JACOBIAN_UNIT),
    "jacobian_rate": Quantity("Time derivative of jacobian", "1", (6, "velocities"), VELOCITY),
    "jacobian_in_frame_rate": Quantity("Time derivative of jacobian_in_frame", "1", (6, "velocities"), VELOCITY),
    "acceleration_bias": Quantity("Acceleration and angular acceleration that velocities cause", "1", (6,), VELOCITY),
    "mass_matrix": Quantity("Mass matrix", "1", ("velocities", "velocities"), POSE, "kg m^2, kg m or kg"),
    "kinetic": Quantity("Kinetic energy", "J", (), VELOCITY),
    "potential": Quantity("Potential energy in uniform gravity", "J"),
    "linear": Quantity("Linear momentum", "kg m/s", _V, VELOCITY),
    "angular": Quantity("Angular momentum about the world's origin", "kg m^2/s", _V, VELOCITY),
    # ---- frames of a robot
    "R": Quantity("Position of the frame's origin", "m", _V),
    "S": Quantity("Rotation matrix from frame axes to world axes", "1", (3, 3)),
    "quat": Quantity("Quaternion of S, scalar last", "1", (4,)),
    "v": Quantity("Velocity of the frame's origin", "m/s", _V, VELOCITY),
    "omega": Quantity("Angular velocity", "rad/s", _V, VELOCITY),
    "a": Quantity("Acceleration of the frame's origin, the second time derivative of R", "m/s^2", _V, ACCELERATION),
    "alpha": Quantity("Angular acceleration", "rad/s^2", _V, ACCELERATION),
    # ---- joints and dynamics of a robot
    "tau": Quantity(
        "Torque of every hinge [N m] and force of every slider [N], in the order of q",
        "1",
        _COORDINATES,
        ACCELERATION,
        "N m or N",
    ),
    "force": Quantity("Force of the carrying body on the body of each joint", "N", ("joints", 3), ACCELERATION),
    "torque": Quantity("Torque about the joint's point", "N m", ("joints", 3), ACCELERATION),
    "torque_regressor": Quantity("Regressor of tau", "1", ("velocities", "parameters"), ACCELERATION),
    "bias_forces": Quantity("Forces at zero acceleration", "1", ("velocities",), VELOCITY, "N m or N"),
    "gravity_forces": Quantity("Forces that hold the robot at rest", "1", ("velocities",), POSE, "N m or N"),
    "pivots": Quantity("Pivots of the factored mass matrix", "1", _COORDINATES),
    "base_pivots": Quantity("Pivots of a free base", "1", (6,)),
    "q_all": Quantity("Coordinates of all joints of a closed mechanism", "1", ("tree",)),
    "qd_all": Quantity("Time derivatives of q_all", "1", ("tree",), VELOCITY),
    "qdd_all": Quantity("Second time derivatives of q_all", "1", ("tree",), ACCELERATION),
    "strut_length": Quantity("Lengths of the struts", "m", ("struts",)),
    "strut_rate": Quantity("Rates of the lengths of the struts", "m/s", ("struts",), VELOCITY),
    "strut_force": Quantity("Forces of the struts, which push where they are positive", "N", ("struts",), VELOCITY),
    "tree_tau": Quantity("Efforts of all joints without the forces in loops", "1", ("tree",), ACCELERATION),
    "loop_wrenches": Quantity("Force and torque by which each condition of a loop acts", "1", ("conditions", 6)),
    "loop_gaps": Quantity("By how much each loop is open", "m", ("loops",)),
    "loop_jacobian": Quantity("Derivatives of the conditions of loops by q_all", "1", ("conditions", "tree")),
    "centre_of_mass": Quantity("Centre of mass", "m", _V),
    "centre_of_mass_jacobian": Quantity("Jacobian of the centre of mass", "1", (3, "velocities")),
    "centroidal_momentum_matrix": Quantity("Matrix of the momentum about the centre of mass", "1", (6, "velocities")),
    "centroidal_momentum_matrix_rate": Quantity("Its time derivative", "1", (6, "velocities"), VELOCITY),
    **{
        f"{of}_{by}": Quantity(f"Derivatives of {of} by {by}", "1", ("velocities", "velocities"), ACCELERATION)
        for of, others in (("tau", ("q", "qd", "qdd")), ("qdd", ("q", "qd", "tau")))
        for by in others
    },
    "angular_about_origin": Quantity("Angular momentum about the world's origin", "kg m^2/s", _V, VELOCITY),
    "angular_about_centre": Quantity("Angular momentum about the centre of mass", "kg m^2/s", _V, VELOCITY),
}
"""What each name stands for; components such as R1_x have no entry."""


def sample_shape(name: str, sizes: Mapping[str, int]) -> tuple[int, ...]:
    """Return the shape of one sample of a quantity, for the numbers that a robot has."""
    return tuple(part if isinstance(part, int) else sizes[part] for part in QUANTITIES[name].shape)


def unit_of(name: str, of_joints: bool = False) -> str:
    """Return the unit of a quantity, or of one of its components; "1" if it has none or is not known. `of_joints`:
    whether coordinates are those of the joints of a robot.

    >>> unit_of("omega2"), unit_of("R2"), unit_of("S2"), unit_of("bearing_torque_x")
    ('rad/s', 'm', '1', 'N m')
    """
    for known in (name, name.rpartition("_")[0]):
        quantity = QUANTITIES.get(known) or QUANTITIES.get(known.rstrip("12"))
        if quantity is not None:
            return (of_joints and quantity.unit_of_joints) or quantity.unit
    return "1"


def attribute_texts(
    names: Iterable[str], shapes: Mapping[str, Shape] | None = None, leading: str = "..."
) -> dict[str, str]:
    """Return a description of each attribute of a result by name, with shape and unit.

    Args:
        names: names of quantities.
        shapes: shapes of a sample, where they are not those in space.
        leading: the leading axes.

    >>> attribute_texts(("v2",))
    {'v2': "Velocity of body 2's reference point; (..., 3) m/s."}
    """
    texts = {}
    for name in names:
        text, unit, shape, *_ = QUANTITIES[name]
        sizes = [
            "dof" if part in ("coordinates", "velocities") else str(part)
            for part in (shape if shapes is None else shapes[name])
        ]
        inner = ", ".join((leading, *sizes)) if sizes else f"{leading},"
        texts[name] = f"{text}; ({inner}){'' if unit == '1' else f' {unit}'}."
    return texts
