"""Problems A02, A03 and A04 of the IFToMM library of computational benchmark problems, with errors and run times.

The references share no code with hingepair: the pendulum to which the N four-bars are equal, bodies of the plane held
together by Lagrange multipliers (A03), and points and axes in Cartesian coordinates (A04), by SciPy's DOP853. A03 is
also compared with the end that the test set for initial value problems of Bari publishes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import hingepair as hp

Array: TypeAlias = NDArray[np.float64]
Z = (0, 0, 1)
FALL = (0.0, -9.81, 0.0)


class Problem(NamedTuple):
    """A mechanism, its motion, and what is compared."""

    name: str
    mechanism: hp.Mechanism
    t: Array
    q0: tuple[float, ...]
    qd0: tuple[float, ...]
    tau: float
    gravity: tuple[float, float, float]
    seen: Callable[[Any], Array]  # of a simulated motion
    reference: Callable[[], Array]  # the same, of a motion that is computed otherwise


# ---- A02: N windows of bars of 1 m and 1 kg, upright, pushed aside with 1 m/s


def four_bars(count: int, t: Array) -> Problem:
    """Return N four-bars, each of which drives the next; all pass change points where they lie flat."""
    upright, across = (hp.Body(1.0, along, (1 / 12,) * 3) for along in ((0, 0.5, 0), (0.5, 0, 0)))
    joints, parents = [], []
    for k in range(count + 1):
        joints.append(hp.HingePair((k, 0, 0), (0, 0, 0), Z, name=f"bar{k:02}", body2=upright))
        parents.append(0)
        if k < count:
            joints.append(hp.HingePair((0, 1, 0), (0, 0, 0), Z, name=f"beam{k:02}", body2=across))
            parents.append(len(joints) - 1)
    robot, loops = hp.Mechanism(joints, parents=parents), []
    for k in range(count):
        robot = robot.with_frame(f"end{k}", f"beam{k:02}", R=(1, 0, 0))
        robot = robot.with_frame(f"top{k}", f"bar{k + 1:02}", R=(0, 1, 0))
        loops.append(hp.Loop(f"end{k}", f"top{k}"))
    closed = robot.closed(*loops, coordinates="bar00").with_frame("B0", "bar00", R=(0, 1, 0))

    def reference() -> Array:
        inertia, moment = (count + 1) / 3 + count, 9.81 * ((count + 1) / 2 + count)
        phi = integrated(lambda _, y: [y[1], moment / inertia * np.sin(y[0])], [0.0, 1.0], t, 1e-13)[0]
        return np.stack((np.sin(phi), np.cos(phi)), axis=-1)

    name = f"A02, {count} four-bars: B0 [m]"
    return Problem(name, closed, t, (0,), (-1,), 0.0, FALL, lambda motion: motion["B0"].R[:, :2], reference)


# ---- A03: Andrews' squeezing mechanism, seven bodies driven by 0.033 N m

START = {  # rad, at rest
    "beta": -0.0617138900142764496358948458001, "theta": 0.0, "gamma": 0.455279819163070380255912382449,
    "phi": 0.222668390165885884674473185609, "delta": 0.487364979543842550225598953530,
    "omega": -0.222668390165885884674473185609, "epsilon": 1.23054744454982119249735015568,
}  # fmt: skip
END = {  # rad at 0.03 s, as published: https://archimede.uniba.it/~testset
    "beta": 15.81077119629904, "theta": -15.75637105984298, "gamma": 0.04082224013073101, "phi": -0.5347301163226948,
    "delta": 0.5244099658805304, "omega": 0.5347301163226948, "epsilon": 1.048080741042263,
}  # fmt: skip
FIRST_ACCELERATION = 14222.4439199541138705911625887  # rad/s^2, of beta
A, B, C = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
MASSES = {
    "beta": (0.04325, 2.194e-6, (0.00092, 0)), "theta": (0.00365, 4.410e-7, (-0.0115, 0)),
    "gamma": (0.02373, 5.255e-6, (0.01043, -0.01874)), "phi": (0.00706, 5.667e-7, (0, 0.01421 - 0.02)),
    "delta": (0.0705, 1.169e-5, (0.02308, 0.00916)), "omega": (0.00706, 5.667e-7, (0.02 - 0.01421, 0)),
    "epsilon": (0.05498, 1.912e-5, (-0.00449, -0.01228)),
}  # fmt: skip
# By the body that a hinge carries: the body at which it is, None for the ground, and the point in its axes [m].
HINGES = {
    "beta": (None, (0, 0)), "theta": ("beta", (0.007, 0)), "delta": (None, A), "phi": ("delta", (0.04, 0)),
    "epsilon": (None, A), "omega": ("epsilon", (0, -0.04)), "gamma": (None, B),
}  # fmt: skip
ENDS = {"theta": (-0.028, 0), "gamma": (0, -0.035), "phi": (0, -0.02), "omega": (0.02, 0)}  # which meet in one point
SPRING, SPRING_LENGTH, SPRING_POINT, TORQUE = 4530.0, 0.07785, (0.02, -0.018), 0.033


def andrews(t: Array) -> Problem:
    """Return Andrews' squeezing mechanism; what is compared are its seven angles."""
    names = [*HINGES]
    joints = [
        hp.HingePair((*point, 0), (0, 0, 0), Z, name=name, body2=hp.Body(mass, (*centre, 0), (moment,) * 3))
        for name, (_, point) in HINGES.items()
        for mass, moment, centre in [MASSES[name]]
    ]
    robot = hp.Mechanism(joints, parents=[names.index(one) + 1 if one else 0 for one, _ in HINGES.values()])
    for name, point in ENDS.items():
        robot = robot.with_frame(f"end_{name}", name, R=(*point, 0))
    robot = robot.with_frame("C", "base", R=(*C, 0)).with_frame("D", "gamma", R=(*SPRING_POINT, 0))
    robot = robot.with_strut("C", "D", "spring", stiffness=SPRING, free_length=SPRING_LENGTH)
    loops = [hp.Loop("end_theta", f"end_{name}") for name in ("gamma", "phi", "omega")]
    closed = robot.closed(*loops, coordinates="beta", at=START)

    def angles(motion: Any) -> Array:
        q = closed.all_coordinates(motion.q)
        return np.stack([q[:, robot.names.index(name)] for name in END], axis=-1)

    return Problem(
        "A03, Andrews' squeezer: angles [rad]", closed, t, (START["beta"],), (0,), TORQUE, (0, 0, 0), angles,
        lambda: planar_squeezer(t),
    )  # fmt: skip


