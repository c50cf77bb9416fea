"""Tables of numbers: columns read from files and from DataFrames, their units, printed sheets, whole files."""
