"""The pair and its results in other tools' files.

URDF and MJCF in and out, the robots of example-robot-data, results on disk. Imports pair and what lies below it.
"""
