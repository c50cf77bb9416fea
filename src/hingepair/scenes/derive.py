"""Closed forms of a scene, of a pair, or of a frame of a robot."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.rotations.euler import matrix_to_euler
from hingepair.scenes.scene import Scene
from hingepair.scenes.tables import Table
from hingepair.symbolic.closed_forms import SYMBOLIC_CONSTANTS, frame_forms, pair_forms, point_key
from hingepair.symbolic.exact import Expr, exact, to_sympy


def derive(
    scene_or_pair: Scene | HingePair | PlanarPair | Mechanism,
    symbolic: Iterable[str] = (),
    frame: str | None = None,
) -> Any:
    r"""Return closed forms as SymPy expressions: of a Scene, a HingePair or a PlanarPair by the equations E1-E11
    (docs/concepts/equations.md), of a Mechanism, or its scene, those of one link, joint or frame.

    The coordinates of a HingePair are functions of t: x(t), y(t), z(t), the XYZ Euler angles phi_x(t), phi_y(t),
    phi_z(t), and psi(t). The coordinates of a PlanarPair are x(t), y(t), phi(t), psi(t). The coordinates of a Scene
    are the expressions in its file; a coordinate that the file defines by waypoints (instants and values), and all of
    a scene without a motion or with a simulated one, stay functions of t.

    All numbers are exact. An expression in a scene file, including those in the table [pair], is used as it is
    written. A float becomes the number that its shortest decimal form shows: 0.1 becomes 1/10. The components of a
    normalised axis become exact roots if their squares are rational numbers with denominators up to 1000: the axis
    (1, 1, 0) has the components sqrt(2)/2, sqrt(2)/2 and 0. A product of sines and cosines becomes a sum if the sum
    is not longer. Text and LaTeX show constants other than simple fractions and roots as decimals.

    The base of a robot rests at the origin. For joints with parallel axes, the matrices contain cosines and sines of
    sums of angles, such as cos(q_2 + q_3). Written forms with long lines abbreviate them: c_23 is cos(q_2 + q_3),
    and s_23 is sin(q_2 + q_3). They also name terms that occur several times: k_1, k_2 and so on. If a URDF
    file rounds right angles, such as 1.5708 for pi/2, load the robot with `snap=1e-5`: an angle within this tolerance
    [rad] of a multiple of pi/2 is then replaced by that multiple.

    Args:
        scene_or_pair: a Scene, a HingePair, a PlanarPair, or a Mechanism with base="fixed".
        symbolic: tuple of names of constants that stay symbols; () by default. For a pair, "u1", "u2" and "n" are
            possible (symbols u1_x, u1_y, u1_z and so on; n is assumed to have length 1). For a scene, the names of
            the scene's constants are possible too, unless they are called as a coordinate, a component or an output.
            Not for a robot.
        frame: name of a link, a joint or another frame of a robot; by default its only link without children. The
            name is required if several links have no children. Only for a robot.

    Returns:
        ClosedForms. For a scene or a pair, `.R2`, `.omega2` and so on are SymPy matrices in the symbol `.t`; of a
        point named tip also `.tip`, `.tip_v` and `.tip_a`. For a planar pair, `.phi2`, `.omega2` and `.alpha2` are
        SymPy expressions. For a robot, position `.R`, rotation `.S`, `.jacobian`, velocity `.v` and angular velocity
        `.omega` of the frame, in world axes, are SymPy matrices in the symbols `.q` and `.qd`. The methods
        `.to_text()`, `.to_latex()`, `.to_python()` and `.to_c()` return the forms as text.

    Raises:
        ArgumentError: the derivatives of an expression are too long. The message names the argument.

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

    In this example, the last link of the robot has the name of its joint, joint1:

    >>> pairs = [hp.HingePair(u1=(2 * k, 0, 0), u2=(0, 0, 0), n=(0, 0, 1), name=f"joint{k}") for k in (0, 1)]
    >>> arm = hp.Mechanism(pairs).with_frame("hand", link="joint1", R=(1, 0, 0))
    >>> hp.derive(arm, frame="hand").R
    Matrix([
    [2*cos(q_1) + cos(q_1 + q_2)],
    [2*sin(q_1) + sin(q_1 + q_2)],
    [                          0]])
    """
    if isinstance(scene_or_pair, Scene) and scene_or_pair.mechanism is not None:
        scene_or_pair = scene_or_pair.mechanism
    if isinstance(scene_or_pair, Mechanism):
        if symbolic:
            raise ArgumentError("symbolic", "nothing for a robot, whose numbers the formulas show", quoted(symbolic))
        return frame_forms(scene_or_pair, frame)
    if frame is not None:
        raise ArgumentError("frame", "a robot, whose frame it is", quoted(scene_or_pair))
    if isinstance(scene_or_pair, Scene):
        scene, pair = scene_or_pair, scene_or_pair.assembly.pair
        names = _symbolic_names(symbolic, pair, scene.constants)
        symbolic_constants = tuple(name for name in names if name in scene.constants)
        written = _exact_pair_values(scene.tables, symbolic_constants)
        if scene.has_motion and not scene.is_simulated:
            motion = dict.fromkeys(scene.expressions, exact(0)) | scene.functions.expressions(symbolic_constants)
            return pair_forms(pair, motion, scene.sequence, names, written)
        return pair_forms(pair, _fixed_body1(scene), symbolic=names, exact_values=written)
    pair = scene_or_pair
    if not isinstance(pair, HingePair | PlanarPair):
        raise ArgumentError("scene_or_pair", "a Scene, a HingePair, a PlanarPair or a Mechanism", quoted(pair))
    return pair_forms(pair, symbolic=_symbolic_names(symbolic, pair, ()))


def _fixed_body1(scene: Scene) -> dict[str, Expr]:
    """Return the coordinates of body 1 where [dynamics] fixes it; otherwise nothing."""
    start = scene.dynamics.start
    if "dynamics" not in scene.tables.values or scene.dynamics.base != "fixed" or start is None:
        return {}
    x, y, z, *phi = map(exact, (*start.R.tolist(), *matrix_to_euler(start.S).tolist()))
    given = (x, y, phi[2]) if scene.assembly.planar else (x, y, z, *phi)
    return dict(zip(scene.assembly.kind.coordinates[:-1], given, strict=True))


def _symbolic_names(symbolic: object, pair: HingePair | PlanarPair, constants: Collection[str]) -> tuple[str, ...]:
    """Return the argument `symbolic` as a tuple; refuse names of neither the pair's geometry nor `constants`."""
    allowed_names = (*(key for key in SYMBOLIC_CONSTANTS if hasattr(pair, key)), *constants)
    expected = f"names out of {', '.join(allowed_names)}"
    if isinstance(symbolic, str) or not isinstance(symbolic, Iterable):
        raise ArgumentError("symbolic", f"a tuple of {expected}", quoted(symbolic))
    names = tuple(symbolic)
    for name in names:
        if name not in allowed_names:
            raise ArgumentError("symbolic", expected, quoted(name))
    return names


def _exact_pair_values(tables: Table, symbolic_constants: tuple[str, ...]) -> dict[str, tuple[Expr, ...]]:
    """Return u1, u2 and points as [pair] writes them."""
    table, found = tables.table("pair"), {}
    points = [table.table(key, required=False) for key in ("points1", "points2")]
    for part, names in ((table, ("u1", "u2")), *((part, tuple(part.values)) for part in points)):
        for name in names:
            written = part.expressions(name, len(part.values[name]), symbolic_constants=symbolic_constants)
            found[name if part is table else point_key(name)] = tuple(to_sympy(name, x) for x in written)
    return found
