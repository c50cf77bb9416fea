"""Closed mechanisms and struts by Pinocchio, as the tree whose joints stand where the loops put them.

Pinocchio moves the frames that loops and struts join: their points and axes must move as the loops say. The
velocities of all joints are N q' with the coordinates' rates q'; of the mechanism, what is M and tau of the tree is
N^T M N and N^T tau, less what the struts exert.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hingepair.mechanism.mechanism import Mechanism, robot_of, tree_of
from hingepair.numeric.arrays import Float64Array
from hingepair.validation.scales import Scales

Outputs = dict[str, Float64Array]

_SHARED_AXES = {"ball": [], "hinge": [2], "weld": [0, 1, 2]}  # columns of S that both frames of a loop have alike


class Linkage:
    """A robot at N samples, and the tree without its loops and struts (`plain`).

    Args:
        robot: the robot.
        given: its q and, as far as known, qd and qdd.
        shape: leading shape of the N samples.
    """

    def __init__(self, robot: Mechanism, given: Mapping[str, Any], shape: tuple[int, ...]) -> None:
        self.robot, tree, count = robot, tree_of(robot), math.prod(shape)
        rows = [tree.rows(name, one) for name, one in given.items()]
        self._given = [np.broadcast_to(one, (*shape, robot.dof)).reshape(count, robot.dof) for one in rows]
        self._size = 1.0 if tree.closure is None else tree.closure.size
        closed = () if tree.closure is None else zip(tree.closure.loops, tree.closure.frames, strict=True)
        joined = {loop.name: (loop.kind, loop.length or 0.0, pair) for loop, pair in closed}
        # Kind, length and frames of loops and struts; the length of a strut may be a coordinate.
        self._joined = joined | {strut.name: ("distance", 0.0, strut.frames) for strut in tree.struts}
        self.struts = tree.struts
        ends = [frame for _, _, pair in self._joined.values() for frame in pair]
        self.ends = {f"end {k} of loops and struts": frame for k, frame in enumerate(ends)}
        self.plain = robot_of(replace(tree, closure=None, struts=(), frames={**tree.frames, **self.ends}), robot.base)
        self.coordinates = self._of_all_joints(*self._given)

    def _of_all_joints(self, *given: Float64Array) -> Sequence[Float64Array]:
        if tree_of(self.robot).closure is None:
            return given
        found: Any = self.robot.all_coordinates(*given)
        return found if len(given) > 1 else (found,)

    def accelerations(self, qdd: Float64Array) -> Float64Array:
        """Return those of the tree, (N, joints), from those of the coordinates, (N, dof)."""
        return self._of_all_joints(*self._given[:2], qdd)[2]

    def velocities(self) -> Float64Array:
        """Return the matrices N from the rates of the coordinates to those of the tree, (N, joints, dof)."""
        q, dof = self._given[0], self.robot.dof
        found = np.zeros((*self.coordinates[0].shape, dof))
        for k, unit in enumerate(np.eye(dof)):
            found[..., k] = self._of_all_joints(q, np.broadcast_to(unit, q.shape))[1]
        return found

    def condition(self) -> Any:
        """Return by how much joints that follow may be further off than what determines them; (N, 1, 1)."""
        if tree_of(self.robot).closure is None:
            return 1.0
        return 1.0 + 1.0 / np.reshape(self.robot.transmission(self._given[0]), (-1, 1, 1))

    def exerted(self) -> Float64Array:
        """Return the forces of struts along the coordinates, (struts, N, dof)."""
        q, qd = self._given[:2]
        found = np.zeros((len(self.struts), *q.shape))
        for k, unit in enumerate(np.eye(self.robot.dof)):
            for place, along in enumerate(self.robot.struts(q, np.broadcast_to(unit, q.shape)).values()):
                found[place, :, k] = along.rate
        return found * np.stack([state.force for state in self.robot.struts(q, qd).values()])[..., None]

    def gaps(self, motion: Outputs, scales: Scales) -> dict[str, tuple[Float64Array, ...]]:
        """Return, by name, gaps of loops and lengths of struts and their derivatives: what they are to be, what they
        are by Pinocchio's motion of the `ends`, and the scales of their errors; (N, ...) each.
        """
        states = self.robot.struts(*self._given[:2]) if self.struts else {}
        names, found = ("gap", "gap_rate", "gap_acceleration")[: len(self._given)], list[list[Any]]()
        for place, (name, (kind, length, pair)) in enumerate(self._joined.items()):
            one, two = ({letter: array[:, 2 * place + k] for letter, array in motion.items()} for k in range(2))
            apart = _distance(one, two) if kind == "distance" else _gap(one, two, _SHARED_AXES[kind], self._size)
            expected: list[Any] = [length, 0.0, 0.0]
            if name in states:
                expected = [*(np.reshape(x, (-1, 1)) for x in states[name][:2]), apart[-1]]  # moves as it must
            if name in self.robot.names and len(names) > 2:  # the length of a strut
                expected[2] = self._given[2][:, [self.robot.names.index(name)]]
            sizes = [scales.motion(frame) for frame in pair]
            size = [sum(each[point][:, None] + self._size * each[turn][:, None] for each in sizes)
                    for point, turn in (("d", "S"), ("v", "omega"), ("a", "alpha"))]  # fmt: skip
            size[2] = (size[2] + self._size * sum(each["omega"][:, None] ** 2 for each in sizes)) * np.reshape(
                self.condition(), (-1, 1)
            )
            found.append([np.broadcast_arrays(*parts) for parts in zip(expected, apart, size, strict=False)])
        of_levels = (zip(*level, strict=True) for level in zip(*found, strict=True))
        columns = (tuple(np.concatenate(part, axis=1) for part in parts) for parts in of_levels)
        return dict(zip(names, columns, strict=True))


def _gap(one: Outputs, two: Outputs, axes: list[int], size: float) -> list[Float64Array]:
    """Return how far the points of two frames are apart, and these axes, times a size, with derivatives; (N, ...)."""
    found = []
    for frame in (one, two):
        shared = np.swapaxes(frame["S"], -1, -2)[:, axes] * size
        levels = [(frame["d"], shared)]
        if "v" in frame:
            omega = frame["omega"][:, None]
            turning = np.cross(omega, shared)
            levels.append((frame["v"], turning))
        if "a" in frame:
            levels.append((frame["a"], np.cross(frame["alpha"][:, None], shared) + np.cross(omega, turning)))
        found.append([np.concatenate((point, turn.reshape(len(point), -1)), axis=1) for point, turn in levels])
    return [second - first for first, second in zip(*found, strict=True)]


def _distance(one: Outputs, two: Outputs) -> list[Float64Array]:
    """Return the distance of the points of two frames with its derivatives; (N, 1) each."""
    apart, *rates = (two[letter] - one[letter] for letter in ("d", "v", "a") if letter in one)
    found = [np.linalg.norm(apart, axis=1, keepdims=True)]
    along = apart / found[0]
    found += [(along * rate).sum(axis=1, keepdims=True) for rate in rates]
    if len(rates) > 1:
        found[2] += ((rates[0] ** 2).sum(axis=1, keepdims=True) - found[1] ** 2) / found[0]
    return found
