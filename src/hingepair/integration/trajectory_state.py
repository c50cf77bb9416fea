"""From integrated angles to the state of the pair: what else is needed, and what is known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError
from hingepair.evaluation.plan import ACCELERATION, PLANAR, SPATIAL, check_outputs, default_outputs, make_plan
from hingepair.integration.signals import Signal, Values
from hingepair.integration.trajectory import rotations
from hingepair.numeric.blocks import components_of, evaluate
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import Outputs
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.states import PairState, PlanarState

Rates = Mapping[str, Signal | None]

_GIVEN: Final = {
    **{"R1": "R1", "v1": "R1[1]", "a1": "R1[2]", "omega1": "omega1", "psid": "psid", "alpha1": "alpha1"},
    **{"psidd": "psidd", "phi1d": "omega1", "phi1dd": "alpha1"},
}

_WANTED: Final = {"v1": "(R1, v1) or (R1, v1, a1)", "a1": "(R1, v1, a1)"}


def spatial_state(
    pair: HingePair,
    t: Values,
    quats: Values,
    psi: Values,
    rates: Rates,
    point: Mapping[str, NDArray[Any]],
    outputs: Outputs,
    *,
    body: bool,
    backend: str,
) -> PairState:
    """The state of a pair at the instants.

    Args:
        pair: the pair.
        t: the instants.
        quats: attitude of body 1.
        psi: hinge angle.
        rates: omega1, psid, alpha1, psidd.
        point: R1, v1, a1, as far as known.
        outputs: names; None for all of body 2 that can be had.
        body: whether omega1 and alpha1 are in body axes.
        backend: as for `forward_kinematics`.
    """
    names, needed = _wanted(pair.constants, outputs, rates, point, SPATIAL)
    if not names:
        return PairState({}, t.shape)
    known: dict[str, Any] = {name: point[name] for name in ("R1", "v1", "a1") if name in needed}
    S1 = rotations(quats)
    for name in needed & {"omega1", "alpha1", "psid", "psidd"}:
        values = rates[name].instants(t)  # type: ignore[union-attr]
        known[name] = turned(S1, values) if body and values.ndim == 2 else values
    motion = BodyMotion._trusted(
        R=known.get("R1", np.zeros(3)),
        S=S1,
        v=known.get("v1"),
        omega=known.get("omega1"),
        a=known.get("a1"),
        alpha=known.get("alpha1"),
    )
    psid = known.get("psid", 0.0 if "psidd" in known else None)
    return pair.forward_kinematics_from_body1(motion, psi, psid, known.get("psidd"), outputs=names, backend=backend)


def planar_state(
    pair: PlanarPair,
    t: Values,
    angles: tuple[Values, Values],
    rates: Rates,
    point: Mapping[str, NDArray[Any]],
    outputs: Outputs,
    *,
    backend: str,
) -> PlanarState:
    """The state of a planar pair at the instants; angles = (phi, psi)."""
    names, needed = _wanted(pair.constants, outputs, rates, point, PLANAR)
    if not names:
        return PlanarState({}, t.shape)
    zero = np.zeros(2)
    levels: list[Any] = [(point["R1"], *angles)]
    for place, turn, hinge in (("v1", "phi1d", "psid"), ("a1", "phi1dd", "psidd")):
        if needed & {"v1", "phi1d", "psid", "a1", "phi1dd", "psidd"}:
            parts = [
                rates[_GIVEN[name]].instants(t) if name in needed else 0.0  # type: ignore[union-attr]
                for name in (turn, hinge)
            ]
            levels.append((point[place] if place in needed else zero, *parts))
    coordinates = [(p[..., 0], p[..., 1], a, b) for p, a, b in levels]
    return pair.forward_kinematics(*coordinates, outputs=names, backend=backend)


def _wanted(
    pair: Constants, outputs: Outputs, rates: Rates, point: Mapping[str, Any], kind: str
) -> tuple[tuple[str, ...], frozenset[str]]:
    """The outputs, and the inputs that they need.

    Raises:
        ArgumentError: an unknown output, or one that needs what is not given; names that.
    """
    given = {name for name, rate in rates.items() if rate is not None} | point.keys()
    given |= {name for name, own in _GIVEN.items() if own in given} | {"S1", "psi", "phi1"} | pair.values.keys()

    def inputs(names: tuple[str, ...]) -> frozenset[str]:
        return frozenset(make_plan(names, None, "home" in pair.values, kind=kind).inputs) if names else frozenset()

    if outputs is None:
        possible = default_outputs(ACCELERATION, kind)
        names = tuple(name for name in possible if inputs((name,)) <= given)
        return names, inputs(names)
    names = check_outputs(outputs, kind) if not isinstance(outputs, tuple) or outputs else ()
    for name in names:
        for missing in sorted(inputs((name,)) - given):
            expected = f"{_WANTED.get(missing, 'a value')}, since output {name} needs it"
            got = f"no {missing}" if missing in _WANTED else None
            raise ArgumentError(_GIVEN[missing].partition("[")[0], expected, got)
    return names, inputs(names)


def turned(S1: NDArray[Any], vectors: Values) -> Values:
    """Vectors from body 1's axes to the world's."""
    parts = {"S1": components_of(S1, 2), "w": components_of(vectors)}
    return evaluate(lambda v: eq.rotate(v["S1"], v["w"]), parts, (3,), np.dtype(np.float64))
