"""Closed forms of a scene's motion, or of any motion of a pair."""

from __future__ import annotations

from collections.abc import Iterable

from hingepair.errors import ArgumentError, quoted
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.scenes.scene import Scene
from hingepair.symbolic.closed_forms import SYMBOLIC
from hingepair.symbolic.derivation import Derivation


def derive(scene_or_pair: Scene | HingePair | PlanarPair, symbolic: Iterable[str] = ()) -> Derivation:
    r"""The closed forms of a scene's motion, or of any motion of a pair, as SymPy expressions (E1-E11).

    Of a bare pair the coordinates are functions of t: x(t), y(t), z(t), phi_x(t), phi_y(t), phi_z(t) (XYZ), psi(t);
    of a planar pair x(t), y(t), phi(t), psi(t); of a scene those that go through way points. Numbers are exact: a
    float is the number that its shortest decimal form writes (0.1 is 1/10), and an axis whose squared components are
    rational numbers with denominators up to 1000 is that axis: (1, 1, 0) gives sqrt(2)/2. Products of sines and
    cosines become sums where that is no longer.

    Args:
        scene_or_pair: a Scene, a HingePair or a PlanarPair.
        symbolic: what stays a letter: of u1, u2 and n (u1_x, u1_y, u1_z and so on; n is taken to have length 1), and
            of a scene's constants.

    Returns:
        The derivation; `.omega1`, `.R2` and so on are SymPy matrices in `.t`; `.to_text()`, `.to_latex()` and
        `.to_python()` write them out.

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
    """
    scene = scene_or_pair if isinstance(scene_or_pair, Scene) else None
    pair = scene_or_pair if scene is None else scene.pair
    if not isinstance(pair, HingePair | PlanarPair):
        raise ArgumentError("scene_or_pair", "a Scene, a HingePair or a PlanarPair", quoted(pair))
    constants = {} if scene is None else scene.constants
    known = (*(key for key in SYMBOLIC if hasattr(pair, key)), *constants)
    expected = f"names out of {', '.join(known)}"
    if isinstance(symbolic, str) or not isinstance(symbolic, Iterable):
        raise ArgumentError("symbolic", f"a tuple of {expected}", quoted(symbolic))
    names = tuple(symbolic)
    for name in names:
        if name not in known:
            raise ArgumentError("symbolic", expected, quoted(name))
    if scene is None:
        return Derivation(pair, symbolic=names)
    motion = scene.functions().expressions(tuple(name for name in names if name in constants))
    return Derivation(pair, motion, scene.sequence, names)
