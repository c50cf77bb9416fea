"""Plans: which equations are needed for which outputs.

`steps` and `dynamics_steps` are the tables of which equation computes what from what, `plan` selects those that the
requested outputs need and hands them to the engine. Imports equations, engine and rotations.
"""
