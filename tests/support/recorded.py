"""Recordings of two bodies, made from rotations written out here: with noise, outliers, and joints of other kinds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import hingepair as hp

U1, U2 = np.array([0.3, 0.1, -0.2]), np.array([-0.2, 0.25, 0.1])
N1 = np.array([1.0, 2.0, -0.5]) / np.sqrt(5.25)


def turns(rotvec):
    """Rotations of rotation vectors, by Rodrigues' formula."""
    vector = np.asarray(rotvec, dtype=float)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    W = np.stack((zero, -z, y, z, zero, -x, -y, x, zero), axis=-1).reshape(*vector.shape, 3)
    with np.errstate(all="ignore"):
        first = np.where(angle > 0, np.sin(angle) / angle, 1.0)
        second = np.where(angle > 0, 2 * (np.sin(angle / 2) / angle) ** 2, 0.5)
    return np.eye(3) + first * W + second * W @ W


HOME = turns((0.3, -0.5, 0.2))


class Recording(NamedTuple):
    """Poses of both bodies, and the angles of the hinge; t in seconds."""

    t: np.ndarray
    R1: np.ndarray
    S1: np.ndarray
    R2: np.ndarray
    S2: np.ndarray
    psi: np.ndarray


def angles(t):
    return np.sin(2 * t) + 0.3 * np.cos(5 * t)


def recording(count=1000, metres=0.0, radians=0.0, seed=0, turn=1.0, outliers=0.0, Q=None, slip=0.0):
    """Two bodies with a hinge; Q(t, psi): another relative attitude, slip: moves the hinge point, body-1 axes."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / 200 * max(1.0, 2000 / count)
    psi = turn * angles(t)
    S1 = turns(np.stack((np.sin(0.7 * t), np.cos(1.1 * t), 0.5 * np.sin(t)), axis=-1))
    R1 = np.stack((np.sin(t), np.cos(t), 0.1 * t), axis=-1)
    S2 = S1 @ (turns(psi[:, None] * N1) @ HOME if Q is None else Q)
    lever = np.broadcast_to(U1 + np.asarray(slip), (count, 3))
    R2 = R1 + np.einsum("nij,nj->ni", S1, lever) - S2 @ U2
    noise = rng.standard_normal((4, count, 3))
    R1, R2 = R1 + metres * noise[0], R2 + metres * noise[1]
    S1, S2 = S1 @ turns(radians * noise[2]), S2 @ turns(radians * noise[3])
    off = rng.random(count) < outliers
    R2[off] += rng.normal(size=(off.sum(), 3))
    S2[off] = turns(3 * rng.normal(size=(off.sum(), 3)))
    return Recording(t, R1, S1, R2, S2, psi)


def bodies(made):
    """The motions of both bodies."""
    return hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=made.R2, S=made.S2)


def truth(sign, gauge="closest_to_R1"):
    """u1, u2, n, home as `fit` names them."""
    n = sign * N1
    m = HOME.T @ n
    slide = -(U1 @ n) if gauge == "closest_to_R1" else -(U2 @ m)
    axis = np.cross(m, n)
    sine = np.linalg.norm(axis)
    return U1 + slide * n, U2 + slide * m, n, turns(axis / sine * np.arctan2(sine, m @ n))
