"""Formulas.

Expressions in t, read without being run and differentiated exactly; the equations of a pair and the motion of a
robot's frame in closed form. Knows nothing of files. Imports pair, mechanism and what lies below them.
"""
