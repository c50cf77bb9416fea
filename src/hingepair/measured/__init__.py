"""Measured motion, and the hinge found from it: recordings on one clock, smoothed, and the pair fitted to them.

The equations read backwards. Imports pair, rotations and numeric; SciPy inside the functions that need it.
"""
