"""E12: from omega1(t) and psi'(t) to attitudes, and to everything about body 2."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair import equations as eq
from hingepair.arrays import check_choice, constant, finite_number, read_only, vectors
from hingepair.attitude_steps import RULES, Rule, Steps, angles, attitudes, loops
from hingepair.backend import How, choose
from hingepair.blocks import components_of, evaluate
from hingepair.errors import ArgumentError, ShapeError
from hingepair.euler import matrix_to_euler
from hingepair.euler_route import RULE as EULER_RULE
from hingepair.euler_route import euler_angles, quaternions_of_euler
from hingepair.evaluate import Outputs
from hingepair.motion import BodyMotion
from hingepair.pair import HingePair, check_pair
from hingepair.plan import check_outputs, default_outputs
from hingepair.planar import PlanarPair
from hingepair.rotations import check_rotation, matrix_to_quaternion
from hingepair.signals import Samples, Signal, Values, read_signal
from hingepair.step_control import angle_error, attitude_error, substeps
from hingepair.trajectory import PlanarTrajectory, Trajectory, rotations

METHODS = (*RULES, "euler_angles", "dop853")
FRAMES = ("world", "body")

Given = ArrayLike | Callable[..., Any]
