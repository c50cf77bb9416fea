"""Derivatives of what a loop computes of a pair or a robot, by its arguments.

A change of an attitude is a rotation about world axes: three numbers, not nine. Accelerations are differentiated as
the solution of the equations of motion (T11).
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import sub
from typing import Any, Final, NamedTuple, TypeAlias

from hingepair.engine.binding import ArrayShape
from hingepair.engine.derivatives import Change, jacobian, pullback, pushforward, variables, weighted_sum
from hingepair.engine.loops import Loop
from hingepair.engine.trace import Operand, TracedValue
from hingepair.equations.dynamics import factor_symmetric, solve_factored
from hingepair.numeric.blocks import components
from hingepair.plans.trees import (
    Request,
    TreeForm,
    TreeQuantities,
    complete_numbers,
    constant_place,
    velocity_count,
)

Parts: TypeAlias = Mapping[str, Sequence[Operand]]
"""Components of outputs by name."""

Moves: TypeAlias = dict[str, list[Change]]
"""Changes by argument, one for each component of a change of it."""

# They change by rotations about world axes, home about those of body 1; next_S1 is S1 after a step in time.
_ATTITUDES: Final = frozenset({"S", "S1", "S2", "home", "next_S1"})
_QUATERNIONS: Final = {"quat_xyzw": (3, 0, 1, 2), "quat_wxyz": (0, 1, 2, 3)}  # places of w, x, y, z
# For each quantity of the joints, those of a free base that come before it, and itself.
_GROUPS: Final = {
    "q": ("R1", "S1", "q"),
    "qd": ("v1", "omega1", "qd"),
    "qdd": ("a1", "alpha1", "qdd"),
    "tau": ("force1", "torque1", "tau"),
}


class Derivative(NamedTuple):
    """What is differentiated, and how."""

    # "jacobian"; "vjp", gradients of a weighted sum of outputs; "jvp", the rates of change of all outputs; "rate",
    # their time derivatives where q changes by qd and the base turns by omega1; "matrices", Jacobians of inverse or
    # forward dynamics such as tau_q, of a free base with rows and columns of the base
    kind: str
    # names of the outputs; of a vjp those with weights, of matrices the names of the matrices
    outputs: tuple[str, ...]
    # arguments by which derivatives are taken, name and shape of one sample
    arguments: tuple[tuple[str, ArrayShape], ...]
    # as other libraries differentiate: attitudes change by their entries in place of rotations, and the outputs
    # themselves are left out
    entries: bool = False
    prefix: str = ""  # of the names of its changes and weights, where those of a derivative before it exist


def body_constants(joints: int, free: bool) -> dict[str, ArrayShape]:
    """Return the shapes of the constants of a robot by which outputs can be differentiated."""
    bodies = joints + free
    return {"masses": (bodies,), "first_moments": (bodies, 3), "inertias": (bodies, 6), "lengths": (joints, 3)}


def change_shape(name: str, sample_shape: ArrayShape) -> ArrayShape:
    """Return the shape of a change of one sample of an argument or output.

    >>> change_shape("S", (2, 3, 3)), change_shape("q", (7,))
    ((2, 3), (7,))
    """
    if name in _QUATERNIONS:
        return (3,)
    return sample_shape[:-1] if name in _ATTITUDES else sample_shape


@functools.lru_cache(maxsize=512)
def derivative_loop(
    plain: Loop, derivative: Derivative, functions: Callable[[dict[str, Any]], Functions] | None = None
) -> Loop:
    """Return the loop that computes a derivative of what another loop computes. The Jacobian of tau by q is called
    tau_q, the weight of tau weight_tau, a gradient gradient_q, a change of q change_q, the rate of tau rate_tau.

    Args:
        plain: the other loop.
        derivative: the derivative.
        functions: for a vjp, what makes functions of the values of the inputs, if other than by default.
    """
    changes = {name: change_shape(name, tail) for name, tail in (*plain.outputs, *derivative.arguments)}
    if derivative.entries:
        changes = dict((*plain.outputs, *derivative.arguments))
    inputs, names = dict(plain.inputs), [name for name, _ in derivative.arguments]
    if isinstance(plain.form, TreeForm) and not body_constants(0, False).keys().isdisjoint(names):
        inputs["axes"] = (9 * (len(plain.form.form.parents) + 1),)
    outputs = {} if derivative.entries else dict(plain.outputs)
    if derivative.kind == "jacobian":
        outputs = {f"{one}_{name}": (*changes[one], *changes[name]) for one in derivative.outputs for name in names}
        outputs |= {one: tail for one, tail in plain.outputs if one not in derivative.outputs}
    elif derivative.kind == "matrices":
        outputs = dict.fromkeys(derivative.outputs, (velocity_count(*_tree_of(plain)),) * 2)
        outputs |= {one: tail for one, tail in plain.outputs if one not in (*_GROUPS["tau"], *_GROUPS["qdd"])}
    elif derivative.kind == "vjp":
        inputs |= {f"{derivative.prefix}weight_{one}": changes[one] for one in derivative.outputs}
        outputs |= {f"gradient_{name}": changes[name] for name in names}
    elif derivative.kind == "jvp":
        inputs |= {f"{derivative.prefix}change_{name}": changes[name] for name in names}
        outputs |= {f"rate_{one}": changes[one] for one in derivative.outputs}
    else:
        inputs |= {"qd": inputs["q"], "omega1": (3,)}
        outputs = {f"rate_{one}" if one in derivative.outputs else one: tail for one, tail in plain.outputs}
    rule = {"jacobian": _jacobian, "matrices": _matrices, "vjp": _gradients, "jvp": _rates, "rate": _time_rates}
    function = functools.partial(rule[derivative.kind], plain, derivative)
    if functions is not None:
        function = functools.partial(_gradients, plain, derivative, make_functions=functions)
    form = None if plain.form is None else (plain.form, derivative)
    return Loop("derivatives", function, inputs, outputs, form=form)


def _jacobian(plain: Loop, derivative: Derivative, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the outputs and the Jacobian of each by every argument."""
    values, moves = _variables(plain, given, derivative.arguments)
    functions = _functions(plain, values)
    rows = functions.jacobian(derivative.outputs, [*itertools.chain(*moves.values())])
    found: dict[str, Any] = {}
    for output in derivative.outputs:
        parts = functions.results[output]
        columns = zip(*rows[output], strict=True)
        for name, changes in moves.items():
            block = [_change_of(output, parts, column) for column in itertools.islice(columns, len(changes))]
            found[f"{output}_{name}"] = tuple(itertools.chain(*zip(*block, strict=True)))
    return {**functions.results, **found}


