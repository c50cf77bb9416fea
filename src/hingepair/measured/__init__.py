"""Measured motion, and what is found from it: recordings smoothed and on one clock, hinges, masses of robots.

The equations read backwards. Imports mechanism, rotations and numeric; SciPy inside the functions that need it.
"""
