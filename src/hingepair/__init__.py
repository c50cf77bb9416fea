"""Two rigid bodies joined by a hinge: everything about body 2 from the motion of body 1 and the hinge angle.

Vectors are in world axes unless their letter says otherwise, in SI units and radians, right-handed. Modules are
imported at first use; pairs need NumPy alone, and Pinocchio, SymPy and the rest are loaded by what uses them.

>>> import numpy as np
>>> import hingepair as hp
>>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
>>> pair.forward_kinematics((0, 0, 0, 0, 0, 0, np.pi / 2)).R2.round(12) + 0.0
array([0.75, 0.  , 0.  ])
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hingepair.errors import nearest

if TYPE_CHECKING:
    from hingepair.errors import ArgumentError as ArgumentError
    from hingepair.errors import DynamicsWarning as DynamicsWarning
    from hingepair.errors import FitError as FitError
    from hingepair.errors import HingePairError as HingePairError
    from hingepair.errors import RotationError as RotationError
    from hingepair.errors import SceneError as SceneError
    from hingepair.errors import ShapeError as ShapeError
    from hingepair.formats.model_writers import to_mjcf as to_mjcf
    from hingepair.formats.model_writers import to_urdf as to_urdf
    from hingepair.formats.recordings import read_recording as read_recording
    from hingepair.formats.robots import load_robot as load_robot
    from hingepair.formats.robots import load_robot_hinge as load_robot_hinge
    from hingepair.measured.clusters import fit_cluster as fit_cluster
    from hingepair.measured.hinge_fit import HingeFit as HingeFit
    from hingepair.measured.hinge_fit import fit as fit
    from hingepair.measured.imus import ImuRecording as ImuRecording
    from hingepair.measured.imus import fit_imus as fit_imus
    from hingepair.measured.mass_fit import fit_masses as fit_masses
    from hingepair.measured.smoothing.angular_velocity import (
        angular_velocity_from_samples as angular_velocity_from_samples,
    )
    from hingepair.measured.smoothing.resample import resample as resample
    from hingepair.measured.smoothing.smooth import smooth as smooth
    from hingepair.mechanism.bodies.body import Body as Body
    from hingepair.mechanism.bodies.body import Box as Box
    from hingepair.mechanism.bodies.body import Cylinder as Cylinder
    from hingepair.mechanism.bodies.body import Sphere as Sphere
    from hingepair.mechanism.bodies.body_motion import BodyMotion as BodyMotion
    from hingepair.mechanism.bodies.hinge_load import HingeLoad as HingeLoad
    from hingepair.mechanism.building.urdf import from_urdf as from_urdf
    from hingepair.mechanism.joints import Screw as Screw
    from hingepair.mechanism.joints import Slider as Slider
    from hingepair.mechanism.linkages import Loop as Loop
    from hingepair.mechanism.mechanism import Mechanism as Mechanism
    from hingepair.mechanism.pairs.hinge_pair import HingePair as HingePair
    from hingepair.mechanism.pairs.planar_pair import PlanarPair as PlanarPair
    from hingepair.mechanism.pairs.tolerances import sample_pairs as sample_pairs
    from hingepair.mechanism.states import MechanismState as MechanismState
    from hingepair.mechanism.states import PairState as PairState
    from hingepair.mechanism.struts import GasSpring as GasSpring
    from hingepair.motion.integrate import integrate as integrate
    from hingepair.motion.linearize import linearize as linearize
    from hingepair.motion.simulate import simulate as simulate
    from hingepair.motion.trajectory import Trajectory as Trajectory
    from hingepair.pictures.page import view as view
    from hingepair.pictures.plot import plot as plot
    from hingepair.rollouts.tracks import Feedback as Feedback
    from hingepair.rotations.euler import euler_rate_matrix as euler_rate_matrix
    from hingepair.rotations.euler import euler_rates as euler_rates
    from hingepair.rotations.euler import euler_to_matrix as euler_to_matrix
    from hingepair.rotations.euler import matrix_to_euler as matrix_to_euler
    from hingepair.rotations.matrices import angular_velocity as angular_velocity
    from hingepair.rotations.matrices import project_to_rotation as project_to_rotation
    from hingepair.rotations.matrices import rodrigues as rodrigues
    from hingepair.rotations.matrices import rotation_exp as rotation_exp
    from hingepair.rotations.matrices import rotation_log as rotation_log
    from hingepair.rotations.matrices import skew as skew
    from hingepair.rotations.matrices import unskew as unskew
    from hingepair.scenes.derive import derive as derive
    from hingepair.scenes.scene import load_scene as load_scene
    from hingepair.scenes.variants.search import search as search
    from hingepair.scenes.variants.vary import vary as vary
    from hingepair.tables.instants import MeasurementWarning as MeasurementWarning
    from hingepair.validation.cross_validate import cross_validate as cross_validate
    from hingepair.validation.pinocchio_twin import to_pinocchio as to_pinocchio

__version__ = "0.3.0"

_MODULES = {
    name: module
    for module, names in {
        "errors": "ArgumentError DynamicsWarning FitError HingePairError RotationError SceneError ShapeError",
        "formats.model_writers": "to_mjcf to_urdf",
        "formats.recordings": "read_recording",
        "formats.robots": "load_robot load_robot_hinge",
        "measured.clusters": "fit_cluster",
        "measured.hinge_fit": "HingeFit fit",
        "measured.imus": "ImuRecording fit_imus",
        "measured.mass_fit": "fit_masses",
        "measured.smoothing.angular_velocity": "angular_velocity_from_samples",
        "measured.smoothing.resample": "resample",
        "measured.smoothing.smooth": "smooth",
        "mechanism.bodies.body": "Body Box Cylinder Sphere",
        "mechanism.bodies.body_motion": "BodyMotion",
        "mechanism.bodies.hinge_load": "HingeLoad",
        "mechanism.building.urdf": "from_urdf",
        "mechanism.joints": "Screw Slider",
        "mechanism.linkages": "Loop",
        "mechanism.mechanism": "Mechanism",
        "mechanism.pairs.hinge_pair": "HingePair",
        "mechanism.pairs.planar_pair": "PlanarPair",
        "mechanism.pairs.tolerances": "sample_pairs",
        "mechanism.states": "MechanismState PairState",
        "mechanism.struts": "GasSpring",
        "motion.integrate": "integrate",
        "motion.linearize": "linearize",
        "motion.simulate": "simulate",
        "motion.trajectory": "Trajectory",
        "pictures.page": "view",
        "pictures.plot": "plot",
        "rollouts.tracks": "Feedback",
        "rotations.euler": "euler_rate_matrix euler_rates euler_to_matrix matrix_to_euler",
        "rotations.matrices": "angular_velocity project_to_rotation rodrigues rotation_exp rotation_log skew unskew",
        "scenes.derive": "derive",
        "scenes.scene": "load_scene",
        "scenes.variants.search": "search",
        "scenes.variants.vary": "vary",
        "tables.instants": "MeasurementWarning",
        "validation.cross_validate": "cross_validate",
        "validation.pinocchio_twin": "to_pinocchio",
    }.items()
    for name in names.split()
}
__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for, so that programs load what they need."""
    if name not in _MODULES:
        # Tools ask every module for names with underscores, thousands of times: no search for those.
        hint = "" if name.startswith("_") else nearest(name, __all__)
        raise AttributeError(f"module 'hingepair' has no attribute {name!r}{hint}")
    value = globals()[name] = getattr(import_module(f"hingepair.{_MODULES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
