"""Numerics that all other subpackages use.

Checks at the border, broadcasting and blocks, arithmetic in twice the precision and with error bounds, unit vectors,
finite differences, instants of recordings, numbers in doubtful units, arrays of other libraries, tables, files of
columns and files written whole. Imports the errors only.
"""
