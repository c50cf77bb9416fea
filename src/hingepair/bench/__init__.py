"""`hingepair bench`: run time against error, beside what else a user could pick.

A benchmark is a function that gives a `harness.Report`, and a command in `cli/bench.py` that calls it; tables, JSON
and picture come out of the report, and nothing else is needed for another one. Imports everything but the command
line.
"""
