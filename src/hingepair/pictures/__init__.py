"""Looking at a motion.

Plots, and a page on which a pair or a robot moves. Imports scenes, dynamics and what lies below them.
"""
