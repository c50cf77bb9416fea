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
    FitError,
    HingePairError,
    RotationError,
    SceneError,
    ShapeError,
)
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.states import PairState
from hingepair.rotations.matrices import (
    project_to_rotation,
    rodrigues,
    rotation_exp,
    rotation_log,
    skew,
    unskew,
)

if TYPE_CHECKING:
    from hingepair.formats.model_writers import to_mjcf, to_urdf
    from hingepair.formats.recordings import read_recording
    from hingepair.formats.robots import load_robot, load_robot_hinge
    from hingepair.measured.clusters import fit_cluster
    from hingepair.measured.hinge_fit import HingeFit, fit
    from hingepair.measured.imus import ImuRecording, fit_imus
    from hingepair.measured.mass_fit import fit_masses
    from hingepair.measured.smoothing.angular_velocity import angular_velocity_from_samples
    from hingepair.measured.smoothing.resample import resample
    from hingepair.measured.smoothing.smooth import smooth
    from hingepair.mechanism.bodies.body import Body, Box, Cylinder, Sphere
    from hingepair.mechanism.bodies.hinge_load import HingeLoad
    from hingepair.mechanism.building.urdf import from_urdf
    from hingepair.mechanism.joints import Screw, Slider
    from hingepair.mechanism.linkages import Loop
    from hingepair.mechanism.mechanism import Mechanism
    from hingepair.mechanism.pairs.tolerances import sample_pairs
    from hingepair.mechanism.states import (
        MechanismState,
    )
    from hingepair.mechanism.struts import GasSpring
    from hingepair.motion.integrate import integrate
    from hingepair.motion.linearize import linearize
    from hingepair.motion.simulate import simulate
    from hingepair.motion.trajectory import Trajectory
    from hingepair.pictures.page import view
    from hingepair.pictures.plot import plot
    from hingepair.rollouts.tracks import Feedback
    from hingepair.rotations.angular_velocity import angular_velocity
    from hingepair.rotations.euler import euler_rate_matrix, euler_rates, euler_to_matrix, matrix_to_euler
    from hingepair.scenes.derive import derive
    from hingepair.scenes.load import load_scene
    from hingepair.scenes.variants.search import search
    from hingepair.scenes.variants.vary import vary
    from hingepair.tables.instants import MeasurementWarning
    from hingepair.validation.cross_validate import cross_validate
    from hingepair.validation.pinocchio_twin import to_pinocchio

__version__ = "0.3.0"

__all__ = [
    "ArgumentError",
    "Body",
    "BodyMotion",
    "Box",
    "Cylinder",
    "DynamicsWarning",
    "Feedback",
    "FitError",
    "GasSpring",
    "HingeFit",
    "HingeLoad",
    "HingePair",
    "HingePairError",
    "ImuRecording",
    "Loop",
    "MeasurementWarning",
    "Mechanism",
    "MechanismState",
    "PairState",
    "PlanarPair",
    "RotationError",
    "SceneError",
    "Screw",
    "ShapeError",
    "Slider",
    "Sphere",
    "Trajectory",
    "angular_velocity",
    "angular_velocity_from_samples",
    "cross_validate",
    "derive",
    "euler_rate_matrix",
    "euler_rates",
    "euler_to_matrix",
    "fit",
    "fit_cluster",
    "fit_imus",
    "fit_masses",
    "from_urdf",
    "integrate",
    "linearize",
    "load_robot",
    "load_robot_hinge",
    "load_scene",
    "matrix_to_euler",
    "plot",
    "project_to_rotation",
    "read_recording",
    "resample",
    "rodrigues",
    "rotation_exp",
    "rotation_log",
    "sample_pairs",
    "search",
    "simulate",
    "skew",
    "smooth",
    "to_mjcf",
    "to_pinocchio",
    "to_urdf",
    "unskew",
    "vary",
    "view",
]

_LAZY_MODULE_BY_NAME = {
    name: module
    for module, names in {
        "mechanism.bodies.hinge_load": "HingeLoad",
        "motion.linearize": "linearize",
        "motion.simulate": "simulate",
        "formats.model_writers": "to_mjcf to_urdf",
        "formats.recordings": "read_recording",
        "formats.robots": "load_robot load_robot_hinge",
        "measured.mass_fit": "fit_masses",
        "motion.integrate": "integrate",
        "motion.trajectory": "Trajectory",
        "measured.clusters": "fit_cluster",
        "measured.hinge_fit": "HingeFit fit",
        "measured.imus": "ImuRecording fit_imus",
        "measured.smoothing.resample": "resample",
        "measured.smoothing.smooth": "smooth",
        "tables.instants": "MeasurementWarning",
        "mechanism.building.urdf": "from_urdf",
        "mechanism.linkages": "Loop",
        "mechanism.struts": "GasSpring",
        "mechanism.mechanism": "Mechanism",
        "mechanism.joints": "Screw Slider",
        "mechanism.states": "MechanismState",
        "mechanism.bodies.body": "Body Box Cylinder Sphere",
        "scenes.variants.search": "search",
        "scenes.variants.vary": "vary",
        "mechanism.pairs.tolerances": "sample_pairs",
        "pictures.page": "view",
        "pictures.plot": "plot",
        "rotations.angular_velocity": "angular_velocity",
        "measured.smoothing.angular_velocity": "angular_velocity_from_samples",
        "rotations.euler": "euler_rate_matrix euler_rates euler_to_matrix matrix_to_euler",
        "rollouts.tracks": "Feedback",
        "scenes.derive": "derive",
        "scenes.load": "load_scene",
        "validation.cross_validate": "cross_validate",
        "validation.pinocchio_twin": "to_pinocchio",
    }.items()
    for name in names.split()
}


def __getattr__(name: str) -> Any:
    """Import a public name that most users of the kinematics never need, when it is first asked for."""
    if name not in _LAZY_MODULE_BY_NAME:
        from hingepair.errors import nearest

        # Tools ask every module for names with underscores, thousands of times: no search for those.
        hint = "" if name.startswith("_") else nearest(name, __all__)
        raise AttributeError(f"module 'hingepair' has no attribute {name!r}{hint}")
    value = globals()[name] = getattr(import_module(f"hingepair.{_LAZY_MODULE_BY_NAME[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
