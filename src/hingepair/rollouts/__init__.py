"""Rollouts: motions of robots in time by steps of constant length, many at once, and gradients through them.

`tracks` reads what acts from step to step, `motions` steps forwards, and `gradients` backwards. The programs of a
step are in `plans.rollouts`; `mechanism` reads the other arguments of users.
"""
