"""From rates to motion (E12).

Attitudes and hinge angles integrated from omega1(t) and psi'(t), with an estimate of the error. Imports pair and what
lies below it.
"""
