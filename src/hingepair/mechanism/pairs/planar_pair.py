"""The planar pair: two bodies in a plane joined by a pin (a hinge) (E11)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import execution_of
from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.bodies.body_motion import motion_of_rotations
from hingepair.mechanism.options import OUT_OPTIONS, Options, with_options
from hingepair.mechanism.pairs.geometry import Points, checked_record, lifted
from hingepair.mechanism.pairs.hinge_pair import HingePair, pair_sheet
from hingepair.mechanism.pairs.subject import PairSubject, read_rows
from hingepair.mechanism.requests import MOTION_LEVELS, ROWS, ask, coordinate_rows
from hingepair.mechanism.states import PlanarState
from hingepair.numeric.arrays import Frozen, broadcast_shape, call_text, constant, set_frozen
from hingepair.plans.arguments import Coordinates, Outputs
from hingepair.plans.pairs import PLANE
from hingepair.plans.prepared import Prepared
from hingepair.rotations.matrices import rotation_exp
from hingepair.tables.sheets import Sheet, Shown

PLANAR_GRAVITY = (0.0, -9.81)  # m/s^2; y points up


@dataclass(frozen=True, slots=True, eq=False, init=False)
class PlanarPair(Frozen, Shown):
    """Two bodies in a plane joined by a hinge, R1 + S1 u1 = R2 + S2 u2 and phi2 = phi + psi (E11): a HingePair with n
    = (0, 0, 1) in the xy plane.

    phi and phi2 are the angles of the bodies, S1 and S2 their rotation matrices (2, 2). Values are copied and
    read-only; `dataclasses.replace(pair, u1=...)` returns a pair with another u1. u1 and u2 may have leading axes,
    which broadcast against those of the samples.

    The methods share these arguments; out, workers and backend are those of `HingePair`:

    - q, qd, qdd: coordinates (x, y, phi, psi), that is, the position of body 1's reference point [m], its angle and
      the hinge angle [rad], and their first and second time derivatives. Each is one array (..., 4), a tuple of four
      numbers or arrays that broadcast, a dict by name, or a table with these columns.
    - outputs: names out of R2, phi2, d, v2, omega2, a2, alpha2, and of points, such as tip, tip_v and tip_a. By
      default, all but those of points for which the coordinates suffice.

    Args:
        u1: hinge point from body 1's reference point, body-1 axes [m]; shape (2,) or (..., 2).
        u2: hinge point from body 2's reference point, body-2 axes [m]; shape (2,) or (..., 2).
        name: name of the pair in exports and messages.
        body1: mass properties and shapes of body 1, a `Body` in space, for `to_spatial` and scenes.
        body2: mass properties and shapes of body 2.
        points1: further points of body 1 by name, from its reference point, body-1 axes [m]; shape (2,) or (..., 2)
            each; as for a `HingePair`.
        points2: further points of body 2, body-2 axes.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.PlanarPair(u1=(1, 0), u2=(-1, 0))
    >>> pair.forward_kinematics((0, 0, 0, np.pi / 2)).R2.round(12) + 0.0
    array([1., 1.])
    """

    u1: NDArray[np.float64]
    u2: NDArray[np.float64]
    name: str
    body1: Body | None
    body2: Body | None
    points1: Points
    points2: Points
    _subject: PairSubject = field(init=False)

    def __init__(
        self,
        u1: ArrayLike,
        u2: ArrayLike,
        name: str = "planar_pair",
        body1: Body | None = None,
        body2: Body | None = None,
        points1: Mapping[str, ArrayLike] | None = None,
        points2: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        record = checked_record(2, name, body1, body2, points1, points2)
        arrays = {"u1": constant("u1", u1, 2), "u2": constant("u2", u2, 2)}
        points = record["points1"], record["points2"]
        subject = PairSubject(name, PLANE, arrays, None, points, (body1, body2))
        set_frozen(self, **arrays, **record, _subject=subject)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (
            *(self.u1, self.u2, self.name, self.body1, self.body2),
            *(dict(self.points1), dict(self.points2)),
        )

    def __repr__(self) -> str:
        return call_text(self, "u1", "u2", "name", "body1", "body2", "points1", "points2")

    def _sheet(self) -> Sheet:
        """Return the printed table: u1, u2 and the masses."""
        return pair_sheet(self, ("u1", "u2"))

    @with_options("outputs", *OUT_OPTIONS)
    def forward_kinematics(
        self,
        q: Coordinates,
        qd: Coordinates | None = None,
        qdd: Coordinates | None = None,
        **options: Unpack[Options],
    ) -> PlanarState:
        """Compute the motion of body 2 from the four coordinates (E11); qd adds velocities, qdd accelerations.

        Arguments: see `PlanarPair`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.PlanarPair(u1=(1, 0), u2=(-1, 0))
        >>> state = pair.forward_kinematics(np.zeros((5, 4)), np.ones((5, 4)))
        >>> state.v2[0], state.omega2[0]
        (array([1., 4.]), np.float64(2.0))
        """
        given = coordinate_rows(q, qd, qdd)
        return ask(self._subject, MOTION_LEVELS[len(given) - 1], given, options)

    def prepare(
        self,
        given: str | Iterable[str],
        *,
        outputs: Iterable[str] | None = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> Prepared:
        """Return a function of arrays that computes given outputs, planned and compiled once, as `HingePair.prepare`
        does. Arguments not listed: see `PlanarPair`.

        Args:
            given: names of the arguments, out of q, qd and qdd; or a word: "pose", "velocity", "acceleration".
            outputs: names of the outputs of `forward_kinematics`.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> f = hp.PlanarPair(u1=(1, 0), u2=(-1, 0)).prepare("pose", outputs=("R2", "phi2"))
        >>> f(np.array([0, 0, 0, np.pi])).phi2
        np.float64(3.141592653589793)
        >>> (f.jacobian((np.zeros(4),))["R2"]["q"] + 0.0).tolist()
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 2.0, 1.0]]
        """
        return self._subject.prepare(self.prepare, given, outputs, execution_of(backend, workers))

    def error_bounds(
        self, q: Coordinates, qd: Coordinates | None = None, qdd: Coordinates | None = None, outputs: Outputs = None
    ) -> dict[str, NDArray[np.float64]]:
        """Compute rigorous bounds on the rounding errors of `forward_kinematics` at every sample, as
        `HingePair.error_bounds` does.

        >>> import hingepair as hp
        >>> pair = hp.PlanarPair(u1=(1, 0), u2=(-1, 0))
        >>> bool(pair.error_bounds((0, 0, 0.5, 0.25))["R2"] < 1e-15)
        True
        """
        given = dict(zip(ROWS, coordinate_rows(q, qd, qdd), strict=False))
        return self._subject.error_bounds(given, outputs)

    def to_spatial(self) -> HingePair:
        """Return this pair as a HingePair with n = (0, 0, 1), and the same mass properties.

        (x, y, phi, psi) are (x, y, 0, 0, 0, phi, psi) there. It has the dynamics; gravity along -y is gravity=(0,
        -9.81, 0).

        >>> import hingepair as hp
        >>> hp.PlanarPair(u1=(1, 0), u2=(-1, 0)).to_spatial().n
        array([0., 0., 1.])
        """
        return self._in_space(self.body1, self.body2)

    def _in_space(self, body1: Body | None, body2: Body | None) -> HingePair:
        """Return the HingePair with n = (0, 0, 1), the levers of this pair and these mass properties."""
        points1, points2 = (
            {name: lifted(position) for name, position in points.items()} for points in (self.points1, self.points2)
        )
        return HingePair(
            lifted(self.u1), lifted(self.u2), (0, 0, 1), name=self.name, body1=body1, body2=body2,
            points1=points1, points2=points2,
        )  # fmt: skip


def dynamics_in_space(pair: HingePair | PlanarPair) -> HingePair:
    """Return the HingePair with the dynamics of a pair: a HingePair itself, or one that a PlanarPair is.

    Its centres of mass are at z = 0, and the principal moments of a body are all its moment about the z axis. So the
    hinge transmits no torque about axes in the plane, as products of inertia in the pair of `to_spatial` can cause.

    >>> import hingepair as hp
    >>> pair = hp.PlanarPair((1, 0), (-1, 0), body2=hp.Body(2, (0, 0, 1), inertia=(1, 2, 3)))
    >>> dynamics_in_space(pair).body2
    Body(mass=2.0, centre_of_mass=[0.0, 0.0, 0.0], inertia=[[3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]])
    """
    if isinstance(pair, HingePair):
        return pair
    return pair._in_space(*(None if body is None else _body_in_plane(body) for body in (pair.body1, pair.body2)))


def _body_in_plane(body: Body) -> Body:
    """Return a Body with its centre of mass at z = 0 and three principal moments, all that about z."""
    x, y, _ = body.centre_of_mass
    level = np.eye(3) * body.inertia[2, 2]
    inertia = (
        body.inertia if np.array_equal(body.inertia, level) else level
    )  # the object, so that an assumed inertia stays assumed
    return replace(body, centre_of_mass=np.array((x, y, 0.0)), inertia=inertia)


def motion_in_space(q: Coordinates, qd: Coordinates | None = None, qdd: Coordinates | None = None) -> tuple[Any, ...]:
    """Return planar coordinates as the motion (body1, psi, psid, psidd) in space; the rates as far as given."""
    coordinates = read_rows(PLANE, q, qd, qdd)
    shape = broadcast_shape(coordinates.shapes)
    zero = np.zeros(shape)
    arrays: dict[str, NDArray[Any]] = {}
    hinge = []
    for part, linear, angular in zip(coordinates.values.values(), "Rva", ("S", "omega", "alpha"), strict=False):
        columns = np.moveaxis(part, -1, 0) if isinstance(part, np.ndarray) else part
        x, y, phi, psi = (np.broadcast_to(c, shape) for c in columns)
        arrays |= {linear: np.stack([x, y, zero], axis=-1), angular: np.stack([zero, zero, phi], axis=-1)}
        hinge.append(psi)
    S = rotation_exp(arrays.pop("S"))
    return motion_of_rotations(S=S, **arrays), *hinge
