"""The engine: runs functions of scalars over one sample or millions of samples. It knows nothing of hinges.

Write a function of values by name, in plain arithmetic and the functions of `trace`; a vector is the tuple of its
components. A `Loop` runs the function over arrays; a `Call` is a loop with known constants, ready for many calls:

>>> import numpy as np
>>> from hingepair.engine.calls import Call
>>> from hingepair.engine.loops import Loop
>>> from hingepair.engine.results import Results
>>> def drag(v):
...     x, y = v["v"]
...     return {"force": tuple(-v["k"] * (x * x + y * y) * c for c in v["v"])}
>>> loop = Loop("drag", drag, inputs={"v": (2,), "k": ()}, outputs={"force": (2,)})
>>> call = Call(loop, argument_shapes={"v": (2,)}, constants={"k": 0.5}, result=Results)
>>> call.run({"v": np.ones((3, 2))}, shapes={"v": (3,)})["force"][0]
array([-1., -1.])

The function is traced once for each pattern of inputs: numbers that are known to be 0, 1 or -1 fold away, and
operations that no output needs are left out. The others run as machine code for eight samples at a time, or where
nothing is compiled as NumPy in blocks of samples; `backend` chooses. The modules:

    trace, derivatives       values that record operations, or fold them; derivatives in the same trace
    binding, loops           which inputs are known, constant or arrays; a traced program for each pattern; NumPy
    llvm                     its machine code, which is kept on disk, and the calls of it by Python
    calls, outputs, results  a loop with its constants; arrays to write into; results
    scans                    a program that is repeated in steps, and passes a state from step to step
    ufunc, jax_torch         a call as a ufunc of NumPy; as a function of JAX and PyTorch
    exports                  a program as a function in C and of CasADi
    backend, threads         what computes a call, and by how many threads; the threads

Derivatives are recorded in the same trace, and fold and compile as all else:

>>> from hingepair.engine.derivatives import pullback
>>> def slope(v):
...     fx, _ = drag(v)["force"]
...     return {"slope": tuple(pullback([(fx, 1.0)], v["v"]))}
>>> loop = Loop("slope", slope, inputs={"v": (2,), "k": ()}, outputs={"slope": (2,)})
>>> call = Call(loop, argument_shapes={"v": (2,)}, constants={"k": 0.5}, result=Results)
>>> call.run({"v": np.ones((3, 2))}, shapes={"v": (3,)})["slope"][0]
array([-2., -1.])

It imports numeric, tables and, for units, the names of quantities.
"""
