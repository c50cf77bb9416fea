"""Pictures of a motion: plots, and a page on which a pair or a robot moves.

The package imports scenes, dynamics and the wings below them.
"""
