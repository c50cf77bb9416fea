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

The function is traced (`trace`) once for each pattern of inputs (`binding`): numbers that are known to be 0, 1 or -1
fold away, and operations that no output needs are left out. The remaining operations run as Python for one state, as
NumPy in blocks (`python_source`), or as machine code for eight samples at a time (`llvm_ir`, `native`), as `backend`
chooses. Derivatives (`derivatives`) are recorded in the same trace, and fold and compile as all else:

>>> from hingepair.engine.derivatives import pullback
>>> def slope(v):
...     fx, _ = drag(v)["force"]
...     return {"slope": tuple(pullback([(fx, 1.0)], v["v"]))}
>>> loop = Loop("slope", slope, inputs={"v": (2,), "k": ()}, outputs={"slope": (2,)})
>>> call = Call(loop, argument_shapes={"v": (2,)}, constants={"k": 0.5}, result=Results)
>>> call.run({"v": np.ones((3, 2))}, shapes={"v": (3,)})["slope"][0]
array([-2., -1.])

`ufunc` makes kernels ufuncs of NumPy, which reads the arrays. The engine imports numeric only.
"""
