"""Hostile texts: scenes, expressions and URDF, made from seeds, thousands of them under limits of memory and work.

Only a result or an error of the library may come out, after so many function calls at most. As a script,

    PYTHONPATH=tests python tests/scenes/test_hostile.py KIND FIRST COUNT

prints one line of JSON for each text that brought anything else, and one at the end: {"done": COUNT, "refused": how
many}.
"""

from __future__ import annotations

import json
import os
import random
import re
import string
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.exported import ARM
from support.work import HANG, bounded_calls

MODELS = Path(__file__).parents[2] / "models"
FUNCTIONS = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "tanh", "exp", "log", "sqrt")
CHOICES = (
    "abs(#)", "min(#, #)", "max(#, #, #)", "clip(#, #, #)", "mod(#, #)", "step(#)", "ramp(#)", "where(#, #, #)",
    "where(# <= # and not # > 1, #, #)", "where(0 < # < 1 or # >= #, #, #)",
)  # fmt: skip
ODD = (
    "0", "1", "-1", "t", "pi", "e", "1e308", "1e999", "-1e-999", "9**9**9", "nan", "inf", "1_0", "0x10", "1j", "''",
    "[]", "()", "t.real", "t[0]", "lambda: t", "__import__('os').system('true')", "().__class__.__mro__",
    "t if t else 0", "x:=1", "*t", "0/0", "1/0", "10**10**10", "0**-1", "log(0)", "sqrt(-1)", "(-8)**(1/3)",
    "t**t**t", "e**e**e**t", "2**0.1234567", "1" * 400, "0." + "3" * 300, "((((((((((t))))))))))",
    "-" * 300 + "t", "\u0661", "\u03c0", "\x00",
    "t\n", "#", "\\", "sin", "sin()", "sin(t, t)", "atan2(t)", "sin(x=t)", "True", "None", "t//2", "t%2", "t@t", "~t",
    "t<<3", "t==t", "t and t", "f'{t}'", "\ud7ff", "\U0001d70b", "exp(exp(exp(exp(t))))",
    "tan(tan(tan(tan(tan(t)))))",
)  # fmt: skip
VALUES = (
    "1e999", "-1e999", "nan", "inf", "-0.0", "1e-320", "9" * 400, "1_000", "0x1F", "true", '""', "[]", "[[]]", "{}",
    "[1, 2]", "[1, 2, 3, 4]", "[nan, 0, 0]", "[0, 0, 0]", '["a", "b", "c"]', "[1e200, 1e-200, 0]", "[[1, 0], [0, 1]]",
    "1979-05-27", '"""', "'''", "\\u0000", "10000000", "1000000000000", "-5", "0", '"9**9**9"', '"t**t**t"',
    "[" * 200, "{a = " * 60,
)  # fmt: skip


def expression(rng):
    """A random expression: grown from the grammar, then some of its characters changed."""

    def grow(depth):
        kind = rng.random()
        if depth == 0 or kind < 0.2:
            return rng.choice((*ODD[:5], "t", "t", "2", "0.1", "3/7", rng.choice(ODD)))
        if kind < 0.6:
            return f"{grow(depth - 1)} {rng.choice(('+', '-', '*', '/', '**', '**'))} {grow(depth - 1)}"
        if kind < 0.85:
            return f"{rng.choice(FUNCTIONS)}({grow(depth - 1)})"
        if kind < 0.95:
            return re.sub("#", lambda _: grow(depth - 1), rng.choice(CHOICES))
        return f"({grow(depth - 1)}){'' if rng.random() < 0.7 else rng.choice(ODD)}"

    text = grow(rng.randint(1, 7))
    if rng.random() < 0.1:
        text = rng.choice(("+", "*", "**", "-", " + t*")).join([text[:40]] * rng.randint(2, 3000))
    return changed(rng, text, ODD) if rng.random() < 0.4 else text


def changed(rng, text, pieces):
    """The text with a few cuts, repeats, swaps, odd pieces and stray characters."""
    for _ in range(rng.randint(1, 4)):
        i, j = sorted(rng.randrange(len(text) + 1) for _ in range(2))
        j = min(j, i + rng.choice((1, 3, 20, 200)))
        head, part, tail = text[:i], text[i:j], text[j:]
        piece, stray = rng.choice(pieces), rng.choice(string.printable + "\x00\x7f\u00e9\u2028\ufeff")
        middles = ("", part * rng.choice((2, 3, 51)), piece, piece + part, stray)
        text = head + rng.choice(middles) + tail
        text = text[:200_000]
    return text


