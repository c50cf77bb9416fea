"""The search for the state whose error bound is largest beside its scale: of many, the worst are varied again.

A state is a dict of arrays with one row a state: u1, u2, n, and q, qd, qdd, or R, S (as quaternions), v, omega, a,
alpha and the hinge's psi, psid, psidd; home as quaternions where there is one.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import hingepair as hp
from hingepair.bench.truth import UNIT, motion_scales

_VECTORS = {"u1": 3, "u2": 3, "n": 3, "q": 7, "qd": 7, "qdd": 7}
_GIVEN = {"u1": 3, "u2": 3, "n": 3, "quat": 4, "R": 3, "v": 3, "omega": 3, "a": 3, "alpha": 3, "hinge": 3}
_PLANAR = {"u1": 2, "u2": 2, "q": 4, "qd": 4, "qdd": 4}
FORMS = {
    "Tait-Bryan": _VECTORS,
    "Tait-Bryan, home": _VECTORS | {"home": 4},
    "proper Euler": _VECTORS,
    "proper Euler, home": _VECTORS | {"home": 4},
    "given attitude": _GIVEN,
    "given attitude, home": _GIVEN | {"home": 4},
    "planar": _PLANAR,
}


def search(form, output, rng, count=1500, rounds=60, dtype=np.float64):
    """The largest bound found, in units of u * scale, and its state."""
    population = _first(FORMS[form], rng, count)
    best, state = 0.0, None
    for _ in range(rounds):
        ratio = ratios(form, population, (output,), dtype)[output]
        order = np.argsort(-ratio)
        if ratio[order[0]] > best:
            best, state = float(ratio[order[0]]), {k: v[order[0]] for k, v in population.items()}
        population = _varied(population, order[: count // 10], count, rng)
    return best, state


def ratios(form, state, outputs, dtype=np.float64):
    """The bounds of states in units of u * scale, by output."""
    own = {k: v.astype(dtype) for k, v in state.items() if k != "home"}
    constants = {k: own[k] for k in ("u1", "u2", "n") if k in own}
    if "home" in state:
        constants["home"] = _turns(state["home"])
    if form == "planar":
        pair, motion = hp.PlanarPair(**constants), (own["q"], own["qd"], own["qdd"])
        bounds = pair.error_bounds(*motion, outputs=outputs)
        W1, A1 = abs(own["qd"][:, 2]), abs(own["qdd"][:, 2]) + own["qd"][:, 2] ** 2
        parts = [np.column_stack((c[:, :2], 0 * c[:, 2], c[:, 3])) for c in motion]
    elif "quat" in state:
        pair, psi, psid, psidd = hp.HingePair(**constants), *own["hinge"].T
        S = _turns(state["quat"]).astype(dtype)
        body1 = hp.BodyMotion(S=S, **{k: own[k] for k in ("R", "v", "omega", "a", "alpha")})
        bounds = pair.error_bounds(body1, psi, psid, psidd, outputs=outputs)
        W1, A1 = (np.linalg.norm(own[k], axis=-1) for k in ("omega", "alpha"))
        parts = [np.column_stack((own[k], c)) for k, c in (("R", psi), ("v", psid), ("a", psidd))]
    else:
        pair, motion = hp.HingePair(**constants), (own["q"], own["qd"], own["qdd"])
        sequence = "XYZ" if form.startswith("Tait") else "XYX"
        bounds = pair.error_bounds(*motion, outputs=outputs, sequence=sequence)
        W1 = abs(motion[1][:, 3:6]).sum(axis=-1)
        A1 = abs(motion[2][:, 3:6]).sum(axis=-1) + W1**2
        parts = motion
    levers = [own[k] if own[k].shape[1] == 3 else np.column_stack((own[k], 0 * own[k][:, 0])) for k in ("u1", "u2")]
    scales = motion_scales(levers, parts, W1, A1)
    with np.errstate(all="ignore"):
        found = {name: bounds[name] / (UNIT[np.dtype(dtype)] * scales[name]) for name in outputs}
    return {name: np.where(np.isfinite(ratio), ratio, 0.0) for name, ratio in found.items()}


def _turns(quat_wxyz):
    return Rotation.from_quat(quat_wxyz, scalar_first=True).as_matrix()


def _first(shape, rng, count):
    """States of all kinds: numbers of very different size, many that are tiny."""
    state = {}
    for name, width in shape.items():
        numbers = rng.normal(size=(count, width))
        numbers *= np.where(rng.random((count, 1)) < 0.5, 1.0, 10 ** rng.uniform(-9, 0, (count, 1)))
        numbers *= np.where(rng.random((count, width)) < 0.7, 1.0, 10 ** rng.uniform(-9, 0, (count, width)))
        state[name] = numbers
    for name in ("q", "hinge"):
        if name in state:
            width = shape[name]
            angles = slice(2, 4) if width == 4 else slice(0, 1) if width == 3 else slice(3, 7)
            state[name][:, angles] *= np.pi
    return state


def _varied(population, parents, count, rng):
    """The parents, and children of them: numbers changed by factors or sums of any size, or taken from another."""
    mothers = rng.choice(parents, count)
    fathers = rng.choice(parents, count)
    size = 10 ** rng.uniform(-6, 0, (count, 1))
    children = {}
    for name, numbers in population.items():
        own, other = numbers[mothers], numbers[fathers]
        shape = own.shape
        changed = rng.random(shape) < rng.choice([0.1, 0.3, 0.8], (count, 1))
        step = size * rng.normal(size=shape)
        moved = np.where(rng.random(shape) < 0.5, own * (1 + step), own + step * rng.choice([1.0, 1e-3, 1e-6], shape))
        child = np.where(changed, moved, own)
        child = np.where(rng.random((count, 1)) < 0.1, other, child)
        child[: len(parents)] = numbers[parents]
        children[name] = child
    return children
