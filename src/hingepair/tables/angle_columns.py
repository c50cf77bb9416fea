"""Euler angles and hinge angles in logs: their unit, and what a log of a motion in the plane leaves out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.tables.suspicions import suspicions
from hingepair.tables.wrapped_angles import is_wrapped

PlanarColumns: TypeAlias = Mapping[tuple[str, ...], tuple[str, ...]]
"""Columns that a log in the plane leaves out together, and those that it then has."""


def planar_zeros(names: Collection[str], planar: PlanarColumns, sequence: object = "XYZ") -> list[str]:
    """Return the columns that a log leaves out since they are 0 in the plane; none if it has one of them.

    Args:
        names: columns that the log has.
        planar: columns that such logs leave out together, and those that they then have.
        sequence: axes of the Euler angles.

    Raises:
        ArgumentError: the third angle, which such logs have, is not about z.

    >>> planar_zeros({"t", "x", "y", "phi_z"}, {("z", "phi_x"): ("x", "y", "phi_z"), ("v_z",): ("v_x", "v_y")})
    ['z', 'phi_x']
    """
    zeros = [
        name
        for flat, beside in planar.items()
        if {*beside} <= {*names} and {*names}.isdisjoint(flat)
        for name in flat
    ]
    if zeros and str(sequence)[2:].upper() != "Z":
        expected = f"a sequence that ends in Z, such as XYZ, since the log has no {', '.join(zeros)}"
        raise ArgumentError("sequence", expected, quoted(sequence))
    return zeros


def headings_among(angles: Sequence[str], sequence: object = "XYZ") -> list[str]:
    """Return those of three Euler angles that turn about z, as a heading does.

    >>> headings_among(("phi_x", "phi_y", "phi_z"), "ZYX")
    ['phi_x']
    """
    return [name for name, axis in zip(angles, str(sequence).upper(), strict=False) if axis == "Z"]


def doubts_about_angles(angles: Mapping[str, Float64Array], conversion: Callable[[str], str]) -> list[str]:
    """Return sentences on angles that are probably in degrees, and on those that may then be, too.

    Args:
        angles: samples of angles that are taken for radians, by name; shape (N,) each.
        conversion: function from the name of an angle to how the user states that it is in degrees.

    Raises:
        ArgumentError: an angle jumps by nearly 360, as degrees that were brought into one turn.

    >>> import numpy as np
    >>> angles = {"psi": np.linspace(0, 90, 9), "phi_x": np.linspace(0, 3, 9)}
    >>> doubts_about_angles(angles, lambda name: f"{name}_deg")[1]
    'phi_x may be in the same unit as psi'
    """
    sentences, large, small = [], [], []
    for name, samples in angles.items():
        stated = conversion(name)
        if is_wrapped(samples, 360.0):
            raise ArgumentError(name, f"angles in radians, or {stated}", "jumps by nearly 360, as of degrees")
        doubts = suspicions("angle", name, samples, radians=stated.replace("{", "{{").replace("}", "}}"))
        sentences += doubts
        if doubts:
            large.append(name)
        elif np.unique(samples[np.isfinite(samples)]).size > 1:
            small.append(name)
    if large and small:  # a few degrees are not suspicious by themselves
        sentences.append(f"{', '.join(small)} may be in the same unit as {large[0]}")
    return sentences
