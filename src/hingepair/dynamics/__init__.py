"""Dynamics: motion in time under loads.

Simulation of a pair from a start to any instant, energy balances and linearization. Imports integration, pair and
what lies below.
"""
