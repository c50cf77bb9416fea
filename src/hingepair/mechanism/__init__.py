"""Bodies joined by hinges: one pair, and whole robots, by the recursions T1-T14 behind fronts.

`tree` is the record of a robot after fixed and locked joints are folded away; `building` makes it, and `Mechanism`
computes with it. `pairs` holds the pair, `bodies` what moves. Imports `plans` and what lies below them.
"""
