"""Dynamics of the pair: forces from a motion, and a motion from forces, as a tree with one hinge (T1-T10)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations.spatial import ZERO_VECTOR
from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array, FloatArray, is_zero, one_constant
from hingepair.pair.body import Body, inertial_parameters, warn_of_dynamics
from hingepair.pair.computations import BODIES, TASKS, compute, compute_arrays
from hingepair.pair.constants import Constants, with_hinge_frames
from hingepair.plans.dynamics_steps import LOADS
from hingepair.plans.plan import SPATIAL_MOTION_KIND

DEFAULT_GRAVITY = SPATIAL_MOTION_KIND.gravity  # (0, 0, -9.81) m/s^2, world axes

Bodies: TypeAlias = tuple[Body | None, Body | None]
PIVOT_ROUNDING: Final = 64 * 2.0**-53  # a pivot of the mass matrix below this share of all inertia is rounding


def ask(
    pair: Any,
    name: str,
    given: Mapping[str, Any],
    *,
    gravity: ArrayLike | None = None,
    out: Any = None,
    workers: int = 1,
    backend: str = "auto",
    sequence: str | None = None,
    outputs: tuple[str, ...] | None = None,
) -> Any:
    """Compute the outputs of the row `name` of TASKS, or those named in `outputs`; issue a DynamicsWarning for each
    assumed mass. The other arguments are those of the methods.

    Raises:
        ArgumentError: a body that is needed has no mass.
    """
    constants: Constants = pair.constants
    task = TASKS[constants.kind][name]
    given = {one: value for one, value in given.items() if one not in LOADS[:-1] or not is_zero(value)}
    plain = gravity is None or gravity is constants.kind.gravity
    key = (name, outputs, sequence, backend, *given) if plain else None
    if key is not None:
        found = constants.cache.again(key, given.values(), out, workers)
        if found is not None:
            return found
    vector, cache, names = None, constants.cache, outputs or task.outputs
    if task.masses:
        default = constants.kind.gravity
        vector = tuple(one_constant("gravity", default if gravity is None else gravity, len(default)).tolist())
        bodies = {one: getattr(pair, one) for one in BODIES}
        check_masses({one: body for one, body in bodies.items() if body is not None or one in task.masses}, task.hint)
        if any(body is not None and body.assumed for body in bodies.values()):
            key = None  # each call warns
        constants = pair.with_masses()
    elif "S2" in given:
        constants = with_hinge_frames(constants)
    return compute(
        constants.kind, constants, names, given, gravity=vector, out=out, sequence=sequence, backend=backend,
        workers=workers, result=task.result, key=key, cache=cache,
    )  # fmt: skip


def may_be_singular(tree: Constants) -> bool:
    """Return whether the hinge or body 1 may move without any inertia that resists."""
    return bool(_limits(tree.arrays).any())


def _limits(arrays: Mapping[str, Any]) -> Float64Array:
    """Return the sizes below which pivots of the hinge, of forces and of torques on body 1 are rounding."""
    limits: Float64Array = arrays["tree"][..., -3:]
    return limits


def warn_where_singular(psidd: FloatArray, pair: Any) -> None:
    """Issue a DynamicsWarning where accelerations are NaN because the mass matrix of the pair is singular."""
    tree: Constants = pair.massive().with_masses()
    if not may_be_singular(tree) or not isinstance(psidd, np.ndarray | np.generic):
        return
    bad = np.isnan(psidd)
    if not bad.any():
        return
    still: dict[str, Any] = dict.fromkeys(("omega1", "gravity", *LOADS[:-1]), ZERO_VECTOR)
    still |= dict.fromkeys(("psi", "psid", "hinge_torque"), 0.0) | {"S1": np.eye(3)}
    pivots = compute_arrays(tree, ("pivots",), still, dict.fromkeys(still, ()))["pivots"]
    low = ~(pivots > _limits(tree.arrays)[..., [0, 1, 1, 1, 2, 2, 2]])  # NaN are low
    if low.any():
        which = "the hinge" if low[..., 0].any() else "body 1"
        where = f"at {int(bad.sum())} of {bad.size} samples" if bad.shape else "here"
        warn_of_dynamics(f"{pair.name}: no mass resists {which} {where}; accelerations are NaN there")


def watch(pair: Any, output: str, result: Any, _: Any) -> None:
    """Warn of a singular mass matrix in the results of a prepared call."""
    warn_where_singular(np.asarray(result[output]), pair)


# ---- the pair as a tree


def tree_constants(constants: Constants, bodies: Bodies) -> Constants:
    """Return the Constants of a pair, extended by its numbers as a tree of one hinge; they are computed once.

    Raises:
        ArgumentError: a mass times the square of a length overflows.
    """
    extended: Constants | None = constants.cache.others.get("tree")
    if extended is None:
        arrays = tree_numbers(constants, *bodies) | body_numbers(*bodies)
        arrays |= {name: np.zeros(3) for name in LOADS[:-1]} | {"hinge_torque": np.zeros(())}
        extended = constants.extended(arrays | {"least_pivots": _limits(arrays)})
        constants.cache.others["tree"] = extended
    return extended


def check_masses(bodies: Mapping[str, Body | None], hint: str = "") -> None:
    """Raise ArgumentError for a body, by name, that is None; `hint` ends the message for body 1. Issue a
    DynamicsWarning for each assumed value.
    """
    for name, body in bodies.items():
        if body is None:
            examples = f"HingePair(..., {name}=hp.Body(mass=2.0)), or in a scene [pair.{name}] mass = 2.0"
            raise ArgumentError(
                f"pair.{name}", f"mass properties, as in {examples}{hint if name == 'body1' else ''}", None
            )
        for sentence in body.assumed:
            warn_of_dynamics(f"pair.{name}: {sentence}")


def tree_numbers(constants: Constants, body1: Body | None, body2: Body | None) -> dict[str, Float64Array]:
    """Return the numbers of a pair as a tree of one hinge, in the order of `plans.trees`: `tree` (..., 32), in which
    matter on the hinge's axis counts with body 1 (T9); `whole_body2` (..., 22), in which it does not, and body 1 does
    not count; and `arm2` (..., 3), from the hinge point to R2. A body that is None has no mass.

    The tree's axes of body 2 are e1, e2 and n of body 1 at psi = 0.

    Raises:
        ArgumentError: a mass times the square of a length overflows.
    """
    frames = with_hinge_frames(constants).values
    axes = np.stack([np.stack(np.broadcast_arrays(*frames[name]), axis=-1) for name in ("e1", "e2", "n")], axis=-1)
    home = constants.arrays["home"]
    turn = _product(np.swapaxes(axes, -1, -2), home.reshape(*home.shape[:-1], 3, 3))  # from body 2's axes
    u1, u2 = constants.arrays["u1"], constants.arrays["u2"]
    with np.errstate(all="ignore"):
        m1, h1, N1, least1, spread1 = _moments(body1, np.eye(3), np.zeros(3))
        m2, h2, N2, _, spread2 = _moments(body2, turn, u2)
        # Matter on the axis, moved to body 1 (T9).
        w = axes[..., 2]
        h_z, N_zz = h2[..., 2:], N2[..., 2, 2, None, None]
        across = _outer(u1, w)
        base_h = h1 + m2 * u1 + h_z * w
        base_N = N1 + m2 * _outer(u1, u1) + h_z[..., None] * (across + _swapped(across)) + N_zz * _outer(w, w)
        lowest = _lowest_pivots(m1, least1, body1, spread1, m2, N2, h2, spread2, u1)
        place = [axes.reshape(*axes.shape[:-2], 9), u1]
        tree = _joined(
            [*_scalars(m1 + m2), base_h, _six(base_N), *place, h2[..., :2], _six(N2)[..., :5], lowest],
        )
        whole = _joined([*place, *_scalars(m2), h2, _six(N2)])
    if not (np.isfinite(tree).all() and np.isfinite(whole).all()):
        expected = "masses and lengths whose products mass x length^2 stay below 1.8e308 kg m^2"
        raise ArgumentError("pair", expected, "products that overflow")
    return {"tree": tree, "whole_body2": whole, "arm2": -_product(turn, u2[..., None])[..., 0]}


def body_numbers(*bodies: Body | None) -> dict[str, Float64Array]:
    """Return masses (2,), first moments (6,) and inertias (12,) of both bodies, about their reference points; zeros
    of a body that is None.
    """
    rows = np.zeros((2, 10))
    for row, body in zip(rows, bodies, strict=True):
        if body is not None:
            row[:] = inertial_parameters(body.mass, body.centre_of_mass, body.inertia)
    masses, first, second = (columns.ravel() for columns in np.split(rows, (1, 4), axis=1))
    return {"masses": masses, "first_moments": first, "inertias": second}


def _moments(body: Body | None, turn: Any, u: Any) -> tuple[float, Any, Any, float, Any]:
    """Return mass, first and second moment of a body about the point u, in axes to which `turn` rotates; its least
    moment of inertia; and a bound on its inertia about that point.
    """
    if body is None:
        return 0.0, np.zeros(3), np.zeros((3, 3)), 0.0, 0.0
    m, inertia, lever = body.mass, body.inertia, body.centre_of_mass - u
    c = _product(turn, lever[..., None])[..., 0]
    J = _product(_product(turn, inertia), _swapped(turn))
    N = (J[..., 0, 0] + J[..., 1, 1] + J[..., 2, 2])[..., None, None] / 2 * np.eye(3) - J + m * _outer(c, c)
    spread = m * np.abs(lever).sum(axis=-1) ** 2 + np.abs(inertia).max()
    return m, m * c, N, float(np.linalg.eigvalsh(inertia)[0]), spread


def _lowest_pivots(
    m1: float, least1: float, body1: Body | None, spread1: Any, m2: float, N2: Any, h2: Any, spread2: Any, u1: Any
) -> Float64Array:
    """Return the sizes below which pivots of the hinge, of forces and of torques on body 1 are rounding, (..., 3); 0
    where they cannot be that small, as `mechanism.constants` has them for robots.
    """
    reach = np.abs(u1).sum(axis=-1)
    hinge = PIVOT_ROUNDING * spread2
    force = PIVOT_ROUNDING * (m1 + m2)
    torque = PIVOT_ROUNDING * (spread1 + spread2 + 2 * reach * np.abs(h2).sum(axis=-1) + m2 * reach**2)
    c = np.zeros(3) if body1 is None else body1.centre_of_mass
    resists = least1 > torque
    if m1 > 0 and least1 > 0:
        resists &= 1 / (1 / m1 + float(c @ c) / least1) > force
    # 1e-300, since 0 stands for a pivot that is never small
    turns = N2[..., 0, 0] + N2[..., 1, 1] > hinge
    return np.stack(
        np.broadcast_arrays(
            np.where(turns, 0.0, np.maximum(hinge, 1e-300)),
            np.where(resists, 0.0, np.maximum(force, 1e-300)),
            np.where(resists, 0.0, np.maximum(torque, 1e-300)),
        ),
        axis=-1,
    )


def _product(A: Any, B: Any) -> Any:
    """Return A @ B in which products with 0 and 1 are exact, and without -0.0."""
    return sum(A[..., :, k, None] * B[..., k, None, :] for k in range(3)) + 0.0


def _swapped(A: Any) -> Any:
    return np.swapaxes(A, -1, -2)


def _outer(a: Any, b: Any) -> Any:
    return a[..., :, None] * b[..., None, :]


def _six(N: Any) -> Any:
    """Return the entries xx, xy, xz, yy, yz and zz of symmetric matrices."""
    return N[..., (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)]


def _scalars(*values: float) -> list[Any]:
    return [np.array([value]) for value in values]


def _joined(parts: list[Any]) -> Float64Array:
    """Return parts with their components on the last axis as one array, broadcast."""
    shape = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
    return np.concatenate([np.broadcast_to(part, (*shape, part.shape[-1])) for part in parts], axis=-1) + 0.0
