"""Tables of the reference: each public name of a page with the first sentence of its docstring, and its methods.

`python tests/support/reference.py` writes them into docs/reference, so that the pages can be read as files.
"""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path

PAGES = sorted((Path(__file__).parents[2] / "docs" / "reference").glob("*.md"))
_BEGIN, _END = "<!-- names of this page -->\n", "<!-- end of names -->\n"
_OBJECT = re.compile(r"^\.\. auto(class|function|exception):: (hingepair[\w.]*)\.(\w+)", re.MULTILINE)


def with_table(page: str) -> str:
    """Return the text of a page with the table of its names as their docstrings say it today."""
    bare = re.sub(f"{_BEGIN}.*?{_END}\n", "", page, flags=re.DOTALL)
    found = [(kind, getattr(importlib.import_module(module), name)) for kind, module, name in _OBJECT.findall(bare)]
    if not found:
        return bare
    rows = ["| name | |", "|---|---|"]
    for kind, one in found:
        call = f"{one.__name__}(...)" if kind == "function" else one.__name__
        rows.append(f"| **`{call}`** | {_first_sentence(one)} |")
        if kind == "class":
            rows += [f"| `.{name}` | {_first_sentence(member)} |" for name, member in _members(one)]
    place = bare.index("```{eval-rst}")
    return f"{bare[:place]}{_BEGIN}{chr(10).join(rows)}\n{_END}\n{bare[place:]}"


def _members(one: type) -> list[tuple[str, object]]:
    """Return the public methods and properties of a class, as it has them itself or from classes of the package."""
    names = [name for name in dir(one) if not name.startswith("_")]
    found = []
    for name in names:
        owner = next((base for base in one.__mro__ if name in vars(base)), None)
        member = None if owner is None else vars(owner)[name]
        if isinstance(member, classmethod | staticmethod):
            member = member.__func__
        if (
            owner is None
            or not owner.__module__.startswith("hingepair")
            or not (inspect.isfunction(member) or isinstance(member, property))
        ):
            continue
        if inspect.getdoc(member):
            found.append((f"{name}(...)" if inspect.isfunction(member) else name, member))
    return found


def _first_sentence(one: object) -> str:
    text = (inspect.getdoc(one) or "").partition("\n\n")[0].replace("\n", " ")
    sentence = re.split(r"(?<=[\w)\]`\"'])\.(?= [A-Z`])", text)[0].rstrip(".")
    return sentence.replace("|", "\\|") + "."


if __name__ == "__main__":
    for path in PAGES:
        path.write_text(with_table(path.read_text(encoding="utf-8")), encoding="utf-8")
