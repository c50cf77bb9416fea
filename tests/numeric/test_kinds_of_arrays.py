"""Arrays of other libraries, told from NumPy's and from what is no array."""

from __future__ import annotations

import array_api_strict as strict
import numpy as np
import pytest

import hingepair as hp
from hingepair.numeric.array_libraries import (
    apply_function,
    check_sample_shape,
    foreign_components,
    is_foreign,
    library_of,
    where_less,
)

A = strict.asarray([[0.25, 1.0], [2.0, -3.0]])


def test_what_is_of_another_library() -> None:
    assert is_foreign(A)
    for value in (np.zeros(2), np.float64(1), 1.0, 1, 1j, "a", b"a", [1], (1,), {}, None, object(), np.zeros):
        assert not is_foreign(value)


def test_the_library_of_arguments_is_found_with_its_dtype_and_name() -> None:
    assert library_of({"q": np.zeros(7), "qd": 1.0, "qdd": None}) is None
    assert library_of({}) is None
    single = strict.asarray([1.0], dtype=strict.float32)
    library = library_of({"a": 1.0, "q": single, "qd": None})
    assert (library.name, library.dtype) == ("array_api_strict", strict.float32)
    assert library_of({"q": single, "qd": A}).dtype == strict.float64
    assert library.array(A) is A
    made = library.array(np.arange(2.0))
    assert is_foreign(made)
    assert made.dtype == strict.float32
    for constant in (np.zeros(2), np.float64(1.0), np.arange(2)):  # the dtype of NumPy's arrays does not count
        assert library_of({"q": constant, "qd": single}).dtype == strict.float32


def test_libraries_are_not_mixed() -> None:
    with pytest.raises(hp.ArgumentError, match="q: expected an array of array_api_strict, as qd is, or of NumPy"):
        library_of({"q": [0.0], "qd": A})
    with pytest.raises(hp.errors.DtypeError, match="q: expected float32 or float64"):
        library_of({"q": strict.asarray([1, 2])})


def test_components_are_taken_apart_and_joined() -> None:
    library = library_of({"A": A})
    assert [np.asarray(c).tolist() for c in foreign_components("A", A, 2)] == [[0.25, 2.0], [1.0, -3.0]]
    assert [float(c) for c in foreign_components("A", A, 2, 2)] == [0.25, 1.0, 2.0, -3.0]
    x, y = foreign_components("A", (A[0, :], 2), 2)
    assert x[0] == 0.25
    assert type(y) is float
    components = library.join_components((A[0, :], 5.0), (2,), (2,))
    assert np.asarray(components).tolist() == [[0.25, 5.0], [1.0, 5.0]]
    assert np.asarray(library.join_components((A[0, 0],), (2,), ())).tolist() == [0.25, 0.25]
    with pytest.raises(hp.ShapeError, match="A: expected a tuple of 3 components, got one of 2"):
        foreign_components("A", (A, A), 3)


def test_the_last_axes_are_checked() -> None:
    check_sample_shape("A", A, 2)
    check_sample_shape("A", A, 2, 2)
    for tail in ((3,), (2, 3), (2, 2, 2)):
        with pytest.raises(hp.ShapeError, match=r"A: expected shape \(..., .*got shape \(2, 2\)"):
            check_sample_shape("A", A, *tail)


def test_functions_are_those_of_the_library() -> None:
    x = np.asarray(A)
    for name, exact in {"sine": np.sin(x), "cosine": np.cos(x), "versine": 1 - np.cos(x)}.items():
        found = apply_function(name, A)
        assert is_foreign(found)
        np.testing.assert_allclose(np.asarray(found), exact, rtol=1e-14)
    tiny = apply_function("versine", strict.asarray([1e-9]))
    assert float(tiny[0]) == pytest.approx(5e-19, rel=1e-14)
    assert float(apply_function("square_root", strict.asarray([2.25]))[0]) == 1.5


@pytest.mark.parametrize("swapped", [False, True])
def test_a_choice_by_size(swapped: bool) -> None:
    one = strict.asarray(1.0)
    a, b = (one, A) if swapped else (A, one)
    found = where_less(a, b, A, -A)
    x = np.asarray(A)
    assert np.asarray(found).tolist() == np.where(np.asarray(a) < np.asarray(b), x, -x).tolist()