def scene(rng):
    """A scene of the models, with a value replaced, lines moved about, or characters changed."""
    lines = rng.choice([path.read_text(encoding="utf-8") for path in sorted(MODELS.glob("*.toml"))]).splitlines()
    for _ in range(rng.randint(1, 3)):
        i = rng.randrange(len(lines))
        key, equals, _ = lines[i].partition("=")
        what = rng.random()
        if equals and what < 0.45:
            value = json.dumps(expression(rng)) if rng.random() < 0.4 else rng.choice(VALUES)
            lines[i] = f"{key}= {value}"
        elif what < 0.55:
            lines.pop(i)
        elif what < 0.65:
            lines.insert(rng.randrange(len(lines)), lines[i])
        elif what < 0.75:
            lines.insert(i, f"{rng.choice(('psi', 'file', 'a' * 2000, '.'.join('a' * 300), 'constants.e', 'x'))} = 1")
        if not lines:
            break
    text = "\n".join(lines)
    return changed(rng, text, VALUES) if rng.random() < 0.3 else text


TAGS = (
    "<joint", "</joint>", "<link name='x'/>", "<axis xyz='0 0 0'/>", "<axis xyz='nan 0 1'/>", "xyz='1 2'", "1e999",
    "nan", "0x1", "1,5", "<!DOCTYPE r [<!ENTITY a 'aa'>]>", "<!ENTITY x SYSTEM 'file:///etc/passwd'>", "&a;", "&#0;",
    "<![CDATA[", "<a>" * 500, "</robot>", "<robot>", "name=''", "type='prismatic'", "type='floating'", "base",
    "tip", "shoulder", "\x00", "<?xml version='1.0' encoding='utf-16'?>", "<!--", "-->", "9" * 500,
    "<xacro:include filename='x'/>",
)  # fmt: skip


def urdf(rng):
    """A small robot, changed."""
    return changed(rng, ARM, TAGS)


def use_expression(text, _rng, _folder):
    from hingepair.symbolic.expressions import parse_expression
    from hingepair.symbolic.time_functions import TimeFunctions

    part = parse_expression("motion.psi", text, {"k": 0.5})
    TimeFunctions([part]).derivatives(np.array([-1.0, 0.0, 1e-9, 0.5, 1e6]))


def use_scene(text, _rng, folder):
    path = Path(folder) / "scene.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    loaded = hp.load_scene(path)
    str(loaded.plan())
    if loaded.t.size <= 20_000:
        loaded.evaluate()


def use_urdf(text, rng, _folder):
    joint = rng.choice(("shoulder", "elbow", "weld", "knee", ""))
    hp.from_urdf(text, joint=joint, body2_frame=rng.choice((None, "base", "tip", "hand", "nowhere")))


USES = {"expression": (expression, use_expression), "scene": (scene, use_scene), "urdf": (urdf, use_urdf)}
MOST_CALLS = {"expression": 10**7, "scene": 2 * 10**7, "urdf": 10**6}
"""Function calls that a text may make: some ten times what the heaviest makes. Two million steps of integration are
two million calls."""


def attempt(kind, seed, folder):
    """(what is wrong or None, whether it was refused, the text)."""
    rng, (make, use) = random.Random(f"{kind} {seed}"), USES[kind]
    text = make(rng)
    try:
        with warnings.catch_warnings(), bounded_calls(MOST_CALLS[kind]):
            warnings.simplefilter("error")
            for category in (hp.DynamicsWarning, hp.MeasurementWarning):
                warnings.simplefilter("ignore", category)  # what the library says to users
            use(text, rng, folder)
    except hp.HingePairError as error:
        return (None if str(error).strip() else "an empty message"), True, text
    except BaseException as error:
        return f"{type(error).__name__}: {error}"[:300], False, text
    return None, False, text


def findings(kind, first, count):
    """What goes wrong with so many texts, as (seed, what, text); and how many were refused."""
    found, refused = [], 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            wrong, was_refused, text = attempt(kind, seed, folder)
            refused += was_refused
            found += [(seed, wrong, text[:400])] if wrong else []
    return found, refused


def main():
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
    kind, first, count = sys.argv[1], *map(int, sys.argv[2:4])
    found, refused = findings(kind, first, count)
    for seed, wrong, text in found:
        print(json.dumps({"seed": seed, "wrong": wrong, "text": text}))
    print(json.dumps({"done": count, "refused": refused}))


TESTS = Path(__file__).parents[1]
MANY = {"expression": 200, "scene": 40, "urdf": 600}


@pytest.mark.slow(4)
@pytest.mark.parametrize("kind", MANY)
def test_many_hostile_texts(kind):
    """In a process of its own with 3 GiB of addresses: what hangs, crashes or eats memory is found out."""
    paths = os.pathsep.join((str(Path(hp.__file__).parents[1]), str(TESTS)))
    environment = dict(os.environ, PYTHONPATH=paths, PYTHONWARNINGS="error")
    command = [sys.executable, __file__, kind, "0", str(MANY[kind])]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=2 * HANG, check=False)
    assert done.returncode == 0, (done.returncode, done.stderr[-2000:])
    *found, last = map(json.loads, done.stdout.splitlines())
    assert not found
    assert last["done"] == MANY[kind]
    assert 0.2 * MANY[kind] < last["refused"] < MANY[kind]
    assert "Traceback" not in done.stderr


if __name__ == "__main__":
    main()
