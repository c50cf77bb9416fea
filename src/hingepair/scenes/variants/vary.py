"""Variants of a scene: numbers of the file that have other values, computed together where the library can."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body import Body
from hingepair.numeric.arrays import Float64Array, real_array
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.scenes.assembly import Acting, Arrays, Assembly, order_of
from hingepair.scenes.bodies import read_body, read_mechanism
from hingepair.scenes.motions.functions import read_function_motion
from hingepair.scenes.motions.known import PSI, Known
from hingepair.scenes.numbers import NumberPath, keep_motion, number_path, with_numbers, write_numbers
from hingepair.scenes.scene import Scene, load_scene, with_constants_evaluated
from hingepair.scenes.tables import Table
from hingepair.scenes.variants.reductions import check_reductions, reduce_arrays
from hingepair.symbolic.expressions import Expression
from hingepair.tables.units import Columns

MAX_STATES: Final = 200_000
"""States (variants times instants) that are computed at a time."""


def vary(
    scene: Scene | str | Path,
    values: Mapping[str, ArrayLike],
    outputs: Iterable[str] | None = None,
    *,
    reduce: Iterable[str] = (),
    units: str | None = None,
) -> Any:
    """Compute a scene for all combinations of values of its numbers.

    Variants that differ in geometry, masses or constants of the motion are computed together. A variant that cannot
    be computed is NaN, and does not end the others.

    Args:
        scene: a Scene, or the path of its file.
        values: values by the key of a number in the scene file, such as "pair.u1[0]", "pair.body2.mass",
            "constants.speed", "joint[1].u1[2]" or "dynamics.psi.damping"; shape (n,) each.
        outputs: names of outputs, as for `Scene.evaluate`, and of forces such as "hinge_torque"; by default those of
            the scene.
        reduce: what is kept of each component over the instants, such as "absmax", "last" or "t_below(0.1)"; all
            instants by default.
        units: units of the results in place of SI units, such as "deg, mm"; by default those of the scene.

    Returns:
        An xarray.Dataset: an axis for each key, then `time` unless `reduce` is given, and the components of vectors
        and matrices. `reason`, an array of texts over the keys, says why a variant is NaN.

    Raises:
        ArgumentError: a key leads to no number of the scene, or an output is unknown.

    >>> import hingepair as hp
    >>> values = {"pair.u1[0]": [0.3, 0.4], "pair.body2.mass": [20, 25, 30]}
    >>> found = hp.vary("models/landing_gear.toml", values, ["R2"])
    >>> dict(found.sizes)
    {'pair.u1[0]': 2, 'pair.body2.mass': 3, 'time': 2401, 'xyz': 3}
    """
    from hingepair.numeric.optional import require
    from hingepair.tables.data_frames import dataset

    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    if not isinstance(values, Mapping) or not values:
        raise ArgumentError("values", 'values by key, such as {"pair.u1[0]": [0.3, 0.4]}', quoted(values))
    axes = {}
    for key, own in values.items():
        axes[key] = real_array(f"values[{key!r}]", own).astype(np.float64).ravel()
    reductions = check_reductions("reduce", reduce)
    variants = Variants(scene, tuple(axes), None if outputs is None else tuple(outputs))
    numbers = np.stack([axis.ravel() for axis in np.meshgrid(*axes.values(), indexing="ij")], axis=-1)
    shape, columns = tuple(map(len, axes.values())), scene.in_units(units)
    xarray = require("xarray", "hp.vary")
    batches = variants.batches(numbers)
    if reductions:
        parts = [(batch.reduced(reductions, columns), batch.reasons) for batch in batches]
        found = {name: np.concatenate([own[name] for own, _ in parts]).reshape(shape) for name in parts[0][0]}
        data = xarray.Dataset({name: (tuple(axes), array) for name, array in found.items()})
    else:
        done = [*batches]
        longest = max((batch.t for batch in done), key=len)
        alike = all(np.array_equal(batch.t, longest) for batch in done)
        parts = [(batch.arrays | ({} if alike else {"t": batch.t[None]}), batch.reasons) for batch in done]
        whole = {name: np.concatenate([_padded(own[name], len(longest)) for own, _ in parts]) for name in parts[0][0]}
        whole = {name: array.reshape(*shape, *array.shape[1:]) for name, array in whole.items()}
        data = dataset(whole, (*axes, "time"), columns, f"{scene.title}, varied", longest if alike else None)
    reasons = [reason for _, own in parts for reason in own]
    data["reason"] = (tuple(axes), np.array(reasons, dtype=object).reshape(shape))
    return data.assign_coords(axes)


def _padded(array: NDArray[Any], count: int) -> NDArray[Any]:
    """Return an array (variants, samples, ...) with NaN behind its end, up to `count` samples."""
    widths = [(0, 0), (0, count - array.shape[1]), *[(0, 0)] * (array.ndim - 2)]
    return np.pad(array, widths, constant_values=np.nan) if count > array.shape[1] else array


@dataclass(frozen=True, slots=True)
class Batch:
    """Variants that were computed together."""

    t: Float64Array  # instants [s]; (samples,)
    arrays: Arrays  # outputs by name; (variants, samples, ...)
    reasons: list[str]  # why a variant is NaN, at some instants or at all; otherwise empty

    def reduced(self, reductions: Sequence[str], columns: Columns) -> dict[str, Float64Array]:
        """Return the reductions of each component, (variants,) each, in units."""
        return reduce_arrays(self.t, self.arrays, reductions, columns)


class Variants:
    """Computer of the outputs of a scene for any values of some of its numbers.

    Args:
        scene: the scene.
        keys: keys of the numbers.
        outputs: names of the outputs to compute for each variant; None for all that the scene has.
    """

    def __init__(self, scene: Scene, keys: Sequence[str], outputs: Sequence[str] | None) -> None:
        entry = Table("values", "", {}, {})
        self.scene, self.keys = scene, tuple(keys)
        self.outputs = None if outputs is None else tuple(outputs)
        self._warned: dict[Any, Any] = {}  # warnings of its scenes, each of which is given once
        self.paths = [number_path(entry, scene.tables.values, key) for key in keys]
        if self.outputs is not None:
            scene.request(self.outputs)

    def scene_of(self, numbers: Sequence[float]) -> Scene:
        """Return the scene with these numbers."""
        return self.scene.changed(self.paths, numbers)

    def batches(self, numbers: Float64Array) -> Iterator[Batch]:
        """Yield the results of variants, `numbers` (variants, keys), in their order."""
        step = max(1, MAX_STATES // self.scene.samples)
        for start in range(0, len(numbers), step):
            rows = numbers[start : start + step]
            batch = self._together(rows)
            yield from map(self._one, rows.tolist()) if batch is None else [batch]

    def compute(self, numbers: Sequence[float]) -> Batch:
        """Return the results of one variant; refuse one that cannot be computed."""
        return self._of_scene(self.scene_of(numbers))

    def _of_scene(self, scene: Scene) -> Batch:
        """Return the results of a scene; warnings on results that are NaN at some instants become its reason."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            arrays = {name: array[None] for name, array in scene.arrays(self.outputs).items()}
        reasons = [str(one.message) for one in caught if re.search("are NaN|beyond its stroke", str(one.message))]
        for one in caught:
            if str(one.message) not in reasons:
                warnings.warn_explicit(one.message, one.category, one.filename, one.lineno, registry=self._warned)
        return Batch(scene.t, arrays, ["; ".join(dict.fromkeys(reasons))])

    def _one(self, numbers: Sequence[float]) -> Batch:
        """Return the results of one variant; NaN and the reason if it cannot be computed."""
        try:
            return self.compute(numbers)
        except ArgumentError as error:
            lost = {name: np.full(array.shape, np.nan) for name, array in self._plain.arrays.items()}
            return Batch(self._plain.t, lost, [str(error)])

    @lock_free_cached_property
    def _plain(self) -> Batch:
        """The scene as its file describes it."""
        return self._of_scene(self.scene)

    # ---- variants together

    def _together(self, numbers: Float64Array) -> Batch | None:
        """Compute variants in one call; None where they must be computed one by one."""
        if self.scene.motion.simulated is not None:
            return None
        try:
            return self._of_assemblies(numbers) if keep_motion(self.paths) else self._of_motions(numbers)
        except ArgumentError:  # of some variant: found again one by one
            return None

    def _of_motions(self, numbers: Float64Array) -> Batch | None:
        """Compute variants whose motions differ: the numbers are symbols of the expressions, and their instants those
        of one long motion. None if the scene needs them elsewhere, or if a variant is NaN, which by itself says why.
        """
        scene, level = self.scene, self.scene.motion.level
        names = [f"_varied_{k}" for k in range(len(self.paths))]
        values = with_numbers(scene.tables.values, self.paths, names)
        tables = replace(scene.tables, values=values, constants={name: Expression(name) for name in names})
        try:
            tables = with_constants_evaluated(tables)
            _ = Scene(tables, scene.path).dynamics
            source: Any = read_function_motion(tables, scene.assembly).source
        except (ArgumentError, TypeError):  # a symbol is no number
            return None
        given = {name: np.repeat(column, scene.samples) for name, column in zip(names, numbers.T, strict=True)}
        known = source.at(np.tile(scene.t, len(numbers)), level, given)
        arrays = self._arrays(scene.assembly, known)
        if not all(np.isfinite(own).all() for own in arrays.values()):
            return None
        shape = (len(numbers), scene.samples)
        arrays = {name: own.reshape(*shape, *own.shape[1:]) for name, own in arrays.items()}
        return Batch(scene.t, arrays, [""] * len(numbers))

    def _arrays(self, assembly: Assembly, known: Known) -> Arrays:
        """Return the outputs, and forces, of an assembly along a known motion."""
        scene, request = self.scene, self.scene.request(self.outputs)
        part = known.part(slice(None), order_of(request))
        return assembly.compute(request, part, Acting(scene.motion, slice(None), scene.gravity), "auto").arrays

    def _of_assemblies(self, numbers: Float64Array) -> Batch | None:
        """Compute variants along one motion, whose geometry and masses are arrays with an axis of variants; None if
        they differ in more than vectors and bodies of a pair, or in payloads.
        """
        scene = self.scene
        places = dict.fromkeys(path[: 2 if path[0] == "pair" else 3] for path in self.paths)
        if any(place[:2] not in _ARRAYS for place in places):
            return None
        varied, rows = with_numbers(scene.tables.values, self.paths, numbers[0]), []
        for row in numbers.tolist():
            write_numbers(varied, self.paths, row)
            rows.append([_read_place(replace(scene.tables, values=varied), place) for place in places])
        found = dict(zip(places, zip(*rows, strict=True), strict=True))
        vectors = {str(place[1]): np.array(own)[:, None] for place, own in found.items() if place[1] in _VECTORS}
        bodies = {str(place[-1]): own for place, own in found.items() if place[1] not in _VECTORS}
        assembly = scene.assembly
        if vectors:
            assembly = Assembly(replace(assembly.pair, **vectors))
        if bodies and assembly.pair is not None:
            bare = Assembly(replace(assembly.pair, **dict.fromkeys(bodies, _MASSLESS))).robot.with_base(
                assembly.robot.base
            )
            links = {"body1": bare.links[0], "body2": PSI[0]}
            assembly = Assembly(assembly.pair)
            assembly.robot = _with_payloads(bare, {links[body]: own for body, own in bodies.items()})
        elif bodies:
            assembly = Assembly(_with_payloads(self._without_payloads([*bodies]), bodies), scene.frames)
        arrays, plain = self._arrays(assembly, scene.known(slice(None), scene.motion.level)), self._plain.arrays
        whole = {name: np.broadcast_to(own, (len(numbers), *plain[name].shape[1:])) for name, own in arrays.items()}
        return Batch(scene.t, whole, [""] * len(numbers))

    def _without_payloads(self, links: Sequence[str]) -> Any:
        """Return the robot without the payloads of some links."""
        tables = self.scene.tables
        mechanism = dict(tables.values["mechanism"])
        mechanism["payload"] = {link: own for link, own in mechanism["payload"].items() if link not in links}
        tables = replace(tables, values={**tables.values, "mechanism": mechanism})
        return read_mechanism(tables, self.scene.path.parent, base=self.scene.assembly.robot.base)


