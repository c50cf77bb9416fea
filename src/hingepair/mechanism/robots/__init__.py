"""Robots: the methods of a `Mechanism`, what computes them, and the constants of its programs."""
