"""Bodies: mass properties and shapes, how a body moves, and what acts at a hinge."""
