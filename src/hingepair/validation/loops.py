"""Closed mechanisms and struts by Pinocchio: its constraints at all joints of the tree, whose results they reduce.

Pinocchio's `RigidConstraintModel` gives the gaps of the loops and their Jacobian J. The velocities of all joints are
N q', with J N = 0 and q' those of the coordinates; a mass matrix is N^T M N, and efforts are N^T (tau - struts).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hingepair.mechanism.linkages import Loop
from hingepair.mechanism.mechanism import Mechanism, robot_of, tree_of
from hingepair.mechanism.tree import Frame, Tree
from hingepair.numeric.arrays import Float64Array
from hingepair.validation.pinocchio_twin import Twin, import_pinocchio


class Reduction(NamedTuple):
    """What Pinocchio says of loops and struts at N samples; K is the number of coordinates."""

    velocities: Float64Array  # from those of the robot to those of the tree, both with six of a free base
    struts: Float64Array  # efforts of struts at the coordinates of the tree, which act beside tau
    gaps: Float64Array  # of all conditions [m]
    gap_rates: Float64Array  # [m/s]
    rate_scales: Float64Array  # sizes of the terms of the gap rates
    lengths: Float64Array  # of struts [m]
    sizes: Float64Array  # those of the velocities, with what rounding makes of them where they are ill conditioned
    condition: Float64Array  # of the equations that give the velocities; (N,)
    gap_changes: Float64Array  # second derivatives of all gaps [m/s^2]
    change_scales: Float64Array  # sizes of the terms of these
    length_changes: Float64Array  # second derivatives of the lengths of struts [m/s^2]
    length_change_scales: Float64Array


class Linkage:
    """A robot with loops or struts, and the tree without them.

    Args:
        robot: the robot.
    """

    def __init__(self, robot: Mechanism) -> None:
        self.robot, tree = robot, tree_of(robot)
        self.plain = robot_of(replace(tree, closure=None, struts=()), robot.base)
        self._closure, self._struts = tree.closure, tree.struts
        loops = () if tree.closure is None else zip(tree.closure.loops, tree.closure.frames, strict=True)
        self._loops = [(loop, pair) for loop, pair in loops if loop.name not in robot.names]
        self.size = 1.0 if tree.closure is None else tree.closure.size

    @classmethod
    def of(cls, robot: Mechanism) -> Linkage | None:
        """Return the linkage of a robot; None of a tree without struts."""
        tree = tree_of(robot)
        return cls(robot) if tree.closure is not None or tree.struts else None

    def of_all_joints(self, coordinates: Mapping[str, Any]) -> dict[str, Any]:
        """Return q and, as far as given, qd and qdd of the tree."""
        if self._closure is None:
            return dict(coordinates)
        found = self.robot.all_coordinates(*coordinates.values())
        return dict(zip(coordinates, found if len(coordinates) > 1 else (found,), strict=True))

    def accelerations(self, coordinates: Mapping[str, Any], qdd: Float64Array) -> Float64Array:
        """Return those of the tree, (N, ...), from those of the coordinates."""
        if self._closure is None:
            return qdd
        shaped = np.reshape(qdd, (*np.shape(self.robot.all_coordinates(coordinates["q"]))[:-1], self.robot.dof))
        found = self.robot.all_coordinates(coordinates["q"], coordinates["qd"], shaped)[2]
        return np.asarray(found, np.float64).reshape(len(qdd), -1)

    def reduction(self, twin: Twin, joints: list[Float64Array], states: list[Float64Array]) -> Reduction:
        """Return what reduces the results of the tree.

        Args:
            twin: the tree in Pinocchio.
            joints: coordinates of the tree and, as far as known, their derivatives; (N, tree) each.
            states: the same as Pinocchio has them, q and v.
        """
        pin = import_pinocchio("cross_validate")
        tree, dof, free = tree_of(self.plain), self.robot.dof, 6 * (self.robot.base == "free")
        models = [_constraint(pin, twin, loop, pair) for loop, pair in self._loops]
        struts = [_constraint(pin, twin, _STRUT, strut.frames) for strut in self._struts]
        forces = self._strut_forces(joints)
        found = []
        for k, q in enumerate(np.nan_to_num(states[0])):  # samples that are not finite are not compared
            pin.computeJointJacobians(twin.model, twin.data, q)
            evaluate = functools.partial(_evaluated, pin, twin, self.size)
            parts = [evaluate(loop, model) for (loop, _), model in zip(self._loops, models, strict=True)]
            lines = [evaluate(_STRUT, model) for model in struts]
            J = np.concatenate([rows for _, rows in parts]) if parts else np.zeros((0, twin.ratios.shape[1]))
            gaps = np.concatenate([gap for gap, _ in parts]) if parts else np.zeros(0)
            lengthening = np.array([rows[0] for _, rows in lines]).reshape(len(lines), twin.ratios.shape[1])
            N, condition = np.eye(free + dof), 1.0
            if self._closure is not None:
                chosen = np.zeros((dof, J.shape[1]))
                for i, name in enumerate(self.robot.names):
                    chosen[i] = _row_of(name, tree, [strut.name for strut in self._struts], lengthening)
                sides = np.concatenate((np.zeros((len(J), dof)), np.eye(dof)))
                inner, _, _, singular = np.linalg.lstsq(np.concatenate((J, chosen)), sides, rcond=None)
                condition = 1.0 + singular[0] / singular[-1]
                N = np.zeros((free + len(inner), free + dof))
                N[:free, :free], N[free:, free:] = np.eye(free), inner
            sizes = np.abs(N)
            sizes[free:, free:] += (condition - 1) * sizes[free:, free:].max(initial=0.0)
            rates = joints[1][k] if len(joints) > 1 else np.zeros(J.shape[1])
            changes: list[Float64Array] = [np.zeros(0)] * 4
            if len(states) > 2:
                pin.forwardKinematics(twin.model, twin.data, q, *(np.nan_to_num(state[k]) for state in states[1:]))
                lines_of_action = [(_STRUT, strut.frames) for strut in self._struts]
                changes = [
                    np.array([part for one in loops for part in _gap_changes(pin, twin, self.size, *one)[i]])
                    for loops in (self._loops, lines_of_action)
                    for i in range(2)
                ]
            lengths = [gap[0] for gap, _ in lines]
            terms = J @ rates, np.abs(J) @ np.abs(rates)
            found.append((N, forces[k] @ lengthening, gaps, *terms, lengths, sizes, condition, *changes))
        columns = [np.array(column, dtype=np.float64) for column in zip(*found, strict=True)]
        for column in columns:
            column[~np.isfinite(states[0]).all(axis=1)] = np.nan
        return Reduction(*columns)

    def _strut_forces(self, joints: list[Float64Array]) -> Float64Array:
        """Return the forces of all struts at given coordinates of the tree, (N, struts)."""
        if not self._struts:
            return np.zeros((len(joints[0]), 0))
        states = self.robot.opened().struts(*joints[:2])
        return np.stack([state.force for state in states.values()], axis=-1)

    def reduced(
        self, reduction: Reduction, theirs: dict[str, Float64Array], scales: dict[str, Float64Array]
    ) -> tuple[dict[str, Float64Array], dict[str, Float64Array]]:
        """Return Pinocchio's outputs, and the scales of their errors, of the robot from those of the tree."""
        N, sizes = reduction.velocities, reduction.sizes
        theirs, scales = dict(theirs), dict(scales)
        if "jacobian" in theirs:
            theirs["jacobian"] = np.einsum("nfij,njk->nfik", theirs["jacobian"], N)
            scales["jacobian"] = np.einsum("nfij,njk->nfik", scales["jacobian"], sizes)
        theirs["mass_matrix"] = np.swapaxes(N, 1, 2) @ theirs["mass_matrix"] @ N
        scales["mass_matrix"] = np.swapaxes(sizes, 1, 2) @ scales["mass_matrix"] @ sizes
        free = 6 * (self.robot.base == "free")
        for name in ("tau", "forward_dynamics"):
            if name in theirs:
                theirs[name], _ = self.onto_coordinates(reduction, theirs[name])
                _, scales[name] = self.onto_coordinates(reduction, scales[name])
        if "tau" in theirs and free:
            theirs["tau"], scales["tau"] = theirs["tau"][:, free:], scales["tau"][:, free:]
        if self._struts:  # whose energy Pinocchio does not know
            theirs.pop("potential", None)
        return theirs, scales

    def onto_coordinates(self, reduction: Reduction, efforts: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return efforts at the coordinates, behind those of a free base, from those of the tree, and the sizes of
        their terms.
        """
        missing = reduction.velocities.shape[1] - efforts.shape[1]
        efforts = np.pad(efforts, ((0, 0), (missing, 0)))
        struts = np.pad(reduction.struts, ((0, 0), (efforts.shape[1] - reduction.struts.shape[1], 0)))
        turned = np.swapaxes(reduction.velocities, 1, 2)
        sizes = np.swapaxes(reduction.sizes, 1, 2) @ (np.abs(efforts) + np.abs(struts))[..., None]
        found = turned @ (efforts - struts)[..., None]
        return found[..., 0], sizes[..., 0]

    def of_loops(self, reduction: Reduction, coordinates: Mapping[str, Any]) -> dict[str, tuple[Float64Array, ...]]:
        """Return, by name, what both say of loops and struts and the scale of its error: gaps are 0."""
        found: dict[str, tuple[Float64Array, ...]] = {}
        if reduction.gaps.size:
            found["gap"] = reduction.gaps, 0 * reduction.gaps, np.full(reduction.gaps.shape[:1], self.size)
            found["gap_rate"] = reduction.gap_rates, 0 * reduction.gap_rates, reduction.rate_scales.max(axis=1)
            if reduction.gap_changes.size:
                sizes = reduction.change_scales.max(axis=1) * reduction.condition
                found["gap_acceleration"] = reduction.gap_changes, 0 * reduction.gap_changes, sizes
        if self._struts:
            states = self.robot.struts(*[*coordinates.values()][:2])
            lengths = np.array([state.length for state in states.values()]).T.reshape(reduction.lengths.shape)
            size = reduction.lengths.sum(axis=1) + self.size
            found["strut_length"] = lengths, reduction.lengths, size
            driving = [name for name in self.robot.names if name in states]
            if driving and reduction.length_changes.size:
                rows = tree_of(self.robot).rows("qdd", coordinates["qdd"]).reshape(len(lengths), -1)
                ours = rows[:, [self.robot.names.index(name) for name in driving]]
                theirs = reduction.length_changes[:, [[*states].index(name) for name in driving]]
                size = np.abs(reduction.length_changes).max(axis=1) + reduction.length_change_scales.max(axis=1)
                found["strut_acceleration"] = ours, theirs, size * reduction.condition
        return found


_STRUT = Loop("", "", kind="distance", length=1.0, name="strut")
_SELECTED = {"ball": 3, "hinge": 5, "weld": 6}  # how many components of the constraint are conditions


def _row_of(name: str, tree: Tree, struts: list[str], lengthening: Float64Array) -> Float64Array:
    """Return the derivatives of a coordinate of the robot by those of the tree."""
    columns = [joint.name for joint in tree.coordinates]
    if name in columns:
        return np.asarray(np.eye(len(columns))[columns.index(name)])
    return np.asarray(lengthening[struts.index(name)])


def _constraint(pin: Any, twin: Twin, loop: Loop, pair: tuple[Frame, Frame]) -> tuple[Any, Any]:
    """Return Pinocchio's constraint between two frames, and its data."""
    kind = pin.ContactType.CONTACT_6D if loop.kind in ("hinge", "weld") else pin.ContactType.CONTACT_3D
    root = int(twin.has_free_flyer)
    ends = [part for frame in pair for part in (root + frame.body, pin.SE3(np.array(frame.S), np.array(frame.R)))]
    model = pin.RigidConstraintModel(kind, twin.model, *ends, pin.ReferenceFrame.LOCAL)
    return model, model.createData()


def _evaluated(
    pin: Any, twin: Twin, size: float, loop: Loop, constraint: tuple[Any, Any]
) -> tuple[Float64Array, Float64Array]:
    """Return the conditions of a loop, angles times `size`, and their derivatives by the tree's coordinates; of a
    "distance" the distance less its length, or that of a strut.
    """
    model, data = constraint
    model.calc(twin.model, twin.data, data)
    flyer = 6 * twin.has_free_flyer
    J = pin.getConstraintJacobian(twin.model, twin.data, model, data)[:, flyer:] @ twin.ratios
    apart, turn = np.array(data.c1Mc2.translation), np.array(data.c1Mc2.rotation)
    if loop.kind == "distance":
        distance = float(np.linalg.norm(apart))
        length = 0.0 if loop is _STRUT else float(loop.length or 0.0)
        return np.array([distance - length]), -(apart / distance @ J[:3])[None]
    angles = pin.log3(turn) if loop.kind == "weld" else np.array([-turn[1, 2], turn[0, 2], 0.0])
    scaled = np.concatenate((J[:3], size * J[3:]))
    count = _SELECTED[loop.kind]
    return np.concatenate((apart, size * angles))[:count], scaled[:count]


def _gap_changes(
    pin: Any, twin: Twin, size: float, loop: Loop, pair: tuple[Frame, Frame]
) -> tuple[Float64Array, Float64Array]:
    """Return the second derivatives of the conditions of a loop, angles times `size`, and the sizes of their terms,
    from the classical accelerations of its frames.
    """
    axes, root = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, int(twin.has_free_flyer)
    found: list[tuple[Any, ...]] = []
    for frame in pair:
        seat = root + frame.body, pin.SE3(np.array(frame.S), np.array(frame.R))
        pose = twin.data.oMi[seat[0]] * seat[1]
        twist = pin.getFrameVelocity(twin.model, twin.data, *seat, axes)
        change = pin.getFrameClassicalAcceleration(twin.model, twin.data, *seat, axes)
        motion = pose.translation, twist.linear, twist.angular, change.linear, change.angular, pose.rotation
        found.append(tuple(map(np.array, motion)))
    R, v, omega, a, alpha, S = zip(*found, strict=True)
    moved, turned = a[0] - a[1], alpha[1] - alpha[0] - np.cross(omega[0], omega[1] - omega[0])
    speeds = float(np.linalg.norm(v[0]) + np.linalg.norm(v[1]))
    sizes = np.full(6, np.linalg.norm(a[0]) + np.linalg.norm(a[1]) + size * np.linalg.norm(alpha, axis=1).sum())
    if loop.kind == "distance":
        apart, rate = R[0] - R[1], v[0] - v[1]
        distance = float(np.linalg.norm(apart))
        along = apart / distance
        bent = (rate @ rate - (along @ rate) ** 2) / distance
        return np.array([along @ moved + bent]), sizes[:1] + speeds**2 / distance
    angles = S[0].T @ turned if loop.kind == "hinge" else S[0].T @ (alpha[1] - alpha[0])
    count = _SELECTED[loop.kind]
    return np.concatenate((moved, size * angles))[:count], sizes[:count]
