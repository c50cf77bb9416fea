"""Bodies joined by hinges: one pair, and whole robots, by the recursions T1-T14 behind fronts.

`requests` has the table of all that can be asked, and `ask`, which methods of pairs and robots call; `options` what
they share, `states` their results. `pairs` and `robots` hold what users call, and how it is answered; `bodies` what
moves. `tree` is the record of a robot after fixed and locked joints are folded away; `building` makes it, and
`Mechanism` computes with it. Imports `plans` and what lies below them.
"""
