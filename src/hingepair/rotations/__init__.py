"""Rotations by themselves.

Matrices, exponential and logarithm, quaternions; Euler angles and their rates in all sequences; angular velocity from
matrices. Imports numeric and equations.
"""
