"""Formulas.

Expressions in t, read without being run and differentiated exactly; the equations in closed form. Knows nothing of
files. Imports pair and what lies below it.
"""
