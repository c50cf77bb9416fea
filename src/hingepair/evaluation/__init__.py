"""Running the equations.

`steps` and `dynamics_steps` are the tables of which equation makes what of what, `plan` takes those that some outputs
need. `loops` runs a plan over one state or millions: traced (`trace`) once for each pattern of inputs (`binding`),
then as Python and NumPy (`python_source`) or compiled (`llvm_ir`, `native`; `array_heads` takes Python's arrays), as
`backend` chooses. Imports numeric, equations and rotations.
"""
