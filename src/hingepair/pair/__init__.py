"""The pair and what it is asked.

`HingePair`, `PlanarPair`, the motion of body 1, the state of body 2; forward kinematics, Jacobians, residuals,
sensitivities, dynamics, and how accurate they are: scales, the promise, bounds of any state. All of them name what is
given and what is asked for, and go one way: `prepared`, for one state and small batches, and `evaluate`, for many.
Imports plans and what lies below it.
"""