def planar_squeezer(t: Array) -> Array:
    """Return the angles of A03 from x, y and the angle of seven free bodies, with multipliers for the hinges."""
    names = [*HINGES]
    masses = np.array([[MASSES[name][0]] * 2 + [MASSES[name][1]] for name in names]).ravel()
    joints = [(name, one, (0.0, 0.0), point) for name, (one, point) in HINGES.items()]
    joints += [("theta", name, ENDS["theta"], ENDS[name]) for name in ("gamma", "phi", "omega")]

    def arm(name: str | None, point: Any) -> Array:
        return np.asarray(point, float) - np.asarray(MASSES[name][2] if name else (0, 0), float)

    def turned(angle: float, vector: Array) -> tuple[Array, Array]:
        """Return a vector in world axes, and its derivative by the angle."""
        c, s = np.cos(angle), np.sin(angle)
        x, y = vector
        return np.array([c * x - s * y, s * x + c * y]), np.array([-s * x - c * y, c * x - s * y])

    def conditions(x: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return the gaps of all hinges, their Jacobian and the second derivatives at rest of x''."""
        gaps, J, bias = np.zeros(2 * len(joints)), np.zeros((2 * len(joints), len(x))), np.zeros(2 * len(joints))
        for k, (first, second, at_first, at_second) in enumerate(joints):
            rows = slice(2 * k, 2 * k + 2)
            for name, point, sign in ((first, at_first, 1), (second, at_second, -1)):
                if name is None:
                    gaps[rows] += sign * np.asarray(point)
                    continue
                own = 3 * names.index(name)
                r, dr = turned(x[own + 2], arm(name, point))
                gaps[rows] += sign * (x[own : own + 2] + r)
                J[rows, own : own + 2] += sign * np.eye(2)
                J[rows, own + 2] += sign * dr
                bias[rows] -= sign * r * v[own + 2] ** 2
        return gaps, J, bias

    def rates(_: float, y: Array) -> Array:
        x, v = np.split(y, 2)
        _, J, bias = conditions(x, v)
        force, own = np.zeros(len(x)), 3 * names.index("gamma")
        force[3 * names.index("beta") + 2] = TORQUE
        r, dr = turned(x[own + 2], arm("gamma", SPRING_POINT))
        apart = x[own : own + 2] + r - C
        length = np.hypot(*apart)
        pull = -SPRING * (length - SPRING_LENGTH) / length * apart
        force[own : own + 2] += pull
        force[own + 2] += dr @ pull
        inverse = J / masses
        multipliers = np.linalg.solve(inverse @ J.T, inverse @ force + bias)
        return np.concatenate((v, (force - J.T @ multipliers) / masses))

    angle, point = dict[str | None, float]({None: 0.0}), dict[str | None, Array]({None: np.zeros(2)})
    start = np.zeros(3 * len(names))
    for k, (name, (one, at)) in enumerate(HINGES.items()):
        angle[name] = START[name] + angle[one]
        point[name] = point[one] + turned(angle[one], np.asarray(at, float))[0]
        centre = turned(angle[name], np.asarray(MASSES[name][2], float))[0]
        start[3 * k : 3 * k + 3] = *(point[name] + centre), angle[name]
    found = integrated(rates, np.concatenate((start, 0 * start)), t, 1e-12)
    absolute = {None: 0 * t, **{name: found[3 * k + 2] for k, name in enumerate(names)}}
    return np.stack([absolute[name] - absolute[HINGES[name][0]] for name in END], axis=-1)


# ---- A04: Bricard's mechanism, five rods of 1 m, 1 kg and a section of 0.1 m x 0.1 m along edges of a cube

CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)], float)
AXES = np.array([(0, 1, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0)], float)  # at these corners
SECTION = 0.1**2 / 12  # second moment of the section's mass per kg [m^2]


def bricard(t: Array) -> Problem:
    """Return Bricard's mechanism, which moves though six hinges leave no freedom; P3 is compared."""
    joints = []
    for k in range(5):
        along = CORNERS[k + 1] - CORNERS[k]
        inertia = np.diag(np.where(np.abs(along) > 0.5, 2 * SECTION, 1 / 12 + SECTION))
        u1 = CORNERS[k] - CORNERS[max(k - 1, 0)]
        joints.append(hp.HingePair(u1, (0, 0, 0), AXES[k], name=f"P{k}", body2=hp.Body(1.0, along / 2, inertia)))
    robot = hp.Mechanism(joints).with_frame("end", "P4", R=CORNERS[5] - CORNERS[4])
    robot = robot.with_frame("P5", "base", R=CORNERS[5])
    closed = robot.closed(hp.Loop("end", "P5", kind="hinge", axis=AXES[5]), coordinates="P0")
    return Problem(
        "A04, Bricard: P3 [m]", closed, t, (0,), (0,), 0.0, FALL, lambda motion: motion["P3"].R,
        lambda: cartesian_bricard(t),
    )  # fmt: skip


def cartesian_bricard(t: Array) -> Array:
    """Return P3 of A04 from P1 to P4 and the axes there, which stay across the rods: 24 conditions, one redundant."""
    free, size = slice(1, 5), 12

    def whole(x: Array, ends: Array) -> Array:
        return np.concatenate((ends[:1], x.reshape(4, 3), ends[-1:]))

    pairs = [("pp", k + 1, k, k + 1, k) for k in range(5)]  # products of two vectors: rods, and rods by axes
    pairs += [("pn", k + 1, k, j, None) for k in range(5) for j in (k, k + 1)]
    pairs += [("nn", k, None, k + 1, None) for k in range(5)] + [("nn", k, None, k, None) for k in range(1, 5)]

    def rates(_: float, y: Array) -> Array:
        parts = np.split(y, 4)
        p, n = whole(parts[0], CORNERS), whole(parts[1], AXES)
        dp, dn = whole(parts[2], 0 * CORNERS), whole(parts[3], 0 * AXES)
        J, bias = np.zeros((len(pairs), 2, 6, 3)), np.zeros(len(pairs))
        for row, (kinds, *places) in enumerate(pairs):
            factors = []
            for kind, plus, minus in zip(kinds, places[::2], places[1::2], strict=True):
                own, moving = (p, dp) if kind == "p" else (n, dn)
                less = (0, 0) if minus is None else (own[minus], moving[minus])
                factors.append((kind == "n", plus, minus, own[plus] - less[0], moving[plus] - less[1]))
            for (axis, plus, minus, _, _), (_, _, _, other, _) in (factors, factors[::-1]):
                J[row, int(axis), plus] += other
                if minus is not None:
                    J[row, int(axis), minus] -= other
            bias[row] = -2 * factors[0][4] @ factors[1][4]
        J = J[:, :, free].reshape(len(pairs), 2 * size)
        inverse = J @ weights
        multipliers = np.linalg.lstsq(inverse @ J.T, inverse @ force - bias, rcond=1e-9)[0]
        return np.concatenate((y[2 * size :], weights @ (force - J.T @ multipliers)))

    mass, load = np.zeros((2, 6, 6)), np.zeros((2, 6, 3))
    for k in range(5):  # a uniform rod, whose section moves with both axes
        mass[0, k : k + 2, k : k + 2] += np.array([[2, 1], [1, 2]]) / 6
        mass[1, [k, k + 1], [k, k + 1]] += SECTION
        load[0, k : k + 2, 1] -= 9.81 / 2
    weights = np.zeros((2 * size, 2 * size))
    for part in range(2):
        own = slice(part * size, (part + 1) * size)
        weights[own, own] = np.kron(np.linalg.inv(mass[part, free, free]), np.eye(3))
    force = load[:, free].ravel()
    start = np.concatenate((CORNERS[free].ravel(), AXES[free].ravel(), np.zeros(2 * size)))
    return integrated(rates, start, t, 1e-13)[6:9].T


# ---- all


def integrated(rates: Callable[[float, Array], Any], start: Any, t: Array, tol: float) -> Array:
    """Return the states of a motion by DOP853; shape (states, instants)."""
    return np.asarray(solve_ivp(rates, (t[0], t[-1]), start, "DOP853", t, rtol=tol, atol=tol).y)


def problems(share: float = 1.0) -> list[Problem]:
    """Return all problems, for a share of their spans of 10, 0.05 and 10 s."""
    ten = np.linspace(0, 10 * share, 401)
    return [four_bars(2, ten), four_bars(40, ten), andrews(np.linspace(0, 0.05 * share, 401)), bricard(ten)]


def simulated(problem: Problem, tol: float) -> Any:
    """Return the simulated motion of a problem."""
    return hp.simulate(
        problem.mechanism, problem.t, problem.q0, problem.qd0, tau=problem.tau, gravity=problem.gravity, tol=tol
    )


def main() -> None:
    """Print a line for each problem."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    options.add_argument("--share", type=float, default=1.0, help="of the spans, from 0 to 1")
    options.add_argument("--tol", type=float, default=1e-12, help="tolerance of the simulation")
    given = options.parse_args()
    print(f"{'problem':42}{'error':>9}{'time [s]':>10}{'steps':>7}{'energy':>9}{'reference [s]':>15}")
    for problem in problems(given.share):
        simulated(problem, given.tol)  # which compiles
        start = time.perf_counter()
        motion = simulated(problem, given.tol)
        between = time.perf_counter()
        truth = problem.reference()
        taken = between - start, time.perf_counter() - between
        error = np.abs(problem.seen(motion) - truth).max()
        energy = motion.energy()
        work = problem.tau * (motion.q[:, 0] - motion.q[0, 0])
        drift = np.ptp(energy.kinetic + energy.potential - work) / np.ptp(energy.kinetic)
        print(f"{problem.name:42}{error:9.1e}{taken[0]:10.3f}{motion.steps:7}{drift:9.0e}{taken[1]:15.2f}")
    squeezer = andrews(np.array([0, 0.03]))
    end = squeezer.seen(simulated(squeezer, given.tol))[-1]
    print(f"A03 at 0.03 s differs from what is published by {np.abs(end - [*END.values()]).max():.1e} rad")


if __name__ == "__main__":
    main()
