"""What is printed - values, reports, notes, plans, help - is what `tests/golden` holds.

`pytest tests/test_golden.py --renew-golden` writes the files again; what has changed is read in the diff. Numbers
keep two digits, and widths of columns do not count, so that nothing hangs on last bits; what is next to zero is 0.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.commands import run_command
from support.recorded import recording

GOLDEN = Path(__file__).parent / "golden"
MODELS = Path(__file__).parents[1] / "models"
PUBLIC = ("HingePair", "PlanarPair", "Body", "Box", "Cylinder", "Sphere", "Slider", "Screw", "HingeLoad", "Feedback")
COMMANDS = (
    *("run", "forces", "derive", "tolerance", "sweep", "search", "fit", "masses", "plot", "view", "examples"),
    *("robots", "urdf", "mjcf", "check", "bench"),
)

BODY = hp.Body(1.5, (-0.15, 0.1, 0.2), (0.2, 0.3, 0.25), shapes=[hp.Box((0.4, 0.1, 0.1)), hp.Sphere(0.1, (0, 0, 1))])
PAIR = hp.HingePair(
    (0.5, 0.2, 0.1), (-0.25, 0.1, 0.3), (1, 0, 0), name="knee", limits=(-1, 2), body1=BODY, body2=BODY
)
FLAT = hp.PlanarPair((1, 0), (0, 1), name="legs")
Q = np.linspace(-0.5, 0.7, 7)
MANY = Q + np.linspace(0, 1, 12).reshape(4, 3, 1)
STILL = hp.BodyMotion(S=np.eye(3), **dict.fromkeys(("R", "v", "omega", "a", "alpha"), np.zeros(3)))
ROBOT = hp.Mechanism(
    [
        PAIR,
        hp.Slider((0.2, 0, 0), (0, 0, 0), (0, 0, 1), name="lift", body2=BODY, limits=(0, 1)),
        hp.Screw((0, 0, 0.1), (0, 0, 0), (0, 0, 1), pitch=0.1, name="jack", body2=BODY),
    ],
    name="arm",
)


def bodies(*noise):
    made = recording(400, *noise)
    return hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=made.R2, S=made.S2)


def notes(*calls):
    """The warnings of calls, one a line."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for call in calls:
            call()
    return "\n".join(f"{one.category.__name__}: {one.message}" for one in caught)


def scene(name):
    return hp.load_scene(MODELS / f"{name}.toml")


def lines(*values):
    return "\n".join(map(repr, values))


def motion_of(made):
    return hp.simulate(PAIR, np.linspace(0, 1, 5), STILL, 0.3, 0.0, base="fixed") if made == "pair" else hp.simulate(
        ROBOT, np.linspace(0, 1, 5), [0.3, 0.1, 0.0]
    )  # fmt: skip


def shifted(body):
    return hp.BodyMotion(R=body.R + np.array((1e-2, 0, 0)), S=body.S)


