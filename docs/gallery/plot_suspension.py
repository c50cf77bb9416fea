"""
Tolerances of a wheel suspension
================================

The rear wheel of a car is carried by a semi-trailing arm, which is one inclined hinge. Toe and camber of the wheel
change with its travel, and manufacturing tolerances make them scatter from car to car. How large is the scatter, and
which dimension causes it?

The dimensions are assumed: the hinge axis is swept by 15 degrees, and the centre of the wheel is 0.42 m behind it.
Toe within 10 minutes of arc (1/6 degree) of its nominal value is taken as acceptable.
"""

import matplotlib.pyplot as plt
import numpy as np

import hingepair as hp

# %%
# Body 1 is the car, with x forward, y to the left and z up. Body 2 is the arm with the left wheel; its reference
# point is the centre of the wheel, and its y axis is the axis of the wheel. At psi = 0 the car is at its design
# height, with 9 minutes of toe-in and -1.5 degrees of camber.
SWEEP, TOE, CAMBER = np.radians((15, 0.15, -1.5))
alignment = hp.rodrigues((0, 0, 1), -TOE) @ hp.rodrigues((1, 0, 0), -CAMBER)
axis = (np.sin(SWEEP), np.cos(SWEEP), 0)
arm = hp.HingePair(u1=(-1.0, 0.45, 0), u2=(0.42, -0.25, 0.02), n=axis, home=alignment)
car = hp.BodyMotion.at_rest()

# %%
# Two bushes, 0.4 m apart, carry the arm. The standard deviation of their positions on the car is 0.5 mm in each
# direction. The mean of both deviations shifts u1; their difference tilts the axis and the arm with it. The standard
# deviation of the direction of the face of the wheel bearing is 0.5 mrad. Each source has a covariance of twelve
# numbers: u1, u2, n and the rotation vector by which `home` deviates. The total covariance is the sum of all sources.
DISTANCE, n = 0.4, arm.n
sources = {}
for number, letter in enumerate("xyz"):
    columns = []
    for sign in (-1, 1):  # the bush on either side
        shift = 0.5e-3 * np.eye(3)[number]
        turn = np.cross(n, sign * shift / DISTANCE)
        columns.append(np.concatenate((shift / 2, np.zeros(3), np.cross(turn, n), turn)))
    sources[f"bushes, {letter}"] = np.transpose(columns) @ columns
for number, direction in ((0, "camber"), (2, "toe")):
    column = np.zeros(12)
    column[9 + number] = 0.5e-3
    sources[f"bearing face, {direction}"] = np.outer(column, column)
covariance = sum(sources.values())
built = hp.sample_pairs(arm, 20_000, covariance=covariance, seed=1)


def toe_and_camber(S2):
    """Return toe-in and camber of a left wheel [degrees] from its attitude."""
    return np.degrees((-np.arctan2(S2[..., 1, 0], S2[..., 0, 0]), -np.arcsin(S2[..., 2, 1])))


psi = np.radians(np.linspace(-10, 10, 41))
design = arm.forward_kinematics_from_body1(car, psi)
travel = 1000 * (design.R2[:, 2] - arm.forward_kinematics_from_body1(car, 0.0).R2[2])  # mm
cars = built.forward_kinematics_from_body1(car, psi[:, None], outputs=("S2",))
nominal, scattered = toe_and_camber(design.S2), toe_and_camber(cars.S2)
middle = len(psi) // 2
spread = scattered[:, middle].std(axis=1)
bad = np.mean(np.abs(scattered[0, middle] - nominal[0, middle]) > 10 / 60)
print(
    f"at design height: toe {60 * spread[0]:.1f} minutes, camber {60 * spread[1]:.1f} minutes (standard deviations)"
)
print(f"toe is out of 10 minutes in {100 * bad:.0f} % of the cars, which need an adjustment")

# %%
# `propagate_covariance` computes the same to first order without samples, for each source. Toe is the rotation about
# z, camber the rotation about x. The positions of the bushes along x cause most of the scatter of toe, and their
# positions along z cause most of the scatter of camber; the bearing face contributes little.
shares = {
    name: arm.propagate_covariance(car, 0.0, covariance=part).attitude_std[[2, 0]] for name, part in sources.items()
}
total = np.sqrt(sum(share**2 for share in shares.values()))
print(f"to first order: toe {60 * np.degrees(total[0]):.1f} minutes, camber {60 * np.degrees(total[1]):.1f} minutes")

figure, (toe, camber, bars) = plt.subplots(1, 3, figsize=(11, 4), layout="constrained")
for axes, value, cases, title in zip((toe, camber), nominal, scattered, ("Toe-in", "Camber"), strict=True):
    for outer, shade in ((97.7, 0.2), (84.1, 0.35)):
        axes.fill_betweenx(travel, *np.percentile(cases, (100 - outer, outer), axis=1), color="C0", alpha=shade, lw=0)
    axes.plot(value, travel, "k")
    axes.axhline(0, color="0.6", lw=0.8)
    axes.set(xlabel=f"{title.lower()} [degrees]", ylabel="wheel travel, up [mm]", title=f"{title}: 1 and 2 sigma")
toe.plot([nominal[0, middle] - 1 / 6, nominal[0, middle] + 1 / 6], [0, 0], "r|-", ms=12, label="10 minutes")
toe.legend()
places = np.arange(len(shares))
for number, name in enumerate(("toe", "camber")):
    bars.barh(
        places + 0.2 - 0.4 * number,
        [100 * (share[number] / total[number]) ** 2 for share in shares.values()],
        0.4,
        label=name,
    )
bars.set_yticks(places, shares)
bars.set(xlabel="share of the variance [%]", title="Sources of the scatter")
bars.legend()
plt.show()
