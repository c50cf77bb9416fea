"""What URDF and MJCF say of the bodies: masses, shapes and names reach the simulators, and come back."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.rotations.matrices import rotation_exp
from support import states
from support.exported import WRITERS, corner_pair

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*no (mass properties|mass|inertia) (are|is) given:hingepair.DynamicsWarning"
)

U = 2.0**-53


# ---------------------------------------------------------------- mass properties


def random_body(rng):
    turn, (a, b) = rotation_exp(3 * rng.normal(size=3)), rng.uniform(0.1, 1, 2)
    c = rng.uniform(abs(a - b), a + b)
    return hp.Body(10 ** rng.uniform(-2, 2), rng.normal(size=3), turn @ np.diag([a, b, c]) @ turn.T)


def laden_pair(k):
    rng = states.generator(87, k)
    return corner_pair(k, body1=random_body(rng), body2=random_body(rng))


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
@pytest.mark.parametrize("k", range(6))
def test_mujoco_reads_the_mass_properties(k, write):
    import mujoco

    # Of the largest moment: MuJoCo 4 stops turning principal axes when 1e-12 from them, before it was 1e-6.
    eigen = 2.0**-38 if int(mujoco.__version__.partition(".")[0]) >= 4 else 2.0**-20
    pair = laden_pair(k)
    model = mujoco.MjModel.from_xml_string(write(pair))
    for name, body, origin in (("body1", pair.body1, 0), ("body2_at_hinge", pair.body2, pair.u2)):
        read = model.body(name)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, read.iquat)
        turn = turn.reshape(3, 3)
        assert read.mass == body.mass
        assert np.abs(read.ipos - (body.centre_of_mass - origin)).max() <= 16 * U * 4
        inertia = turn @ np.diag(read.inertia) @ turn.T
        assert np.abs(inertia - body.inertia).max() <= eigen * np.abs(body.inertia).max()


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_the_rounded_moments_of_a_flat_body_are_written_as_a_body_has_them(write):
    import mujoco

    plate = hp.Body(mass=0.5, inertia=(0.0417, 0.0416, 0.0834))
    model = mujoco.MjModel.from_xml_string(write(hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1), body2=plate)))
    np.testing.assert_allclose(np.sort(model.body_inertia[2]), (0.0417, 0.0418, 0.0835), rtol=1024 * U)


@pytest.mark.slow
def test_masses_and_limits_are_read_back():
    for k in range(20):
        pair = laden_pair(k)
        back = hp.from_urdf(hp.to_urdf(pair), "hinge", body2_frame="body2")
        for one, two, origin in ((pair.body1, back.body1, 0), (pair.body2, back.body2, pair.u2)):
            assert two.mass == one.mass
            lengths = np.linalg.norm(one.centre_of_mass) + np.linalg.norm(origin)
            assert np.abs(two.centre_of_mass - one.centre_of_mass).max() <= 4 * U * lengths
            assert np.abs(two.inertia - one.inertia).max() <= 4 * U * np.abs(one.inertia).max()


# ---------------------------------------------------------------- shapes


def geoms(text):
    """Type, size, place and direction of everything MuJoCo draws, body by body."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert not (model.geom_contype | model.geom_conaffinity).any()
    return model.geom_type, model.geom_size, data.geom_xpos, data.geom_xmat.reshape(-1, 3, 3)[:, :, 2]


@pytest.mark.parametrize("k", range(4))
def test_shapes_are_read_back(k):
    rng = states.generator(89, k)
    turns = rotation_exp(3 * rng.normal(size=(4, 3)))
    shapes = (
        hp.Box((0.1, 0.2, 0.3), (1, 2, 3), turns[0]),
        hp.Box((0.1, 0.2, 0.3)),
        hp.Sphere(0.5, (0, 1, 0)),
        hp.Cylinder(0.1, 0.4, (-1, 0, 2), turns[1, 2]),
    )
    pair = corner_pair(k, body1=hp.Body(shapes=shapes), body2=hp.Body(shapes=shapes[::-1]))
    back = hp.from_urdf(hp.to_urdf(pair), "hinge", body2_frame="body2")
    for body, expected in ((back.body1, shapes), (back.body2, shapes[::-1])):
        assert len(body.shapes) == len(expected)
        for one, two in zip(body.shapes, expected, strict=True):
            assert type(one) is type(two)
            for name in ("size", "radius", "length"):
                assert np.array_equal(getattr(one, name, 0), getattr(two, name, 0))
            for name in ("center", "axes", "axis"):
                error = np.abs(np.subtract(getattr(one, name, 0), getattr(two, name, 0))).max()
                assert error <= 32 * U * (4 if name == "center" else 1), name
    for one, two in zip(geoms(hp.to_urdf(pair)), geoms(hp.to_mjcf(pair)), strict=True):
        assert np.abs(one - two).max() <= 64 * U * 10
