"""The pair and what it is asked.

`HingePair`, `PlanarPair`, the motion of body 1, the state of body 2; forward kinematics, Jacobians, residuals,
sensitivities, and how accurate they are: scales, the promise, bounds of any state. Imports
evaluation and what lies below it.
"""
