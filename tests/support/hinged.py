"""Pairs, and motions of their bodies, as objects of the library."""

from __future__ import annotations

import numpy as np

import hingepair as hp
from support.states import generator
from support.states import pair as random_pair

LETTERS = {"R": "R2", "S": "S2", "v": "v2", "omega": "omega2", "a": "a2", "alpha": "alpha2"}
OUTPUTS = ("S1", "omega1", "alpha1", *LETTERS.values())


def pair_of(constants, **changes):
    """The pair of (u1, u2, n, home)."""
    return hp.HingePair(**dict(zip(("u1", "u2", "n", "home"), constants, strict=True)) | changes)


def made(key=0, **changes):
    """A random pair."""
    return pair_of(random_pair(generator(85, key)), **changes)


def bodies(pair, motion, backend="numpy", **changes):
    """Both bodies of a motion as the library computes it; changes replace arrays of body 2."""
    q, qd, qdd = motion
    s = pair.forward_kinematics(q, qd, qdd, outputs=OUTPUTS, backend=backend)
    own = {"R": q[..., :3], "v": qd[..., :3], "a": qdd[..., :3], "S": s.S1, "omega": s.omega1, "alpha": s.alpha1}
    other = {letter: getattr(s, name) for letter, name in LETTERS.items()} | changes
    return hp.BodyMotion(**own), hp.BodyMotion(**other)


def shaken(t):
    """Motion of a body that is shaken along x, and turns about z."""
    wave, rate = (np.stack([f(3 * t), 0 * t, 0 * t], axis=-1) for f in (np.sin, np.cos))
    turn = hp.rodrigues((0, 0, 1), 0.5 * t)
    return hp.BodyMotion(R=wave, S=turn, v=3 * rate, omega=(0, 0, 0.5), a=-9 * wave, alpha=np.zeros((len(t), 3)))


def only(body, *letters):
    return hp.BodyMotion(**{letter: getattr(body, letter) for letter in letters})
