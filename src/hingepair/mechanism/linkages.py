"""Loops of a closed mechanism: read, assembled, and given the starts from which programs close them.

A closed mechanism is assembled once, near coordinates that the user names. From there each chain of joints that a
loop closes is followed as far as its coordinate leads, and a series is fitted to what was found: the start of the
Newton steps in `plans.closures`. So every q has one assembly, whatever was computed before.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations.trees import joints_to_base
from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.chain_paths import ChainPath
from hingepair.mechanism.robots.constants import axes_along, frame_numbers, robot_constants
from hingepair.mechanism.tree import Frame, Tree, TreeClosure
from hingepair.numeric.arrays import Float64Array, FloatArray, check_choice, finite_number, one_constant, read_only
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.plans.closures import CONDITIONS, PRECISION, Chain, Chains, Closure
from hingepair.plans.trees import TreeQuantities, TreeRequest

_LINE_STEPS: Final = 12  # from the assembly to q, where several coordinates move one chain
_OFFSETS: Final = (0.0, 0.1, -0.1, 0.4, -0.4)  # of the starts from which loops are assembled [rad or m]

_OPEN = 1e-6  # a component of which this much is open, of its largest possible value, counts as open
_DEAD = 1e-6  # of the size of the mechanism: within this gap, a loop that is not closed is at a dead point
_NO_RANK = 1e-10  # singular values below this share of the largest count as 0


@dataclass(frozen=True, slots=True)
class Loop:
    """Two frames of a mechanism that stay together, by which `Mechanism.closed` closes a loop.

    Args:
        frame1: name of a frame, link or joint of the mechanism, or of its base.
        frame2: the other one.
        kind: "ball": the origins are one point (E1); "hinge": a point and an axis are shared (E1, E2); "weld": the
            frames are one; "distance": the origins stay at a distance.
        axis: axis of a "hinge", with the same components in the axes of both frames; shape (3,).
        length: distance [m] of a "distance".
        name: name of the loop; by default "frame1-frame2".

    >>> import hingepair as hp
    >>> hp.Loop("tip_a", "tip_b").name
    'tip_a-tip_b'
    """

    frame1: str
    frame2: str
    kind: str = "ball"
    axis: ArrayLike | None = None
    length: float | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        check_choice("kind", self.kind, tuple(CONDITIONS))
        given = {"axis": self.axis, "length": self.length}
        for argument, kind in (("axis", "hinge"), ("length", "distance")):
            if (given[argument] is None) == (self.kind == kind):
                expected = "a value" if self.kind == kind else "None"
                raise ArgumentError(argument, f"{expected} for a loop of kind {self.kind!r}", quoted(given[argument]))
        if self.axis is not None:
            object.__setattr__(self, "axis", tuple(unit_axis("axis", one_constant("axis", self.axis, 3)).tolist()))
        if self.length is not None:
            length = finite_number("length", self.length)
            if length <= 0:
                raise ArgumentError("length", "a distance above 0", quoted(self.length))
        if self.name is None:
            object.__setattr__(self, "name", f"{self.frame1}-{self.frame2}")


def close_tree(
    tree: Tree, loops: Sequence[Loop], coordinates: str | Iterable[str] | None, at: Mapping[str, float] | None
) -> Tree:
    """Return a tree with loops closed, whose coordinates are those named."""
    if tree.closure is not None:
        raise ArgumentError("robot", "one without loops: all loops are closed in one call", "a closed mechanism")
    tree.single()
    names = None if coordinates is None else _read_coordinates(tree, coordinates)
    start, lengths = _read_positions(tree, at)
    assembly = _Assembly(tree, _checked_loops(loops, names or ()), names)
    values = assembly.assembled(start, lengths)
    chains, numbers = assembly.starts(values)
    record = TreeClosure(
        tuple(assembly.loops), assembly.closure._replace(chains=chains), assembly.frames, assembly.size, numbers,
        assembly.names, {joint.name: values[column] for column, joint in enumerate(tree.coordinates)},
        assembly.redundant, tuple(column for column, turns in enumerate(assembly.turns) if not turns),
    )  # fmt: skip
    return replace(tree, closure=record, source=None)


def _checked_loops(loops: Sequence[Any], names: Sequence[str]) -> list[Loop]:
    wrong = [loop for loop in loops if not isinstance(loop, Loop)]
    if wrong or not (loops or names):
        raise ArgumentError("loops", "Loops", quoted(wrong[0]) if wrong else "none")
    found = [str(loop.name) for loop in loops]
    if len({*found}) < len(found):
        raise ArgumentError("loops", "a different name for each", ", ".join(found))
    return list(loops)


def _read_positions(
    tree: Tree, at: Mapping[str, float] | None, label: str = "at"
) -> tuple[dict[int, float], dict[str, float]]:
    """Return the argument `at`: coordinates of the tree by column, 0 where none is named; and lengths of struts."""
    names, struts = [joint.name for joint in tree.coordinates], [strut.name for strut in tree.struts]
    if at is not None and not isinstance(at, Mapping):
        raise ArgumentError(label, "coordinates by joint", quoted(at))
    values, lengths = dict.fromkeys(range(len(names)), 0.0), {}
    for name, value in (at or {}).items():
        check_choice(label, name, [*names, *struts])
        number = finite_number(f"{label}[{name!r}]", value)
        if name in struts:
            lengths[name] = number
        else:
            values[names.index(name)] = number
    return values, lengths


def _read_coordinates(tree: Tree, coordinates: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of the joints and struts that the argument `coordinates` names."""
    names = [*(joint.name for joint in tree.coordinates), *(strut.name for strut in tree.struts)]
    wanted = (coordinates,) if isinstance(coordinates, str) else tuple(coordinates)
    for name in wanted:
        check_choice("coordinates", name, names)
    if len({*wanted}) < len(wanted):
        raise ArgumentError("coordinates", "each name once", quoted(wanted))
    return wanted


