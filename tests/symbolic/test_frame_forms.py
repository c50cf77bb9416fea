"""Closed forms of a robot's frame: what is written out is what the robot computes, in the form that papers have."""

from __future__ import annotations

import json

import numpy as np
import pinocchio as pin
import pytest
import sympy

import hingepair as hp
from hingepair.formats.robots import robot_urdf
from hingepair.mechanism.mechanism import tree_of
from hingepair.symbolic.exact_constants import exact_angle, exact_entry

U = 2.0**-53
SNAP = 1e-6


def oblique_robot(seed):
    """Hinges and sliders in series with oblique axes, some parallel to the one before, and a tool."""
    rng = np.random.default_rng(seed)
    pairs = []
    n, home = rng.standard_normal(3), np.eye(3)
    for k in range(6):
        if rng.random() < 0.4:
            n = home.T @ n * rng.choice((-1, 1))  # parallel to the joint before
            home = hp.rodrigues(n, rng.choice((0.0, 0.3, np.pi / 2)))  # about its own axis
        else:
            n, home = rng.standard_normal(3), hp.rodrigues(rng.standard_normal(3), rng.uniform(-3, 3))
        kind = hp.Slider if rng.random() < 0.3 else hp.HingePair
        u1, u2 = rng.uniform(-1, 1, (2, 3))
        pairs.append(kind(u1=u1, u2=u2 * (k % 2), n=n, home=home, name=f"joint{k}"))
    turn = hp.rodrigues(rng.standard_normal(3), 0.5)
    return hp.Mechanism(pairs, name="oblique").with_frame("tool", "joint5", R=rng.uniform(-1, 1, 3), S=turn)


MIMIC = """<robot name="follower"><link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="e"/>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
<limit effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.5 0 0" rpy="0.2 0 0"/>
<axis xyz="0 1 0"/><mimic joint="j1" multiplier="-2" offset="0.25"/><limit effort="1" velocity="1"/></joint>
<joint name="j3" type="prismatic"><parent link="c"/><child link="d"/><origin xyz="0 0.3 0"/><axis xyz="0 0 1"/>
<mimic joint="j1" multiplier="0.1"/><limit effort="1" velocity="1"/></joint>
<joint name="j4" type="continuous"><parent link="d"/><child link="e"/><origin xyz="0 0 .2" rpy="0 0 0.7"/>
<axis xyz="0 0 -1"/></joint></robot>"""

ROBOTS = {
    "ur5": lambda: (hp.load_robot("ur5_robot", snap=SNAP), "tool0"),
    "ur5 as written": lambda: (hp.load_robot("ur5_robot"), "tool0"),
    "ur5, a joint locked": lambda: (hp.load_robot("ur5_robot", locked={"elbow_joint": 0.3}), "ee_link"),
    "panda": lambda: (hp.load_robot("panda"), "panda_hand_tcp"),
    "panda's finger": lambda: (hp.load_robot("panda"), "panda_leftfinger"),
    "solo12": lambda: (hp.load_robot("solo12"), "FL_FOOT"),
    "kinova": lambda: (hp.load_robot("kinova", snap=SNAP), "j2s6s200_end_effector"),
    "the base": lambda: (hp.load_robot("ur5_robot"), "base"),
    "followers": lambda: (hp.Mechanism.from_urdf(MIMIC), "e"),
    "Pinocchio's numbers": lambda: (
        hp.Mechanism.from_pinocchio(pin.buildModelFromUrdf(str(robot_urdf("ur5_robot")))),
        "tool0",
    ),
    **{f"oblique {seed}": lambda seed=seed: (oblique_robot(seed), "tool") for seed in (0, 1, 3)},
}


def functions(forms, **how):
    """The functions of the generated module."""
    module: dict = {}
    exec(compile(forms.to_python(**how), "generated", "exec"), module)
    return module


def states(robot, count=40, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (2, count, robot.dof))


def reach(robot):
    return 1 + sum(np.abs(joint.u).sum() + 3 * (joint.kind == "slider") for joint in tree_of(robot).joints)


@pytest.mark.slow
@pytest.mark.parametrize("which", ROBOTS)
def test_the_generated_module_computes_what_the_robot_computes(which):
    robot, frame = ROBOTS[which]()
    module = functions(hp.derive(robot, frame=frame))
    q, qd = states(robot)
    state = robot.forward_kinematics(q, qd, frames=(frame,))[frame]
    size, rate = reach(robot), 3 * len(tree_of(robot).joints)
    for values, expected, scale in (
        (module["R"](q), state.R, size),
        (module["S"](q), state.S, 1),
        (module["jacobian"](q), robot.jacobian(q, frame), size),
        (module["v"](q, qd), state.v, size * rate),
        (module["omega"](q, qd), state.omega, rate),
    ):
        assert values.shape == expected.shape
        assert np.abs(values - expected).max() <= 64 * U * scale


