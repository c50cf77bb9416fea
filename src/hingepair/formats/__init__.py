"""The pair and its results in other tools' files.

URDF in and out, MJCF out, the robots of example-robot-data. Imports pair and what lies below it.
"""
