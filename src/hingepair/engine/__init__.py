"""The engine: functions of scalars, run over one sample or millions of them.

`loops` runs a function over arrays: it is traced once for each pattern of inputs (`trace`, `binding`), and then runs
as Python and NumPy (`python_source`) or as machine code (`llvm_ir`, `native`; `array_heads` takes Python's arrays),
as `backend` chooses. Knows nothing of hinges. Imports numeric.
"""