_MASSLESS: Final = Body(1e-200, inertia=(1e-200,) * 3)  # nothing beside the bodies that are added to it
_VECTORS: Final = ("u1", "u2", "n")
_ARRAYS: Final = {("mechanism", "payload"), *(("pair", key) for key in (*_VECTORS, "body1", "body2"))}


def _read_place(tables: Table, place: NumberPath) -> Any:
    """Return the vector or the body of a scene at a place such as ("pair", "u1")."""
    *outer, key = map(str, place)
    for name in outer:
        tables = tables.table(name)
    return tables.numbers(key, len(tables.values[key])) if place[1] in _VECTORS else read_body(tables, key)


def _with_payloads(robot: Any, bodies: Mapping[str, Sequence[Any]]) -> Any:
    """Return the robot with a body for each variant at each of these links."""
    for link, own in bodies.items():
        keys = ("mass", "centre_of_mass", "inertia")
        robot = robot.with_payload(
            link, **{key: np.array([getattr(body, key) for body in own])[:, None] for key in keys}
        )
    return robot


def lost_variants(keys: Sequence[str], numbers: Float64Array, reasons: Sequence[str]) -> str:
    """Return a sentence on how many variants cannot be computed, and why the first cannot; empty without any."""
    lost = [k for k, reason in enumerate(reasons) if reason]
    if not lost:
        return ""
    first = ", ".join(f"{key} = {value:.6g}" for key, value in zip(keys, numbers[lost[0]], strict=True))
    which = f"{len(lost)} of {len(reasons)} variants cannot be computed, or not at all instants"
    return f"{which}, the first with {first}: {reasons[lost[0]]}"
