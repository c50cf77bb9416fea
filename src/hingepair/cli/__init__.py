"""The command line.

The commands and what they print. Imports every wing, the bench only when it is asked for.
"""
