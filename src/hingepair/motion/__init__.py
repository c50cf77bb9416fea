"""Motion in time: of pairs from their rates (E12), and of pairs and robots from the loads on them.

Imports `pair`, `mechanism` and what these import.
"""
