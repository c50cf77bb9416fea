"""Inverse kinematics: the search for coordinates at which frames of a robot have wanted poses.

`goals` says what a target is, `steps` has the equations, `starts` chooses where to begin, `search` solves many
targets at once, and `paths` follows targets in order. `mechanism` reads the arguments of users.
"""
