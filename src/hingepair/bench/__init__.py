"""`hingepair bench`.

Run time against error, beside what else a user could pick. Imports every other wing but the command line.
"""
