"""The equations E1-E11 and T1-T14 and their derivatives, written once.

Plain arithmetic on tuples of scalars: floats, arrays, symbols and tracers all run through the same lines. Imports no
other part of the package.
"""
