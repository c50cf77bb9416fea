"""From rates to motion (E12).

Attitudes and hinge angles integrated from omega1(t) and psi'(t), with an estimate of the error. `integrate` reads
what is given (`signals`), lets `solve` find the angles and makes a `trajectory`; `step_selection` finds the steps
that a tolerance asks for, `methods` says what a step is, `stepping` multiplies them, for attitudes and angles alike
(`integrals`); `error_estimate` and, of samples, `interpolation_error` say how far off the result is. Imports pair and
what lies below it.
"""
