"""The hinge from inertial sensors, one on either body: axis, point, angle, and all of them with the clock offset."""
