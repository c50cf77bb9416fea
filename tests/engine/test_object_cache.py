"""Compiled code on disk: the same bits in every process, whatever happens to the files."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hingepair.engine.llvm import images, native, object_cache
from support.work import HANG, python

IR = "define i64 @kernel(i64 %x) {{\n  %y = mul i64 %x, {factor}\n  ret i64 %y\n}}\n"
PROCESS = """
import sys
import numpy as np
import hingepair as hp

{before}
pair = hp.HingePair(u1=(1, 0, 0), u2=(0, 1, 0), n=(0, 0, 1))
q = np.random.default_rng(0).uniform(-9, 9, (1000, 7))
state = pair.forward_kinematics(q, outputs={outputs}, backend="compiled")
print(state.{name}.tobytes().hex()[:4000], "llvmlite" in sys.modules)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    path = tmp_path / "cache"
    monkeypatch.setenv("HINGEPAIR_CACHE", str(path))
    monkeypatch.setattr(object_cache, "_looked", False)
    return path


def start(before="", name="R2", **environment):
    code = PROCESS.format(before=before, outputs=(name,), name=name)
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | environment,
    )


def printed(process):
    output, errors = process.communicate(timeout=HANG)
    assert process.returncode == 0, errors
    return output.split()


def objects(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_what_is_written_is_read(folder):
    assert object_cache.read_object("0a") is None
    object_cache.write_object("0a", b"code")
    assert object_cache.read_object("0a") == b"code"
    assert object_cache.read_object("0b") is None
    assert [path.suffix for path in folder.iterdir()] == [".object"]


LOADERS = {
    "of this system": "",
    "llvmlite": "from hingepair.engine.llvm import images\nimages.CAN_LINK = False",
}


@pytest.mark.slow(3)
@pytest.mark.parametrize("loader", LOADERS)
def test_code_of_one_process_serves_another(folder, loader):
    """In another order of sets, and at other addresses."""
    before = LOADERS[loader]
    first, made_first = printed(start(before, PYTHONHASHSEED="1")), objects(folder)
    second = printed(start(before, PYTHONHASHSEED="2"))
    assert first[0] == second[0]
    assert (first[1], second[1]) == ("True", str(bool(before) or not images.CAN_LINK))
    assert objects(folder) == made_first
    assert printed(start(PYTHONHASHSEED="2", HINGEPAIR_CACHE="off")) == first


ROBOT = """
import numpy as np
import hingepair as hp
from hingepair.plans import trees

robot = hp.load_robot("ur5_robot")
{before}
q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 20_000, 6))
tau = robot.prepare("inverse_dynamics", outputs=("tau",), backend="compiled")(q, qd, qdd)
print(np.asarray(getattr(tau, "tau", tau)).tobytes().hex()[:4000])
print(robot.mass_matrix(q).tobytes().hex()[:4000])
"""
NO_TRACE = "trees.TreeQuantities = None"


@pytest.mark.slow(3)
@pytest.mark.usefixtures("folder")
def test_a_robots_code_on_disk_is_found_without_a_trace():
    code, traced = (ROBOT.format(before=before) for before in (NO_TRACE, ""))
    without = python(traced, HINGEPAIR_CACHE="off").split()
    assert len(without) == 2
    assert python(code, fails=True) == ""
    assert python(traced).split() == without
    assert python(code).split() == without


UPGRADE = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np, hingepair as hp
hp.Mechanism  # imports the equations
if sys.argv[2] == "upgrade":
    path = sys.argv[1] + "/hingepair/equations/trees.py"
    old = open(path).read()
    new = old.replace("cross(first_moment, a))", "scale(cross(first_moment, a), 2.0))")
    assert new != old
    open(path, "w").write(new)
robot = hp.load_robot("ur5_robot", base="fixed")
print(robot.inverse_dynamics(np.full((1, 6), 0.3), np.zeros((1, 6)), np.zeros((1, 6))).tau[0, 1])
"""


@pytest.mark.slow(3)
@pytest.mark.usefixtures("folder")
def test_code_is_kept_under_the_sources_that_made_it(tmp_path):
    """A process that goes on after an upgrade computes with the old sources: that is no code of the new ones."""
    shutil.copytree(Path(object_cache.__file__).parents[2], tmp_path / "hingepair")

    def run(*arguments, **environment):
        return float(python(UPGRADE, str(tmp_path), *arguments, PYTHONWARNINGS="ignore", **environment))

    old, new = run("upgrade"), run("-")
    assert new == run("-", HINGEPAIR_CACHE="off")
    assert abs(new - old) > 1


@pytest.mark.slow(3)
def test_a_process_killed_while_it_writes_leaves_nothing_that_is_read(folder):
    kill = """
import os, signal
from hingepair.engine.llvm import object_cache
object_cache.Path.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
"""
    killed = start(kill)
    killed.communicate(timeout=HANG)
    assert killed.returncode == -9
    assert len([*folder.iterdir()]) == 1
    assert printed(start())[0] == printed(start(HINGEPAIR_CACHE="off"))[0]


@pytest.mark.slow(3)
@pytest.mark.skipif(not hasattr(os, "fork"), reason="a system without forks")
@pytest.mark.parametrize("loader", LOADERS)
def test_a_fork_while_threads_compile_and_free_code_can_do_so_too(folder, loader):
    """No lock is left held in the child, llvmlite's own included."""
    fork = """
import gc, os, threading, time
import hingepair.engine.llvm.native as native
ir = "define i64 @kernel(i64 %x) {{ %y = add i64 %x, {} ret i64 %y }}"
done = False
def work(first):
    k = first
    while not done:
        native.Kernel("one", lambda: ir.format(k)).address("kernel")
        k += 1
threads = [threading.Thread(target=work, args=(1000 * k,)) for k in range(2)]
for thread in threads:
    thread.start()
for _ in range(10):
    time.sleep(0.01)
    child = os.fork()
    if not child:
        native.Kernel("one", lambda: ir.format(7)).address("kernel")
        gc.collect()
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
done = True
for thread in threads:
    thread.join()
"""
    printed(start(LOADERS[loader] + fork))
    assert len(objects(folder)) > 2


HARMS = {
    "empty": lambda _: b"",
    "cut": lambda content: content[:-1],
    "a bit": lambda content: content[:-9] + bytes([content[-9] ^ 4]) + content[-8:],
}


@pytest.mark.parametrize("harm", HARMS)
def test_a_damaged_file_is_made_again(folder, harm):
    object_cache.write_object("0a", b"some machine code")
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(HARMS[harm](whole))
    assert object_cache.read_object("0a") is None
    object_cache.write_object("0a", b"some machine code")
    assert path.read_bytes() == whole


def test_a_file_under_another_key_is_not_taken(folder):
    object_cache.write_object("0a", b"code")
    (path,) = folder.iterdir()
    path.rename(path.with_name(path.name.replace("0a", "0b")))
    assert object_cache.read_object("0b") is None


def give_away(path):
    if os.geteuid():
        pytest.skip("only root can give a file away")
    os.chown(path, 12345, 12345)


SUSPECTS = {
    "of another": give_away,
    "that the group can write": lambda path: path.chmod(0o775),
    "that all can write": lambda path: path.chmod(0o1777),
}


@pytest.mark.skipif(os.name != "posix", reason="owners and modes of files")
@pytest.mark.parametrize("suspect", SUSPECTS)
def test_a_folder_where_others_may_write_is_refused_with_a_warning(folder, suspect):
    object_cache.write_object("0a", b"code")
    SUSPECTS[suspect](folder)
    with pytest.warns(RuntimeWarning, match="is not used"):
        assert object_cache.read_object("0a") is None


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("value", ["cache", "../cache"])
def test_a_relative_folder_is_refused_with_a_warning(tmp_path, monkeypatch, value):
    """It would be another one in each current folder, such as that of an archive of somebody else."""
    monkeypatch.setenv("HINGEPAIR_CACHE", value)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.warns(RuntimeWarning, match="relative"):
        object_cache.write_object("0a", b"code")
    (tmp_path / "here").rmdir()
    assert [*tmp_path.iterdir()] == []


def test_what_was_not_used_for_the_longest_time_goes_when_the_folder_is_full(folder, monkeypatch):
    for k, name in enumerate(("used", "old", "new")):
        object_cache.write_object(name, bytes(1000))
        os.utime(next(folder.glob(f"*-{name}.*")), (k, k))
    assert object_cache.read_object("used") is not None
    monkeypatch.setattr(object_cache, "_looked", False)
    monkeypatch.setattr(object_cache, "MAX_BYTES", 3500)
    object_cache.write_object("last", bytes(1000))
    assert {name for name in ("used", "old", "new", "last") if object_cache.read_object(name)} == {"used", "last"}


@pytest.mark.parametrize("value", ["off", "0", "/dev/null/cache"])
def test_without_a_folder_code_is_compiled_all_the_same(value, monkeypatch):
    monkeypatch.setenv("HINGEPAIR_CACHE", value)
    object_cache.write_object("0a", b"code")
    assert object_cache.read_object("0a") is None
    assert native.Kernel("one", lambda: IR.format(factor=3)).address("kernel")


def test_a_disk_that_is_full_is_no_error_and_nothing_stays(folder, monkeypatch):
    def replace(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", replace)
    object_cache.write_object("0a", b"code")
    assert [*folder.iterdir()] == []


def test_code_of_another_processor_is_not_taken(folder, monkeypatch):
    native.Kernel("one", lambda: IR.format(factor=5))
    before, processor = set(folder.iterdir()), native.host_processor()
    native.Kernel("one", lambda: IR.format(factor=5))
    assert set(folder.iterdir()) == before
    monkeypatch.setattr(native, "host_processor", lambda: (processor[0], processor[1] + ",-sse4a"))
    native.Kernel("one", lambda: IR.format(factor=5))
    assert len({*folder.iterdir()} - before) == 2  # the kernel, and the functions that kernels share
