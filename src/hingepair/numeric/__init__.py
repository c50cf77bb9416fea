"""What every wing counts on.

Checks at the border, broadcasting and blocks, arithmetic in twice the precision, unit vectors, finite differences,
tables in plain text. Imports the errors only.
"""
