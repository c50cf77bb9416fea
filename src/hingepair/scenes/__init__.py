"""Scene files.

A pair, its motion by expressions, logs, rates or what acts, and the instants. Imports dynamics, symbolic, formats,
validation and what lies below them.
"""
