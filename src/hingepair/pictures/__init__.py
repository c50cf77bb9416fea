"""Looking at a motion.

Plots, and a page on which the pair moves. Imports scenes, dynamics and what lies below them.
"""
