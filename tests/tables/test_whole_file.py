"""A file is there whole or not at all, and what is no file stays what it is."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import threading

import pytest

from hingepair.errors import ArgumentError
from hingepair.tables.whole_file import whole_file
from support.sparse import sparse
from support.work import HANG


def write(target, content=b"new", inputs=()):
    with whole_file(target, inputs) as file:
        file.write(content)


@pytest.mark.parametrize("mode", [0o600, 0o644, 0o640, 0o755], ids=oct)
def test_the_mode_of_what_is_replaced_is_kept(tmp_path, mode):
    target = tmp_path / "a"
    target.write_bytes(b"old")
    target.chmod(mode)
    with whole_file(target) as file:
        file.write(b"new")
        (beside,) = set(tmp_path.iterdir()) - {target}
        assert not stat.S_IMODE(beside.stat().st_mode) & ~mode  # nobody else may read it meanwhile
    assert target.read_bytes() == b"new"
    assert stat.S_IMODE(target.stat().st_mode) == mode


@pytest.mark.parametrize("umask", [0o077, 0o022, 0o002], ids=oct)
def test_a_new_file_has_the_mode_that_the_umask_leaves(tmp_path, umask):
    before = os.umask(umask)
    try:
        write(tmp_path / "a")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o666 & ~umask


@pytest.mark.parametrize("there", [True, False], ids=["file", "dangling"])
def test_through_a_symlink_the_file_behind_it_is_written(tmp_path, there):
    (tmp_path / "folder").mkdir()
    behind, link = tmp_path / "folder" / "behind", tmp_path / "link"
    if there:
        behind.write_bytes(b"old")
    link.symlink_to("folder/behind")
    write(link)
    assert link.is_symlink()
    assert behind.read_bytes() == b"new"
    assert os.listdir(tmp_path / "folder") == ["behind"]


def test_a_pipe_stays_a_pipe(tmp_path):
    pipe, found = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: found.append(pipe.read_bytes()), daemon=True)
    reader.start()
    write(pipe, b"through")
    reader.join(HANG)
    assert found == [b"through"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_device_stays_a_device():
    """A terminal of our own: what goes wrong here must not cost the machine its /dev/null."""
    ours, terminal = os.openpty()
    name = os.ttyname(terminal)
    write(name, b"shown")
    assert os.read(ours, 10) == b"shown"
    assert stat.S_ISCHR(os.stat(name).st_mode)
    os.close(ours)
    os.close(terminal)


@pytest.mark.parametrize("name", [".", "no/such/folder/a", "a\0b", "file/b", "circle", "x" * 300], ids=ascii)
def test_what_cannot_be_written_is_said_and_leaves_nothing(tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_bytes(b"old")
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(ArgumentError, match="path: expected a file that can be written"):
        write(name)
    assert sorted(os.listdir()) == ["circle", "file"]


@pytest.mark.parametrize("spelling", ["log.csv", "./log.csv", "link", "hard"])
def test_an_input_is_not_written_over(tmp_path, spelling, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_bytes(b"measured")
    (tmp_path / "link").symlink_to("log.csv")
    os.link("log.csv", "hard")
    with pytest.raises(ArgumentError, match="path: expected a file other than those that are read"):
        write(spelling, inputs=["scene.toml", "log.csv"])
    assert (tmp_path / "log.csv").read_bytes() == b"measured"


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, OSError, ValueError])
def test_an_error_inside_leaves_what_was_there(tmp_path, error):
    target = tmp_path / "a"
    target.write_bytes(b"old")

    def fail():
        with whole_file(target) as file:
            file.write(b"half")
            raise error

    with pytest.raises(ArgumentError if error is OSError else error):
        fail()
    assert target.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.slow
@pytest.mark.parametrize("number", sparse([signal.SIGTERM, signal.SIGINT, signal.SIGHUP], 3, lambda n: n.name))
def test_a_signal_takes_the_half_written_file_away(tmp_path, number):
    code = (
        "import signal, time; from hingepair.cli.main import set_up_process\n"
        "from hingepair.tables.whole_file import whole_file\n"
        f"signal.signal({int(number)}, signal.SIG_DFL); set_up_process()\n"  # a background process may ignore it
        f"with whole_file({str(tmp_path / 'a')!r}) as file:\n"
        f"    file.write(b'half'); print('.', flush=True); time.sleep({HANG})"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    process.stdout.readline()
    assert len(os.listdir(tmp_path)) == 1
    process.send_signal(number)
    process.stdout.close()
    assert process.wait(HANG) == 128 + number
    assert os.listdir(tmp_path) == []
