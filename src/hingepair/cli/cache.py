"""`hingepair cache`: where compiled code is kept on disk, how large it is, and its deletion."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from hingepair.cli.output import JsonOption
from hingepair.engine.llvm.object_cache import MAX_BYTES, MAX_FILES, cache_files, cache_folder, clear_cache
from hingepair.tables.sheets import json_text


def cache_command(
    clear: Annotated[bool, typer.Option("--clear", help="Delete the compiled code.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Show where compiled code is kept on disk, and how large it is.

    The folder is that of the environment variable HINGEPAIR_CACHE, or hingepair in the user's folder for caches.
    HINGEPAIR_CACHE=off turns it off. What is deleted is compiled again when it is needed.
    """
    folder = cache_folder()
    deleted = clear_cache(folder) if clear and folder else []
    files = cache_files(folder) if folder else []
    size = sum(file.size for file in files)
    report = {
        "folder": None if folder is None else str(folder),
        "writable": folder is not None and _is_writable(folder),
        "files": len(files),
        "bytes": size,
        "max_files": MAX_FILES,
        "max_bytes": MAX_BYTES,
        "deleted": len(deleted),
    }
    if as_json:
        print(json_text(report))
        return
    if folder is None:
        lines = ["off: HINGEPAIR_CACHE says so" if os.environ.get("HINGEPAIR_CACHE") else "off: the user has no home"]
    else:
        most = f"at most {MAX_FILES} files and {MAX_BYTES / 2**20:.0f} MiB"
        lines = [str(folder), f"{len(files)} files, {size / 2**20:.1f} MiB ({most})"]
        if not report["writable"]:
            lines.append("this folder cannot be written: nothing more is kept, and every process compiles anew")
    if clear:
        lines.append(f"deleted: {len(deleted)} files")
    print(*lines, sep="\n")


def _is_writable(folder: Path) -> bool:
    """Return whether files can be made in a folder, or the folder itself if it does not exist."""
    existing = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)
