"""Motion by functions of t: expressions, differentiated exactly, numbers and way points.

They are the coordinates themselves, or the rates that are integrated.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from hingepair.evaluation.steps import COORDINATES, PLANAR_COORDINATES
from hingepair.integration.signals import Function as Signal
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.sequences import SEQUENCES
from hingepair.scenes.functions import ByFunctions, FunctionsOfTime, read_functions
from hingepair.scenes.instants import held_instants, read_instants
from hingepair.scenes.integrated_motion import START, integrated
from hingepair.scenes.motion import Motion, turns_about
from hingepair.scenes.tables import Table

TOLERANCE: Final = 1e-12
"""Largest error of integrated angles that is aimed at unless `tol` is given [rad]; what is left is reported."""


def read_expression_motion(motion: Table, time: Table, planar: bool) -> Motion:
    """The motion that the tables [motion] and [time] describe: coordinates, or rates to be integrated (E12).

    Raises:
        SceneError: a value cannot be used; names file, table and key.
    """
    if "omega1" in motion.values or "psi_dot" in motion.values:
        return _by_rates(motion, held_instants(time), planar)
    names = PLANAR_COORDINATES if planar else COORDINATES
    motion.check_keys((*names, "constants", *(() if planar else ("sequence", "file", "omega1"))))
    functions, t = read_functions(motion, names), read_instants(time)
    sequence = None if planar else motion.choice("sequence", SEQUENCES, "XYZ")
    how = turns_about(sequence) if sequence else "in the plane z = 0"
    given = ByFunctions(t, functions, sequence)
    return Motion(t, given, "coordinates as expressions in t", how, functions=(functions,))


def _by_rates(table: Table, t: Float64Array, planar: bool) -> Motion:
    own = ("x", "y", "phi_0") if planar else ("x", "y", "z", "S1_0", "frame")
    table.check_keys((*START, "tol", "omega1", "psi_dot", "constants", *own))
    axes = own[:2] if planar else own[:3]
    omega = (
        replace(table, values={"omega1": table.values.get("omega1")}) if planar else table.entries("omega1", 3, "t")
    )
    turning, hinge = read_functions(omega, tuple(omega.values)), read_functions(table, ("psi_dot",))
    point = read_functions(replace(table, values=dict.fromkeys(axes, 0) | table.values), axes)
    known = dict(zip(("R1", "v1", "a1"), point.stacked(t, 2), strict=True))
    known |= dict(zip(("omega1", "alpha1"), turning.stacked(t, 1), strict=True))
    known |= dict(zip(("psid", "psidd"), hinge.stacked(t, 1), strict=True))
    signals = _signal("omega1", turning), _signal("psi_dot", hinge)
    tol = table.number("tol", TOLERANCE)
    return integrated(table, t, signals, known, tol, planar=planar, functions=(turning, hinge, point))


def _signal(name: str, functions: FunctionsOfTime) -> Signal:
    return Signal(name, lambda t: functions.stacked(t, 0)[0], functions.tail)
