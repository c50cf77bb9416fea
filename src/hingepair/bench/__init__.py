"""`hingepair bench`: run time and error of a pair's kinematics, and the 60-digit reference that judges them.

Imports everything but the command line.
"""
