"""Numerics that all other subpackages use.

Checks at the border, broadcasting and blocks, arithmetic in twice the precision and with error bounds, unit vectors,
angles that wrap, finite differences, complementarity problems, values that are computed once, optional packages.
Imports the errors only.
"""
