"""Two rigid bodies joined by a hinge."""
