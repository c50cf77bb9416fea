"""Arrays of other libraries: those of JAX and of the strict array API go through and come back as they are."""

from __future__ import annotations

import subprocess
import sys

import array_api_strict as strict
import numpy as np
import pytest

import hingepair as hp
from support import states

OUTPUTS = ("R2", "S2", "d", "v2", "omega2", "a2", "alpha2", "R1", "S1", "v1", "omega1", "a1", "alpha1")
SCALE = {"a2": 400.0, "alpha2": 60.0}


@pytest.fixture(params=["strict", pytest.param("jax", marks=pytest.mark.slow)])
def library(request):
    """A module of arrays, and their type."""
    if request.param == "strict":
        yield strict, type(strict.asarray(0.0))
    else:
        yield request.getfixturevalue("jnp"), request.getfixturevalue("jax").Array


@pytest.fixture
def jax():
    """JAX, computing in float64."""
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        yield jax


@pytest.fixture
def jnp(jax):
    return jax.numpy


def some(key, count=6, home=True):
    rng = states.generator(97, key)
    u1, u2, n, C = states.pair(rng, home=home)
    return hp.HingePair(u1=u1, u2=u2, n=n, home=C), states.coordinates(rng, count)


def body1_of(library, key, count=6):
    names = ("R", "S", "v", "omega", "a", "alpha")
    arrays = dict(zip(names, states.body1(states.generator(98, key), count), strict=True))
    return hp.BodyMotion(**{name: library.asarray(array) for name, array in arrays.items()})


def require(state, expected, kind, ulps=64):
    """The same numbers as NumPy's, as arrays of the library."""
    assert state.shape == expected.shape
    assert set(state.outputs) == set(expected.outputs)
    for name in expected.outputs:
        got, want = getattr(state, name), getattr(expected, name)
        assert isinstance(got, kind), name
        assert tuple(got.shape) == want.shape, name
        unit = np.finfo(want.dtype).eps
        assert np.all(abs(np.asarray(got) - want) <= ulps * unit * (20 + abs(want).max())), name


@pytest.mark.slow
@pytest.mark.parametrize("sequence", ["XYZ", "zxz"])
def test_coordinates_in_one_array(library, sequence):
    module, kind = library
    pair, motion = some(0)
    state = pair.forward_kinematics(*map(module.asarray, motion), outputs=OUTPUTS, sequence=sequence)
    require(state, pair.forward_kinematics(*motion, outputs=OUTPUTS, sequence=sequence), kind)
    one = pair.forward_kinematics(module.asarray(motion[0][0]))
    require(one, pair.forward_kinematics(motion[0][0]), kind)


def test_seven_coordinates_with_numbers_among_them(library):
    """What is a number stays one: outputs that do not depend on an array are arrays all the same."""
    module, kind = library
    pair, (motion, *_) = some(1, home=False)
    q = (0.5, 1, 0, *motion[:, 3:5].T, 0, motion[:, 6])
    qd = (0.0, 0.0, 1.0, 0.0, motion[:, 1], 0.0, 2.0)
    foreign = [
        tuple(module.asarray(np.array(c)) if isinstance(c, np.ndarray) else c for c in part) for part in (q, qd)
    ]
    outputs = ("R1", "v1", "v2", "S2", "omega1")
    require(pair.forward_kinematics(*foreign, outputs=outputs), pair.forward_kinematics(q, qd, outputs=outputs), kind)
    still = (0,) * 6
    state = pair.forward_kinematics((*still, module.asarray(motion[:, 6])), outputs=("S1", "R2"))
    require(state, pair.forward_kinematics((*still, motion[:, 6]), outputs=("S1", "R2")), kind)


@pytest.mark.slow
def test_a_given_motion_of_body_1(library):
    module, kind = library
    pair, _ = some(2)
    hinge = states.generator(99).normal(size=(3, 6))
    state = pair.forward_kinematics_from_body1(body1_of(module, 2), *map(module.asarray, hinge))
    require(state, pair.forward_kinematics_from_body1(body1_of(np, 2), *hinge), kind)
    turned = pair.forward_kinematics_from_body1(body1_of(module, 2), 0.5, outputs=("R2", "S2"))
    require(turned, pair.forward_kinematics_from_body1(body1_of(np, 2), 0.5, outputs=("R2", "S2")), kind)


def test_dynamics_of_planar_pairs(library):
    xp, array = library
    rod = hp.Body(2, inertia=(1, 1, 1))
    flat = hp.PlanarPair((0.5, 0.1), (-0.3, 0.2), body1=rod, body2=rod)
    rows = np.random.default_rng(0).normal(size=(3, 4, 4))
    q, qd, qdd = map(xp.asarray, rows)
    found, expected = flat.inverse_dynamics(q, qd, qdd), flat.inverse_dynamics(*rows)
    for name in ("force1", "torque1", "hinge_torque"):
        assert isinstance(getattr(found, name), array)
        assert np.allclose(np.asarray(getattr(found, name)), getattr(expected, name), rtol=1e-12)
    assert isinstance(flat.forward_dynamics(q, qd, force1=xp.ones((4, 2))), array)


