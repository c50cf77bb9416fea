"""
A knee from motion capture
==========================

Where is the axis of a knee, how far does the knee bend, and how large is the uncertainty? Cameras recorded four
markers on the thigh and four on the shank of a walking person; the hinge is identified from these recordings alone.

The recording is synthetic, so that the true hinge is known: 8 s at 100 Hz, with noise of 1 mm (standard deviation) on
every marker and one marker that is hidden during a tenth of the samples. The angles of hip and knee are assumed, of
the order of human walking: the knee bends by some 20 degrees under load and by 60 degrees in the swing phase.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicSpline

import hingepair as hp

# %%
# The thigh is body 1; its reference point is the hip, with x forward, y to the left and z up. The shank is body 2;
# its reference point is the ankle. The axis of the knee is tilted by 3 degrees from the y axis of the thigh.
CYCLE = 1.1  # s, one stride
cycle = np.array([0, 10, 15, 40, 60, 72, 85, 95, 100]) / 100
knee = CubicSpline(cycle, np.radians([5, 16, 18, 5, 35, 61, 30, 3, 5]), bc_type="periodic")
hip = CubicSpline([0, 0.25, 0.52, 0.85, 1], np.radians([30, 10, -10, 32, 30]), bc_type="periodic")
axis = hp.rodrigues((1, 0, 0), np.radians(3)) @ (0, 1, 0)
leg = hp.HingePair(u1=(0.01, 0, -0.42), u2=(0.0, 0, 0.41), n=axis)

t = np.arange(800) / 100
share = t / CYCLE % 1
angles = np.stack((0.06 * np.sin(2 * np.pi * share), -hip(share), 0.08 * np.sin(2 * np.pi * share + 1)), axis=-1)
hips = np.stack((1.3 * t, 0.02 * np.sin(2 * np.pi * share), 0.9 + 0.02 * np.cos(4 * np.pi * share)), axis=-1)
thigh = hp.BodyMotion(R=hips, S=hp.euler_to_matrix(angles))
state = leg.forward_kinematics_from_body1(thigh, knee(share))

# %%
# The cameras record markers with noise, and NaN where a marker is hidden.
rng = np.random.default_rng(5)
on_thigh = np.array([(0.06, 0.05, -0.12), (0.07, -0.05, -0.2), (-0.02, 0.08, -0.26), (0.05, 0.02, -0.32)])
on_shank = np.array([(0.05, 0.04, 0.30), (0.05, -0.04, 0.24), (-0.03, 0.06, 0.18), (0.04, 0.01, 0.11)])


def seen(R, S, places):
    """Return the recorded positions of the markers of one body [m], shape (N, 4, 3)."""
    markers = R[:, None] + np.einsum("tij,mj->tmi", S, places) + 1e-3 * rng.standard_normal((len(R), 4, 3))
    markers[rng.random(len(R)) < 0.1, 2] = np.nan
    return markers


# %%
# `fit_cluster` computes poses from markers, and `fit` the hinge from poses. The reference point of each pose is the
# mean of the markers. It is the most certain point of the body, because errors of the attitude do not move it. Both
# bodies are recorded with one clock.
mean1, mean2 = on_thigh.mean(axis=0), on_shank.mean(axis=0)
body1 = hp.fit_cluster(seen(thigh.R, thigh.S, on_thigh), reference=on_thigh - mean1).body
body2 = hp.fit_cluster(seen(state.R2, state.S2, on_shank), reference=on_shank - mean2).body
fit = hp.fit(body1, body2, t=t, clock_offset=0)
print(fit)

# %%
# The uncertainty of the axis grows with the distance from the markers. Axes drawn from the covariance of the fit
# intersect the plane y = 0.1 m, the outer side of the knee, within an ellipse of about a millimetre. In reality,
# markers on skin also move relative to the bone; neither this recording nor the uncertainty includes this error.
offset = 0.1
draws = hp.sample_pairs(fit.pair, 2000, covariance=fit.covariance, seed=1)


def pierced(u1, n):
    """Return x and z at which the axis intersects the plane y = offset of the thigh [mm], shape (..., 2)."""
    return 1000 * (u1 + ((offset - u1[..., 1]) / n[..., 1])[..., None] * n)[..., [0, 2]]


cloud, estimate = pierced(draws.u1 + mean1, draws.n), pierced(fit.pair.u1 + mean1, fit.pair.n)
truth = pierced(leg.u1, leg.n)
error = np.degrees(np.arccos(min(1.0, abs(fit.pair.n @ leg.n))))
print(f"axis off by {error:.2f} degrees; in the plane off by {np.hypot(*(estimate - truth)):.1f} mm")

figure, (path, curve, place) = plt.subplots(1, 3, figsize=(11, 4), layout="constrained", width_ratios=(1.2, 1, 0.9))
knees = thigh.R + thigh.S @ leg.u1
for now in range(0, 121, 8):
    points = np.stack((thigh.R[now], knees[now], state.R2[now]))
    path.plot(points[:, 0], points[:, 2], "-o", color=plt.cm.viridis(now / 130), ms=3)
path.set(aspect="equal", xlabel="x [m]", ylabel="z [m]", title="The leg in one stride")
curve.plot(100 * share, np.degrees(fit.psi), ".", ms=3, color="C0", label="identified, 7 strides")
curve.plot(100 * cycle, np.degrees(knee(cycle)), "k+", ms=9)
grid = np.linspace(0, 1, 200)
curve.plot(100 * grid, np.degrees(knee(grid)), "k", lw=1, label="truth")
curve.set(xlabel="gait cycle [%]", ylabel="flexion of the knee [degrees]", ylim=(0, 80), title="Hinge angle")
curve.legend()
place.plot(*cloud.T, ".", ms=2, alpha=0.3, label="2000 draws of the fit")
place.plot(*estimate, "C0o", mec="k", label="estimate")
place.plot(*truth, "k+", ms=12, mew=2, label="truth")
place.set(aspect="equal", xlabel="x in the thigh [mm]", ylabel="z in the thigh [mm]", title="The axis at y = 0.1 m")
place.legend(fontsize="small")
plt.show()
