"""Pairs: `HingePair` and `PlanarPair`, what can be asked of them, residuals, tolerances and promised accuracy."""