@pytest.mark.slow
def test_the_generated_module_agrees_with_pinocchio():
    robot = hp.load_robot("ur5_robot", snap=0.0)
    module = functions(hp.derive(robot, frame="tool0"))
    model = pin.buildModelFromUrdf(str(robot_urdf("ur5_robot")))
    data, frame = model.createData(), model.getFrameId("tool0")
    q, qd = states(robot)
    for one, rates in zip(q, qd, strict=True):
        pin.forwardKinematics(model, data, one, rates)
        pose = pin.updateFramePlacement(model, data, frame)
        velocity = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        J = pin.computeFrameJacobian(model, data, one, frame, pin.LOCAL_WORLD_ALIGNED)
        for values, expected in (
            (module["R"](one), pose.translation),
            (module["S"](one), pose.rotation),
            (module["jacobian"](one), J),
            (module["v"](one, rates), velocity.linear),
            (module["omega"](one, rates), velocity.angular),
        ):
            np.testing.assert_allclose(values, expected, rtol=0, atol=1e-14)


@pytest.mark.slow
def test_arguments_of_the_generated_module_broadcast():
    module = functions(hp.derive(hp.load_robot("ur5_robot"), frame="tool0"))
    assert module["S"](np.zeros((2, 5, 6))).shape == (2, 5, 3, 3)
    assert module["jacobian"]([0, 0, 0, 0, 0, 0]).shape == (6, 6)
    assert module["v"](np.zeros((4, 1, 6)), np.zeros((3, 6))).shape == (4, 3, 3)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["solo12", "followers"])
def test_the_jacobian_is_the_derivative_of_position_and_attitude(which):
    """In thirty digits, with SymPy's own derivatives."""
    robot, frame = ROBOTS[which]()
    forms = hp.derive(robot, frame=frame)
    q, _ = states(robot, 1)
    at = {letter: sympy.Rational(float(value)) for letter, value in zip(forms.q, q[0], strict=True)}
    rates = sympy.Matrix(forms.R).jacobian(forms.q)
    assert abs(np.array((rates - forms.jacobian[:3, :]).subs(at).evalf(30), float)).max() < 1e-14
    for column, letter in enumerate(forms.q):
        W = (forms.S.diff(letter) * forms.S.T).subs(at).evalf(30)
        spin = sympy.Matrix([W[2, 1], W[0, 2], W[1, 0]]) - forms.jacobian[3:, column].subs(at).evalf(30)
        assert abs(np.array(spin, float)).max() < 1e-14
    motion = sympy.Matrix(forms.jacobian) * sympy.Matrix(forms.qd)
    both = sympy.Matrix.vstack(sympy.Matrix(forms.v), sympy.Matrix(forms.omega))
    at |= {letter: sympy.Rational(k, 7) for k, letter in enumerate(forms.qd)}
    assert abs(np.array((both - motion).subs(at).evalf(30), float)).max() < 1e-14


def test_a_leg_has_its_textbook_jacobian_and_says_what_does_not_move_it():
    text = hp.derive(hp.load_robot("solo12"), frame="FR_FOOT").to_text(["jacobian"])
    assert "q_4 FR_HAA; q_5 FR_HFE; q_6 FR_KFE; the other joints do not move the frame" in text
    assert text.splitlines()[-4:] == [
        "Jω_x4 = 1",
        "Jω_y5 = Jω_y6 = c_4",
        "Jω_z5 = Jω_z6 = s_4",
        "Jv_x4 = Jω_x5 = Jω_x6 = Jω_y4 = Jω_z4 = 0",
    ]
    assert "Jv_x6 = -0.16 c_56\n" in text


