"""Pairs, their motions and their results.

The modules hold `HingePair` and `PlanarPair`, the motion of body 1 and the state of body 2; forward kinematics,
Jacobians, residuals and dynamics; and the accuracy of these: scales, promised bounds, and bounds for
any state. All computations name their inputs and outputs, make a plan, and run it by a call of the engine, which
`evaluate` caches for each pair. This wing imports `plans` and the wings below it.
"""