def test_planar_pairs_and_pairs_of_their_own(library):
    module, kind = library
    rng = states.generator(100)
    q, qd, qdd = rng.normal(size=(3, 6, 4))
    flat = hp.PlanarPair(u1=(0.5, 0.1), u2=(-0.3, 0.2))
    require(flat.forward_kinematics(*map(module.asarray, (q, qd, qdd))), flat.forward_kinematics(q, qd, qdd), kind)
    pairs = hp.HingePair(u1=rng.normal(size=(6, 3)), u2=rng.normal(size=3), n=rng.normal(size=(6, 3)))
    q = rng.normal(size=(1, 7))
    require(pairs.forward_kinematics(module.asarray(q)), pairs.forward_kinematics(q), kind)


def test_float32_stays_float32(library):
    module, kind = library
    pair, motion = some(3, home=False)
    motion = [c.astype(np.float32) for c in motion[:1]]
    state = pair.forward_kinematics(*map(module.asarray, motion))
    assert state.R2.dtype == module.float32
    require(state, pair.forward_kinematics(*motion), kind)


def test_prepared_calls(library):
    """Coordinates, and the quaternion of body 1 with what is beyond kinematics."""
    module, kind = library
    pair, (q, qd, _) = some(11)
    fk = pair.prepare("velocity", outputs=("R2", "omega2"))
    require(fk(*map(module.asarray, (q, qd))), fk(q, qd), kind)
    require(fk(*map(module.asarray, (q[0], qd[0]))), fk(q[0], qd[0]), kind)
    half = pair.prepare(("S1", "psi"), outputs=("S2",))
    assert np.allclose(np.asarray(half(module.eye(3), 1).S2), half(np.eye(3), 1).S2, rtol=0, atol=1e-15)
    quat, psi = states.generator(102).normal(size=(6, 4)), q[:, 6]
    at = pair.prepare(("quat_xyzw", "psi"), outputs=("S2", "jacobian"))
    found, expected = at(module.asarray(quat), module.asarray(psi)), at(quat, psi)
    for name in ("S2", "jacobian"):
        assert isinstance(found[name], kind)
        assert np.allclose(np.asarray(found[name]), expected[name], rtol=0, atol=1e-13)
    beside = at(module.asarray(quat), psi).S2  # constants may be NumPy's
    assert isinstance(beside, kind)
    assert np.allclose(np.asarray(beside), expected.S2, rtol=0, atol=1e-13)
    with pytest.raises(hp.ArgumentError, match="psi"):
        at(module.asarray(quat), psi.tolist())
    with pytest.raises(hp.ArgumentError, match="out"):
        fk(module.asarray(q), module.asarray(qd), out={"R2": np.empty((6, 3))})


# ---- JAX's own ways


