"""Running the equations.

The plan of what is needed, and the ways to run a plan over one state or millions. Imports numeric, equations and
rotations.
"""
