"""A function of arrays as a function of CasADi, which calls back into Python, with its Jacobian."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from hingepair.engine.binding import ArrayShape
from hingepair.engine.jax_torch import Chain, Differentiable
from hingepair.numeric.optional import require


def casadi_function(name: str, function: Differentiable, arguments: list[str], outputs: list[str]) -> Any:
    """Return a `casadi.Callback` of one state. Vectors are columns; of what has more than two axes, the first are
    joined to rows.
    """
    casadi = require("casadi", "f.casadi")
    given, results = ([_sizes(tail) for tail in tails] for tails in (function.arguments, function.outputs))

    class Called(casadi.Callback):  # type: ignore[misc, name-defined]
        """A chain of derivatives: none, or the Jacobians of all outputs by all arguments."""

        def __init__(self, name: str, chain: Chain, names: tuple[list[str], list[str]], options: Any) -> None:
            casadi.Callback.__init__(self)
            self.chain, self.names, self.made = chain, names, list[Any]()
            self.construct(name, options)

        def get_n_in(self) -> int:
            return len(self.names[0])

        def get_n_out(self) -> int:
            return len(self.names[1])

        def get_name_in(self, k: int) -> str:
            return self.names[0][k]

        def get_name_out(self, k: int) -> str:
            return self.names[1][k]

        def get_sparsity_in(self, k: int) -> Any:
            sizes = [*given, *results]  # a Jacobian takes the outputs as well, which it does not need
            return casadi.Sparsity.dense(*sizes[k])

        def get_sparsity_out(self, k: int) -> Any:
            if not self.chain:
                return casadi.Sparsity.dense(*results[k])
            row, column = divmod(k, len(given))
            return casadi.Sparsity.dense(math.prod(results[row]), math.prod(given[column]))

        def eval(self, values: Any) -> list[Any]:
            pairs = zip(values, function.arguments, strict=False)
            found = function.run(self.chain, [np.array(one).reshape(tail) for one, tail in pairs])
            if not self.chain:
                return [np.reshape(one, size) for one, size in zip(found, results, strict=True)]
            ends = [*itertools.accumulate(map(math.prod, given), initial=0)]
            return [
                matrix[_by_columns(rows)][:, np.arange(start, end)[_by_columns(columns)]]
                for matrix, rows in zip(found, results, strict=True)
                for (start, end), columns in zip(itertools.pairwise(ends), given, strict=True)
            ]

        def has_jacobian(self) -> bool:
            return not self.chain

        def get_jacobian(self, name: str, inputs: Any, outputs: Any, options: Any) -> Any:
            chain = (("jacobian", tuple(range(len(given)))),)
            made = Called(name, chain, ([*inputs], [*outputs]), {**options, "enable_fd": True})  # second derivatives
            self.made.append(made)  # CasADi does not keep it
            return made

    return Called(name, (), (arguments, outputs), {})


def _sizes(tail: ArrayShape) -> tuple[int, int]:
    """Return the rows and columns of an array in CasADi."""
    return (math.prod(tail[:-1]), tail[-1]) if len(tail) > 1 else (math.prod(tail), 1)


def _by_columns(size: tuple[int, int]) -> Any:
    """Return the places of the entries of a matrix, stored by rows, column by column."""
    return np.arange(math.prod(size)).reshape(size).ravel(order="F")
