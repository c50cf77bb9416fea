"""Motion by rates that are samples in a file.

[motion]
file = "gyro.csv"                # columns t, omega1_x, omega1_y, omega1_z, psid; as far as known also x, v1_x, a1_x,
integrate = true                 # ..., alpha1_x, ..., psidd (`hingepair.scenes.log_file`); R1 = 0 without x, y, z
differentiate = true             # optional: find the derivatives that the file lacks
S1_0 = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]  # optional; psi_0, frame, method as in `scenes.rate_expressions`
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from hingepair.errors import ArgumentError
from hingepair.integration.signals import Samples
from hingepair.numeric.finite_differences import check_instants, differentiate
from hingepair.scenes.integrated_motion import START, Float64Array, IntegratedMotion, integrated_in_space
from hingepair.scenes.log_file import ARRAYS, Columns, SampleFile
from hingepair.scenes.tables import Table

ORDER: Final = 6
"""Of the derivatives of samples."""

_NAMES: Final = ("omega1", "psid", "alpha1", "psidd", "R1", "v1", "a1")
_COLUMNS: Final = {name: ARRAYS.get(name, (name,)) for name in _NAMES}


def read_rate_file(table: Table, folder: Path) -> IntegratedMotion:
    """The motion whose rates are in the file that the table [motion] names.

    Raises:
        SceneError: a key of the table, the file or one of its columns cannot be used; names it.
        MissingDependencyError: the file is a .parquet and pyarrow is not installed.
    """
    table.check_keys((*START, "S1_0", "frame", "file", "integrate", "differentiate"))
    completed = table.values.get("differentiate", False)
    if not isinstance(completed, bool):
        table.fail("differentiate", "true or false")
    file = SampleFile(folder / table.text("file"))
    columns = file.columns()
    for column in columns:
        if column != "t" and not any(column in own for own in _COLUMNS.values()):
            file.fail(column, "columns of rates and of R1, since motion.integrate is true", "a column")
    if "t" not in columns:
        file.fail("t", "a column", "no such column")
    known = _arrays(file, columns)
    try:
        t = check_instants("t", columns["t"], ORDER if completed else 0)
    except ArgumentError as error:
        file.fail("t", error.expected, error.got)
    if completed:
        known = _completed(t, known)
    if "v1" not in known:
        file.fail("v1_x", "a column beside x (or differentiate = true)", "no such column")
    signals = Samples(t, known["omega1"]), Samples(t, known["psid"])
    return integrated_in_space(table, t, signals, known, None)


def _arrays(file: SampleFile, columns: Columns) -> dict[str, Float64Array]:
    """What the file has, by name; a body 1 that stays at the origin where it has no R1."""
    found = {}
    for name, own in _COLUMNS.items():
        array = file.together(columns, own, required=name in {"omega1", "psid"})
        if array is not None:
            found[name] = array if len(own) > 1 else array[:, 0]
    for name in ("omega1", "psid"):
        bad = np.argwhere(~np.isfinite(found[name].reshape(len(columns["t"]), -1)))
        if bad.size:
            sample, i = bad[0]
            file.fail(_COLUMNS[name][i], "finite numbers, to be integrated", f"nan or inf at sample {sample}")
    if "R1" not in found:
        found |= dict.fromkeys(("R1", "v1", "a1"), np.zeros((len(columns["t"]), 3)))
    return found


def _completed(t: Float64Array, known: dict[str, Float64Array]) -> dict[str, Float64Array]:
    """The same with the derivatives that are missing."""
    found = dict(known)
    for names in (("omega1", "alpha1"), ("psid", "psidd"), ("v1", "a1") if "v1" in known else ("R1", "v1", "a1")):
        if not found.keys() >= set(names):
            columns = found[names[0]].reshape(t.size, -1).T
            each = zip(*(differentiate(t, column, ORDER) for column in columns), strict=True)
            shape = found[names[0]].shape
            for name, derivative in zip(names[1:], each, strict=False):
                found.setdefault(name, np.stack(derivative, axis=-1).reshape(shape))
    return found
