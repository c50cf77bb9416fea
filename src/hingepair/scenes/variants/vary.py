"""Variants of a scene: numbers of the file that have other values, computed together where the library can."""

from __future__ import annotations

import functools
import json
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import Float64Array, real_array
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.scenes.bodies import read_body, read_mechanism
from hingepair.scenes.load import load_scene, read_subject, scene_from_tables, with_constants_evaluated
from hingepair.scenes.motions.dynamics import read_dynamics
from hingepair.scenes.motions.functions import read_function_motion
from hingepair.scenes.motions.known import Known
from hingepair.scenes.numbers import keep_motion, number_path, with_numbers
from hingepair.scenes.scene import Scene
from hingepair.scenes.subject import Acting, Arrays, Subject, order_of
from hingepair.scenes.tables import Table
from hingepair.scenes.variants.reductions import Touches, check_reductions, reduce_arrays, touches_of
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
    client: Any = None,
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
        client: `dask.distributed.Client` on whose cluster the variants are computed; by default this process does.

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
    batches = variants.batches(numbers) if client is None else _on_cluster(client, variants, numbers)
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
    touches: list[Touches]  # of each variant: coordinates at impacts, which lie between the instants

    def reduced(self, reductions: Sequence[str], columns: Columns) -> dict[str, Float64Array]:
        """Return the reductions of each component, (variants,) each, in units."""
        return reduce_arrays(self.t, self.arrays, reductions, columns, self.touches)


def _on_cluster(client: Any, variants: Variants, numbers: Float64Array) -> Iterator[Batch]:
    """Yield the results of variants in their order, computed on the cluster of a Dask client."""
    parts = np.array_split(numbers, min(len(numbers), 4 * max(len(client.scheduler_info()["workers"]), 1)))
    for future in client.map(_all_batches, [variants] * len(parts), parts, pure=False):
        yield from future.result()


def _all_batches(variants: Variants, numbers: Float64Array) -> list[Batch]:
    return [*variants.batches(numbers)]


@functools.lru_cache(4)
def _variants_again(path: str, tables: str, keys: tuple[str, ...], outputs: tuple[str, ...] | None) -> Variants:
    """Return the computer of variants of a scene from the JSON text of its tables."""
    values = with_constants_evaluated(Table(path, "", json.loads(tables), {}))
    return Variants(scene_from_tables(values, Path(path)), keys, outputs)


