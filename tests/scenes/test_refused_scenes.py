"""Scenes that are refused, each in one line that names the file, the table and the key; wording is not pinned.

A row of the table is the good scene, what is changed in it (`old -> new`, or `+ text` behind it), and the
place that the message names.
"""

from __future__ import annotations

import pytest

import hingepair as hp

TIME = "[time]\nstart = 0\nstop = 2\nsamples = 21\n"
PAIR = "[pair]\nu1 = [0.5, 0.2, 0.1]\nu2 = [-0.25, 0.1, 0.3]\nn = [1, 0, 0]\n"
BODIES = "body1 = { mass = 1, inertia = [1, 1, 1] }\nbody2 = { mass = 1, inertia = [1, 1, 1] }\n"
FLAT = "planar = true\n[pair]\nu1 = [1, 2]\nu2 = [1, 0]\n[motion]\nx = 0\ny = 0\nphi = 0\npsi = 't'\n" + TIME
JOINTS = "".join(
    f"[[joint]]\nname = '{name}'\n{more}u1 = [2, 0, 0]\nu2 = [0, 0, 0]\nn = [0, 1, 0]\n"
    "body2 = { mass = 4, inertia = [1, 1, 1] }\n"
    for name, more in (("boom", ""), ("stick", "parent = 'boom'\n"), ("ram", "parent = 'stick'\nkind = 'slider'\n"))
)
EULER = "t,x,y,z,phi_x,phi_y,phi_z,psi"
SCENES = {
    "pair": PAIR + '[motion]\nx = "w*t"\ny = 0.5\nz = 0\nphi_x = 0\nphi_y = 0\nphi_z = 0\npsi = "pi*t"\n'
    + "[constants]\nw = 2\n" + TIME,
    "flat": FLAT,
    "moved": PAIR + BODIES + TIME + "[dynamics]\n",
    "robot": JOINTS + TIME + "[motion]\n",
    "falls": JOINTS + TIME + "[dynamics]\n",
    "panda": "[mechanism]\nrobot = 'panda'\nlocked = { panda_joint1 = 0 }\n" + TIME + "[motion]\n",
    "log": PAIR + "[motion]\nfile = 'log.csv'\n",
    "rates": PAIR + "[motion]\nfile = 'log.csv'\nintegrate = true\nframe = 'world'\n",
    "robot log": JOINTS + "[motion]\nfile = 'log.csv'\n",
}  # fmt: skip
LOGS = {
    "log": EULER + "\n" + "".join(f"{k},0,0,0,0,0,0,0\n" for k in range(9)),
    "rates": "t,omega1_x,omega1_y,omega1_z,psid\n" + "".join(f"{k / 10},0,0,1,2\n" for k in range(12)),
    "robot log": "t,boom\n0,0\n1,0\n",
}
TABLE = r"""
pair | [pair] -> [pair | TOML
pair | psi = -> psy = | motion.psy
pair | [time] -> [times] | times
pair | u1 = [0.5, 0.2, 0.1] -> u1 = [0.5, 0.2] | pair.u1
pair | n = [1, 0, 0] -> n = [0, 0, 0] | pair.n
pair | n = [1, 0, 0] -> n = [1, 0, 0]\nhome = [[2,0,0],[0,1,0],[0,0,1]] | pair.home
pair | n = [1, 0, 0] -> n = [1, 0, 0]\nhome = { axis = [1, 0, 0] } | pair.home
pair | n = [1, 0, 0] -> n = [1, 0, 0]\nlimits = [2, 1] | pair.limits
pair | n = [1, 0, 0] -> n = [1, 0, 0]\nbody1 = { mass = -1 } | pair.body1.mass
pair | n = [1, 0, 0] -> n = [1, 0, 0]\nbody1 = { shapes = [{ cone = 1 }] } | pair.body1.shapes[0]
pair | y = 0.5 -> y = 1e999 | motion.y
pair | pi*t -> sine(t) | unknown name 'sine'
pair | pi*t -> 2t | 2*t
pair | [motion] -> [motion]\nsequence = "XXY" | motion.sequence
pair | w = 2 -> w = 2\nsin = 3 | constants.sin
pair | w = 2 -> w = [2] | constants.w
pair | samples = 21 -> samples = 0 | time.samples
pair | samples = 21 -> samples = 1000000000000 | time.samples
pair | samples = 21 -> samples = 1 | time.samples
pair | start = 0\nstop = 2 -> start = 1e9\nstop = 1000000000.000001 | time.samples
pair | stop = 2 -> stop = -1 | time.stop
pair | + [outputs]\nnames = ["R3"] | outputs.names
pair | + [outputs]\n"a\\nb" = 1 | outputs
pair | [pair] -> title = "a\u001b[31mb"\n[pair] | printable
pair | "pi*t" -> { t = [0, 1] } | motion.psi.value
pair | "pi*t" -> { t = [0, 0], value = [0, 1] } | motion.psi.t
pair | "pi*t" -> { t = [0, 1], value = [0, 1], speed = 0.9 } | motion.psi.speed
flat | u1 = [1, 2] -> u1 = [1, 2, 0] | pair.u1
flat | u1 = [1, 2] -> u1 = [1, 2]\nn = [0, 0, 1] | pair.n
flat | phi = 0 -> phi_z = 0 | motion.phi
flat | + [outputs]\nnames = ["S2"] | outputs.names
moved | + base = 'held' | dynamics.base
moved | + bass = 'free' | dynamics.bass
moved | + psi.tau = 'phi' | dynamics.psi.tau
moved | + force1 = [0, 'psi_d', 0] | dynamics.force1[1]
moved | + tol = 1 | dynamics.tol
moved | + gravity = 9.81 | dynamics.gravity
moved | + base = 'pinned'\nv1_0 = [1, 0, 0] | dynamics.v1_0
moved | + base = 'prescribed'\nR1_0 = [1, 0, 0] | dynamics.R1_0
moved | + [motion]\nx = 0 | motion.y
moved | + phi_0 = 1 | dynamics.phi_0
moved | + psi.tau = 'log(0.2 - t)' | dynamics
moved | + psi.stops = [-1, 1]\npsi.stop_restitution = 0\npsi.stop_damping = 2 | stop_damping
moved | + psi.stops = [-1, 1]\npsi.stop_restitution = 0\npsi.stop_stiffness = 1e4 | stop_stiffness
robot | 'boom'\nu1 -> 'bom'\nu1 | joint.stick.parent
robot | name = 'boom' -> name = 'boom'\nparent = 'ram' | parent
robot | name = 'ram' -> name = 'boom' | joint[2].name
robot | 'slider' -> 'slidr' | joint.ram.kind
robot | + [pair] | pair
robot | + [mechanism]\nrobot = 'panda' | mechanism.robot
robot | + [mechanism.frames]\na = { link = 'rm' } | mechanism.frames.a.link
robot | + [mechanism.payload]\nrm = { mass = 1 } | mechanism.payload.rm
robot | + [mechanism.payload]\nram = {} | mechanism.payload.ram.mass
robot | + [[joint]]\nname = 'tip'\nram = 't' | joint[3].ram
robot | 'ram' -> 't' | motion.t
robot | 'ram' -> 'boomd' | joints of other names
robot | 'ram' -> 'file' | motion.file
panda | 'panda' -> 'pand' | mechanism.robot
panda | panda_joint1 -> panda_joint | mechanism.locked
panda | + panda_jiont2 = 't' | motion.panda_jiont2
panda | + panda_finger_joint2 = 0 | motion.panda_finger_joint2
panda | + panda_joint1 = 0 | motion.panda_joint1
panda | + smooth = true | motion.smooth
falls | + elbow.friction = 1 | dynamics.elbow
falls | + boom.mass = 1 | dynamics.boom.mass
falls | + boom.stops = true | dynamics.boom.stops
falls | + base = "prescribed" | dynamics.base
falls | + boom.tau = "psi" | dynamics.boom.tau
falls | + [motion]\nelbow = 1 | motion.elbow
falls | + boom.friction = 1\n[motion]\nboom = 1 | dynamics.boom
falls | + [motion]\nboom = "abs(t - 0.3)" | motion.boom
falls | + [motion]\nx = "abs(t - 0.3)" | dynamics.base
falls | + wrenches.hand.force = [0, 0, 1] | dynamics.wrenches
falls | + wrenches.boom.moment = [0, 1, 0] | wrenches.boom.moment
falls | + until = "elbow - 1" | dynamics.until
falls | + until = "1" | dynamics.until
falls | + ram.q_0 = 8\nram.stops = [-1, 1]\nram.stop_restitution = 0 | dynamics.ram.q_0
log | 'log.csv' -> 'no.csv' | motion.file
log | + loss = 'cauchy' | motion.loss
log | + psi_0 = 1 | motion.psi_0
log | + [outputs]\nnames = ["omega1"] | outputs.names
log | + frame = 'body' | motion.frame
log | + columns.t = 'Zei' | motion.columns.t
log | + columns.psy = 'psi' | columns.psy
log | + columns.psi = { name = 'psi', unit = 'degrees' } | columns.psi.unit
log | + [time]\nstart = 0 | time
log | csv: x,y -> y | x
log | csv: ,psi\n -> ,R2_x\n | R2_x
log | csv: ,psi\n -> ,psa\n | psa
rates | + smooth = true | motion.smooth
rates | + tol = 1e-9 | motion.tol
rates | integrate = true -> integrate = "yes" | motion.integrate
rates | 'world' -> 'hinge' | motion.frame
rates | + method = "euler" | motion.method
rates | + S1_0 = [[2,0,0],[0,1,0],[0,0,1]] | motion.S1_0
rates | csv: psid -> psidd | psid
rates | csv: omega1_z -> alpha1_z | omega1_z
rates | csv: 0.3,0, -> 0.3,nan, | omega1_x
robot log | csv: boom -> bom | boom
robot log | csv: boom -> stickd | stick
"""


