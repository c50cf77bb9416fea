"""Motions of scenes, of a pair or of the joints of a robot.

A `Motion` (motion.py) has its coordinates at some instants (known.py) from functions of time (functions.py, with way
points in waypoints.py), from a log (logged.py, its columns in log_columns.py) or from what acts (simulated.py).
"""
