"""Comparisons of pairs and robots with the same pairs and robots in Pinocchio.

This wing imports `pair`, `mechanism` and the wings below them.
"""
