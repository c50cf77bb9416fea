"""What every wing counts on.

Checks at the border, broadcasting and blocks, arithmetic in twice the precision and with error bounds, unit vectors,
finite differences, arrays of other libraries, tables in plain text. Imports the errors only.
"""
