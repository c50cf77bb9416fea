"""`hingepair bench`: run time against error, beside what else a user could pick.

A bench is a function that gives rows (`measure.Row`), a command in `cli/bench.py` reports them, and both pictures and
tables come out of rows; nothing else is needed for another one. Imports everything but the command line.
"""
