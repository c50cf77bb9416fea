"""Results of a call: arrays by name, with an attribute for each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, UnknownOutputError, choices, nearest, quoted
from hingepair.numeric.arrays import FloatArray, read_only, real_array
from hingepair.tables.data_frames import data_frame, dataset, sample_rows
from hingepair.tables.sheets import Sheet, Shown, sheet_of
from hingepair.tables.units import Columns, Units


class Results(Shown):
    """Results of a call by name: read-only NumPy arrays, or arrays of another library. They are available as
    results[name] and, for the names in the class's `__slots__`, as attributes.

    Args:
        arrays: the results by name, each of shape (*shape, ...).
        shape: leading shape of the samples; () for one state.
    """

    __slots__ = ("_content",)

    _content: tuple[tuple[str, ...], tuple[Any, ...], tuple[int, ...]]  # names, arrays, shape

    def __init__(self, arrays: Mapping[str, Any], shape: tuple[int, ...]) -> None:
        _set_attribute(self, "_content", (tuple(arrays), tuple(arrays.values()), shape))

    @classmethod
    def maker(cls, outputs: Iterable[tuple[str, tuple[int, ...]]]) -> Callable[..., Any]:
        """Return a function that makes results quickly: of the arrays in a tuple, their leading shape, and whether
        they are read-only already. `outputs` are names and shapes of one sample.
        """
        names, tails = zip(*outputs, strict=True)
        new, set_content = cls.__new__, Results.__dict__["_content"].__set__
        slots = [(k, cls.__dict__[name].__set__) for k, name in enumerate(names) if name in cls.__slots__]
        has_numbers = () in tails

        def make(arrays: tuple[Any, ...], shape: tuple[int, ...], frozen: bool) -> Any:
            made = new(cls)
            set_content(made, (names, arrays, shape))
            if frozen and (shape or not has_numbers):  # else each is made when it is asked for
                for k, put in slots:
                    put(made, arrays[k])
            return made

        return make

    @property
    def shape(self) -> tuple[int, ...]:
        """Leading shape of every output; () for one state."""
        return self._content[2]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the computed outputs."""
        return self._content[0]

    def arrays(self) -> dict[str, FloatArray]:
        """Return the outputs by name: read-only arrays, or a NumPy number where the output is a single number."""
        return {name: self._output(name) for name in self._content[0]}

    def to_dataframe(self, units: str | None = None) -> Any:
        """Return a pandas DataFrame with a row for each sample, and the columns that saved results have: R2_x of
        vectors, S2_xy of matrices, psi of numbers. `attrs["units"]` holds the units by name.

        Args:
            units: units in place of SI units, such as "deg, mm"; the headings then say the units: "R2_x [mm]".

        Raises:
            ArgumentError: the samples have more than one axis, the arrays are not in memory, or a unit is unknown.
            MissingDependencyError: pandas is not installed.
        """
        columns = Columns(Units.of(units), self._unit)
        if len(self.shape) > 1:
            raise ArgumentError("to_dataframe", "one sample, or samples along one axis", f"shape {self.shape}")
        recorded = {name: real_array(name, array) for name, array in self._recorded().items()}
        return data_frame(sample_rows(recorded, len(self.shape)), columns, type(self).__name__)

    def to_xarray(self, units: str | None = None) -> Any:
        """Return an xarray Dataset with a variable for each output, named as the columns of `to_dataframe` begin.

        The samples have the dimension `sample`, or sample_0, sample_1, ...; a vector has `xyz` or `xy`, a matrix
        `xyz` for its rows (world axes) and `body_xyz` for its columns.

        Args:
            units: units in place of SI units, such as "deg, mm"; the names stay as they are.

        Raises:
            ArgumentError: a unit is unknown.
            MissingDependencyError: xarray is not installed.
        """
        axes = len(self.shape)
        leading = ("sample",) if axes == 1 else tuple(f"sample_{k}" for k in range(axes))
        recorded = {name: real_array(name, array) for name, array in self._recorded().items()}
        return dataset(recorded, leading, Columns(Units.of(units), self._unit), type(self).__name__)

    def _recorded(self) -> dict[str, Any]:
        """Return the outputs by the names that tables have: numbers, vectors and small matrices for each sample."""
        return dict(self.arrays())

    def _unit(self, name: str) -> str:
        """Return the SI unit of an array of `_recorded`, or of one of its components."""
        return unit_of(name)

    def __getitem__(self, name: str) -> FloatArray:
        """Return an output by its name; outputs that are not attributes of the class are available here only.

        Raises:
            UnknownOutputError: the output was not computed.
        """
        names = self._content[0]
        if name not in names:
            raise UnknownOutputError("output", choices(names) + nearest(str(name), names), quoted(name))
        return self._output(name)

    def _output(self, name: str) -> FloatArray:
        names, arrays, _ = self._content
        array: FloatArray = _user_view(arrays[names.index(name)])
        return array

    if not TYPE_CHECKING:  # a type checker knows the outputs by the annotations, and reports all other names

        def __getattr__(self, name: str) -> Any:
            """Return an output that is accessed for the first time, or None if it was not computed."""
            array = self._output(name) if name in self._content[0] else None
            if name in type(self).__slots__:
                _set_attribute(self, name, array)
            elif array is None:
                raise missing_attribute_error(self, name)
            return array

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{name}: a {type(self).__name__} cannot be changed")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"{name}: a {type(self).__name__} cannot be changed")

    def __dir__(self) -> list[str]:
        missing = {name for name in type(self).__slots__ if getattr(self, name, None) is None}
        return [name for name in object.__dir__(self) if name not in missing and not name.startswith("_")]

    def __repr__(self) -> str:
        names = ", ".join(self.outputs)
        return f"{type(self).__name__}(shape={self.shape}, outputs=({names}))"

    def _sheet(self) -> Sheet:
        return sheet_of(f"{type(self).__name__}, shape {self.shape}", self.arrays().items())

    def __reduce__(self) -> tuple[type[Self], tuple[dict[str, FloatArray], tuple[int, ...]]]:
        return type(self), (self.arrays(), self.shape)


_set_attribute = object.__setattr__


def writable_arrays(results: Results) -> dict[str, FloatArray]:
    """Return the arrays of results that no user holds, which become writable in place; numbers become arrays."""
    names, arrays, _ = results._content
    for array in arrays:
        for part in (getattr(array, "base", None), array):
            if isinstance(part, np.ndarray) and not part.flags.writeable:
                part.flags.writeable = True
    return {name: np.array(a) if isinstance(a, np.generic) else a for name, a in zip(names, arrays, strict=True)}


def _user_view(array: Any) -> Any:
    """Return what users see of an array of NumPy: a number if it has no axes, else a read-only view."""
    if not isinstance(array, np.ndarray):
        return array
    if array.ndim == 0:
        return array[()]
    return read_only(array) if array.flags.writeable else array


def missing_attribute_error(value: object, name: str) -> AttributeError:
    """Return an AttributeError which lists the attributes that exist, unless the name begins with an underscore."""
    existing = "" if name.startswith("_") else f"; it has {', '.join(dir(value))}"
    return AttributeError(f"{type(value).__name__} has no {name!r}{existing}", name=name, obj=value)
