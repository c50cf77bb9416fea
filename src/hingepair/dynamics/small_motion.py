"""Small motions about a state: poles, natural frequencies and damping ratios."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array as Array


@dataclass(frozen=True, eq=False)
class SmallMotion:
    """Linearized motion, x' = rates + A x + B u for small changes x of the state and u of the loads."""

    #: derivatives of the state's rates by the state; shape (..., k, k)
    A: Array

    _drift: ClassVar[float] = 1e-7
    """Of the largest pole: double poles at 0 come out as the root of rounding errors, and count as 0 below this."""

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A that are not 0 [1/s], sorted by magnitude, of each conjugate pair the one with a positive
        imaginary part; of one state.

        Raises:
            ArgumentError: there are several states.
        """
        if self.A.ndim > 2:
            raise ArgumentError("poles", "the linearization about one state", f"{self.A.shape[:-2]} of them")
        found = np.linalg.eigvals(self.A).astype(np.complex128)
        found = found[(np.abs(found) > self._drift * np.abs(found).max(initial=0.0)) & (found.imag >= 0)]
        # Poles of equal magnitude are sorted by their real parts, whatever rounding says.
        sizes = [float(f"{abs(pole):.9g}") for pole in found]
        return np.asarray(found[np.lexsort((found.real, sizes))])

    @property
    def natural_frequencies(self) -> Array:
        """Absolute values of the poles [rad/s]."""
        return np.abs(self.poles)

    @property
    def damping_ratios(self) -> Array:
        """Damping ratio of each pole; 0 without damping, 1 for real poles, below 0 if the motion grows."""
        poles = self.poles
        return np.asarray(-poles.real / np.abs(poles), np.float64)
