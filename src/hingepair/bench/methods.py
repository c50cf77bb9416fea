"""What a way of `bench direct` is: a way to get body 2 from the same coordinates, as a Python user would write it.

A method takes (pair, q, qd, qdd), of shape (N, 7) or None from the first level that is not wanted on, and returns the
outputs of the level by name. What it can prepare once, it prepares when it is made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.states import PairState

Array: TypeAlias = NDArray[Any]
Motion: TypeAlias = tuple[Array, ...]
Found: TypeAlias = Mapping[str, Array]
Job: TypeAlias = Callable[[], Found]

LEVELS = {"pose": ("R2", "S2"), "velocity": ("R2", "S2", "v2", "omega2")}
LEVELS["acceleration"] = (*LEVELS["velocity"], "a2", "alpha2")

PARTS = (("R1", "phi", "psi"), ("v1", "phid", "psid"), ("a1", "phidd", "psidd"))
"""What the seven coordinates and their derivatives are to the equations."""


class Method(NamedTuple):
    """One way: its name, what makes a job of a pair and a motion, the most samples it is asked for, its dtype."""

    name: str
    prepare: Callable[[HingePair, Motion], Job]
    most: int
    dtype: Any
    needs: str = ""


def outputs_at(parts: int) -> tuple[str, ...]:
    """What is computed from so many of q, qd, qdd."""
    return tuple(LEVELS.values())[parts - 1]


def room_at(parts: int, samples: int, dtype: Any = np.float64) -> dict[str, Array]:
    """Arrays for these outputs."""
    return {n: np.zeros((samples, *((3, 3) if n == "S2" else (3,))), dtype) for n in outputs_at(parts)}


def converted(motion: Motion, dtype: DTypeLike) -> Motion:
    """The motion in a dtype."""
    return tuple(c.astype(dtype, copy=False) for c in motion)


def ours(backend: str, *, workers: int = 1, fresh: bool = False) -> Callable[[HingePair, Motion], Job]:
    """This library, with fresh outputs or into arrays that are there; a single sample is given as one state."""

    def prepare(pair: HingePair, motion: Motion) -> Job:
        names = outputs_at(len(motion))
        room: dict[str, Array] | None = None if fresh else room_at(len(motion), len(motion[0]), motion[0].dtype)
        if len(motion[0]) == 1:
            motion = tuple(c[0] for c in motion)
            room = room and {name: array[0] for name, array in room.items()}

        def run() -> Found:
            state: PairState = pair.forward_kinematics(
                *motion, outputs=names, out=room, backend=backend, workers=workers
            )
            return state.arrays()

        return run

    return prepare