TEXTS = {
    "values": lambda: lines(
        PAIR, FLAT, BODY, *BODY.shapes, hp.Cylinder(1, 2), STILL, ROBOT, *(ROBOT[name] for name in ROBOT.names),
        hp.HingeLoad(stiffness=3, stops=(-1, 1), stop_restitution=0.5), hp.Feedback(1.0, 2.0, 0.0),
    ),
    "results": lambda: lines(
        PAIR.forward_kinematics(Q, Q, Q), PAIR.forward_kinematics(MANY), FLAT.forward_kinematics(Q[:4]),
        PAIR.inverse_dynamics(STILL, 0.1, 0.2, 0.3), PAIR.energy(STILL, 0.1, 0.2), PAIR.prepare("velocity"),
        ROBOT.forward_kinematics(Q[:3], Q[:3]), ROBOT.forward_kinematics(Q[:3])["jack"], ROBOT.prepare("mass_matrix"),
        ROBOT.rollout(Q[:3], Q[:3], 0, 0.01, steps=3), motion_of("pair"), motion_of("robot"),
        hp.integrate(PAIR, [0, 1], (0, 0, 1), 1.0), scene("hatch").evaluate(), scene("excavator").evaluate(),
    ),
    "robot": lambda: f"{ROBOT}\n\n{hp.load_robot('panda')}",
    "forces": lambda: str(ROBOT.inverse_dynamics(Q[:3], Q[:3], Q[:3])),
    "forces_of_many": lambda: str(ROBOT.inverse_dynamics(MANY[..., :3], MANY[..., :3], MANY[..., :3])),
    "residuals": lambda: str(PAIR.residuals(STILL, shifted(STILL), tolerances={"gap": 1.0})),
    "cross_validation": lambda: masked(str(hp.cross_validate(PAIR, MANY, MANY, MANY))),
    "fit": lambda: str(hp.fit(*bodies(1e-3, 2e-3))),
    "fit_of_what_is_no_hinge": lambda: str(hp.fit(bodies(1e-3, 2e-3)[0], shifted(bodies(1e-2, 2e-1)[1]))),
    "smoothed": lambda: repr(hp.smooth(recording(400).t, bodies(1e-3, 2e-3)[0])),
    "plan": lambda: re.sub(
        r"\d+(?= operations| in all|:)", "#",
        "\n\n".join(str(scene(name).plan()) for name in ("hatch", "truck_trailer", "excavator")),
    ),
    "scenes": lambda: "\n\n".join(str(hp.load_scene(path)) for path in sorted(MODELS.glob("*.toml"))),
    "closed_forms": lambda: lines(
        *(getattr(hp.derive(scene("reference_2d")), name) for name in ("R2", "omega2"))
    ),
    "urdf": lambda: hp.to_urdf(PAIR),
    "mjcf": lambda: hp.to_mjcf(PAIR),
    "notes": lambda: notes(
        lambda: hp.load_robot("panda").inverse_dynamics(*np.zeros((3, 8))),
        lambda: hp.HingePair((1, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(mass=1)).hinge_wrench(STILL, 0, 0, 0),
        lambda: hp.smooth(np.arange(400) / 100, 200 * np.sin(np.arange(400.0))),
        lambda: hp.integrate(PAIR, np.arange(50) * 10.0, np.tile((0, 0, 0.5), (50, 1)), 0.5 + np.zeros(50)),
        lambda: hp.to_urdf(PAIR),
    ),
    "command": lambda: run_command("--help").stdout,
    **{f"command_{name}": lambda name=name: run_command(name, "--help").stdout for name in COMMANDS},
    "printed_run": lambda: run_command("run", MODELS / "hatch.toml").stdout,
    "printed_run_of_a_robot": lambda: run_command("run", MODELS / "excavator.toml").stdout,
    "printed_forces": lambda: run_command("forces", MODELS / "hatch.toml").stdout,
    "printed_forces_of_a_robot": lambda: run_command("forces", MODELS / "excavator.toml").stdout,
    "printed_check": lambda: masked(run_command("check", MODELS / "reference_3d.toml").stdout),
    "printed_derive": lambda: run_command("derive", MODELS / "reference_2d.toml").stdout,
    "printed_robots": lambda: run_command("robots", "panda").stdout,
    "printed_examples": lambda: run_command("examples").stdout,
}  # fmt: skip


def masked(text):
    """Numbers that are measured errors."""
    return re.sub(r"\d+(\.\d+)?(e[-+]\d+)?", "#", text)


def rounded(text):
    """The text with numbers of two digits, and gaps of two blanks at most."""

    def shorter(match):
        number = float(match[0])
        return f"{number:.2g}" if abs(number) > 1e-12 else "0"

    text = re.sub(r"(?<![\w.])-?\d+(\.\d+(e[-+]\d+)?|e[-+]\d+)(?![\w.])", shorter, text)
    text = re.sub(r"np\.float64\((.*?)\)", r"\1", text)  # as NumPy 1 writes it
    text = re.sub(r"[\d.e-]+ (?=u \* scale)", "# ", text)
    text = re.sub(r"(?<=\S) {3,}|(?<=\S)-{4,}", "  ", text).replace(str(MODELS), "models")
    return "\n".join(line.rstrip() for line in text.strip().splitlines()) + "\n"


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning", "ignore::hingepair.MeasurementWarning")
def test_what_is_printed(name, request):
    path = GOLDEN / f"{name}.txt"
    printed = rounded(TEXTS[name]())
    if request.config.getoption("--renew-golden"):
        path.write_text(printed, encoding="utf-8")
    assert printed == path.read_text(encoding="utf-8"), "pytest tests/test_golden.py --renew-golden takes it over"


def test_no_file_is_left_over():
    assert {path.stem for path in GOLDEN.glob("*")} == TEXTS.keys()
