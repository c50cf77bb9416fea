"""Motion by rates: the angular velocity of body 1 and the hinge rate, integrated (E12)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hingepair.engine.backend import execution_of_steps
from hingepair.motion.integrate import METHODS, RATE_FRAME_NAMES, SolveOptions, solve
from hingepair.motion.signals import Signal
from hingepair.motion.trajectory import quaternions_to_matrices, rotate_to_world
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.rotations.matrices import check_rotation
from hingepair.scenes.motions.known import PSI, EulerBase, Known, known_by_body1
from hingepair.scenes.motions.motion import LazyValue, Motion
from hingepair.scenes.tables import Table


def integrate_motion(
    table: Table,
    t: Float64Array,
    signals: tuple[Signal, Signal],
    arrays: Mapping[str, Float64Array],
    tol: float | None = None,
    *,
    planar: bool = False,
    **motion_fields: Any,
) -> Motion:
    """Integrate the angular velocity of body 1 and the hinge rate (equation E12; in the plane E11).

    Args:
        table: the table [motion], with the start attitude and angle, the axes (`frame`) and the method.
        t: instants [s]; shape (N,).
        signals: omega1 and psi' as Signals.
        arrays: R1, v1, omega1 and psid at t by name; also a1, alpha1 and psidd where these are known.
        tol: error to aim at [rad]. A SceneError is raised if it is missed and the table has the key `tol`.
        planar: whether the motion is in the plane.
        **motion_fields: further fields of the motion by name, such as functions, hint and notes.
    """
    body = not planar and table.choice("frame", RATE_FRAME_NAMES) == "body"
    method = table.choice("method", METHODS)
    options = SolveOptions(t, tol, execution_of_steps("auto", len(t)), body, ("omega1", "psi_dot"))
    start: Any
    key_by_rate_name_in_errors = {"omega1(t)": "omega1", "psi_dot(t)": "psi_dot", "psid": "psi_dot"}
    with table.naming(**key_by_rate_name_in_errors):
        options.check()
        if planar:
            start = table.number("phi_0", 0.0)
        else:
            start = np.array(table.rotation("S1_0") if "S1_0" in table.values else np.eye(3))
            check_rotation("S1_0", start)
        solution = solve(options, *signals, start, table.number("psi_0", 0.0))
        if "tol" in table.values:
            solution.check_tolerance(options)
        error = LazyValue(lambda: solution.largest_error)
    arrays = {**arrays, "psi": solution.psi}
    joints = tuple((arrays[name],) for name in ("psi", "psid", "psidd") if name in arrays)
    if planar:
        rows = (("R1", solution.orientations), ("v1", arrays["omega1"]), ("a1", arrays["alpha1"]))
        base = EulerBase(tuple((*arrays[R].T, angle) for R, angle in rows), None)
        source = Known(PSI, t.size, joints, base)
    else:
        arrays["S1"] = quaternions_to_matrices(solution.orientations)
        if body:
            arrays |= {
                name: rotate_to_world(arrays["S1"], arrays[name]) for name in ("omega1", "alpha1") if name in arrays
            }
        joints = joints if {"a1", "alpha1"} <= arrays.keys() else joints[:2]
        source = known_by_body1(PSI, joints, arrays)
    return Motion(
        moving=PSI,
        t=read_only(t),
        source=source,
        origin="integrated from rates",
        how=f"omega1 and psi' integrated by {method}",
        errors={"rad": error},
        doubt="too few samples to tell how far the integration is off",
        **motion_fields,
    )
