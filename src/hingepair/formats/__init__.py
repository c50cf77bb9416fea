"""The pair, its results and recordings of its bodies in files.

URDF in and out, MJCF out, the robots of example-robot-data, recordings of two bodies. Imports pair, measured and what
lies below them.
"""
