"""Whole robots: trees of hinges and sliders, by the equations of one pair and the recursions T1-T9.

`tree` is the record of a robot after fixed and locked joints are folded away; `building` makes it, and `Mechanism`
computes with it. Imports the pair, plans and what lies below them.
"""
