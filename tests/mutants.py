"""Draw random mutants of the package and count those that the tests notice.

    python tests/mutants.py --count 60 --seed 1 --jobs 2 equations pair cli

A mutant is the package with one operator, number, condition or statement changed. The fast tests of its package run
first, then the slow ones, then the fast tests of all others. Mutants that survive are printed; some may be equivalent
to the original.
"""

from __future__ import annotations

import argparse
import ast
import copy
import itertools
import os
import queue
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGE = Path("src/hingepair")
HANG = 1200  # s, of one run of tests: a mutant that loops for ever is noticed
SWAPPED = {
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult},
    **{ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq},
    **{ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And},
    ast.BitAnd: ast.BitOr,  # not the other way: `A | B` is a type
}
SKIPPED = ("annotation", "returns", "decorator_list")  # fields without behaviour, or that break every import


class Mutant(NamedTuple):
    """One change of a file of the package."""

    file: Path
    line: int
    old: str
    new: str
    text: str  # of the whole file

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.old!r} -> {self.new!r}"


def changed(node: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield what is changed in a node, and what it becomes."""
    match node:
        case ast.BinOp(op=op) | ast.BoolOp(op=op) | ast.AugAssign(op=op) if type(op) in SWAPPED:
            yield node, replaced(node, op=SWAPPED[type(op)]())
        case ast.Compare(ops=[op]) if type(op) in SWAPPED:
            yield node, replaced(node, ops=[SWAPPED[type(op)]()])
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield node, operand
        case ast.Constant(value=bool(value)):
            yield node, replaced(node, value=not value)
        case ast.Constant(value=int(value)):
            yield node, replaced(node, value=value + 1)
        case ast.Constant(value=float(value)):
            yield node, replaced(node, value=1.5 * value if value else 1.0)
        case ast.If(test=test) | ast.IfExp(test=test) | ast.While(test=test):
            yield test, ast.UnaryOp(ast.Not(), test)
        case ast.Expr(value=ast.Call()) | ast.Raise() | ast.Continue():
            yield node, ast.Pass()


def replaced(node: ast.AST, **fields: object) -> ast.AST:
    found = copy.copy(node)
    for name, value in fields.items():
        setattr(found, name, value)
    return found


def nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of code that runs: no types, no text of strings, nothing under TYPE_CHECKING."""
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)):
        return
    yield node
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and name not in SKIPPED:
                yield from nodes(child)


def mutants_of(file: Path) -> Iterator[Mutant]:
    """Yield all mutants of a file."""
    source = (ROOT / file).read_bytes()
    starts = [0, *itertools.accumulate(map(len, source.splitlines(keepends=True)))]
    for node in nodes(ast.parse(source)):
        for old, new in changed(node):
            begin = starts[old.lineno - 1] + old.col_offset
            end = starts[old.end_lineno - 1] + old.end_col_offset
            whole = f"({ast.unparse(new)})" if isinstance(new, ast.expr) else ast.unparse(new)
            text = (source[:begin] + whole.encode() + source[end:]).decode()
            yield Mutant(file, old.lineno, source[begin:end].decode(), whole, text)


def draw(packages: list[str], count: int, seed: int) -> list[Mutant]:
    """Return random mutants, each equally likely."""
    files = sorted(
        file.relative_to(ROOT) for package in packages for file in (ROOT / PACKAGE / package).rglob("*.py")
    )
    found = [mutant for file in files for mutant in mutants_of(file)]
    return random.Random(seed).sample(found, min(count, len(found)))


def stages(mutant: Mutant) -> dict[str, list[str]]:
    """Return the arguments of pytest for each run of tests, by its name."""
    package = mutant.file.parts[2]
    of_pairs_and_robots = ["test_contract.py", "mechanism"] if package in {"equations", "plans"} else []
    own = [path for name in (package, *of_pairs_and_robots) if (ROOT / (path := f"tests/{name}")).exists()]
    others = {"fast tests of others": ["-n", "0", *(f"--ignore={path}" for path in own)]}
    if not own:  # of single modules
        return others
    return {"its package": [*own, "-n", "0"], "its slow tests": [*own, "-n", "0", "-m", "slow"], **others}


def noticed(mutant: Mutant, tree: Path, number: int) -> str:
    """Return which run of tests notices a mutant, or nothing."""
    target = tree / mutant.file
    original = target.read_bytes()
    target.write_text(mutant.text, encoding="utf-8")
    os.utime(target, (number, number))  # or Python takes the bytecode of another mutant of this second
    try:
        for name, arguments in stages(mutant).items():
            if fails(tree, arguments):
                return name
    finally:
        target.write_bytes(original)
    return ""


def fails(tree: Path, arguments: list[str]) -> bool:
    command = [str(Path(sys.executable).with_name("pytest")), "-q", "-x", *arguments]
    environment = os.environ | {"PYTHONPATH": str(tree / "src"), "PYTHONDONTWRITEBYTECODE": ""}
    environment["HINGEPAIR_CACHE"] = str(tree / "kernels")  # by the digest of the sources: kept from mutant to mutant
    with (
        (tree / "output.txt").open("w") as output,
        subprocess.Popen(
            command, cwd=tree, env=environment, stdout=output, stderr=output, start_new_session=True
        ) as process,
    ):
        try:
            return process.wait(HANG) != 0
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("packages", nargs="*", metavar="PACKAGE", help="of src/hingepair; all if none is named")
    parser.add_argument("--count", type=int, default=20, help="number of mutants")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument("--jobs", type=int, default=1, help="mutants that are tested at a time")
    parser.add_argument("--list", action="store_true", help="print the mutants, and test none")
    options = parser.parse_args()
    mutants = draw(options.packages or [""], options.count, options.seed)
    if options.list:
        print(*mutants, sep="\n")
        return
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.jobs) as pool:
        trees: queue.Queue[Path] = queue.Queue()
        for number in range(options.jobs):
            tree = Path(folder) / str(number)
            ignored = shutil.ignore_patterns(".git", ".venv*", ".*_cache", ".hypothesis", "_build", "__pycache__")
            shutil.copytree(ROOT, tree, ignore=ignored, symlinks=True)
            trees.put(tree)
        if fails(tree, ["-n", str(options.jobs)]):
            sys.exit("the tests fail without a mutant:\n" + (tree / "output.txt").read_text())

        def test(numbered: tuple[int, Mutant]) -> tuple[Mutant, str]:
            tree = trees.get()
            try:
                return numbered[1], noticed(numbered[1], tree, numbered[0])
            finally:
                trees.put(tree)

        for mutant, name in pool.map(test, enumerate(mutants, 1)):
            found[name] += 1
            print(f"{f'noticed by {name}' if name else 'SURVIVES'}: {mutant}", flush=True)
    killed = found.total() - found[""]
    print(f"{killed} of {found.total()} noticed ({killed / max(found.total(), 1):.0%}):", dict(found))


if __name__ == "__main__":
    main()
