"""Rollouts: motions of robots in time by steps of constant length, many at once, and gradients through them.

`tracks` reads what acts from step to step, `motions` steps forwards, and `gradients` backwards; `libraries` hands
both to JAX and PyTorch. The programs of a step are in `plans.rollouts`; `mechanism` reads the other arguments.
"""