@pytest.mark.parametrize("row", TABLE.strip().splitlines())
def test_a_scene_is_refused_by_its_place(tmp_path, row):
    name, change, place = (part.strip() for part in row.split(" | "))
    text, log = SCENES[name], LOGS.get(name, "")
    in_log = change.startswith("csv: ")
    old, arrow, new = (
        part.replace(r"\n", "\n").replace("\\\n", r"\n") for part in change.removeprefix("csv: ").partition("->")
    )
    if not arrow:
        text += old.removeprefix("+ ") + "\n"
    else:
        given, old, new = (log if in_log else text), old.strip(" "), new.strip(" ")
        assert old in given
        text, log = (text, given.replace(old, new, 1)) if in_log else (given.replace(old, new, 1), log)
    (tmp_path / "log.csv").write_text(log)
    (tmp_path / "my.toml").write_text(text)
    with pytest.raises(hp.SceneError) as caught:
        hp.load_scene(tmp_path / "my.toml")
    message = str(caught.value)
    assert place in message
    assert ("my.toml" in message) != ("log.csv" in message.partition(": ")[0])
    assert "\n" not in message
    assert ("expected" in message and "got" in message) or "known: " in message


FILES = {
    "empty": (b"", "[pair]"),
    "not UTF-8": (b"\xff\xfe", "UTF-8"),
    "large": (b"# " + b"x" * 1_100_000, "bytes"),
    "long dotted keys": ("\n".join("a." * 2_000 + f"k{i} = 1" for i in range(200)).encode(), "16 parts"),
    "endless integer": (SCENES["pair"].replace("21", f"0x{'f' * 5_000}").encode(), "time.samples"),
    "deep": (b"a = " + b"[" * 50_000, "TOML"),
    "long key": (b"a" + b".a" * 100_000 + b" = 1", "my.toml"),
}


@pytest.mark.parametrize(("content", "word"), FILES.values(), ids=FILES)
def test_a_file_that_is_no_scene_is_refused(tmp_path, content, word):
    (tmp_path / "my.toml").write_bytes(content)
    with pytest.raises(hp.SceneError, match=r"my\.toml") as caught:
        hp.load_scene(tmp_path / "my.toml")
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["pair", "flat", "moved", "robot", "falls", "panda", "log", "rates", "robot log"])
def test_the_good_scenes_are_good(tmp_path, name):
    (tmp_path / "log.csv").write_text(LOGS.get(name, ""))
    (tmp_path / "my.toml").write_text(SCENES[name])
    assert hp.load_scene(tmp_path / "my.toml").samples > 1
