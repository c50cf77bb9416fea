"""Closed forms of a scene's motion, of any motion of a pair, or of a robot's frame."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from typing import overload

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.scenes.pair_table import pair_expressions
from hingepair.scenes.scene import Scene, load_pair, load_tables
from hingepair.scenes.tables import Table
from hingepair.symbolic.closed_forms import SYMBOLIC_CONSTANT_NAMES
from hingepair.symbolic.derivation import Derivation
from hingepair.symbolic.frame_forms import FrameForms
from hingepair.symbolic.kinks import Expr, constant_value


@overload
def derive(scene_or_pair: Scene | HingePair | PlanarPair, symbolic: Iterable[str] = ()) -> Derivation: ...
@overload
def derive(scene_or_pair: Mechanism, symbolic: Iterable[str] = (), frame: str | None = None) -> FrameForms: ...
def derive(
    scene_or_pair: Scene | HingePair | PlanarPair | Mechanism,
    symbolic: Iterable[str] = (),
    frame: str | None = None,
) -> Derivation | FrameForms:
    r"""Return closed forms (E1-E11) of a scene's motion or a pair's: a Derivation; of a robot's frame: FrameForms.

    Of a bare pair the coordinates are functions of t: x(t), y(t), z(t), phi_x(t), phi_y(t), phi_z(t) (XYZ), psi(t);
    of a planar pair x(t), y(t), phi(t), psi(t); of a scene those that go through way points. Numbers are exact: what
    a scene writes as an expression, also in its pair, stays that expression; a float is the number that its shortest
    decimal form writes (0.1 is 1/10), and an axis whose squared components are rational numbers with denominators up
    to 1000 is that axis: (1, 1, 0) gives sqrt(2)/2. Products of sines and cosines become sums where that is no
    longer. Text, LaTeX and Python have a constant exactly unless its 17 digits are shorter.

    Of a robot, whose base rests at the origin, these are position R and attitude S of a frame, its Jacobian, v and
    omega. Joints whose axes are parallel make sums of angles, c_23 = cos(q_2 + q_3), and sums that come again are
    named k_1, k_2. A robot whose URDF has right angles to a few digits is best loaded with snap=1e-6.

    Args:
        scene_or_pair: a Scene, a HingePair, a PlanarPair or a Mechanism with a fixed base.
        symbolic: what stays a letter: of u1, u2 and n (u1_x, u1_y, u1_z and so on; n is taken to have length 1), and
            of a scene's constants. Of a robot: u, points of its joints (u_3x of the third, in the axes of the body
            that carries it) and the frame's origin p.
        frame: name of a robot's link, joint or other frame; that of the last link unless given.

    Returns:
        The derivation; `.omega1`, `.R2` and so on are SymPy matrices in `.t`, of a robot `.R`, `.S`, `.jacobian`,
        `.v` and `.omega` in `.q` and `.qd`; `.to_text()`, `.to_latex()` and `.to_python()` write them out.

    Raises:
        ArgumentError: an argument cannot be used, or an expression's derivatives are too long; names it.

    >>> import hingepair as hp
    >>> pair = hp.PlanarPair(u1=(1, 0), u2=(-1, 0))
    >>> hp.derive(pair).R2
    Matrix([
    [x(t) + cos(phi(t) + psi(t)) + cos(phi(t))],
    [y(t) + sin(phi(t) + psi(t)) + sin(phi(t))]])
    >>> print(hp.derive(pair, ("u1", "u2")).to_latex(["omega2"]))
    \begin{align*}  % \usepackage{amsmath}
      \omega_{2} &= \dot{\phi} + \dot{\psi}
    \end{align*}
    <BLANKLINE>
    >>> links = [hp.HingePair(u1=(2 * k, 0, 0), u2=(0, 0, 0), n=(0, 0, 1), name=f"joint{k}") for k in (0, 1)]
    >>> arm = hp.Mechanism(links).with_frame("hand", link="joint1", R=(1, 0, 0))
    >>> hp.derive(arm, frame="hand").R
    Matrix([
    [2*cos(q_1) + cos(q_1 + q_2)],
    [2*sin(q_1) + sin(q_1 + q_2)],
    [                          0]])
    """
    if isinstance(scene_or_pair, Mechanism):
        return FrameForms(scene_or_pair, frame, symbolic)
    if frame is not None:
        raise ArgumentError("frame", "a robot, whose frame it is", quoted(scene_or_pair))
    if isinstance(scene_or_pair, Scene):
        scene = scene_or_pair
        names = _symbolic_names(symbolic, scene.pair, scene.constants)
        symbolic_constants = tuple(name for name in names if name in scene.constants)
        motion = scene.functions().expressions(symbolic_constants)
        written = _exact_pair_values(scene.pair, scene.tables, symbolic_constants)
        return Derivation(scene.pair, motion, scene.sequence, names, written)
    pair = scene_or_pair
    if not isinstance(pair, HingePair | PlanarPair):
        raise ArgumentError("scene_or_pair", "a Scene, a HingePair, a PlanarPair or a Mechanism", quoted(pair))
    return Derivation(pair, symbolic=_symbolic_names(symbolic, pair, ()))


def derive_any_motion(path: str | os.PathLike[str], symbolic: Iterable[str] = ()) -> Derivation:
    """Return closed forms of a scene file's pair whose coordinates are unspecified functions of t: a Derivation.

    Args:
        path: the scene file.
        symbolic: as for `derive`.

    Raises:
        SceneError: the file cannot be read as a scene.
        ArgumentError: as for `derive`.
    """
    tables = load_tables(path)
    pair = load_pair(path)
    names = _symbolic_names(symbolic, pair, tables.constants)
    symbolic_constants = tuple(name for name in names if name in tables.constants)
    return Derivation(pair, symbolic=names, exact_values=_exact_pair_values(pair, tables, symbolic_constants))


def _symbolic_names(symbolic: object, pair: HingePair | PlanarPair, constants: Collection[str]) -> tuple[str, ...]:
    """Return the argument `symbolic` as a tuple of names of u1, u2, n and scene constants; refuse other values."""
    allowed_names = (*(key for key in SYMBOLIC_CONSTANT_NAMES if hasattr(pair, key)), *constants)
    expected = f"names out of {', '.join(allowed_names)}"
    if isinstance(symbolic, str) or not isinstance(symbolic, Iterable):
        raise ArgumentError("symbolic", f"a tuple of {expected}", quoted(symbolic))
    names = tuple(symbolic)
    for name in names:
        if name not in allowed_names:
            raise ArgumentError("symbolic", expected, quoted(name))
    return names


def _exact_pair_values(
    pair: HingePair | PlanarPair, tables: Table, symbolic_constants: tuple[str, ...]
) -> dict[str, tuple[Expr, ...]]:
    """Return the exact u1, u2, n and home that the scene file holds, by name; leave out those that differ from the
    pair's numbers.

    Someone may have given the scene another pair (`dataclasses.replace`).
    """
    table, planar = tables.table("pair"), isinstance(pair, PlanarPair)
    numbers = pair.constants.values
    same = {
        key
        for key, exprs in pair_expressions(table, planar).items()
        if key in numbers and np.allclose([constant_value(c) for c in exprs], numbers[key], rtol=1e-14, atol=1e-15)
    }
    return {key: exprs for key, exprs in pair_expressions(table, planar, symbolic_constants).items() if key in same}
