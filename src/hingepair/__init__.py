"""Two rigid bodies joined by a hinge: everything about body 2 from the motion of body 1 and the hinge angle.

Vectors are in world axes unless their letter says otherwise, in SI units and radians, right-handed. `import
hingepair` loads NumPy and nothing else; Pinocchio, SymPy and the rest are imported by the functions that use them.

>>> import numpy as np
>>> import hingepair as hp
>>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
>>> pair.forward_kinematics((0, 0, 0, 0, 0, 0, np.pi / 2)).R2.round(12) + 0.0
array([0.75, 0.  , 0.  ])
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hingepair.attitude_rates import angular_velocity, angular_velocity_from_samples
from hingepair.errors import (
    ArgumentError,
    AxisError,
    DtypeError,
    GimbalLockError,
    HingePairError,
    MissingDependencyError,
    RotationError,
    SceneError,
    ShapeError,
    URDFError,
)
from hingepair.euler import euler_rate_matrix, euler_rates, euler_to_matrix, matrix_to_euler
from hingepair.motion import BodyMotion
from hingepair.pair import HingePair
from hingepair.planar import PlanarPair
from hingepair.rotations import (
    project_to_rotation,
    rodrigues,
    rotation_exp,
    rotation_log,
    skew,
    unskew,
)
from hingepair.state import PairState, PlanarState

if TYPE_CHECKING:
    from hingepair.body import Body, Box, Cylinder, Sphere
    from hingepair.closed_forms import derive
    from hingepair.euler_motion import euler_kinematics
    from hingepair.integration import integrate
    from hingepair.mjcf import to_mjcf
    from hingepair.pinocchio import cross_validate, cross_validate_from_body1, to_pinocchio
    from hingepair.robots import load_robot_hinge
    from hingepair.scene import load_scene
    from hingepair.trajectory import PlanarTrajectory, Trajectory
    from hingepair.urdf import from_urdf, to_urdf

__version__ = "0.1.0"

__all__ = [
    "ArgumentError",
    "AxisError",
    "Body",
    "BodyMotion",
    "Box",
    "Cylinder",
    "DtypeError",
    "GimbalLockError",
    "HingePair",
    "HingePairError",
    "MissingDependencyError",
    "PairState",
    "PlanarPair",
    "PlanarState",
    "PlanarTrajectory",
    "RotationError",
    "SceneError",
    "ShapeError",
    "Sphere",
    "Trajectory",
    "URDFError",
    "angular_velocity",
    "angular_velocity_from_samples",
    "cross_validate",
    "cross_validate_from_body1",
    "derive",
    "euler_kinematics",
    "euler_rate_matrix",
    "euler_rates",
    "euler_to_matrix",
    "from_urdf",
    "integrate",
    "load_robot_hinge",
    "load_scene",
    "matrix_to_euler",
    "project_to_rotation",
    "rodrigues",
    "rotation_exp",
    "rotation_log",
    "skew",
    "to_mjcf",
    "to_pinocchio",
    "to_urdf",
    "unskew",
]

_LATER = {
    "Body": "body",
    "Box": "body",
    "Cylinder": "body",
    "PlanarTrajectory": "trajectory",
    "Trajectory": "trajectory",
    "cross_validate": "pinocchio",
    "cross_validate_from_body1": "pinocchio",
    "derive": "closed_forms",
    "euler_kinematics": "euler_motion",
    "from_urdf": "urdf",
    "integrate": "integration",
    "load_robot_hinge": "robots",
    "load_scene": "scene",
    "Sphere": "body",
    "to_mjcf": "mjcf",
    "to_pinocchio": "pinocchio",
    "to_urdf": "urdf",
}


def __getattr__(name: str) -> Any:
    """What most users of the kinematics never need is imported when it is first asked for."""
    if name not in _LATER:
        raise AttributeError(f"module 'hingepair' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"hingepair.{_LATER[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})
