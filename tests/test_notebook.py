"""What notebooks and prompts show: few lines, and nothing of a text taken for markup."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.recorded import recording

MODELS = Path(__file__).parents[1] / "models"
HOSTILE = "<script>alert('\x1b[2J')</script>&"


class Cells(HTMLParser):
    """Texts of the cells; tags that were opened."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag, attrs):
        assert not attrs
        self.tags.append(tag)

    def handle_data(self, data):
        self.texts.append(data)


KINDS = ("pair", "planar pair", "one state", "states", "scene", "result", "forces", "trajectory", "check")
KINDS += ("residuals", "fit", "hostile scene")


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A value of each kind, and words that stand in its table."""
    bodies = {"body1": hp.Body(mass=3), "body2": hp.Body(mass=2)}
    pair = hp.HingePair(u1=(0.5, 0, 1 / 3), u2=(1, 0, 0), n=(0, 0, 1), name=HOSTILE, limits=(-1, 1), **bodies)
    t = np.linspace(0, 1, 5)
    scene = hp.load_scene(MODELS / "landing_gear.toml")
    body1 = hp.BodyMotion(R=np.zeros((5, 3)), S=np.broadcast_to(np.eye(3), (5, 3, 3)))
    body2 = pair.forward_kinematics_from_body1(body1, t)
    hostile = tmp_path_factory.mktemp("scenes") / "hostile.toml"
    hostile.write_text((MODELS / "landing_gear.toml").read_text().replace('"landing_gear"', '"<b>&"'))
    made = recording(300)
    first, second = hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=made.R2, S=made.S2)
    return {
        "pair": (pair, ("u1", "0.5, 0, 0.333333", "m", "-1, 1", "kg")),
        "planar pair": (hp.PlanarPair(u1=(1, 0), u2=(0, 1), name=HOSTILE), ("u2", "0, 1")),
        "one state": (pair.forward_kinematics((0,) * 7), ("R2", "S2", "1, 0, 0; 0, 1, 0; 0, 0, 1")),
        "states": (pair.forward_kinematics((t, 0, 0, 0, 0, 0, t)), ("array of shape (5, 3, 3)",)),
        "scene": (scene, (scene.title, "landing_gear", "2401", "0..12")),
        "hostile scene": (hp.load_scene(hostile), ("<b>&",)),
        "result": (scene.evaluate(), ("a2", "m/s^2", "psi", "rad")),
        "forces": (scene.forces(), ("hinge_torque", "N m")),
        "trajectory": (hp.integrate(pair, t, omega1=(0, 0, 1), psid=np.cos), ("omega2", "rad/s")),
        "check": (hp.cross_validate(pair, (0.1,) * 7), ("R2", "PASSED: 3 outputs of 1 sample")),
        "residuals": (pair.residuals(body1, hp.BodyMotion(R=body2.R2, S=body2.S2)), ("gap", "E1")),
        "fit": (hp.fit(first, second), ("home", "standard deviation")),
    }


@pytest.mark.parametrize("kind", KINDS)
def test_a_notebook_shows_a_table_and_a_prompt_few_lines(shown, kind):
    value, words = shown[kind]
    page = Cells()
    page.feed(value._repr_html_())
    assert {"table", "tr", "td"} <= set(page.tags) <= {"table", "caption", "thead", "tbody", "tr", "th", "td", "p"}
    text = "\n".join(page.texts)
    for word in words:
        assert word in text
    assert "\x1b" not in text
    assert len(text) < 3000
    assert len(repr(value)) < 800
    assert not re.search(r"\n.*\n.*\n.*\n.*\n.*\n", repr(value))
