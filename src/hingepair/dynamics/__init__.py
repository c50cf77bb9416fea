"""Motion in time under forces.

The pair's own answer to what acts on it, from a start to any instant. Imports integration, pair and what lies below.
"""
