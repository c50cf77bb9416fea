"""Forces in the loops of a closed mechanism, and how well its coordinates move it.

The conditions c of the loops act by forces and torques in proportion to their multipliers lambda. At the joints that
follow, no motor acts: what a motion takes there comes from the loops, (dc/dq)^T lambda = e.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hingepair.mechanism.tree import TreeClosure
from hingepair.numeric.arrays import FloatArray
from hingepair.plans.closures import CONDITIONS, MAX_GAPS, MIN_TRANSMISSIONS

_OPEN = 1e-6  # a component of which this much is open, of its largest possible value, counts as open
_NO_RANK = 1e-10  # singular values below this share of the largest count as 0


class LoopWrench(NamedTuple):
    """What the body of a loop's first frame exerts on that of the second, world axes."""

    force: FloatArray  # [N]; shape (..., 3)
    torque: FloatArray  # about the origin of the frames [N m]; shape (..., 3)


def _following(closure: TreeClosure) -> list[int]:
    """Return the columns of the joints that follow the coordinates."""
    return sorted({column for chain in closure.form.chains for column in chain.dependent})


def transmission(closure: TreeClosure, jacobian: FloatArray) -> FloatArray:
    """Return the smallest over the largest singular value of the loops' Jacobian, NaN where it is NaN. Lengths count
    in sizes of the mechanism.
    """
    columns = _following(closure)
    A = jacobian[..., columns] * np.where(np.isin(columns, closure.sliding), closure.size, 1.0)
    finite = np.asarray(np.isfinite(A).all(axis=(-1, -2)))
    singular = np.linalg.svd(np.where(finite[..., None, None], A, 1.0), compute_uv=False)
    return np.asarray(np.where(finite, singular[..., -1] / singular[..., 0], np.nan))


def open_samples(closure: TreeClosure, q: FloatArray, all_q: FloatArray, gaps: FloatArray) -> str | None:
    """Return which loop is open or at a dead point, at how many samples, and where first; None where all are closed.

    Args:
        closure: the loops.
        q: coordinates; shape (..., dof).
        all_q: those of the tree, NaN where the loops cannot be closed; shape (..., tree).
        gaps: by how much each loop is open [m]; shape (..., loops).
    """
    bad = np.isnan(all_q).any(axis=-1) & np.isfinite(q).all(axis=-1)
    if not bad.any():
        return None
    all_q, gaps, q = all_q[bad][0], gaps[bad][0], q[bad][0]
    chain = next(one for one in closure.form.chains if np.isnan(all_q[[*one.dependent]]).any())
    apart = gaps[[*chain.loops]]
    if (apart < MAX_GAPS[1] * closure.size).all():
        loops = ", ".join(str(closure.loops[place].name) for place in chain.loops)
        state = f"{loops} at a dead point, with a transmission below {MIN_TRANSMISSIONS[1]:g}"
    else:
        worst = int(np.argmax(np.nan_to_num(apart, nan=np.inf)))
        state = f"{closure.loops[chain.loops[worst]].name} cannot be closed"
        if np.isfinite(apart[worst]):
            state += f", a gap of {apart[worst] * 1e3:.4g} mm is left"
    where = ", ".join(f"{name} = {value:.6g}" for name, value in zip(closure.names, q, strict=True))
    count = f"NaN at {int(bad.sum())} of {bad.size} samples, first" if bad.shape else "NaN"
    return f"results are {count} at {where}: {state}"


def loop_wrenches(
    closure: TreeClosure, efforts: FloatArray, jacobian: FloatArray, units: FloatArray
) -> dict[str, LoopWrench]:
    """Return the wrenches of all loops by name.

    Args:
        closure: the loops.
        efforts: what the motion takes at each coordinate of the tree; shape (..., tree).
        jacobian: derivatives of the conditions by these coordinates; shape (..., conditions, tree).
        units: force and torque on the second body for each condition's multiplier 1; shape (..., conditions, 6).
    """
    columns = _following(closure)
    A = np.swapaxes(jacobian[..., columns], -1, -2)
    finite = np.asarray(np.isfinite(A).all(axis=(-1, -2)))
    U, singular, Vh = np.linalg.svd(np.where(finite[..., None, None], A, 0.0))
    rank = singular.shape[-1]
    known = singular > _NO_RANK * singular[..., :1]
    inverse = np.where(known, 1 / np.where(known, singular, 1.0), 0.0)
    along = np.einsum("...ji,...j->...i", U[..., :rank], efforts[..., columns]) * inverse
    multipliers = np.einsum("...ji,...j->...i", Vh[..., :rank, :], along)
    # Combinations of conditions that act on no joint: redundant conditions share forces in ways that stay open.
    idle = np.concatenate((np.where(known[..., None], 0.0, Vh[..., :rank, :]), Vh[..., rank:, :]), axis=-2)
    wrenches, start = {}, 0
    for loop in closure.loops:
        end = start + CONDITIONS[loop.kind]
        unit = units[..., start:end, :]
        wrench = np.einsum("...i,...ij->...j", multipliers[..., start:end], unit)
        loose = np.abs(np.einsum("...ki,...ij->...kj", idle[..., start:end], unit)).max(axis=-2, initial=0.0)
        largest = np.abs(unit).max(axis=(-1, -2))[..., None]
        wrench = np.where((loose > _OPEN * largest) | ~finite[..., None], np.nan, wrench)
        wrenches[str(loop.name)] = LoopWrench(wrench[..., :3], wrench[..., 3:])
        start = end
    return {name: wrench for name, wrench in wrenches.items() if name not in closure.names}
