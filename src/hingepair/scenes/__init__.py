"""Scene files.

A pair, its motion by expressions, logs or rates, and the instants. Imports integration, symbolic, formats, validation
and what lies below them.
"""