@pytest.mark.slow
def test_points_stay_letters_where_asked():
    robot = hp.load_robot("ur5_robot", snap=SNAP)
    forms = hp.derive(robot, ("u",), "tool0")
    assert [letter.name for letter in forms.numbers] == [
        "u_1z",
        "u_2y",
        "u_3y",
        "u_3z",
        "u_4z",
        "u_5y",
        "u_6z",
        "p_y",
    ]
    assert "u_1z = 0.089159; u_2y = 0.13585; u_3y = -0.1197;" in forms.to_text(["R"])
    assert "R_z = u_1z - k_2 s_234 - s_2 u_3z - s_23 u_4z - c_234 u_6z\n" in forms.to_text(["R"])
    module = functions(forms)
    q, qd = states(robot)
    longer = robot.with_frame("longer", "tool0", R=(0, 0, 0.1))
    expected = longer.forward_kinematics(q, qd, frames=("longer",))["longer"]
    np.testing.assert_allclose(module["R"](q, p_y=0.1823), expected.R, rtol=0, atol=1e-15)
    np.testing.assert_allclose(module["v"](q, qd, p_y=0.1823), expected.v, rtol=0, atol=1e-14)
    np.testing.assert_allclose(module["R"](q), robot.forward_kinematics(q, frames="tool0")["tool0"].R, atol=1e-15)


@pytest.mark.parametrize("which", ["solo12", "the base", pytest.param("followers", marks=pytest.mark.slow(3))])
def test_every_line_of_latex_can_be_set(which):
    mathtext = pytest.importorskip("matplotlib.mathtext")
    robot, frame = ROBOTS[which]()
    text = hp.derive(robot, ("u",), frame).to_latex()
    body = text.partition("amsmath}\n")[2].removesuffix("\n\\end{align*}\n")
    assert "&=" in body
    parser = mathtext.MathTextParser("path")
    for line in body.split("\\\\\n"):
        parser.parse(f"${line.strip().replace('&', '')}$")


@pytest.mark.slow
def test_sympy_reads_the_components_back():
    forms = hp.derive(hp.load_robot("ur5_robot", snap=SNAP), frame="tool0")
    source = json.loads(json.dumps(forms.to_sympy(["R", "jacobian"])))
    assert len(source) == 3 + 36
    plain = {letter: sympy.Symbol(letter.name) for letter in forms.q}
    assert sympy.expand(sympy.sympify(source["R_x"]) - forms.R[0].subs(plain)) == 0
    assert sympy.expand(sympy.sympify(source["Jomega_y6"]) - forms.jacobian[4, 5].subs(plain)) == 0


def test_what_rounding_left_is_taken_for_zero_and_said():
    pair = hp.HingePair(u1=(1, 1e-17, 0), u2=(0, 0, 0), n=(0, 0, 1), name="a")
    forms = hp.derive(hp.Mechanism([pair]))
    assert list(forms.R) == [1, 0, 0]
    note = "lengths of at most 1e-17 m, which rounding left, are taken for 0"
    for text in (forms.to_text(), forms.to_latex(), forms.to_python()):
        assert note in text
    small = hp.HingePair(u1=(1, 1e-14, 0), u2=(0, 0, 0), n=(0, 0, 1), name="a")
    assert hp.derive(hp.Mechanism([small])).R[1] == sympy.Rational(1, 10**14)


def test_entries_and_angles_are_recognised_within_rounding_only():
    assert exact_entry(0.7071067811865476) == sympy.sqrt(2) / 2
    assert exact_entry(-6.1e-17) == 0
    assert exact_entry(1 - 2**-53) == 1
    assert exact_entry(4.9e-12) == sympy.Rational(49, 10**13)
    assert exact_entry(0.7071067811) == sympy.Rational(7071067811, 10**10)
    assert exact_angle(-np.pi / 4) == -sympy.pi / 4
    assert exact_angle(0.1 + 0.2) == sympy.Rational(3, 10)
    assert exact_angle(1.57079632679) == sympy.Rational(157079632679, 10**11)


def test_a_frame_on_the_base_does_not_move():
    forms = hp.derive(hp.load_robot("ur5_robot"), frame="world")
    assert forms.to_text().splitlines()[0] == "frame world of ur5: no joint moves the frame"
    assert forms.jacobian == sympy.zeros(6, 6)
    assert forms.v == sympy.zeros(3, 1)


def test_names_are_text_and_never_code():
    name = 'a"""\nraise SystemExit\\\n"""'
    pair = hp.HingePair(u1=(1, 0, 0), u2=(0, 0, 0), n=(0, 0, 1), name=name)
    forms = hp.derive(hp.Mechanism([pair], name=name))
    assert functions(forms)["R"]([0.0]).tolist() == [1, 0, 0]
    assert forms.to_latex().splitlines()[1] == "\\begin{align*}  % \\usepackage{amsmath}"
    assert len(forms.to_text(["R"]).splitlines()) == 3
