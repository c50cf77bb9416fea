"""Inverse kinematics: the search for coordinates at which frames of a robot have wanted poses.

`goals` has the kinds of targets, each with its equations, and `steps` the step towards all of them; `starts` chooses
where to begin, `search` solves many targets at once, and `paths` follows targets in order. `mechanism` reads the
arguments of users.
"""
