"""Symbolic expressions and closed forms.

A parser of expressions in t that runs no code, their derivatives, and closed forms of the equations of a pair and of
the motion of a robot's frame. No module reads or writes files.
"""