def follow_path(tree: Tree, q: Float64Array, guess: Mapping[str, float] | None = None) -> Float64Array:
    """Return all coordinates of a closed mechanism along a path, (samples, joints), each from the sample before; NaN
    from where it cannot be followed on.

    Args:
        tree: the closed mechanism.
        q: its coordinates; shape (samples, dof).
        guess: coordinates of the tree by joint near which the path begins; by default where it was assembled.
    """
    closure = tree.loops()
    opened = replace(tree, closure=None)
    loops = [loop for loop in closure.loops if loop.name not in closure.names]
    assembly = _Assembly(opened, loops, closure.names)
    values = assembly.assembled(*_read_positions(opened, {**closure.assembled, **(guess or {})}, "guess"))
    found = np.full((len(q), len(opened.coordinates)), np.nan)
    for place, row in enumerate(q):
        following = assembly.followed(values, row) if np.isfinite(row).all() else None
        if following is None:
            break
        values = following
        found[place] = [values[column] for column in range(found.shape[1])]
    return found


class _Assembly:
    """The loops of a tree, evaluated with numbers while the mechanism is put together.

    Values are by key: the column of a coordinate of the tree, or -1 - k of a length that is the k-th coordinate.
    """

    def __init__(self, tree: Tree, loops: Sequence[Loop], names: Sequence[str] | None) -> None:
        self._tree = tree
        constants = robot_constants(tree, free=False)
        quantities = TreeQuantities(constants.form, TreeRequest((), False), {"constants": constants.numbers})
        self._links, self._ratios = quantities.links, quantities.ratios
        self._columns = constants.form.columns
        self._joints = [joint.name for joint in tree.coordinates]
        self.turns = [joint.axis.turns == 1 and not joint.axis.shifts for joint in tree.coordinates]
        struts = {strut.name: strut for strut in tree.struts}
        self._asked = len(loops)  # behind these stand the lengths that are coordinates
        driving = [struts[name] for name in names or () if name in struts]
        self.loops = [*loops, *(Loop(*strut.ends, kind="distance", length=1.0, name=strut.name) for strut in driving)]
        self.frames = (*(self._frames_of(loop) for loop in loops), *(strut.frames for strut in driving))
        self._ends = tuple((first.body, second.body) for first, second in self.frames)
        lengths: list[Any] = [np.linalg.norm(joint.u) for joint in tree.joints]
        lengths += [np.linalg.norm(frame.R) for pair in self.frames for frame in pair]
        lengths += [loop.length or 0.0 for loop in loops]
        self.size = float(max(lengths)) or 1.0
        self._numbers = [PRECISION, self.size]
        for (first, second), loop in zip(self.frames, self.loops, strict=True):
            self._numbers += [*frame_numbers(constants, (first, second)), loop.length or 0.0]
        self._free_choice = names is None
        self.names: tuple[str, ...] = ()
        self._choose(names)
        self.redundant = 0

    def _choose(self, names: Sequence[str] | None) -> None:
        """Take these as the coordinates."""
        kinds = tuple(loop.kind for loop in self.loops)
        self.names = tuple(names or ())
        columns = tuple(self._joints.index(name) if name in self._joints else None for name in self.names)
        places = {str(loop.name): self._asked + k for k, loop in enumerate(self.loops[self._asked :])}
        lengths = tuple(None if name in self._joints else places[name] for name in self.names)
        turning = tuple(column is not None and self.turns[column] for column in columns)
        self.closure = Closure(columns, lengths, kinds, self._ends, (), turning)
        self._keys = [self.closure.key(k) for k in range(len(self.names))]
        self._chains = Chains(
            self.closure, self._numbers, self._links, self._ratios, self._columns, (0.0,) * len(self.names)
        )

    def _frames_of(self, loop: Loop) -> tuple[Frame, Frame]:
        """Return the frames of a loop, with their z axes along the axis of a hinge."""
        found = [self._tree.known_frame(f"Loop.{k}", getattr(loop, k)) for k in ("frame1", "frame2")]
        if loop.axis is not None:
            turn = axes_along(np.asarray(loop.axis, float))
            found = [replace(frame, S=read_only(frame.S @ turn)) for frame in found]
        if found[0].body == found[1].body:
            got = f"{loop.frame1!r} and {loop.frame2!r} of one body"
            raise ArgumentError(f"loop {loop.name}", "frames of two bodies that move against each other", got)
        return found[0], found[1]

    # ---- which joints close which loops

    def _path(self, place: int) -> tuple[set[int], set[int]]:
        """Return the joints between the bodies of a loop, and those that carry both."""
        first, second = (joints_to_base(self._links, body) for body in self._ends[place])
        return first ^ second, first & second

    def _chain(self, places: Sequence[int], known: Iterable[int] | None = None) -> Chain:
        """Return the chain that closes loops, with the joints from the last body that carries all of them, where some
        coordinates are known; by default those in q.
        """
        parts = [self._path(place) for place in places]
        carrying = set.intersection(*(common for _, common in parts))
        joints = tuple(sorted(set().union(*(own | common for own, common in parts)) - carrying))
        columns = sorted({self._columns[number - 1] for number in joints})
        lengths = [key for key, place in zip(self._keys, self.closure.lengths, strict=True) if place in places]
        given = self._keys if known is None else known
        driving = [column for column in columns if column in given] + lengths
        return Chain(
            joints, tuple(places), tuple(column for column in columns if column not in given),
            tuple(driving), tuple(key >= 0 and self.turns[key] for key in driving),
            "line", 0, 0, 0,
        )  # fmt: skip

    def chains(self, values: Mapping[int, float]) -> list[Chain]:
        """Return the chains of all loops in order: each determines its joints from what is known by then.

        A four-bar that drives the next is a chain of its own. Loops that only together determine their joints are
        one chain, with those that say the same twice.
        """
        known, left, found = {*self._keys}, list(range(len(self.loops))), list[Chain]()
        while left:
            group = self._smallest_group(left, known, values)
            inside = known.union(self._chain(group, known).dependent)
            group = [place for place in left if place in group or inside.issuperset(self._chain([place]).dependent)]
            found.append(self._chain(group, known))
            known, left = inside, [place for place in left if place not in group]
        return found

    def _smallest_group(self, left: Sequence[int], known: set[int], values: Mapping[int, float]) -> Sequence[int]:
        """Return loops that determine their joints: one, or two, or else all that share joints with one."""
        for size in (1, 2):
            for group in itertools.combinations(left, size):
                chain = self._chain(group, known)
                if chain.dependent and _rank(self.conditions(chain, values, chain.dependent)[1]) == len(
                    chain.dependent
                ):
                    return group
        joined = [left[0]]
        while True:
            inside = {*self._chain(joined, known).dependent}
            beside = [one for one in left if one not in joined and {*self._chain([one], known).dependent} & inside]
            if not beside:
                return joined
            joined += beside

    # ---- assembly

    def conditions(self, chain: Chain, values: Mapping[int, float], keys: Sequence[int]) -> tuple[Any, Any]:
        """Return the conditions of a chain and their derivatives by keys, as arrays."""
        found = self._chains.conditions(chain, values)
        rows = [float(one.row.get(key, 0.0)) for one in found for key in keys]
        return np.array([one.gap for one in found], float), np.array(rows).reshape(len(found), len(keys))

    def assembled(self, start: Mapping[int, float], lengths: Mapping[str, float]) -> dict[int, float]:
        """Return values at which all loops are closed; the coordinates keep their start where they can."""
        asked = list(range(self._asked))
        values = {
            **start,
            **{key: lengths.get(name, 1.0) for key, name in zip(self._keys, self.names, strict=True) if key < 0},
        }
        loosely = self._closed_near(asked, values, [*start])
        free = self._free_joints(loosely)
        if not free:
            raise ArgumentError("loops", "loops that leave a degree of freedom", "none is left")
        if self._free_choice:
            self._choose(free)
        elif len(self.names) != len(free):
            degrees = "1 degree" if len(free) == 1 else f"{len(free)} degrees"
            expected = f"{len(free)} of them, since the mechanism has {degrees} of freedom"
            raise ArgumentError("coordinates", expected, f"{len(self.names)}: {', '.join(self.names)}")
        dependent = [column for column in start if column not in self._keys]
        known = asked + [
            place
            for name, place in zip(self.names, self.closure.lengths, strict=True)
            if place is not None and name in lengths
        ]
        try:
            values = self._closed_near(known, values, dependent)
        except ArgumentError:
            self._check_independent(loosely, dependent)  # which says more
            raise
        for key, place in zip(self._keys, self.closure.lengths, strict=True):
            if place is not None:  # a length that was not told is what it is
                gaps, _ = self.conditions(self._chain([place]), values, ())
                values[key] += float(gaps[0])
        rank = self._check_independent(values, dependent)
        self.redundant = sum(CONDITIONS[kind] for kind in self.closure.loops) - rank
        return values

    def _check_independent(self, values: Mapping[int, float], dependent: Sequence[int]) -> int:
        """Return the rank of the conditions by the dependent coordinates; refuse one that is not full."""
        _, A = self.conditions(self._chain(range(len(self.loops))), values, dependent)
        rank = _rank(A)
        if rank < len(dependent):
            loose = np.linalg.svd(A)[2][rank:]  # motions of the others while the coordinates stand
            free = [self._joints[c] for c, x in zip(dependent, np.abs(loose).max(axis=0), strict=True) if x > 1e-6]
            expected = f"coordinates that determine all others; these do not hold {', '.join(free)}"
            raise ArgumentError("coordinates", expected, ", ".join(self.names))
        return rank

    def _free_joints(self, values: Mapping[int, float]) -> list[str]:
        """Return names of as many joints as there are degrees of freedom, which determine all others: those near the
        base first.
        """
        if not self._asked:
            return self._joints
        _, A = self.conditions(self._chain(range(self._asked)), values, range(len(self._joints)))
        dependent: list[int] = []
        for column in reversed(range(len(self._joints))):
            if _rank(A[:, [*dependent, column]]) > len(dependent):
                dependent.append(column)
        return [name for column, name in enumerate(self._joints) if column not in dependent]

    def _closed_near(
        self, places: Sequence[int], start: Mapping[int, float], columns: Sequence[int]
    ) -> dict[int, float]:
        """Return values at which these loops are closed by the given columns, near the start.

        Where all joints stand in line, no step closes a gap along this line: other starts close by are tried, too.
        """
        if not places:
            return dict(start)
        chain = self._chain(places)
        found = []
        for offset in _OFFSETS:
            moved = {column: start[column] + offset * (1 + 0.3 * k) for k, column in enumerate(columns)}
            values, gaps = self._approached(chain, {**start, **moved}, columns)
            left = iter(gaps.tolist())
            apart = [math.hypot(*itertools.islice(left, CONDITIONS[self.closure.loops[one]])) for one in chain.loops]
            if max(apart) < 1e-10 * self.size:
                return values
            found.append(max(zip(apart, chain.loops, strict=True)))
        least, worst = min(found)
        expected = f"coordinates near which the loop {self.loops[worst].name} can be closed"
        raise ArgumentError("at", expected, f"{least * 1e3:.3g} mm apart")

    def _approached(
        self, chain: Chain, values: Mapping[int, float], columns: Sequence[int]
    ) -> tuple[dict[int, float], Float64Array]:
        """Return values near a start at which the gaps of a chain are least, and the gaps."""
        from scipy.optimize import least_squares

        def at(x: Float64Array) -> tuple[Any, Any]:
            return self.conditions(chain, {**values, **dict(zip(columns, x.tolist(), strict=True))}, columns)

        x = np.array([values[column] for column in columns])
        if len(x):
            sizes = np.array([1.0 if self.turns[column] else self.size for column in columns])
            exact = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15)
            x = least_squares(lambda x: at(x)[0], x, lambda x: at(x)[1], x_scale=sizes, max_nfev=200, **exact).x
            for _ in range(2):
                gaps, A = at(x)
                if np.linalg.norm(gaps) < 1e-3 * self.size:  # else it cannot be closed here
                    x = x - np.linalg.lstsq(A, gaps, rcond=1e-9)[0]
        return dict(values) | dict(zip(columns, x.tolist(), strict=True)), at(x)[0]

    def followed(self, values: Mapping[int, float], q: Float64Array) -> dict[int, float] | None:
        """Return the closed values with the coordinates q, along the line from others; None where it ends before."""
        chain = self._chain(range(len(self.loops)))
        start, count = np.array([values[key] for key in self._keys]), len(chain.dependent)
        way, share = q - start, len(self._joints)  # a key that nothing else has

        def along(here: Mapping[int, float], _: Sequence[int]) -> tuple[Any, Any]:
            moved = dict(here) | dict(zip(self._keys, (start + here[share] * way).tolist(), strict=True))
            gaps, A = self.conditions(chain, moved, (*chain.dependent, *self._keys))
            return gaps, np.column_stack((A[:, :count], A[:, count:] @ way))

        turns = [self.turns[column] for column in chain.dependent]
        end = ChainPath(along, share, chain.dependent, turns, {**values, share: 0.0}, self.size, False).reached(1.0)
        known = dict(zip(self._keys, q.tolist(), strict=True))
        return None if end is None else {**values, **known, **dict(zip(chain.dependent, end.tolist(), strict=True))}

    # ---- starts

    def starts(self, values: Mapping[int, float]) -> tuple[tuple[Chain, ...], tuple[float, ...]]:
        """Return the chains of all loops, with the kinds of their starts, and the numbers of these starts."""
        found, numbers = list[Chain](), list[float]()
        sources = {key: {key} for key in self._keys}  # on which coordinates in q each depends
        for chain in self.chains(values):
            moved_by = set[int]().union(*(sources[key] for key in chain.driving))
            sources |= dict.fromkeys(chain.dependent, moved_by)
            whole, (source, *others) = chain, chain.driving
            if others and len(moved_by) == 1:  # followed together with those before, by the coordinate of all
                (source,), others = moved_by, []
                whole = self._chain([place for one in (*found, chain) for place in one.loops])
            if others:
                here = [values[key] for key in (*chain.driving, *chain.dependent)]
                rows, sign = self._orientation(chain, values)
                found.append(chain._replace(start="line", terms=_LINE_STEPS, steps=6, rows=rows, sign=sign))
                numbers += here
                continue
            shifts = source < 0 or bool(self._tree.coordinates[source].axis.shifts)
            turns = [self.turns[column] for column in whole.dependent]
            path = ChainPath(
                functools.partial(self.conditions, whole), source, whole.dependent, turns, values, self.size, shifts
            )
            start = path.start(chain.dependent)
            found.append(chain._replace(start=start.kind, source=source, terms=start.terms, steps=start.steps))
            numbers += start.numbers
        return tuple(found), tuple(numbers)

    def _orientation(self, chain: Chain, values: Mapping[int, float]) -> tuple[tuple[int, ...], float]:
        """Return conditions that determine the dependent coordinates, in the order of elimination, and the sign of
        the determinant of their derivatives.
        """
        from scipy.linalg import lu

        order, _, upper = lu(self.conditions(chain, values, chain.dependent)[1])
        rows = order.argmax(axis=0)[: len(chain.dependent)]
        return tuple(rows.tolist()), float(np.prod(np.sign(np.diag(upper))))


