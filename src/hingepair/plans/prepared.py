"""Prepared calls of pairs, planar pairs and robots: planned, checked and compiled once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hingepair.engine import jax_torch
from hingepair.engine.backend import Execution
from hingepair.engine.calls import Call
from hingepair.engine.exports import c_source
from hingepair.engine.results import writable_arrays
from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import FloatArray
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.arguments import chosen_names
from hingepair.plans.computation import Computation
from hingepair.plans.dask_chunks import is_dask
from hingepair.plans.derivatives import Derivative


class _Derived(NamedTuple):
    """A derivative of a prepared call, and what computes it."""

    names: tuple[str, ...]  # of the arguments by which it is taken
    further: tuple[str, ...]  # outputs that have weights, or arguments that change
    call: Call
    labels: Mapping[str, str]  # of the weights or changes in messages


class Prepared:
    """Function of arrays that computes given outputs of a pair or a robot; the methods `prepare` return it. It can be
    copied and pickled.

    Attributes:
        given: names of the arguments, in order.
        outputs: names of the computed outputs.
    """

    def __init__(
        self,
        computation: Computation,
        given: tuple[str, ...],
        execution: Execution,
        gravity: tuple[float, ...] | None,
        factory: Callable[[], Prepared],
        watch: Callable[[Any, Mapping[str, Any]], None] | None = None,
    ) -> None:
        self._computation, self._gravity, self._execution = computation, gravity, execution
        self._factory, self._watch = factory, watch  # how it is made anew; what looks at results
        self._call: Call = computation.call(given, execution.backend, gravity, prepared=True)
        self.given, self.outputs, self._count = given, self._call.outputs, len(given)
        self._plain = execution.workers == 1 and watch is None
        self._derivatives: dict[Any, _Derived] = {}
        if execution.backend == "auto":
            self._call.compile()

    def __repr__(self) -> str:
        return f"Prepared(given={self.given}, outputs={self.outputs})"

    def __reduce__(self) -> tuple[Any, ...]:
        return self._factory, ()

    @property
    def ufunc(self) -> np.ufunc:
        """The kernel itself, a generalised ufunc of NumPy such as "(7),(7)->(3),(3,3)". It follows NumPy's rules of
        broadcasting and casting (integers, bool and float16 become float64), and checks no rotation. It stays
        in memory, cannot be pickled, and returns the outputs in order.

        >>> import hingepair as hp, numpy as np
        >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
        >>> f = pair.prepare("pose", outputs=("R2", "d")).ufunc
        >>> f.signature
        '(7)->(3),(3)'
        >>> R2, d = f(np.zeros((2, 5, 7)))
        >>> R2.shape
        (2, 5, 3)
        """
        return self._unchecked.ufunc

    @lock_free_cached_property
    def jax(self) -> Callable[..., Any]:
        """This call as a function of arrays of JAX in the processor's memory: it takes one array for each argument,
        (..., one sample), and returns what the call returns, with arrays of JAX. Rotations are not checked.

        `jit`, `vmap`, `scan` and derivatives of any order (`jvp`, `vjp`, `grad`, `jacfwd`, `jacrev`, `hessian`)
        are computed by kernels. An attitude changes by its nine entries.

        Raises:
            ArgumentError: the pair's geometry has axes.
        """
        return jax_torch.library_function("jax", self._call_of_chain)

    @lock_free_cached_property
    def torch(self) -> Callable[..., Any]:
        """This call as a function of tensors of PyTorch in the processor's memory: it takes one tensor for each
        argument, (..., one sample), and returns what the call returns, with tensors. `backward`, also of gradients,
        and `torch.func` (`grad`, `jacrev`, `jacfwd`, `hessian`, `vmap`) differentiate it; `torch.compile` ends its
        graph there. Rotations are not checked; an attitude changes by its nine entries.

        Raises:
            ArgumentError: the program has too many operations.
        """
        return jax_torch.library_function("torch", self._call_of_chain)

    def casadi(self, name: str = "hingepair") -> Any:
        """Return this call as a `casadi.Function` of one state: it takes a column for each argument, and returns one
        for each output; matrices are matrices. CasADi differentiates it as often as it wants, and can write it in C.
        Rotations are not checked; an attitude changes by its nine entries; an output with the name of an argument is
        called S1_out.

        Args:
            name: name of the function.

        Raises:
            ArgumentError: the geometry of the pair has samples.
            MissingDependencyError: CasADi is not installed.
        """
        from hingepair.engine.exports import casadi_function

        call = self._single_program("casadi")
        return casadi_function(name, *call.program_with_numbers(), tuple(call.argument_shapes.items()))

    def to_c(self, name: str) -> str:
        """Return this call as the source of a C function of one state, which needs nothing but the C library.

        Its parameters are arrays of doubles, the arguments and then the outputs, matrices by rows, none of which may
        overlap another; an output with the name of an argument is called S1_out. The comment says shapes and units.
        Masses, lengths and gravity are numbers in the source. Rotations are not checked.

        Args:
            name: name of the function.

        Raises:
            ArgumentError: the geometry of the pair has samples, or the name is none.

        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
        >>> source = pair.prepare("velocity", outputs=("omega2",)).to_c("door")
        >>> [line for line in source.splitlines() if line.startswith("void")]
        ['void door(const double *restrict q, const double *restrict qd, double *restrict omega2)']
        """
        call = self._single_program("to_c")
        arguments, outputs = tuple(call.argument_shapes.items()), dict(call.loop.outputs)
        of_joints = self._computation.coordinates.noun == "joints"
        units = {one: unit_of(one, of_joints) for one in (*call.argument_shapes, *outputs)}
        title = f"{', '.join(outputs)} from {', '.join(self.given)}, for one state; written by hingepair."
        return c_source(name, *call.program_with_numbers(), arguments, units, title)

    @property
    def _unchecked(self) -> Call:
        """The call without checks of attitudes."""
        return self._computation.call(self.given, "auto", self._gravity)

    def _single_program(self, method: str) -> Call:
        """Return the call without checks of attitudes; refuse what is no program for one state."""
        call = self._unchecked
        if not call.has_kernels:
            expected = "a call without samples among its constants"
            raise ArgumentError(method, expected, ", ".join(self.outputs))
        return call

    def _call_of_chain(self, chain: jax_torch.Chain) -> Call:
        """Return the call, or a derivative of a derivative of it, in which attitudes change by their entries."""
        given, derivatives, call = self.given, tuple[Derivative, ...](), self._unchecked
        for times, (kind, by) in enumerate(chain, 1):
            names, outputs = [given[k] for k in by], tuple(name for name, _ in call.loop.outputs)
            prefix = f"{times}_" if times > 1 else ""
            arguments = tuple((name, call.argument_shapes[name]) for name in names)
            derivatives = (*derivatives, Derivative(kind, outputs, arguments, entries=True, prefix=prefix))
            added = [f"change_{one}" for one in names] if kind == "jvp" else [f"weight_{one}" for one in outputs]
            given = (*given, *(f"{prefix}{one}" for one in added))
            call = self._computation.call(given, "auto", self._gravity, derivatives=derivatives)
        return call

    def __call__(self, *given: Any, out: Any = None, **by_name: Any) -> Any:
        """Compute the outputs for one state or many.

        Args:
            *given: the arguments, in the order of the attribute `given`; shape (..., coordinates) of q, qd, qdd and
                tau, (..., 3) of vectors, (..., 3, 3) of S1 and S2, (..., 4) of quaternions, (...,) of numbers. They
                broadcast. Coordinates may also be tuples, dicts by name and tables; such a call takes longer.
            out: arrays by output name, into which the results are written; where there is one output, also one
                array. A call that is refused for an unusable argument does not change them.
            **by_name: refused, since arguments have no names in calls.
        """
        if by_name:
            expected = f"no keywords, but arguments in order: {', '.join(self.given)}"
            raise ArgumentError(next(iter(by_name)), expected, "a keyword")
        if len(given) != self._count:
            raise ArgumentError("*given", f"{self._count} arguments: {', '.join(self.given)}", f"{len(given)}")
        if self._plain:
            result = self._call.rows(*given) if out is None else self._call.rows(*given, out=out)
            if result is not None:
                return result
        named = dict(zip(self.given, given, strict=True))
        if any(map(is_dask, given)):
            return self._computation.over_chunks(self._call, self, named, out)
        result = self._computation.answer(self._call, named, out, self._execution.workers)
        if self._watch is not None:
            self._watch(result, named)
        return result

    # ---- derivatives

    def jacobian(
        self, given: Sequence[Any], wrt: str | Iterable[str] | None = None
    ) -> dict[str, dict[str, FloatArray]]:
        """Compute the derivatives of all outputs by arguments, exactly up to rounding.

        Args:
            given: the arguments, as a tuple in the order of the call.
            wrt: names of arguments out of `given`, by default all; or of constants: of a robot masses, first_moments,
                inertias and lengths, of kinematics of a pair in space u1, u2, n and home (see below).

        Returns:
            {output: {argument: array}}. The shape of an array is (..., shape of the output, shape of the argument),
            such as (..., dof, dof) of tau by q. A rotation matrix (S of frames, S1, S2) counts as three numbers: it
            changes along rotations about the axes of the world [rad], and so does a quaternion. The first call for a
            choice of arguments compiles.

            The bodies of a robot stand in the order of the joints that move them, a free base first: masses [kg],
            shape (bodies,); first_moments, mass times centre of mass [kg m], (bodies, 3); inertias about the origin
            of the body's frame [kg m^2], (bodies, 6), in Pinocchio's order xx, xy, yy, xz, yz, zz. Each changes while
            the others stay. lengths [m], (joints, 3), are the positions of the joints in their parents' frames.

            n changes across itself only, home along rotations about the axes of body 1 [rad].

        Raises:
            ArgumentError: the program has too many operations.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> f = hp.load_robot("ur5_robot").prepare("inverse_dynamics", outputs=("tau",))
        >>> q, qd, qdd = np.zeros((3, 6))
        >>> f.jacobian((q, qd, qdd), wrt=("q", "qd"))["tau"]["q"].shape
        (6, 6)
        """
        names, arrays, _ = self._derive("jacobian", given, {}, wrt)
        return {one: {name: arrays[f"{one}_{name}"] for name in names} for one in self.outputs}

    def vjp(
        self, given: Sequence[Any], cotangents: Mapping[str, Any], wrt: str | Iterable[str] | None = None
    ) -> tuple[Any, dict[str, FloatArray]]:
        """Compute the results of the call, and the gradient of a weighted sum of outputs by every argument.

        Args:
            given: the arguments, as a tuple in the order of the call.
            cotangents: weights by output, each of the shape of the output; for a rotation matrix three, those of
                rotations about the axes of the world. Outputs without weights do not count.
            wrt: names of arguments and constants, as for `jacobian`.

        Returns:
            (value, gradient): what the call returns, and a dict of arrays by argument. The gradient of each sample is
            its own: it is not summed over samples that share an argument.

        Raises:
            ArgumentError: the program has too many operations.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> f = hp.load_robot("ur5_robot").prepare("inverse_dynamics", outputs=("tau",))
        >>> value, gradient = f.vjp(tuple(np.zeros((3, 6))), {"tau": np.ones(6)})
        >>> value.tau.shape, gradient["q"].shape
        ((6,), (6,))
        """
        names, arrays, value = self._derive("vjp", given, cotangents, wrt)
        return value, {name: arrays[f"gradient_{name}"] for name in names}

    def jvp(self, given: Sequence[Any], tangents: Mapping[str, Any]) -> tuple[Any, dict[str, FloatArray]]:
        """Compute the results of the call, and their rates of change for given rates of change of arguments.

        Args:
            given: the arguments, as a tuple in the order of the call.
            tangents: rates of change by argument or constant (see `jacobian`), each of its shape; for S1 and
                quaternions an angular velocity, axes of the world. All others do not change.

        Returns:
            (value, tangent): what the call returns, and a dict of the rates of change by output; that of a rotation
            matrix is an angular velocity, axes of the world.

        Raises:
            ArgumentError: the program has too many operations.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> f = hp.load_robot("ur5_robot").prepare("pose", frames="tool0")
        >>> value, tangent = f.jvp((np.zeros(6),), {"q": np.ones(6)})
        >>> value.S.shape, tangent["S"].shape
        ((3, 3), (3,))
        """
        _, arrays, value = self._derive("jvp", given, tangents, None)
        return value, {name: arrays[f"rate_{name}"] for name in self.outputs}

    def _derived(self, kind: str, weighted: Any, wrt: Any) -> _Derived:
        """Return a derivative: `weighted` are the cotangents or tangents, by name. It is made at the first call."""
        if isinstance(wrt, Iterable) and not isinstance(wrt, str):
            wrt = tuple(wrt)
        key = kind, tuple(weighted) if isinstance(weighted, Mapping) else None, wrt
        try:
            return self._derivatives[key]
        except (KeyError, TypeError):  # a new one, or what is no name
            pass
        accepted = (*self.given, *self._computation.constant_shapes)
        outputs, further = self.outputs, tuple[str, ...]()
        label, prefix = ("tangents", "change") if kind == "jvp" else ("cotangents", "weight")
        if kind == "jvp":
            names = further = chosen_names(label, weighted, accepted)
        else:
            if kind == "vjp":
                outputs = further = chosen_names(label, weighted, self.outputs)
            names = chosen_names("wrt", self.given if wrt is None else wrt, accepted)
        computation = self._computation if {*names} <= {*self.given} else self._computation.by_constants
        shapes = {**self._call.argument_shapes, **computation.constant_shapes}
        derivative = Derivative(kind, outputs, tuple((name, shapes[name]) for name in names))
        labels = {f"{prefix}_{name}": f"{label}[{name!r}]" for name in further}
        call = computation.call(
            (*self.given, *labels), self._execution.backend, self._gravity, prepared=True, derivatives=(derivative,)
        )
        derived = self._derivatives[key] = _Derived(names, further, call, labels)
        return derived

    def _derive(
        self, kind: str, given: Sequence[Any], weighted: Any, wrt: Any
    ) -> tuple[tuple[str, ...], dict[str, FloatArray], Any]:
        """Compute a derivative: return the names by which it is taken, its arrays, and what the call returns."""
        names, further, call, labels = self._derived(kind, weighted, wrt)
        if not isinstance(given, tuple | list) or len(given) != self._count:
            raise ArgumentError("given", f"a tuple of {', '.join(self.given)}", quoted(given))
        named = dict(zip(call.argument_shapes, (*given, *(weighted[name] for name in further)), strict=True))
        found = self._computation.answer(call, named, None, self._execution.workers, labels)
        arrays, result = writable_arrays(found), self._computation.result
        if kind == "jacobian" or result is None:
            return names, arrays, arrays.get(self.outputs[0])
        return names, arrays, result({name: arrays[name] for name in self.outputs}, found.shape)
