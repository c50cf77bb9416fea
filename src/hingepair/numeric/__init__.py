"""What every wing counts on.

Checks at the border, broadcasting and blocks, arithmetic in twice the precision and with error bounds, unit vectors,
finite differences, arrays of other libraries, tables, files of columns and files written whole. Imports the errors
only.
"""