def _matrices(plain: Loop, derivative: Derivative, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return outputs, and Jacobians of inverse or forward dynamics with a row and a column for each velocity."""
    form, request = _tree_of(plain)
    kinds = {name: name.partition("_")[2] for name in derivative.outputs}
    groups = {kind: _group(kind, request) for kind in kinds.values() if kind in {"q", "qd"}}
    shapes = {"S1": (3, 3), **dict.fromkeys(("q", "qd"), (form.dof,))}
    values, moves = _variables(
        plain, given, [(one, shapes.get(one, (3,))) for names in groups.values() for one in names]
    )
    functions = _functions(plain, values)
    names = _group(derivative.outputs[0].partition("_")[0], request)
    rows = functions.jacobian(names, [*itertools.chain(*moves.values())])
    columns = zip(*(row for name in names for row in rows[name]), strict=True)
    found = dict(functions.results)
    blocks = {kind: [*itertools.islice(columns, velocity_count(form, request))] for kind in groups}
    for name, kind in kinds.items():
        if kind == "qdd":
            found[name] = TreeQuantities(form, request, given).mass_matrix()
        elif isinstance(functions, Accelerations) and kind == "tau":
            found[name] = functions.inverse_mass_matrix()
        else:
            found[name] = tuple(itertools.chain(*zip(*blocks[kind], strict=True)))
    return found


def _gradients(
    plain: Loop,
    derivative: Derivative,
    given: Mapping[str, Any],
    make_functions: Callable[[dict[str, Any]], Functions] | None = None,
) -> dict[str, Any]:
    """Return the outputs, and the gradient of their weighted sum by every argument."""
    values, moves = _variables(plain, given, derivative.arguments, derivative.entries)
    functions = make_functions(values) if make_functions else _functions(plain, values)
    weights: dict[str, list[Operand]] = {}
    for output in derivative.outputs:
        parts, kind = functions.results[output], "" if derivative.entries else output
        given_weights = components(values[f"{derivative.prefix}weight_{output}"])
        sums: list[Operand] = [0.0] * len(parts)
        weights[output] = sums
        for weight, change in zip(given_weights, _changes(kind, parts), strict=True):
            for k, rate in change:
                sums[k] = sums[k] + weight * rate * _share(kind)
    inputs = [x for change in itertools.chain(*moves.values()) for x, _ in change]
    slopes = dict(zip(map(id, inputs), functions.pullback(weights, inputs), strict=True))
    gradients = {
        f"gradient_{name}": tuple(weighted_sum((slopes[id(x)], rate) for x, rate in change) for change in changes)
        for name, changes in moves.items()
    }
    return {**functions.results, **gradients}


def _rates(plain: Loop, derivative: Derivative, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the outputs and their rates of change."""
    values, moves = _variables(plain, given, derivative.arguments, derivative.entries)
    changes = [
        (weight, change)
        for name, group in moves.items()
        for weight, change in zip(components(values[f"{derivative.prefix}change_{name}"]), group, strict=True)
    ]
    functions = _functions(plain, values)
    rates = functions.pushforward(derivative.outputs, _sum(changes))
    changed = {
        f"rate_{one}": tuple(_change_of("" if derivative.entries else one, functions.results[one], rate))
        for one, rate in rates.items()
    }
    return {**functions.results, **changed}


def _time_rates(plain: Loop, derivative: Derivative, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the time derivatives of all components of the outputs."""
    turns = any(isinstance(x, TracedValue) or x for x in given["omega1"])  # S1 folds where the base does not turn
    arguments = [("q", (len(given["qd"]),)), *([("S1", (3, 3))] if turns else [])]
    values, moves = _variables(plain, given, arguments)
    changes = [*zip(given["qd"], moves["q"], strict=True)]
    changes += zip(given["omega1"], moves.get("S1", ()), strict=False)
    functions = _functions(plain, values)
    rates = functions.pushforward(derivative.outputs, _sum(changes))
    return {**functions.results, **{f"rate_{output}": tuple(rate) for output, rate in rates.items()}}


def _variables(
    plain: Loop, given: Mapping[str, Any], arguments: Iterable[tuple[str, ArrayShape]], entries: bool = False
) -> tuple[dict[str, Any], Moves]:
    """Return the values with variables in the place of arguments, and the changes of the arguments."""
    values, moves = dict(given), Moves()
    of_bodies = (
        _changes_of_bodies(_tree_of(plain), values, {name for name, _ in arguments}) if "axes" in values else {}
    )
    for name, tail in arguments:
        if name in of_bodies:
            moves[name] = of_bodies[name]
        elif name in values:
            others = [x for other, group in values.items() if other != name for x in components(group)]
            parts = variables(components(values[name]), others)
            values[name] = parts if tail else parts[0]
            moves[name] = [
                [(parts[k], rate) for k, rate in change] for change in _changes("" if entries else name, parts)
            ]
        else:  # no output depends on it
            moves[name] = [[] for _ in range(math.prod(tail if entries else change_shape(name, tail)))]
    return values, moves


def _changes_of_bodies(tree: TreeForm, values: dict[str, Any], names: Iterable[str]) -> Moves:
    """Return the changes of constants with these names, and put all constants, with variables in their place, among
    the values as "numbers".
    """
    form, request = tree
    numbers = complete_numbers(form, request, values)
    axes = [values["axes"][9 * k : 9 * k + 9] for k in range(len(form.parents) + 1)]
    bodies = [k for k in range(len(axes)) if k or request.free]
    changes: dict[str, list[list[tuple[int, Operand]]]] = {}
    if "masses" in names:
        changes["masses"] = [[(constant_place(k, "mass"), 1.0)] for k in bodies]
    if "first_moments" in names:
        places = [(axes[k], constant_place(k, "first")) for k in bodies]
        changes["first_moments"] = [_along(P, j, place) for P, place in places for j in range(3)]
    if "lengths" in names:
        joints = [(axes[parent], constant_place(k, "u")) for k, parent in enumerate(form.parents, 1)]
        changes["lengths"] = [_along(P, j, place) for P, place in joints for j in range(3)]
    if "inertias" in names:
        places = [(axes[k], constant_place(k, "second")) for k in bodies]
        pairs = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # Pinocchio's order
        changes["inertias"] = [_of_inertia(P, *pair, place) for P, place in places for pair in pairs]
    used = sorted({k for group in changes.values() for change in group for k, _ in change})
    others = [x for k, x in enumerate(numbers) if k not in {*used}]
    others += [x for group in values.values() for x in components(group)]
    for k, variable in zip(used, variables([numbers[k] for k in used], others), strict=True):
        numbers[k] = variable
    values["numbers"] = numbers
    return {
        name: [[(numbers[k], rate) for k, rate in change if not _is_zero(rate)] for change in group]
        for name, group in changes.items()
    }


def _along(P: Sequence[Operand], j: int, place: int) -> list[tuple[int, Operand]]:
    """Return the change of the vector that begins at a place where its j-th component in a body's axes changes; P
    converts from the program's axes to these.
    """
    return [(place + i, P[3 * j + i]) for i in range(3)]


def _of_inertia(P: Sequence[Operand], a: int, b: int, place: int) -> list[tuple[int, Operand]]:
    """Return the change of the second moment, trace(J)/2 - J, that begins at a place where the entry (a, b) of the
    inertia J changes; P is that of `_along`.
    """
    x, y = P[3 * a : 3 * a + 3], P[3 * b : 3 * b + 3]
    changes: list[tuple[int, Operand]] = []
    for k, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        half = 0.5 if a == b and i == j else 0.0
        changes.append((place + k, half - (x[i] * x[j] if a == b else x[i] * y[j] + y[i] * x[j])))
    return changes


def _sum(changes: Iterable[tuple[Operand, Change]]) -> list[tuple[Operand, Operand]]:
    """Return the sum of pairs (weight, change) as one change."""
    sums: dict[int, tuple[Operand, Operand]] = {}
    for weight, change in changes:
        for x, rate in change:
            sums[id(x)] = x, sums.get(id(x), (x, 0.0))[1] + weight * rate
    return [*sums.values()]


def _group(kind: str, request: Request) -> tuple[str, ...]:
    return _GROUPS[kind] if request.free else _GROUPS[kind][2:]


def _functions(plain: Loop, values: dict[str, Any]) -> Functions:
    """Return the outputs of a loop as functions that can be differentiated."""
    if {name for name, _ in plain.outputs}.isdisjoint(_GROUPS["qdd"]) or not isinstance(plain.form, TreeForm):
        return Functions(plain.function(values))
    return Accelerations(TreeQuantities(*plain.form, values))


def _tree_of(plain: Loop) -> TreeForm:
    if not isinstance(plain.form, TreeForm):
        raise TypeError(f"{plain.name} is no loop of a robot")
    return plain.form


class Functions:
    """Results of a program, and their derivatives by what it has traced.

    Args:
        results: results by name, scalars or tuples of components.
    """

    def __init__(self, results: Mapping[str, Any]) -> None:
        self.results: Parts = {name: components(value) for name, value in results.items()}

    def jacobian(self, names: Iterable[str], changes: Sequence[Change]) -> dict[str, list[list[Operand]]]:
        """Return the Jacobians of the named results: a row for each component, a column for each change."""
        return self._by_name(names, jacobian(self._flat(names), changes))

    def pushforward(self, names: Iterable[str], change: Change) -> dict[str, list[Operand]]:
        """Return the rates of change of the components of the named results."""
        return self._by_name(names, pushforward(self._flat(names), change))

    def pullback(self, weights: Parts, inputs: Sequence[Operand]) -> list[Operand]:
        """Return the derivatives by inputs of the sum of the results' components times the weights."""
        flat = (zip(self.results[name], parts, strict=True) for name, parts in weights.items())
        return pullback(itertools.chain(*flat), inputs)

    def _flat(self, names: Iterable[str]) -> list[Operand]:
        return [part for name in names for part in self.results[name]]

    def _by_name(self, names: Iterable[str], rows: Iterable[Any]) -> dict[str, list[Any]]:
        left = iter(rows)
        return {name: [*itertools.islice(left, len(self.results[name]))] for name in names}


class Accelerations(Functions):
    """Results of forward dynamics. The accelerations change such that they take back what a change of inputs adds to
    the torques (T11); this takes fewer operations than to differentiate the articulated bodies (T5, T6).

    Args:
        computation: forward dynamics.
    """

    def __init__(self, computation: TreeQuantities) -> None:
        form, request, values = computation.form, computation.request, computation.values
        self._names, loads = (_group(kind, request) for kind in ("qdd", "tau"))
        super().__init__(computation.outputs(dict.fromkeys((*request.outputs, *self._names))))
        motion = {name: variables(self.results[name]) for name in self._names}
        self._held = [(x, 0.0) for part in motion.values() for x in part]
        inverse = TreeQuantities(form, request, {**values, **motion})
        needed = Functions(inverse.outputs(loads)).results
        self._lack = Functions({name: tuple(map(sub, components(values[name]), needed[name])) for name in loads})
        self._lower, pivots = factor_symmetric(inverse.mass_entries)
        self._shares, self._doubt = [1.0 / pivot for pivot in pivots], computation.singular_doubt

    def jacobian(self, names: Iterable[str], changes: Sequence[Change]) -> dict[str, list[list[Operand]]]:
        """Return the Jacobians as `Functions` does, of the accelerations by solving with the mass matrix (T11)."""
        held = [[*change, *self._held] for change in changes]
        rows = itertools.chain(*self._lack.jacobian(self._lack.results, held).values())
        columns = [self._solve(column) for column in zip(*rows, strict=True)]
        solved = self._by_name(self._names, map(list, zip(*columns, strict=True)))
        return super().jacobian([name for name in names if name not in solved], changes) | solved

    def pushforward(self, names: Iterable[str], change: Change) -> dict[str, list[Operand]]:
        """Return the rates of change as `Functions` does, those of the accelerations by T11."""
        rates = itertools.chain(*self._lack.pushforward(self._lack.results, [*change, *self._held]).values())
        solved = self._by_name(self._names, self._solve([*rates]))
        return super().pushforward([name for name in names if name not in solved], change) | solved

    def pullback(self, weights: Parts, inputs: Sequence[Operand]) -> list[Operand]:
        """Return the derivatives as `Functions` does, those of the accelerations by T11."""
        column = [x for name in self._names for x in weights.get(name, (0.0,) * len(self.results[name]))]
        loads = iter(self._solve(column))
        solved = {name: [*itertools.islice(loads, len(part))] for name, part in self._lack.results.items()}
        others = {name: parts for name, parts in weights.items() if name not in self._names}
        gradients = self._lack.pullback(solved, [*inputs, *(x for x, _ in self._held)])
        return [a + b + self._doubt for a, b in zip(gradients, super().pullback(others, inputs), strict=False)]

    def inverse_mass_matrix(self) -> tuple[Operand, ...]:
        """Return the entries of M^-1, row by row."""
        size = len(self._shares)
        columns = [self._solve([float(i == k) for i in range(size)]) for k in range(size)]
        return tuple(itertools.chain(*columns))  # symmetric

    def _solve(self, column: Sequence[Operand]) -> tuple[Operand, ...]:
        """Return M^-1 times a column."""
        found = solve_factored(self._lower, lambda k, part: part * self._shares[k], column[::-1])[::-1]
        return tuple(x + self._doubt for x in found)


def _changes(name: str, value: Sequence[Operand]) -> list[list[tuple[int, Operand]]]:
    """Return for each component of a change of a value which components of the value change, and how fast."""
    if name in _QUATERNIONS:  # half the product of a unit vector and the quaternion
        w, x, y, z = _QUATERNIONS[name]
        rows = [(w, -1.0, x), (x, 1.0, w), (y, -1.0, z), (z, 1.0, y)]  # of the x axis: w changes by -x/2, ...
        turns = {w: w, x: y, y: z, z: x}
        changes = []
        for _ in range(3):
            changes.append([(a, value[b] * (0.5 * sign)) for a, sign, b in rows])
            rows = [(turns[a], sign, turns[b]) for a, sign, b in rows]
        return changes
    if name == "n":  # stays a unit vector
        return [[(j, float(j == k) - value[j] * value[k]) for j in range(3)] for k in range(3)]
    if name not in _ATTITUDES:
        return [[(k, 1.0)] for k in range(len(value))]
    changes = []
    for first in range(0, len(value), 9):
        for k in range(3):  # a rotation about the k-th axis turns row a into row b, and row b into -a
            a, b = first + 3 * ((k + 1) % 3), first + 3 * ((k + 2) % 3)
            changes.append([(b + j, value[a + j]) for j in range(3)] + [(a + j, -value[b + j]) for j in range(3)])
    return changes


def _change_of(name: str, value: Sequence[Operand], rates: Sequence[Operand]) -> list[Operand]:
    """Return the components of the change of an output from the rates of its components."""
    return [weighted_sum((rates[k], rate) for k, rate in change) * _share(name) for change in _changes(name, value)]


def _is_zero(value: Operand) -> bool:
    return not isinstance(value, TracedValue) and value == 0


def _share(name: str) -> float:
    return 0.5 if name in _ATTITUDES else 1.0  # a rotation is read off two rows
