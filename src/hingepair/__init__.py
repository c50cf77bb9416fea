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

from hingepair.errors import (
    ArgumentError,
    AxisError,
    DtypeError,
    FitError,
    GimbalLockError,
    HingePairError,
    MissingDependencyError,
    RotationError,
    SceneError,
    ShapeError,
    URDFError,
)
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.states import PairState, PlanarState
from hingepair.rotations.angular_velocity import angular_velocity, angular_velocity_from_samples
from hingepair.rotations.euler import (
    euler_kinematics,
    euler_rate_matrix,
    euler_rates,
    euler_to_matrix,
    matrix_to_euler,
)
from hingepair.rotations.matrices import (
    project_to_rotation,
    rodrigues,
    rotation_exp,
    rotation_log,
    skew,
    unskew,
)

if TYPE_CHECKING:
    from hingepair.dynamics.loads import HingeLoad
    from hingepair.dynamics.simulate import SimulationError, simulate
    from hingepair.formats.mjcf_writer import to_mjcf
    from hingepair.formats.robots import load_robot_hinge
    from hingepair.formats.urdf_reader import from_urdf
    from hingepair.formats.urdf_writer import to_urdf
    from hingepair.integration.integrate import integrate
    from hingepair.integration.trajectory import PlanarTrajectory, Trajectory
    from hingepair.measured.hinge_fit import HingeFit, fit
    from hingepair.measured.inertial import AnchorFit, AxisFit, fit_anchor, fit_axis
    from hingepair.measured.instants import MeasurementWarning
    from hingepair.measured.resample import resample
    from hingepair.measured.smooth import SmoothedAngle, SmoothedMotion, smooth
    from hingepair.pair.body import Body, Box, Cylinder, Sphere
    from hingepair.pictures.page import view
    from hingepair.pictures.plot import plot
    from hingepair.scenes.derive import derive
    from hingepair.scenes.scene import load_scene
    from hingepair.validation.cross_validate import cross_validate, cross_validate_from_body1
    from hingepair.validation.pinocchio_twin import to_pinocchio

__version__ = "0.1.0"

__all__ = [
    "AnchorFit",
    "ArgumentError",
    "AxisError",
    "AxisFit",
    "Body",
    "BodyMotion",
    "Box",
    "Cylinder",
    "DtypeError",
    "FitError",
    "GimbalLockError",
    "HingeFit",
    "HingeLoad",
    "HingePair",
    "HingePairError",
    "MeasurementWarning",
    "MissingDependencyError",
    "PairState",
    "PlanarPair",
    "PlanarState",
    "PlanarTrajectory",
    "RotationError",
    "SceneError",
    "ShapeError",
    "SimulationError",
    "SmoothedAngle",
    "SmoothedMotion",
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
    "fit",
    "fit_anchor",
    "fit_axis",
    "from_urdf",
    "integrate",
    "load_robot_hinge",
    "load_scene",
    "matrix_to_euler",
    "plot",
    "project_to_rotation",
    "resample",
    "rodrigues",
    "rotation_exp",
    "rotation_log",
    "simulate",
    "skew",
    "smooth",
    "to_mjcf",
    "to_pinocchio",
    "to_urdf",
    "unskew",
    "view",
]

_LATER = {
    "plot": "pictures.plot",
    "view": "pictures.page",
    "Body": "pair.body",
    "Box": "pair.body",
    "Cylinder": "pair.body",
    "PlanarTrajectory": "integration.trajectory",
    "Trajectory": "integration.trajectory",
    "HingeFit": "measured.hinge_fit",
    "MeasurementWarning": "measured.instants",
    "SmoothedAngle": "measured.smooth",
    "SmoothedMotion": "measured.smooth",
    "HingeLoad": "dynamics.loads",
    "SimulationError": "dynamics.simulate",
    "simulate": "dynamics.simulate",
    "cross_validate": "validation.cross_validate",
    "cross_validate_from_body1": "validation.cross_validate",
    "derive": "scenes.derive",
    "AnchorFit": "measured.inertial",
    "AxisFit": "measured.inertial",
    "fit": "measured.hinge_fit",
    "fit_anchor": "measured.inertial",
    "fit_axis": "measured.inertial",
    "from_urdf": "formats.urdf_reader",
    "integrate": "integration.integrate",
    "load_robot_hinge": "formats.robots",
    "load_scene": "scenes.scene",
    "Sphere": "pair.body",
    "resample": "measured.resample",
    "smooth": "measured.smooth",
    "to_mjcf": "formats.mjcf_writer",
    "to_pinocchio": "validation.pinocchio_twin",
    "to_urdf": "formats.urdf_writer",
}


def __getattr__(name: str) -> Any:
    """What most users of the kinematics never need is imported when it is first asked for."""
    if name not in _LATER:
        raise AttributeError(f"module 'hingepair' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"hingepair.{_LATER[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})
