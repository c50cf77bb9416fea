"""What may come in and what goes out: any leading shape, layout and type; batch and single state alike."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.states import coordinates, generator, pair

pytestmark = pytest.mark.usefixtures("each_backend")

U = 2.0**-53


def test_coordinates_broadcast():
    """Scalars, rows and columns among the seven, and a single q against many qd."""
    rng = generator(40)
    one, (q, qd, _) = hp.HingePair(*pair(rng)), coordinates(rng, 24)
    u, v = q[:4, 5], q[:3, 6]
    mixed = (0.5, 1, 0.0, 0.25, np.array(0.1), u[:, None], v)
    found = one.forward_kinematics(mixed, (0.0,) * 7, outputs=("R2", "S1", "omega2"))
    assert (found.R2.shape, found.S1.shape, found.omega2.shape) == ((4, 3, 3), (4, 3, 3, 3), (4, 3, 3))
    packed = np.stack(np.broadcast_arrays(*(np.asarray(x, float) for x in mixed)), axis=-1)
    assert abs(found.R2 - one.forward_kinematics(packed).R2).max() <= 32 * U
    assert one.forward_kinematics(q[0], qd).v2.shape == (24, 3)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_out_lies_over_no_input_and_no_other_output(backend):
    """At the first call, and where arrays of the same kind came before."""
    pair, names = hp.HingePair(u1=(1, 2, 3), u2=(3, 2, 1), n=(1, 2, 3)), ("R2", "v2")
    room, own = np.zeros(100), np.zeros((10, 3))
    q, qd = room[:70].reshape(10, 7), np.ones((10, 7))
    apart = {"R2": room[70:].reshape(10, 3), "v2": own}
    for _ in range(3):
        for bad in ({"R2": room[69:99].reshape(10, 3)}, {"R2": own, "v2": own}, {"R2": own[:], "v2": own}):
            with pytest.raises(hp.ArgumentError, match="memory of its own"):
                pair.forward_kinematics(q, qd, outputs=names, out=apart | bad, backend=backend)
        pair.forward_kinematics(q, qd, outputs=names, out=apart, backend=backend)
