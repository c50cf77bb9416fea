"""Pairs: `HingePair` and `PlanarPair`, their constants and requests, residuals, tolerances and promised accuracy."""
