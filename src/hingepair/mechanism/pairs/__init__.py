"""Pairs, their motions and their results.

The modules hold `HingePair` and `PlanarPair`, the motion of body 1 and the state of body 2; forward kinematics,
Jacobians, residuals and dynamics; and the accuracy of these: scales, promised bounds, and bounds for
any state. All computations name their inputs and outputs in a request (`requests`), whose program is a tree of one
hinge (`plans.pairs`). This wing imports `plans` and the wings below it.
"""
