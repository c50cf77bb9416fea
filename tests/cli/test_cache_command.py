"""`hingepair cache`: where compiled code is, how large, and gone on request; nothing else is deleted."""

from __future__ import annotations

import json

import pytest

from hingepair.cli.cache import cache_command
from hingepair.engine.llvm import object_cache


@pytest.fixture
def folder(tmp_path, monkeypatch):
    path = tmp_path / "cache"
    monkeypatch.setenv("HINGEPAIR_CACHE", str(path))
    return path


def report(capsys, **options):
    cache_command(as_json=True, **options)
    return json.loads(capsys.readouterr().out)


def test_the_folder_its_files_and_their_size(folder, capsys):
    assert report(capsys)["files"] == 0
    assert not folder.exists()
    for key in ("0a", "0b"):
        object_cache.write_object(key, bytes(1000))
    found = report(capsys)
    size = sum(path.stat().st_size for path in folder.iterdir())
    assert found == {
        "folder": str(folder), "writable": True, "files": 2, "bytes": size, "max_files": 8192, "max_bytes": 2**28,
        "deleted": 0,
    }  # fmt: skip
    cache_command()
    assert capsys.readouterr().out.splitlines() == [str(folder), "2 files, 0.0 MiB (at most 8192 files and 256 MiB)"]


def test_clear_deletes_compiled_code_and_nothing_else(folder, capsys):
    object_cache.write_object("0a", b"code")
    other = folder / "thesis.object"
    other.write_text("mine")
    (folder / "hingepair-0b.part").write_text("unfinished")
    assert report(capsys, clear=True)["deleted"] == 2
    assert [*folder.iterdir()] == [other]


@pytest.mark.parametrize(("value", "expected"), [("off", (None, False)), ("/dev/null/x", ("/dev/null/x", False))])
def test_without_a_folder(value, expected, monkeypatch, capsys):
    monkeypatch.setenv("HINGEPAIR_CACHE", value)
    found = report(capsys, clear=True)
    assert (found["folder"], found["writable"]) == expected