@pytest.mark.slow
def test_jit_and_vmap(jax, jnp):
    pair, (q, qd, _) = some(4)
    q, qd = jnp.asarray(q), jnp.asarray(qd)
    expected = pair.forward_kinematics(np.asarray(q), np.asarray(qd))
    require(jax.jit(pair.forward_kinematics)(q, qd), expected, jax.Array)
    mapped = jax.vmap(lambda q, qd: pair.forward_kinematics(q, qd).v2)(q, qd)
    assert np.allclose(mapped, expected.v2, rtol=0, atol=1e-12)
    require(jax.vmap(pair.forward_kinematics)(q, qd), expected, jax.Array)
    body1 = body1_of(jnp, 4)
    found = jax.jit(lambda S, psi: pair.forward_kinematics_from_body1(hp.BodyMotion(R=body1.R, S=S), psi).R2)
    again = pair.forward_kinematics_from_body1(hp.BodyMotion(R=np.asarray(body1.R), S=np.asarray(body1.S)), 0.3)
    assert np.allclose(found(body1.S, 0.3), again.R2, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_derivatives_are_the_jacobians(jax):
    """Of the position by the coordinates, of omega2 by their rates, and along the motion: the velocity."""
    pair, (q, qd, _) = some(5)

    def by_motion(q, qd):
        by_q, by_rate = (
            jax.jacfwd(lambda c: pair.forward_kinematics(c).R2),
            jax.jacrev(lambda c: pair.forward_kinematics(q, c, outputs=("omega2",)).omega2),
        )
        return by_q(q), by_rate(qd), by_q(q) @ qd

    R2_by_q, omega2_by_qd, v2 = jax.jit(jax.vmap(by_motion))(q, qd)
    slopes = pair.prepare("velocity", outputs=("R2", "omega2")).jacobian((q, qd))
    assert np.allclose(R2_by_q, slopes["R2"]["q"], rtol=0, atol=1e-11)
    assert np.allclose(omega2_by_qd, slopes["omega2"]["qd"], rtol=0, atol=1e-11)
    assert np.allclose(v2, pair.forward_kinematics(q, qd).v2, rtol=0, atol=1e-11)


@pytest.mark.slow
def test_derivatives_exist_at_every_angle(jax):
    """1 - cos psi has no branch whose other side is not a number."""
    pair = hp.HingePair(u1=(1, 0, 0), u2=(0.3, -1, 0), n=(0, 0, 1))
    still = (0.0,) * 6
    psi = np.array([0.0, 1e-160, np.pi / 2, np.pi, -np.pi])
    slope = jax.jit(jax.vmap(jax.grad(lambda x: pair.forward_kinematics((*still, x)).S2[0, 0])))(psi)
    assert np.allclose(slope, -np.sin(psi), rtol=0, atol=1e-15)
    curved = jax.jit(jax.vmap(jax.hessian(lambda x: pair.forward_kinematics((*still, x)).R2)))(psi)
    assert np.isfinite(curved).all()


@pytest.mark.slow
def test_jacobians_are_arrays_of_the_library(library):
    pair, (q, _, _) = some(10)
    body1, own = body1_of(library[0], 10), body1_of(np, 10)
    for ask in (
        lambda convert, body: pair.jacobian(body, convert(q[:, 6])),
        lambda _, body: pair.constraint_jacobian(body, body),
        lambda convert, body: pair.propagate_covariance(body, convert(q[:, 6]), u1_std=0.1, axis_std=0.2).R2_std,
        lambda convert, body: pair.propagate_covariance(
            body, convert(q[:, 6]), u2_std=0.1, axis_std=0.2
        ).contributions()["axis"],
    ):
        found = ask(library[0].asarray, body1)
        assert type(found) is type(body1.S)
        np.testing.assert_allclose(np.asarray(found), ask(np.asarray, own), rtol=0, atol=2e-15)


def test_reports_about_such_arrays_are_in_numpy(library):
    """Residuals and error bounds: those of the same numbers."""
    pair, (q, qd, _) = some(10)
    body1, own = body1_of(library[0], 10), body1_of(np, 10)
    for ask in (
        lambda convert, _: pair.error_bounds(convert(q), convert(qd))["v2"],
        lambda convert, body: pair.error_bounds(body, convert(q[:, 6]))["R2"],
        lambda _, body: pair.residuals(body, own).gap,
    ):
        found = ask(library[0].asarray, body1)
        assert isinstance(found, np.ndarray)
        assert np.array_equal(found, ask(np.asarray, own))


# ---- what is refused


@pytest.mark.slow
def test_kinds_are_not_mixed(jnp):
    pair, (q, qd, _) = some(6)
    with pytest.raises(hp.ArgumentError, match="qd: expected an array of jax"):
        pair.forward_kinematics(jnp.asarray(q), strict.asarray(qd))
    with pytest.raises(hp.ArgumentError, match=r"q\[1\]"):
        pair.forward_kinematics((jnp.asarray(q[:, 0]), strict.asarray(q[:, 1]), 0, 0, 0, 0, 0))
    with pytest.raises(hp.ArgumentError, match="psi"):
        pair.forward_kinematics_from_body1(body1_of(jnp, 6), strict.asarray(q[:, 6]))
    with pytest.raises(hp.ArgumentError, match="S: expected an array of jax"):
        hp.BodyMotion(R=jnp.zeros(3), S=strict.eye(3))


def test_a_constant_attitude_is_checked_for_rotations():
    assert hp.BodyMotion(R=strict.zeros(3), S=np.eye(3)).S.shape == (3, 3)
    with pytest.raises(hp.RotationError, match="S"):
        hp.BodyMotion(R=strict.zeros(3), S=2 * np.eye(3))


@pytest.mark.parametrize("dtype", ["int32", "complex64", "bool", pytest.param("float16", marks=pytest.mark.slow)])
def test_other_dtypes_are_refused(library, dtype):
    pair, (module, _) = some(7)[0], library
    if not hasattr(module, dtype):
        pytest.skip("the array API has no such type")
    with pytest.raises(hp.errors.DtypeError, match=f"q: expected float32 or float64, got .*{dtype}"):
        pair.forward_kinematics(module.zeros(7, dtype=getattr(module, dtype)))


def test_shapes_are_checked(library):
    pair, (module, _) = some(8)[0], library
    with pytest.raises(hp.ShapeError, match=r"q: expected shape \(\.\.\., 7\)"):
        pair.forward_kinematics(module.zeros((3, 6)))
    with pytest.raises(hp.ShapeError, match="qd"):
        pair.forward_kinematics(module.zeros((3, 7)), module.zeros((4, 7)))
    with pytest.raises(hp.ShapeError, match="S"):
        hp.BodyMotion(R=module.zeros(3), S=module.zeros((3, 4)))


@pytest.mark.parametrize("options", [{"out": {}}, {"backend": "compiled"}, {"workers": 2}])
def test_options_of_our_own_backends_are_refused(library, options):
    pair, (q, *_) = some(9)
    options = {"out": {"R2": np.empty((6, 3))}} if "out" in options else options
    with pytest.raises(hp.ArgumentError, match=next(iter(options))):
        pair.forward_kinematics(library[0].asarray(q), **options)


@pytest.mark.slow
def test_no_library_is_imported_for_numpy():
    code = (
        "import sys, numpy as np, hingepair as hp;"
        "p = hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1)); p.forward_kinematics(np.zeros((3, 7)));"
        "assert not {'jax', 'torch', 'array_api_compat'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
