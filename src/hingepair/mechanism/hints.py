"""What users of other libraries look for on a robot, and what it is called here."""

from __future__ import annotations

from typing import Final

from hingepair.errors import nearest

SYNONYMS: Final = {
    "aba": "forward_dynamics",
    "center_of_mass": "centre_of_mass",
    "com": "centre_of_mass",
    "computeABADerivatives": "forward_dynamics_derivatives",
    "computeJointJacobian": "jacobian",
    "computeRNEADerivatives": "inverse_dynamics_derivatives",
    "coriolis": "bias_forces",
    "crba": "mass_matrix",
    "effort_limit": "effort_limits",
    "fk": "forward_kinematics",
    "frame_names": "links",
    "frames": "links",
    "id": "inverse_dynamics",
    "ik": "inverse_kinematics",
    "inertia_matrix": "mass_matrix",
    "joint_limits": "position_limits",
    "joint_names": "names",
    "joints": "names",
    "limits": "position_limits",
    "link_names": "links",
    "lock": "with_locked",
    "n_joints": "dof",
    "njoints": "dof",
    "nq": "dof",
    "num_joints": "dof",
    "nv": "dof",
    "q_limits": "position_limits",
    "rnea": "inverse_dynamics",
    "to_mjcf": "hp.to_mjcf(robot)",
    "to_pinocchio": "hp.to_pinocchio(robot)",
    "to_urdf": "hp.to_urdf(robot)",
    "simulate": "hp.simulate(robot, t, q0)",
    "torque_limits": "effort_limits",
    "velocity_limits": "rate_limits",
    "view": "hp.view(robot)",
}
"""What a robot has in place of a name of other libraries: an attribute, or a call."""


def instead(name: str, known_names: list[str]) -> str:
    """Return the end of a message on a missing attribute: what a robot has instead, a similar known name, or "".

    >>> instead("rnea", [])
    ' (here: inverse_dynamics)'
    """
    if name == "gravity":
        return "; gravity is an argument of each call, such as gravity=(0, 0, -1.62)"
    return f" (here: {SYNONYMS[name]})" if name in SYNONYMS else nearest(name, known_names)
