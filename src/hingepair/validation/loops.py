"""Closed mechanisms and struts by Pinocchio: its constraints at all joints of the tree, whose results they reduce.

Pinocchio's `RigidConstraintModel` gives the gaps of the loops, the lengths of the struts and their Jacobian J. The
velocities of all joints are N q', with J N = 0 of the loops and q' those of the coordinates; a mass matrix is
N^T M N, and efforts are N^T (tau - struts).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hingepair.mechanism.mechanism import Mechanism, robot_of, tree_of
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.closures import CONDITIONS
from hingepair.validation.pinocchio_twin import Twin, import_pinocchio

Outputs = dict[str, Float64Array]


class Reduction(NamedTuple):
    """What leads from results of the tree to those of the robot at N samples."""

    velocities: Float64Array  # N, of a free base with six more rows and columns
    sizes: Float64Array  # its entries, with what rounding makes of them where they are ill conditioned
    struts: Float64Array  # efforts of struts at the coordinates of the tree, which act beside tau


class Linkage:
    """A robot with loops or struts, and the tree without them (`plain`).

    Args:
        robot: the robot.
    """

    def __init__(self, robot: Mechanism) -> None:
        self.robot, tree = robot, tree_of(robot)
        self.plain = robot_of(replace(tree, closure=None, struts=()), robot.base)
        self._closed, self._struts = tree.closure is not None, [strut.name for strut in tree.struts]
        self._items: list[
            tuple[str, float, tuple[Frame, Frame]]
        ] = []  # kind, distance and frames of loops and struts
        self._size = 1.0
        if tree.closure is not None:
            pairs = zip(tree.closure.loops, tree.closure.frames, strict=True)
            self._items = [
                (loop.kind, loop.length or 0.0, pair) for loop, pair in pairs if loop.name not in robot.names
            ]
            self._size = tree.closure.size
        self._loop_rows = sum(CONDITIONS[kind] for kind, _, _ in self._items)
        self._items += [("distance", 0.0, strut.frames) for strut in tree.struts]

    @classmethod
    def of(cls, robot: Mechanism) -> Linkage | None:
        """Return the linkage of a robot; None of a tree without struts."""
        tree = tree_of(robot)
        return cls(robot) if tree.closure is not None or tree.struts else None

    def of_all_joints(self, coordinates: Mapping[str, Any]) -> dict[str, Any]:
        """Return q and, as far as given, qd and qdd of the tree."""
        if not self._closed:
            return dict(coordinates)
        found = self.robot.all_coordinates(*coordinates.values())
        return dict(zip(coordinates, found if len(coordinates) > 1 else (found,), strict=True))

    def accelerations(self, coordinates: Mapping[str, Any], qdd: Float64Array) -> Float64Array:
        """Return those of the tree, (N, ...), from those of the coordinates."""
        if not self._closed:
            return qdd
        shape = np.shape(self.robot.all_coordinates(coordinates["q"]))[:-1]
        given = coordinates["q"], coordinates["qd"], qdd.reshape(*shape, self.robot.dof)
        return np.asarray(self.robot.all_coordinates(*given)[2], np.float64).reshape(len(qdd), -1)

    def compared(
        self,
        twin: Twin,
        joints: list[Float64Array],
        states: list[Float64Array],
        coordinates: Mapping[str, Any],
    ) -> tuple[Reduction, dict[str, tuple[Float64Array, Float64Array, Float64Array]]]:
        """Return what reduces the results of the tree, and what both say of gaps and lengths with scales, by name.

        Args:
            twin: the tree in Pinocchio.
            joints: coordinates of the tree and, as far as known, their derivatives; (N, tree) each.
            states: the same as Pinocchio has them.
            coordinates: those of the robot.
        """
        found = [self._evaluated(twin, [state[k] for state in states]) for k in range(len(states[0]))]
        values, J, changes, terms = (np.array(column, np.float64) for column in zip(*found, strict=True))
        targets = [np.zeros_like(values) for _ in range(3)]  # of values, rates and accelerations
        starts = np.cumsum([0, *(CONDITIONS[kind] for kind, _, _ in self._items)])
        for (kind, length, _), start in zip(self._items, starts, strict=False):
            targets[0][:, start] = length if kind == "distance" else 0.0
        driving = [k for k, name in enumerate(self._struts) if name in self.robot.names]
        forces = np.zeros((len(values), len(self._struts)))
        if self._struts:
            for k, state in enumerate(self.robot.struts(*[*coordinates.values()][:2]).values()):
                row = self._loop_rows + k
                targets[0][:, row], targets[1][:, row], forces[:, k] = (np.reshape(x, -1) for x in state)
            for k in driving if "qdd" in coordinates else ():
                own = tree_of(self.robot).rows("qdd", coordinates["qdd"]).reshape(len(values), -1)
                targets[2][:, self._loop_rows + k] = own[:, self.robot.names.index(self._struts[k])]
        rows, of_struts = J[:, : self._loop_rows], J[:, self._loop_rows :]
        reduction, condition = self._reduced_velocities(rows, of_struts, forces)
        scale = np.full(len(values), self._size) + np.abs(values).sum(axis=1)
        outputs = {"gap": (targets[0], values, scale)}
        if len(joints) > 1:
            speeds = np.einsum("nij,nj->n", np.abs(J), np.abs(joints[1]))
            speeds += self._size * np.abs(joints[1]).sum(axis=1)  # J is a difference of the motions of both frames
            outputs["gap_rate"] = targets[1], np.einsum("nij,nj->ni", J, joints[1]), speeds
        known = [*range(self._loop_rows), *(self._loop_rows + k for k in driving)]  # other struts move as they must
        if len(joints) > 2 and known:
            scale = terms.max(axis=1) * condition
            outputs["gap_acceleration"] = targets[2][:, known], changes[:, known], scale
        return reduction, outputs

    def _reduced_velocities(
        self, rows: Float64Array, of_struts: Float64Array, forces: Float64Array
    ) -> tuple[Reduction, Float64Array]:
        """Return the reduction, and the condition of the equations that give it."""
        dof, free, count = self.robot.dof, 6 * (self.robot.base == "free"), len(rows)
        joints = [joint.name for joint in tree_of(self.plain).coordinates]
        inner, condition = np.broadcast_to(np.eye(dof), (count, dof, dof)), np.ones(count)
        if self._closed:
            unit = np.eye(len(joints))
            chosen = [
                np.broadcast_to(unit[joints.index(name)], (count, len(joints)))
                if name in joints
                else of_struts[:, self._struts.index(name)]
                for name in self.robot.names
            ]
            equations = np.concatenate((rows, np.stack(chosen, axis=1)), axis=1)
            usable = np.isfinite(equations).all(axis=(1, 2))
            equations[~usable] = 1.0  # samples that are not compared
            inner = np.linalg.pinv(equations)[..., -dof:]
            condition = np.where(usable, 1.0 + np.linalg.cond(equations), np.nan)
        N = np.zeros((count, free + len(joints), free + dof))
        N[:, :free, :free], N[:, free:, free:] = np.eye(free), inner
        sizes = np.abs(N)
        worst = sizes[:, free:, free:].max(axis=(1, 2), initial=0.0)
        sizes[:, free:, free:] += ((condition - 1) * worst)[:, None, None]
        return Reduction(N, sizes, np.einsum("nk,nkj->nj", forces, of_struts)), condition

    def reduced(self, reduction: Reduction, theirs: Outputs, scales: Outputs) -> tuple[Outputs, Outputs]:
        """Return Pinocchio's outputs, and the scales of their errors, of the robot from those of the tree."""
        N, sizes, _ = reduction
        theirs, scales = dict(theirs), dict(scales)
        for part, matrix in ((theirs, N), (scales, sizes)):
            if "jacobian" in part:
                part["jacobian"] = np.einsum("nfij,njk->nfik", part["jacobian"], matrix)
            part["mass_matrix"] = np.swapaxes(matrix, 1, 2) @ part["mass_matrix"] @ matrix
        for name in ("tau", "forward_dynamics"):
            if name in theirs:
                theirs[name], _ = self.onto_coordinates(reduction, theirs[name])
                _, scales[name] = self.onto_coordinates(reduction, scales[name])
        if "tau" in theirs and self.robot.base == "free":
            theirs["tau"], scales["tau"] = theirs["tau"][:, 6:], scales["tau"][:, 6:]
        if self._struts:  # whose energy Pinocchio does not know
            theirs.pop("potential", None)
        return theirs, scales

    def onto_coordinates(self, reduction: Reduction, efforts: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return efforts at the coordinates, behind those of a free base, from those of the tree, and the sizes of
        their terms.
        """
        rows = reduction.velocities.shape[1]
        efforts, struts = (np.pad(x, ((0, 0), (rows - x.shape[1], 0))) for x in (efforts, reduction.struts))
        found = np.einsum("nji,nj->ni", reduction.velocities, efforts - struts)
        return found, np.einsum("nji,nj->ni", reduction.sizes, np.abs(efforts) + np.abs(struts))

    def _evaluated(self, twin: Twin, state: list[Float64Array]) -> tuple[Any, ...]:
        """Return values of all conditions of loops and lengths of struts at a state of Pinocchio's, angles times the
        size of the mechanism; their derivatives by the coordinates of the tree; their second derivatives by time; and
        the sizes of the terms of these.
        """
        pin = import_pinocchio("cross_validate")
        q, v, a = (*map(np.nan_to_num, state), *[np.zeros(twin.model.nv)] * 2)[:3]
        pin.computeJointJacobians(twin.model, twin.data, q)
        pin.forwardKinematics(twin.model, twin.data, q, v, a)
        found: tuple[list[Any], ...] = ([], [], [], [])
        for kind, _, pair in self._items:
            for column, part in zip(found, self._condition(pin, twin, kind, pair), strict=True):
                column.extend(part)
        if not all(np.isfinite(part).all() for part in state):
            return tuple(np.full(np.shape(column), np.nan) for column in found)
        return found

    def _condition(self, pin: Any, twin: Twin, kind: str, pair: tuple[Frame, Frame]) -> tuple[Any, ...]:
        """Return what `_evaluated` does of one loop or strut, from Pinocchio's constraint between its frames and the
        classical accelerations of both.
        """
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        seats = [(twin.has_free_flyer + frame.body, pin.SE3(np.array(frame.S), np.array(frame.R))) for frame in pair]
        contact = pin.ContactType.CONTACT_6D if kind in ("hinge", "weld") else pin.ContactType.CONTACT_3D
        model = pin.RigidConstraintModel(contact, twin.model, *seats[0], *seats[1], pin.ReferenceFrame.LOCAL)
        data = model.createData()
        model.calc(twin.model, twin.data, data)
        J = pin.getConstraintJacobian(twin.model, twin.data, model, data)[:, 6 * twin.has_free_flyer :] @ twin.ratios
        apart, turn = np.array(data.c1Mc2.translation), np.array(data.c1Mc2.rotation)
        back = (twin.data.oMi[seats[0][0]] * seats[0][1]).rotation.T  # to the axes of the first frame
        rates = [pin.getFrameVelocity(twin.model, twin.data, *seat, world) for seat in seats]
        changes = [pin.getFrameClassicalAcceleration(twin.model, twin.data, *seat, world) for seat in seats]
        v, a = (back @ (one[1].linear - one[0].linear) for one in (rates, changes))
        omega, alpha = rates[1].angular - rates[0].angular, changes[1].angular - changes[0].angular
        size = sum(np.linalg.norm(one.linear) + self._size * np.linalg.norm(one.angular) for one in changes)
        if kind == "distance":
            distance = float(np.linalg.norm(apart))
            along = apart / distance
            bent = (v @ v - (along @ v) ** 2) / distance
            return [distance], [-along @ J[:3]], [along @ a + bent], [size + v @ v / distance]
        if kind == "hinge":
            alpha = alpha - np.cross(rates[0].angular, omega)
        angles = pin.log3(turn) if kind == "weld" else np.array([-turn[1, 2], turn[0, 2], 0.0])
        count = CONDITIONS[kind]
        scaled = np.concatenate((J[:3], self._size * J[3:]))[:count]
        second = np.concatenate((a, self._size * (back @ alpha)))[:count]
        return np.concatenate((apart, self._size * angles))[:count], scaled, second, [size] * count
