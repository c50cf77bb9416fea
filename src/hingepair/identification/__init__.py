"""Masses and friction of robots, found from recorded motions and torques.

The regressor of a robot is a method of it (`mechanism`); here are the statistics. Imports mechanism and measured.
"""
