"""The constraint equations E1-E11 and their derivatives, written once.

Plain arithmetic on tuples of scalars: floats, arrays, symbols and tracers all run through the same lines. Imports
nothing.
"""
