"""Motion by rates: the angular velocity of body 1 and the hinge rate, integrated (E12)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from hingepair.engine.backend import execution_of
from hingepair.integration.integrate import FRAMES
from hingepair.integration.methods import RULES
from hingepair.integration.signals import Signal
from hingepair.integration.solve import METHODS, SolveOptions, solve
from hingepair.integration.trajectory import LazyValue, quaternions_to_matrices, rotate_to_world
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.rotations.matrices import check_rotation
from hingepair.scenes.known_motion import ByCoordinates, by_body1
from hingepair.scenes.motion import Motion
from hingepair.scenes.tables import Table

START: Final = ("psi_0", "method")
"""Keys that every such motion may have in its table, beside S1_0 and frame in space, phi_0 in the plane."""

_RATE_KEYS: Final = {"omega1(t)": "omega1", "psi_dot(t)": "psi_dot", "psid": "psi_dot"}
"""Key of the table [motion] by the name that messages of `integrate` give to a rate."""


def integrated(
    table: Table,
    t: Float64Array,
    signals: tuple[Signal, Signal],
    known: Mapping[str, Float64Array],
    tol: float | None = None,
    *,
    planar: bool = False,
    **notes: Any,
) -> Motion:
    """Integrate the signals omega1 and psi' to a motion (E12), in the plane by two sums (E11).

    `known` are R1, v1, omega1, psid at the instants, and a1, alpha1, psidd where these are known; `tol` is the error
    that is aimed at, refused where it is missed and the table asks for it; `notes` are functions and hint.
    """
    body = not planar and table.choice("frame", FRAMES) == "body"
    method = table.choice("method", tuple(RULES) if planar else METHODS)
    options = SolveOptions(t, method, tol, execution_of("auto", 1), body, ("omega1", "psi_dot"))
    start: Any
    with table.naming(**_RATE_KEYS):
        if planar:
            start = table.number("phi_0", 0.0)
        else:
            start = np.array(table.rotation("S1_0") if "S1_0" in table.values else np.eye(3))
            check_rotation("S1_0", start)
        found = solve(options, *signals, start, table.number("psi_0", 0.0))
        if "tol" in table.values:
            found.check_tolerance(options)
        error = LazyValue(None, found.largest_error)
    known = {**known, "psi": found.psi}
    if planar:
        rows = (("R1", "phi", "psi"), ("v1", "omega1", "psid"), ("a1", "alpha1", "psidd"))
        known["phi"] = found.orientations
        given: Any = ByCoordinates(t.size, tuple((*known[R].T, known[a], known[b]) for R, a, b in rows), None)
    else:
        known["S1"] = quaternions_to_matrices(found.orientations)
        if body:
            known |= {
                name: rotate_to_world(known["S1"], known[name]) for name in ("omega1", "alpha1") if name in known
            }
        given = by_body1(known)
    how, doubt = f"omega1 and psi' integrated by {method}", "too few samples to tell how far the integration is off"
    return Motion(read_only(t), given, "integrated from rates", how, {"rad": error}, doubt, **notes)
