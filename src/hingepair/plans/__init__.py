"""Plans: what each output of a tree of joints is made of.

`trees` has the quantities of a tree and the table of its outputs; `fronts` and `pairs` make the tree's values of what
is given of a pair; `computation`, `derivatives`, `bounds` and `prepared` run such a program, differentiate it, and
bound its rounding errors. Imports equations, engine and rotations.
"""