class Variants:
    """Computer of the outputs of a scene for any values of some of its numbers. A process to which it is sent reads
    the scene once.

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

    def __reduce__(self) -> tuple[Any, ...]:
        tables = json.dumps(self.scene.tables.values, default=str)  # in the order of the file
        return _variants_again, (str(self.scene.path.absolute()), tables, self.keys, self.outputs)

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
        return Batch(scene.t, arrays, ["; ".join(dict.fromkeys(reasons))], [touches_of(scene.motion)])

    def _one(self, numbers: Sequence[float]) -> Batch:
        """Return the results of one variant; NaN and the reason if it cannot be computed."""
        try:
            return self.compute(numbers)
        except ArgumentError as error:
            lost = {name: np.full(array.shape, np.nan) for name, array in self._plain.arrays.items()}
            return Batch(self._plain.t, lost, [str(error)], [{}])

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
            return self._of_subjects(numbers) if keep_motion(self.paths) else self._of_motions(numbers)
        except ArgumentError:  # of some variant: found again one by one
            return None

    def _of_motions(self, numbers: Float64Array) -> Batch | None:
        """Compute variants whose motions differ: the numbers are symbols of the expressions, and their instants those
        of one long motion. None if the scene needs them elsewhere, or if a variant is NaN, which by itself says why.
        """
        scene, level = self.scene, self.scene.motion.level
        names = [f"_varied_{k}" for k in range(len(self.paths))]
        values = with_numbers(scene.tables.values, self.paths, names)
        tables = replace(scene.tables, values=values, constants={name: Expression(name) for name in names}, let={})
        try:
            tables = with_constants_evaluated(tables)
            read_dynamics(tables, read_subject(tables, scene.path.parent))
            source: Any = read_function_motion(tables, scene.subject).source
        except (ArgumentError, TypeError):  # a symbol is no number
            return None
        given = {name: np.repeat(column, scene.samples) for name, column in zip(names, numbers.T, strict=True)}
        known = source.at(np.tile(scene.t, len(numbers)), level, given)
        arrays = self._arrays(scene.subject, known, self.outputs)
        if not all(np.isfinite(own).all() for own in arrays.values()):
            return None
        shape = (len(numbers), scene.samples)
        arrays = {name: own.reshape(*shape, *own.shape[1:]) for name, own in arrays.items()}
        return Batch(scene.t, arrays, [""] * len(numbers), [{}] * len(numbers))

    def _arrays(self, subject: Subject, known: Known, names: tuple[str, ...] | None, backend: str = "auto") -> Arrays:
        """Return the outputs, and forces, of a subject along a known motion."""
        scene, request = self.scene, self.scene.request(names)
        part = known.part(slice(None), order_of(request))
        return subject.compute(request, part, Acting(scene.motion, slice(None), scene.gravity), backend).arrays

    @lock_free_cached_property
    def _known(self) -> Known:
        return self.scene.known(slice(len(self.scene.t)), self.scene.motion.level)

    def _of_subjects(self, numbers: Float64Array) -> Batch | None:
        """Compute variants along one motion that differ in geometry or masses."""
        subject = self.scene.subject
        arrays = self._of_pairs(numbers) if subject.pair is not None else self._of_payloads(numbers)
        if arrays is None:
            return None
        plain = self._plain.arrays
        whole = {name: np.broadcast_to(own, (len(numbers), *plain[name].shape[1:])) for name, own in arrays.items()}
        return Batch(self.scene.t, whole, [""] * len(numbers), [{}] * len(numbers))

    def _of_pairs(self, numbers: Float64Array) -> Arrays | None:
        """Return the outputs of pairs that differ in components of u1, u2 and n, and in masses, in which forces are
        linear.
        """
        pair: Any = self.scene.pair
        geometry: dict[str, NDArray[Any]] = {}
        masses: dict[str, int] = {}
        for column, path in enumerate(self.paths):
            if len(path) == 3 and path[1] in ("u1", "u2", "n") and isinstance(path[2], int):
                own = self._written(str(path[1]))
                array = geometry.setdefault(str(path[1]), np.tile(own, (len(numbers), 1)))
                array[:, path[2]] = numbers[:, column]
            elif len(path) == 3 and path[1] in ("body1", "body2") and path[2] == "mass":
                masses[str(path[1])] = column
            else:
                return None
        pair = replace(pair, **{key: array[:, None] for key, array in geometry.items()}) if geometry else pair
        known, names = self._known, self.outputs
        if not masses:
            return self._arrays(Subject(pair), known, names)
        table = self.scene.tables.table("pair")
        ends = {body: (numbers[:, column].min(), numbers[:, column].max()) for body, column in masses.items()}

        def with_masses(**chosen: float) -> Arrays:
            bodies = {
                body: read_body(replace(table, values={body: {**table.values[body], "mass": chosen[body]}}), body)
                for body in masses
            }
            return self._arrays(Subject(replace(pair, **bodies)), known, names)

        least = {body: own[0] for body, own in ends.items()}
        base = with_masses(**least)
        arrays = dict(base)
        for body, column in masses.items():
            low, high = ends[body]
            if low == high:
                continue
            other = with_masses(**(least | {body: high}))
            share = (numbers[:, column] - low) / (high - low)
            for name, array in base.items():
                slope = other[name] - array
                if slope.any():
                    lead = share.reshape(-1, *[1] * (max(array.ndim, 1 + self._ndim(name)) - 1))
                    arrays[name] = arrays[name] + lead * slope
        return arrays

    def _ndim(self, name: str) -> int:
        """Return the number of axes of an output with an axis of instants."""
        return self._plain.arrays[name].ndim - 1

    def _written(self, key: str) -> Float64Array:
        """Return u1, u2 or n as the file has it."""
        table = self.scene.tables.table("pair")
        return np.array(table.numbers(key, len(table.values[key])))

    def _of_payloads(self, numbers: Float64Array) -> Arrays | None:
        """Return the outputs of robots that differ in payloads."""
        if any(path[:2] != ("mechanism", "payload") for path in self.paths):
            return None
        values, links = self.scene.tables.values, dict.fromkeys(str(path[2]) for path in self.paths)
        others = {link: own for link, own in values["mechanism"]["payload"].items() if link not in links}
        mechanism = {**values["mechanism"], "payload": others}
        tables = replace(self.scene.tables, values={**values, "mechanism": mechanism})
        robot = read_mechanism(tables, self.scene.path.parent, base=self.scene.subject.robot.base)
        variants = [replace(tables, values=with_numbers(values, self.paths, row)) for row in numbers.tolist()]
        for link in links:
            bodies = [read_body(variant.table("mechanism").table("payload"), link) for variant in variants]
            robot = robot.with_payload(
                link,
                mass=np.array([body.mass for body in bodies])[:, None],
                centre_of_mass=np.array([body.centre_of_mass for body in bodies])[:, None],
                inertia=np.array([body.inertia for body in bodies])[:, None],
            )
        # By name, since "auto" would choose by the number of variants in a chunk, on which no bit may hang.
        return self._arrays(Subject(robot, self.scene.frames), self._known, self.outputs, "compiled")


def lost_variants(keys: Sequence[str], numbers: Float64Array, reasons: Sequence[str]) -> str:
    """Return a sentence on how many variants cannot be computed, and why the first cannot; empty without any."""
    lost = [k for k, reason in enumerate(reasons) if reason]
    if not lost:
        return ""
    first = ", ".join(f"{key} = {value:.6g}" for key, value in zip(keys, numbers[lost[0]], strict=True))
    which = f"{len(lost)} of {len(reasons)} variants cannot be computed, or not at all instants"
    return f"{which}, the first with {first}: {reasons[lost[0]]}"
