"""Integration of rates to motion (E12).

Attitudes and hinge angles are integrated from omega1(t) and psi'(t), with an estimate of the error. `integrate` reads
its arguments (`signals`), calls `solve` for the angles and returns a `trajectory`. `methods` has the one-step
methods; `step_selection` selects steps by a tolerance; `stepping` combines steps by prefix scans, for attitudes and
angles alike (`integrals`); `error_estimate` estimates the error. Imports pair and what lies below it.
"""