def _rank(A: NDArray[np.float64]) -> int:
    if A.size == 0:
        return 0
    singular = np.linalg.svd(A, compute_uv=False)
    return int((singular > 1e-9 * singular[0]).sum()) if singular[0] > 0 else 0


# ---- forces in loops
#
# The conditions c of the loops act by forces and torques in proportion to their multipliers lambda. At the joints
# that follow, no motor acts: what a motion takes there comes from the loops, (dc/dq)^T lambda = e.


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
    all_q, gaps, q = (rows[bad][0] for rows in (all_q, gaps, q))
    chain = next(one for one in closure.form.chains if np.isnan(all_q[[*one.dependent]]).any())
    apart = gaps[[*chain.loops]]
    worst = int(np.argmax(np.nan_to_num(apart, nan=np.inf)))
    loop = closure.loops[chain.loops[worst]].name
    state = f"{loop} at a dead point" if apart[worst] < _DEAD * closure.size else f"{loop} cannot be closed"
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
    A = np.where(finite[..., None, None], A, 0.0)
    inverse = np.linalg.pinv(A, rcond=_NO_RANK)
    multipliers = (inverse @ efforts[..., columns, None])[..., 0]
    # Combinations of conditions that act on no joint: redundant conditions share forces in ways that stay open.
    idle = np.eye(A.shape[-1]) - inverse @ A
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
