"""The same pair in Pinocchio.

Body 2 by both routes, compared. Imports pair and what lies below it.
"""
