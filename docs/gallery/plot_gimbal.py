"""
A gimbal near gimbal lock
=========================

A camera gimbal with axes for yaw, pitch and roll has a singular position: at a pitch of 90 degrees, the axes of yaw
and roll coincide (gimbal lock). Near this position, the rates of the motors grow without bound, while attitudes and
angular velocities are computed as accurately as elsewhere.
"""

import matplotlib.pyplot as plt
import mpmath
import numpy as np

import hingepair as hp

# %%
# The first part computes the rates of the motors. The camera follows a drone that passes overhead at 20 degrees per
# second. The closer its path is to the zenith, the faster the yaw motor must turn. The rates follow from the angular
# velocity (the inverse of equation E4), here for the sequence yaw, pitch, roll (ZYX). `along` is the angle along the
# path, which is zero at the highest point.
along = np.radians(np.linspace(-60, 60, 1201))
yaw_rates = {}
for miss in (20, 5, 2):
    tilt = hp.rodrigues((1, 0, 0), np.radians(miss))  # the plane of the path misses the zenith by this angle
    S = tilt @ hp.rodrigues((0, 1, 0), along - np.pi / 2)  # x axis: the line of sight
    omega = np.radians(20) * tilt[:, 1]
    rates = hp.euler_rates(hp.matrix_to_euler(S, sequence="ZYX"), omega, sequence="ZYX")
    yaw_rates[miss] = np.degrees(np.abs(rates[:, 0]))
    print(f"{miss:2} degrees from the zenith: yaw turns at up to {yaw_rates[miss].max():.0f} deg/s")

# %%
# The second part computes rounding errors. Body 1 is the camera, whose pitch approaches 90 degrees, and body 2 is a
# flap on a hinge. The reference value of the angular velocity of body 2 is computed with 50 digits (mpmath).
pair = hp.HingePair(u1=(0.05, 0, 0.02), u2=(0, 0.01, 0), n=(1, 2, 2))
distance = np.logspace(0, -12, 61)  # of the pitch from 90 degrees [rad]
rng = np.random.default_rng(3)
q = rng.uniform(-3, 3, (61, 7))
q[:, 4] = np.pi / 2 - distance
qd = rng.uniform(-2, 2, (61, 7))


def exact_omega2(q, qd):
    """Return omega2 by E4 and E2 to 50 digits, from the doubles q and qd (ZYX)."""
    mpmath.mp.dps = 50
    yaw, pitch, roll, _ = map(mpmath.mpf, q[3:])
    axes = [mpmath.matrix(axis) for axis in ((0, 0, 1), (0, 1, 0), (1, 0, 0))]

    def turn(axis, angle):
        x, y, z = axis
        cross = mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return mpmath.eye(3) + mpmath.sin(angle) * cross + (1 - mpmath.cos(angle)) * cross**2

    first = turn(axes[0], yaw)
    second = first * turn(axes[1], pitch)
    S1 = second * turn(axes[2], roll)
    omega = [axes[0] * mpmath.mpf(qd[3]), first * axes[1] * mpmath.mpf(qd[4]), second * axes[2] * mpmath.mpf(qd[5])]
    n = mpmath.matrix((1, 2, 2)) / 3
    return omega[0] + omega[1] + omega[2] + S1 * n * mpmath.mpf(qd[6])


state = pair.forward_kinematics(q, qd, sequence="ZYX", outputs=("S1", "omega1", "omega2"))
bound = pair.error_bounds(q, qd, sequence="ZYX", outputs=("omega2",))["omega2"]
error = [
    float(max(abs(one - mpmath.mpf(other)) for one, other in zip(exact_omega2(*row), omega2, strict=True)))
    for *row, omega2 in zip(q, qd, state.omega2, strict=True)
]

# %%
# The rotation matrix of the camera is now transformed to another frame and back, as between two programs. This rounds
# each component. Yaw and roll that are computed from the result lose digits, although the rotation matrix of these
# Euler angles is accurate. Euler rates that are computed from omega1 lose digits likewise.
other = hp.rotation_exp((0.3, -0.5, 0.7))
received = other.T @ (other @ state.S1)
angles = hp.matrix_to_euler(received, sequence="ZYX")
lost = np.abs(np.angle(np.exp(1j * (angles - q[:, 3:6])))).max(axis=1)
kept = np.abs(hp.euler_to_matrix(angles, sequence="ZYX") - state.S1).max(axis=(1, 2))
rates = hp.euler_rates(q[:, 3:6], state.omega1, sequence="ZYX")
print(f"omega2: largest error {max(error):.1e} rad/s, largest bound {bound.max():.1e} rad/s")

figure, (motors, errors) = plt.subplots(1, 2, figsize=(10, 4.4), layout="constrained")
for miss, rate in yaw_rates.items():
    motors.plot(np.degrees(along) / 20, rate, label=f"{miss} degrees from the zenith")
motors.set(xlabel="t [s]", ylabel="rate of the yaw motor [deg/s]", yscale="log", title="Rate of the yaw motor")
motors.axhline(20, color="0.6", ls=":")
motors.legend(loc="lower center")
errors.loglog(distance, bound, "k--", label="omega2 [rad/s]: proved bound")
errors.loglog(distance, error, "ko", ms=4, label="omega2 [rad/s]: error")
errors.loglog(distance, lost, "C1^", ms=4, label="Euler angles [rad], from the attitude")
errors.loglog(distance, kept, "C0s", ms=4, label="attitude, from these Euler angles")
errors.loglog(distance, np.abs(rates - qd[:, 3:6]).max(axis=1), "C3v", ms=4, label="Euler rates [rad/s], from omega1")
errors.invert_xaxis()
errors.set(xlabel="distance of the pitch from 90 degrees [rad]", ylabel="error", title="Rounding errors")
errors.legend(fontsize="small")
plt.show()
