"""Masses and friction of a robot from a recorded motion and its torques, by weighted least squares."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, FitError, ShapeError, nearest, quoted
from hingepair.measured.consistency import body_units, consistent_parameters, nearest_parameters
from hingepair.measured.covariance import neighbour_correlation, sandwich, score_scatter
from hingepair.measured.findings import RANDOM_CORRELATION, Finding, exceeded, is_reliable, notes
from hingepair.measured.robust import LOSSES, OUTLIER, Loss, loss_weights, median_variance
from hingepair.mechanism.inertial_parameters import BaseParameters, body_names, inertia_matrices
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.numeric.arrays import Float64Array, Frozen, broadcast_shape, check_choice, finite_number, read_only
from hingepair.numeric.optional import new_figure
from hingepair.plans.arguments import Coordinates, read_arguments
from hingepair.tables.sheets import Sheet, Shown, align_columns, cell_text, percent
from hingepair.tables.suspicions import suspicions
from hingepair.tables.units import SI, Units, UnitsLike

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class _Term(NamedTuple):
    """Term of the torque of a joint by itself, in proportion to one parameter."""

    factor: Callable[[Float64Array, Float64Array], Float64Array]  # of qd and qdd: the torque for a parameter of 1
    field: str = ""  # of the joint's load that has the parameter
    signed: bool = False  # whether it may be below 0


_TERMS: Final = {  # by name
    "viscous": _Term(lambda qd, _: qd, "damping"),
    "coulomb": _Term(lambda qd, _: np.sign(qd), "friction"),
    "offset": _Term(lambda qd, _: np.ones_like(qd), signed=True),
    "armature": _Term(lambda _, qdd: qdd),
}
JOINT_TERMS: Final = tuple(_TERMS)
"""Names of the terms that a fit may have."""
_NORMAL_95 = 1.959963984540054  # standard deviations: 95 % of a normal distribution are within
_SINGULAR = 1e-12  # of the largest eigenvalue; below, a combination of parameters has no effect on the torques
_BLOCK = 2**23  # numbers of a regressor that are in memory at a time
_WEIGHT_ROUNDS = 3  # in which the noise of each joint and the parameters are estimated in turn
_LEAST_NOISE = 1e-7  # smallest noise assumed, of what the described parameters leave: weights stay finite
_ROUNDING = 1e-12  # smallest noise assumed, of the torques: less is rounding
_HARDLY_KNOWN, _UNKNOWN = 0.5, 2.0  # from these standard deviations on, in parts of what such a body may have
_WORSE = 1.5  # times the error of the samples fitted to; above, the parameters do not hold for new ones
_POOR = 0.2  # of a joint's torque: a larger rest that is not random cannot be filtered noise alone
_GROWTH = 10.0  # of the squares of what is left, in variances of noise per parameter; more is worse than by chance
_JUDGED_STATES = 64  # states whose mass matrices are judged
_JUDGED_SAMPLES = 65536  # samples whose order is judged
_FAR_OFF = 10.0  # squares of outliers, times those of the others; more decides on the parameters
_DEPENDENT = 5.0  # of squares of means, times what noise makes of them
_ORDERED_SAMPLES = 4096  # neighbours that tell delays and the noise of the motion


@dataclass(frozen=True, slots=True, eq=False)
class MassFit(Frozen, Shown):
    """The result of `fit_masses`: base parameters of a robot, and what its joints do by themselves.

    Attributes:
        robot: the robot with the fitted masses, a Mechanism. Of many masses with the fitted base parameters, it has
            those nearest to the masses described. Fitted friction is in its `joint_loads`, which methods count with
            `joint_loads=True`; a fitted rotor in its `armature`.
        base: the BaseParameters; `base.values` are those of the robot as described.
        names: names of all parameters: B base parameters, then terms of joints such as "elbow viscous".
        values: estimates, in the order of `names` [kg, kg m, kg m^2; N m s/rad, N m, N m, kg m^2 for hinges].
        std: their standard deviations; inf where the motion does not determine a parameter.
        covariance: covariance matrix of `values`, without what is not determined; shape (B + F, B + F). It allows for
            noise that is correlated from sample to sample.
        described: the same parameters of the robot as described.
        noise: standard deviation of the noise of the torques of each joint [N m]; shape (dof,).
        rms: root mean square of what is left of the torques in the samples fitted to [N m]; shape (dof,).
        rms_test: the same in the samples kept for the test; shape (dof,), NaN if there are none.
        rms_described: the same by the robot as described, in all samples; shape (dof,).
        samples: number of samples fitted to.
        findings: sentences on what is not determined, what the torques have that the parameters have not, and what
            else is notable, as those of a HingeFit.
        joint_terms: terms of each joint that were fitted.
        unknown: the links whose masses were fitted; () of all.
    """

    robot: Mechanism
    base: BaseParameters
    names: tuple[str, ...]
    values: Float64Array
    std: Float64Array
    covariance: Float64Array
    described: Float64Array
    noise: Float64Array
    rms: Float64Array
    rms_test: Float64Array
    rms_described: Float64Array
    samples: int
    findings: tuple[Finding, ...]
    joint_terms: tuple[str, ...]
    gravity: tuple[float, ...] = field(repr=False)
    unknown: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether no finding says that a number may be wrong by more than its standard deviations."""
        return is_reliable(self.findings)

    @property
    def intervals(self) -> Float64Array:
        """Lower and upper ends of the 95 % confidence intervals of `values`; shape (B + F, 2)."""
        reach = _NORMAL_95 * self.std
        return read_only(np.stack((self.values - reach, self.values + reach), axis=1))

    def torques(self, q: Coordinates, qd: Coordinates, qdd: Coordinates) -> Float64Array:
        """Return the torques of any motion by the fitted parameters, joint terms included; shape (..., dof). The
        arguments are those of `fit_masses`.
        """
        values = _arrays(self.robot, {"q": q, "qd": qd, "qdd": qdd})
        shape = values["q"].shape
        flat = {name: one.reshape(-1, shape[-1]) for name, one in values.items()} | {"tau": np.zeros((1, 1))}
        recording = _Recording(
            self.robot, self.base, self.joint_terms, self.gravity, flat, self.values, bool(self.unknown)
        )
        return -recording.left(self.values).reshape(shape)

    def plot(
        self,
        q: Coordinates,
        qd: Coordinates,
        qdd: Coordinates,
        tau: Coordinates,
        t: ArrayLike,
        units: UnitsLike = None,
    ) -> Figure:
        """Return a Matplotlib figure of measured and fitted torques over time, a row for each joint.

        Args:
            q: recorded coordinates, as for `fit_masses`.
            qd: their first time derivatives.
            qdd: their second time derivatives.
            tau: recorded torques and forces.
            t: instants [s]; shape (N,).
            units: units in place of SI units, such as "N mm, ms".

        Raises:
            MissingDependencyError: Matplotlib is not installed.
        """
        measured, fitted = _arrays(self.robot, {"tau": tau})["tau"], self.torques(q, qd, qdd)
        joints, shown = tree_of(self.robot).coordinates, Units.of(units)
        instants = shown.factor("s") * np.asarray(t, np.float64)
        figure = new_figure(9, 1 + 1.3 * len(joints))
        rows = figure.subplots(len(joints), sharex=True, squeeze=False)[:, 0]
        for k, (axes, joint) in enumerate(zip(rows, joints, strict=True)):
            factor = shown.factor(joint.effort_unit)
            axes.plot(instants, factor * measured[:, k], linewidth=0.8, color="0.6", label="measured")
            axes.plot(instants, factor * fitted[:, k], linewidth=0.8, label="fitted")
            axes.set_ylabel(joint.name, fontsize=8)
            axes.grid(alpha=0.3)
        rows[0].legend(loc="upper right", ncols=2)
        rows[-1].set_xlabel(f"t [{shown.unit('s')}]")
        efforts = dict.fromkeys(joint.effort_unit for joint in joints)
        figure.supylabel(", ".join(f"{'force' if si == 'N' else 'torque'} [{shown.unit(si)}]" for si in efforts))
        return figure

    def __repr__(self) -> str:
        return f"MassFit({len(self.names)} parameters, {self.samples} samples, {'ok' if self.ok else 'not ok'})"

    def __str__(self) -> str:
        return self.text()

    def text(self, units: UnitsLike = None) -> str:
        """Return the report that `print` shows.

        Args:
            units: units in place of SI units, such as "mm, N mm"; of the findings they stay.
        """
        shown = Units.of(units)
        title, rows, _ = self._sheet(shown)
        joints: list[tuple[str, ...]] = [("joint", "unit", "noise", "left", "left in test", "left as described")]
        for k, joint in enumerate(tree_of(self.robot).coordinates):
            cells = (self.noise[k], self.rms[k], self.rms_test[k], self.rms_described[k])
            factor = shown.factor(joint.effort_unit)
            joints.append((joint.name, shown.unit(joint.effort_unit), *(f"{factor * cell:.3g}" for cell in cells)))
        return "\n".join(
            (
                title, *align_columns(rows, {2, 3, 4}),
                "torques, root mean squares", *align_columns(joints, {2, 3, 4, 5}),
                *self.findings, "ok" if self.ok else "NOT RELIABLE",
            )
        )  # fmt: skip

    def _sheet(self, units: Units = SI) -> Sheet:
        """Return the printed table of the parameters, below which are the findings."""
        rows = [("parameter", "unit", "value", "standard deviation", "as described")]
        for k, (name, (unit, factor)) in enumerate(zip(self.names, self._units(units), strict=True)):
            value, std, described = (factor * float(own[k]) for own in (self.values, self.std, self.described))
            rows.append((name, unit, cell_text(value), f"{std:.2g}", cell_text(described)))
        title = f"{self.robot.name}: {len(self.names)} parameters of {self.samples} samples"
        return Sheet(title, rows, self.findings)

    def _units(self, units: Units) -> Iterator[tuple[str, float]]:
        """Yield the unit of each parameter, and the factor from its SI unit."""
        metre, length = units.unit("m"), units.factor("m")
        moments = (("kg", 1.0), (f"kg {metre}", length), (f"kg {metre}^2", length**2))
        for column in (self.base.columns % 10).tolist():  # mass, first moments, inertias
            yield moments[(column > 0) + (column > 3)]
        for term in self.joint_terms:
            for joint in tree_of(self.robot).coordinates:
                effort, factor = units.unit(joint.effort_unit), units.factor(joint.effort_unit)
                if term == "armature":
                    yield moments[0 if joint.unit == "m" else 2]
                elif term == "viscous":
                    yield f"{effort} s/{units.unit(joint.unit)}", factor / units.factor(joint.unit)
                else:
                    yield effort, factor

    def to_json(self) -> str:
        """Return a report as JSON text, in SI units. Numbers that are not finite become null. `parameters` holds
        value, std and described by name, `joints` noise, rms, rms_test and rms_described.
        """
        import json

        def finite(value: float) -> float | None:
            return float(value) if np.isfinite(value) else None

        of_parameters, of_joints = ("values", "std", "described"), ("noise", "rms", "rms_test", "rms_described")
        report = {
            "ok": self.ok,
            "samples": self.samples,
            "parameters": {
                name: {key.removesuffix("s"): finite(getattr(self, key)[k]) for key in of_parameters}
                for k, name in enumerate(self.names)
            },
            "joints": {
                name: {key: finite(getattr(self, key)[k]) for key in of_joints}
                for k, name in enumerate(self.robot.names)
            },
            "findings": list(self.findings),
        }
        return json.dumps(report, indent=2, allow_nan=False)


def fit_masses(
    robot: Mechanism,
    q: Coordinates,
    qd: Coordinates,
    qdd: Coordinates,
    tau: Coordinates,
    *,
    joint_terms: Iterable[str] | None = None,
    physical: bool = False,
    unknown: Iterable[str] = (),
    loss: str = "linear",
    test: float = 0.25,
    gravity: ArrayLike = DEFAULT_GRAVITY,
) -> MassFit:
    """Fit the masses of a robot, and the friction of its joints, to a recorded motion and its torques.

    Torques depend on the masses by the base parameters alone, in which they are linear (T13): weighted least squares,
    where the noise of each joint is estimated from the data. The noise may be correlated from sample to sample; q, qd
    and qdd count as exact.

    Args:
        robot: the robot as described, with a fixed base at rest. Its dimensions are trusted; its masses may be wrong,
            or 0, and decide where the motion does not. Its `armature` counts, unless it is fitted.
        q: recorded coordinates in time, in the forms of `robot.inverse_dynamics`; shape (N, dof). Samples with NaN
            in any argument are not used.
        qd: their first time derivatives; `hp.smooth` derives them from the coordinates of a joint.
        qdd: their second time derivatives.
        tau: recorded torques of hinges [N m] and forces of sliders [N], in the direction of q; shape (N, dof).
        joint_terms: what acts in a joint beside masses, out of "viscous" (in proportion to qd), "coulomb" (to the
            sign of qd), "offset" (constant) and "armature" (in proportion to qdd: the motor's rotor). Unless given,
            it is ("viscous", "coulomb"), and () with `unknown`.
        physical: whether the masses must be those of rigid bodies, and friction not below 0. Of all such parameters
            that explain the torques as well as the best of them do, but for two standard deviations of noise, those
            near to the described ones are found; `std` are without this condition. Needs the extra `measured`.
        unknown: links or frames, such as ["tool0"] of a payload: only the masses of the bodies that carry them are
            fitted; the other bodies, and friction that is not fitted, count as described. () to fit all.
        loss: "linear" (least squares), or a loss by which torques that are far off, such as spikes, count little:
            "soft_l1", "huber", "cauchy" or "arctan", as for `fit`.
        test: part of the samples, the last ones, that is not fitted to, but tells whether the parameters hold for
            other motions; 0 to fit to all.
        gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).

    Returns:
        The MassFit. Check `.ok` and `.findings` before you use its numbers.

    Raises:
        ArgumentError: an argument cannot be used, or the base is free.
        FitError: there are fewer samples than parameters, or no parameter has an effect on the torques.
        MissingDependencyError: `physical`, and the extra `measured` is not installed.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> robot = hp.load_robot("ur5_robot")
    >>> t = np.arange(0, 20, 0.02)[:, None]
    >>> rates = np.linspace(1, 2, robot.dof)
    >>> q, qd, qdd = np.sin(rates * t), rates * np.cos(rates * t), -(rates**2) * np.sin(rates * t)
    >>> loaded = robot.with_payload("tool0", hp.Body(2, inertia=(0.01, 0.01, 0.01)))
    >>> tau = loaded.inverse_dynamics(q, qd, qdd).tau
    >>> fit = hp.fit_masses(robot, q, qd, qdd, tau)
    >>> fit.ok, np.allclose(fit.torques(q, qd, qdd), tau)
    (True, True)
    """
    check_choice("loss", loss, LOSSES)
    links = () if isinstance(unknown, str) else tuple(unknown)
    if isinstance(unknown, str):
        raise ArgumentError("unknown", "names of links, as a list", unknown)
    if joint_terms is None:
        joint_terms = () if links else ("viscous", "coulomb")
    terms, share = _checked_options(robot, joint_terms, test)
    values = _arrays(robot, {"q": q, "qd": qd, "qdd": qdd, "tau": tau})
    if values["q"].ndim != 2:
        raise ShapeError("q", f"shape (N, {robot.dof}), N instants", f"shape {values['q'].shape}")
    known = np.logical_and.reduce([np.isfinite(one).all(axis=-1) for one in values.values()])
    base = robot.base_parameters(gravity=gravity)
    base = _parameters_of(robot, base, links) if links else base
    described = np.concatenate((base.values, *(_described_term(robot, term) for term in terms)))
    recording = _Recording(
        robot, base, terms, tuple(np.asarray(gravity, dtype=np.float64).tolist()),
        {name: one[known] for name, one in values.items()}, described, bool(links),
    )  # fmt: skip
    count = round((1 - share) * recording.samples)
    names = (*base.names, *(f"{joint} {term}" for term in terms for joint in robot.names))  # as `parts` has them
    if count * robot.dof <= len(names):
        raise FitError("q", f"more than {-(-len(names) // robot.dof)} samples to fit to", f"{count}")
    found = _weighted_least_squares(recording, count, LOSSES[loss])
    estimate = described + found.step
    impossible = [] if links else _mass_matrix_findings(recording, found, estimate)
    findings = impossible + _doubts(recording, found, estimate, count)
    parameters, estimate, more = _standard_parameters(recording, found, estimate, physical)
    fitted = _fitted_robot(recording, parameters, estimate)
    tree = tree_of(fitted)
    if tree.notes and not impossible:
        text = (
            f"{len(tree.notes)} of {len(tree.joints)} bodies of `robot` have masses that no rigid body "
            "has. Of all masses with these base parameters, they are nearest to those described: physical=True finds "
            "some of rigid bodies."
        )
        more.append(Finding("bodies", len(tree.notes), 0, text, harmless=True))
    left = recording.left(estimate)
    rms, rms_test = _rms(left[:count]), _rms(left[count:])
    findings += [*more, *_misfits(recording, left[:count], left[count:], found, LOSSES[loss])]
    findings += _data_findings(recording, found, left, count, parameters)
    findings.sort(key=lambda finding: finding.is_note)
    doubts = suspicions("angle", "q", np.abs(recording.values["q"]).max(axis=1))
    findings += [Finding("unit", 1, 0, text) for text in doubts]
    if not known.all():
        findings += notes("missing samples", [f"{int((~known).sum())} of {known.size} samples are missing."])
    return MassFit(
        robot=fitted,
        base=base,
        names=names,
        values=read_only(estimate),
        std=read_only(found.std),
        covariance=read_only(found.covariance),
        described=read_only(described),
        noise=read_only(found.noise),
        rms=read_only(rms),
        rms_test=read_only(rms_test),
        rms_described=read_only(_rms(recording.left(described))),
        samples=count,
        findings=tuple(dict.fromkeys(findings)),
        joint_terms=terms,
        gravity=recording.gravity,
        unknown=links,
    )


def _parameters_of(robot: Mechanism, base: BaseParameters, links: tuple[str, ...]) -> BaseParameters:
    """Return the ten parameters of each body that carries one of these links or frames, as if they were base
    parameters.
    """
    tree, bodies = tree_of(robot), set()
    for name in links:
        frame = tree.links.get(name) or tree.frames.get(name)
        if frame is None:
            known = sorted({*tree.links, *tree.frames})
            raise ArgumentError("unknown", f"links or frames of the robot{nearest(str(name), known)}", quoted(name))
        if frame.body == 0:
            raise ArgumentError("unknown", "links that move", f"{name!r}, which is part of the base")
        bodies.add(frame.body - 1)
    columns = np.concatenate([np.arange(10 * body, 10 * body + 10) for body in sorted(bodies)])
    names = tuple(base.parameter_names[k] for k in columns)
    rows, values = np.eye(base.matrix.shape[1])[columns], robot.inertial_parameters[columns]
    return BaseParameters(names, columns, rows, values, base.parameter_names)


def _checked_options(robot: Any, joint_terms: Iterable[str], test: float) -> tuple[tuple[str, ...], float]:
    """Check the robot and the options of `fit_masses`; return the terms, each once, and the share of the test."""
    if not isinstance(robot, Mechanism):
        raise ArgumentError("robot", "a Mechanism", quoted(robot))
    if robot.base != "fixed":
        raise ArgumentError("robot", "a robot with a fixed base (base='fixed')", "a free base")
    if robot.dof == 0:
        raise ArgumentError("robot", "a robot with joints that move", "none")
    terms = () if isinstance(joint_terms, str) else tuple(dict.fromkeys(joint_terms))
    for term in (joint_terms,) if isinstance(joint_terms, str) else terms:
        if isinstance(joint_terms, str) or term not in JOINT_TERMS:
            raise ArgumentError("joint_terms", f"names out of {', '.join(JOINT_TERMS)}, as a tuple", quoted(term))
    share = finite_number("test", test)
    if not 0 <= share < 1:
        raise ArgumentError("test", "a part of the samples, from 0 to less than 1", test)
    return terms, share


def _arrays(robot: Mechanism, given: dict[str, Any]) -> dict[str, Float64Array]:
    """Return coordinates in any of their forms as arrays of one shape (..., dof)."""
    shapes = dict.fromkeys(given, (robot.dof,))
    read = read_arguments(given, shapes, tree_of(robot).coordinate_names)
    parts = [np.stack(np.broadcast_arrays(*one), axis=-1) if isinstance(one, tuple) else np.asarray(one)
             for one in read.values.values()]  # fmt: skip
    shape = (*broadcast_shape(read.shapes), robot.dof)
    return {
        name: np.broadcast_to(np.asarray(part, dtype=np.float64), shape)
        for name, part in zip(read.values, parts, strict=True)
    }


class _Recording(NamedTuple):
    """A robot and its recording of N samples; k parameters."""

    robot: Mechanism
    base: BaseParameters
    terms: tuple[str, ...]  # of the joints
    gravity: tuple[float, ...]
    values: dict[str, Float64Array]  # q, qd, qdd and tau; (N, dof) each
    described: Float64Array  # parameters; (k,)
    is_partial: bool = False  # whether what is not fitted counts as described: masses, and friction of joints

    @property
    def samples(self) -> int:
        """N."""
        return len(self.values["q"])

    def blocks(self, count: int) -> Iterator[slice]:
        """Return the first `count` samples in blocks, whose regressors fit into memory."""
        size = max(_BLOCK // (self.robot.dof * self.base.matrix.shape[1]), 1)
        return (slice(start, min(start + size, count)) for start in range(0, count, size))

    def rows(self, part: slice) -> Float64Array:
        """Return the columns of the base parameters and of the joint terms for some samples; shape (n, dof, k)."""
        q, qd, qdd = (self.values[name][part] for name in ("q", "qd", "qdd"))
        columns = [self.robot.torque_regressor(q, qd, qdd, gravity=self.gravity)[..., self.base.columns]]
        columns += [_TERMS[term].factor(qd, qdd)[..., None] * np.eye(self.robot.dof) for term in self.terms]
        return np.concatenate(columns, axis=-1)

    def parts(self, parameters: Float64Array) -> tuple[Float64Array, dict[str, Float64Array]]:
        """Return the base parameters, which are the first, and those of all joints, (dof,), by term."""
        base, further = np.split(parameters, [len(self.base.names)])
        return base, dict(zip(self.terms, further.reshape(-1, self.robot.dof), strict=True))

    def torques(self, part: slice) -> Float64Array:
        """Return the recorded torques without those of what is known: rotors, other bodies; shape (n, dof)."""
        q, qd, qdd, tau = (self.values[name][part] for name in ("q", "qd", "qdd", "tau"))
        rotors = 0.0 if "armature" in self.terms else self.robot.armature * qdd
        if not self.is_partial:
            return tau - rotors
        others = self.robot.inertial_parameters.copy()
        others[self.base.columns] = 0.0
        by_others = self.robot.torque_regressor(q, qd, qdd, gravity=self.gravity) @ others
        for term in {"viscous", "coulomb"} - {*self.terms}:
            by_others = by_others + _TERMS[term].factor(qd, qdd) * _described_term(self.robot, term)
        return tau - rotors - by_others

    def left(self, parameters: Float64Array) -> Float64Array:
        """Return what parameters leave of the torques; shape (N, dof)."""
        parts = [self.torques(part) - self.rows(part) @ parameters for part in self.blocks(self.samples)]
        return np.concatenate(parts) if parts else np.zeros((0, self.robot.dof))


def _described_term(robot: Mechanism, term: str) -> Float64Array:
    """Return the parameter that each joint of the robot as described has for a term, 0 for "offset"; (dof,)."""
    if term == "armature":  # followers' rotors count with their leaders
        return robot.armature
    field = _TERMS[term].field
    return np.array([getattr(joint.load, field) if field else 0.0 for joint in tree_of(robot).coordinates])


class _Found(NamedTuple):
    """What weighted least squares found; k parameters."""

    step: Float64Array  # from the parameters as described; (k,)
    factor: Float64Array  # F, F.T @ F the weighted products of columns; (k, k)
    covariance: Float64Array  # (k, k)
    std: Float64Array  # inf of what is not determined; (k,)
    noise: Float64Array  # (dof,)
    unresolved_lag: int  # samples; 0 where the recording is long beside the correlation of its noise


def _weighted_least_squares(recording: _Recording, count: int, loss: Loss | None) -> _Found:
    """Find the step from the described parameters to those that explain the first `count` samples best; with a loss
    by repeated weights, beginning with those of least squares.
    """
    weights = np.ones((count, recording.robot.dof))
    for _ in range(1 if loss is None else 12):
        found = _least_squares_with(recording, count, weights)
        if loss is None:
            break
        left = recording.left(recording.described + found.step)[:count]
        variances = np.array([max(median_variance(column**2, 1), 1e-300) for column in left.T])
        weights = np.maximum(loss_weights(loss, left**2 / variances, 1)[0], 1e-9)
    return found


def _least_squares_with(recording: _Recording, count: int, weights: Float64Array) -> _Found:
    """Find the step that explains the first `count` samples best, whose torques have weights (count, dof)."""
    robot, width = recording.robot, recording.described.size
    # Products of columns, the last of which is what the described parameters leave of the torques, joint by joint:
    # (N, dof, k) would not fit into memory.
    products = np.zeros((robot.dof, width + 1, width + 1))
    for part in recording.blocks(count):
        rows = recording.rows(part)
        off = recording.torques(part) - rows @ recording.described
        columns = np.concatenate((rows, off[..., None]), axis=-1) * np.sqrt(weights[part])[..., None]
        columns = np.moveaxis(columns, 1, 0)
        products += np.swapaxes(columns, 1, 2) @ columns
    unexplained = np.sqrt(products[:, width, width].max() / count)
    least = max(_LEAST_NOISE * unexplained, _ROUNDING * _rms(recording.values["tau"][:count]).max())
    # Parameters and the noise of each joint in turn.
    noise = np.ones(robot.dof)
    for _ in range(_WEIGHT_ROUNDS):
        whole = (products / noise[:, None, None] ** 2).sum(axis=0)
        lengths = np.sqrt(np.diagonal(whole)[:width])
        unit = np.where(lengths > 0, lengths, 1.0)
        sizes, vectors = np.linalg.eigh(whole[:width, :width] / np.outer(unit, unit))
        seen = sizes > _SINGULAR * sizes[-1]
        inverse = (vectors[:, seen] / sizes[seen]) @ vectors[:, seen].T
        step = inverse @ (whole[:width, width] / unit) / unit
        ends = np.append(step, -1.0)
        # Each joint loses its part of the parameters.
        free = max(count - seen.sum() / robot.dof, 1)
        noise = np.maximum(np.sqrt(np.maximum(ends @ products @ ends, 0.0) / free), max(least, 1e-300))
    if not lengths.any():
        raise FitError("q, qd, qdd", "a motion whose torques depend on the robot's masses", "none that does")
    # Covariance, from scores whose neighbours may be correlated.
    scores = []
    for part in recording.blocks(count):
        rows = recording.rows(part)
        left = recording.torques(part) - rows @ (recording.described + step)
        scores.append(np.einsum("nik,ni->kn", rows, weights[part] * left / noise**2) / unit[:, None])
    covariance, lag = sandwich(inverse, np.concatenate(scores, axis=1), robot.dof)
    std = np.sqrt(np.diagonal(covariance)) / unit
    std[(lengths == 0) | (np.abs(vectors[:, ~seen]) > 1e-3).any(axis=1)] = np.inf
    factor = np.sqrt(np.where(seen, sizes, 0.0))[:, None] * vectors.T * unit
    return _Found(step, factor, covariance / np.outer(unit, unit), std, noise, lag)


def _doubts(recording: _Recording, found: _Found, estimate: Float64Array, count: int) -> list[Finding]:
    """Return findings on what the motion of the first `count` samples does not determine, and on friction below 0."""
    robot, base, terms = recording.robot, recording.base, recording.terms
    rates = recording.values["qd"][:count]
    findings, count = [], len(base.names)
    doubt = found.std[:count] / np.sqrt((base.matrix**2) @ (_units(robot) ** 2))
    for number, name in enumerate(body_names(tree_of(robot), False)):
        of_body = np.flatnonzero(~(doubt <= _HARDLY_KNOWN) & (base.columns // 10 == number))
        if of_body.size:
            which = ", ".join(base.names[k].removeprefix(f"{name} ") for k in of_body)
            harmless = bool((doubt[of_body] <= _UNKNOWN).all()) or recording.is_partial
            degree = "hardly" if (doubt[of_body] <= _UNKNOWN).all() else "not"
            how = f"{'are' if of_body.size > 1 else 'is'} {degree} determined"
            advice = f"let {tree_of(robot).joints[number].name} and the joints that carry it turn further and faster"
            text = f"{which} of {name} {how} by this motion: {advice}."
            findings.append(Finding("undetermined", doubt[of_body].max(), _HARDLY_KNOWN, text, harmless=harmless))
    values, std = (recording.parts(array)[1] for array in (estimate, found.std))
    for k, joint in enumerate(robot.names):
        lost = [term for term in terms if np.isinf(std[term][k])]
        if lost:
            which = (
                f"{' and '.join(lost)} {'terms are' if len(lost) > 1 else 'term is'} not determined by this motion"
            )
            still = not rates[:, k].any()
            text = f"{joint} does not move: its {which}." if still else f"Of {joint}, the {which}."
            findings.append(Finding("undetermined", np.inf, 0, text))
    unsigned = [term for term in terms if not _TERMS[term].signed]
    below = np.logical_or.reduce(
        [values[term] + 4 * std[term] < 0 for term in unsigned] or [np.zeros(robot.dof, np.bool_)]
    )
    if below.any():
        joints = ", ".join(np.array(robot.names)[below])
        text = f"Friction or a rotor of {joints} is below 0: do tau and qd have the same sign?"
        findings.append(Finding("sign", below.sum(), 0, text))
    return findings


def _units(robot: Mechanism) -> Float64Array:
    """Return what each inertial parameter may amount to for the bodies as described; shape (10 * bodies,)."""
    return np.concatenate([body_units(*size) for size in _sizes(robot)])


def _sizes(robot: Mechanism) -> Float64Array:
    """Return mass and radius of gyration of each body, means of the others where it has no mass; (bodies, 2)."""
    parameters = robot.inertial_parameters
    mass = np.abs(parameters[::10])
    spread = np.abs(np.trace(inertia_matrices(parameters), axis1=1, axis2=2)) / 2
    heavy = (mass > 0) & (spread > 0)
    if not heavy.any():
        return np.tile((1.0, 0.1), (len(mass), 1))
    radius = np.sqrt(spread / np.where(heavy, mass, 1.0))
    return np.stack(
        (np.where(heavy, mass, mass[heavy].mean()), np.where(heavy, radius, radius[heavy].mean())), axis=1
    )


def _standard_parameters(
    recording: _Recording, found: _Found, estimate: Float64Array, physical: bool
) -> tuple[Float64Array, Float64Array, list[Finding]]:
    """Return inertial parameters that have the estimated base parameters; the estimate, which changes if they must be
    physical; and findings.
    """
    robot, base = recording.robot, recording.base
    start = robot.inertial_parameters.copy()
    start[::10] = np.where(start[::10] == 0, _sizes(robot)[:, 0], start[::10])  # a first moment needs a mass
    if physical:
        signed = np.repeat([_TERMS[term].signed for term in recording.terms], robot.dof).astype(np.bool_)
        parameters, further, squares = consistent_parameters(
            found.factor, base.matrix, estimate, start, _sizes(robot), signed
        )
        text = (
            "No masses of rigid bodies explain the torques as well as the best parameters do: the squares of what is "
            f"left grow by {squares:.3g} times the variance of the noise, with {len(estimate)} parameters."
        )
        changed = np.concatenate((base.matrix @ parameters, further))
        return parameters, changed, exceeded(Finding("bodies", squares, _GROWTH * len(estimate), text))
    parameters = nearest_parameters(base.matrix, recording.parts(estimate)[0], start, _units(robot))
    return parameters, estimate, []


def _mass_matrix_findings(recording: _Recording, found: _Found, estimate: Float64Array) -> list[Finding]:
    """Return a finding if the mass matrix at a recorded position has an eigenvalue below 0 that is not noise."""
    q, dof = recording.values["q"], recording.robot.dof
    q = q[:: -(-len(q) // _JUDGED_STATES), None]
    units, still = np.broadcast_to(np.eye(dof), (len(q), dof, dof)), np.zeros((len(q), dof, dof))

    def rows(qdd: NDArray[np.float64]) -> Float64Array:
        values = {"q": np.broadcast_to(q, units.shape), "qd": still, "qdd": qdd}
        return recording._replace(values=values).rows(slice(None))

    rows_of_M = rows(units) - rows(still)  # M = rows_of_M @ parameters; gravity and offsets drop out
    M = rows_of_M @ estimate
    sizes, vectors = np.linalg.eigh((M + np.swapaxes(M, 1, 2)) / 2)
    along = np.einsum("nie,nje,nijk->nek", vectors, vectors, rows_of_M)  # each size = along @ parameters
    deviation = np.sqrt(np.maximum(np.einsum("nek,kl,nel->ne", along, found.covariance, along), 1e-300))
    undetermined = np.abs(along[..., np.isinf(found.std)]).max(axis=-1, initial=0.0) > 1e-9 * np.abs(along).max()
    below = np.where((sizes > -1e-9 * np.abs(sizes).max()) | undetermined, 0.0, -sizes / deviation)
    worst = np.unravel_index(np.argmax(below), below.shape)
    known_rotors = recording.robot.armature.any() and "armature" not in recording.terms
    text = (
        "The base parameters cannot be those of rigid bodies: in a recorded position, their mass matrix has the "
        f"eigenvalue {sizes[worst]:.3g}, {below[worst]:.3g} standard deviations below 0: do tau and qdd have the "
        f"same sign{', and are the rotors as light as `armature` says' if known_rotors else ''}?"
    )
    # The squares of what is left grow by at least below**2 where other parameters bring the eigenvalue to 0.
    return exceeded(Finding("mass matrix", below[worst] ** 2, _GROWTH * len(estimate), text))


def _not_random(recording: _Recording, left: Float64Array) -> NDArray[np.bool_]:
    """Return for which joints what is left of the torque resembles that of neighbouring samples: in time, or in the
    order of q, qd or qdd of the joint, since samples may be of independent states; shape (dof,).
    """
    thin = slice(None, None, -(-len(left) // _JUDGED_SAMPLES))
    random = max(RANDOM_CORRELATION, 5 / np.sqrt(len(left[thin])))
    motion = [recording.values[name][: len(left)][thin] for name in ("q", "qd", "qdd")]
    largest = [
        max(
            neighbour_correlation(column),
            *(neighbour_correlation(column[thin][np.argsort(one[:, k], kind="stable")]) for one in motion),
        )
        for k, column in enumerate(left.T)
    ]
    return np.asarray(np.array(largest) > random)


def _dependence(recording: _Recording, left: Float64Array) -> Float64Array:
    """Return by how much what is left of each torque depends on q, qd or qdd of a joint (dof,): the squares of means
    over sixteenths of the samples, in order of one of these, in parts of what noise makes of them.
    """
    thin = slice(None, None, -(-len(left) // _JUDGED_SAMPLES))
    columns = [one[: len(left)][thin].T for one in (recording.values[name] for name in ("q", "qd", "qdd"))]
    largest = np.zeros(left.shape[1])
    for k, rest in enumerate(left[thin].T):
        bend = 3 * np.sqrt(max(median_variance(rest**2, 1), 1e-300))
        usual = np.clip(rest, -bend, bend)  # spikes tell nothing of the whole motion
        scatter, _ = score_scatter(usual[None])
        noise = max(float(scatter[0, 0]), float(usual @ usual), 1e-300) / usual.size  # of a sample
        for one in np.concatenate(columns):
            parts = np.array_split(usual[np.argsort(one, kind="stable")], 16)
            squares = [part.sum() ** 2 / part.size for part in parts if part.size]
            largest[k] = max(largest[k], float(np.mean(squares)) / noise)
    return largest


def _misfits(
    recording: _Recording, left: Float64Array, left_test: Float64Array, found: _Found, loss: Loss | None
) -> list[Finding]:
    """Return findings on torques that the parameters do not explain, from what is left in the samples fitted to and
    in those kept for the test.
    """
    rms, size = _rms(left), np.maximum(_rms(recording.values["tau"][: len(left)]), 1e-300)
    joints = np.array(recording.robot.names)
    findings = []
    inexact = rms > 1e-6 * size
    correlated = _not_random(recording, left) & inexact
    q = recording.values["q"][: len(left)]
    q = (q - q.mean(axis=0))[:, np.ptp(q, axis=0) > 0]
    if inexact.any() and q.size and neighbour_correlation(q.T) < RANDOM_CORRELATION:
        text = (
            "Neighbouring samples are of unrelated positions, so that their order does not tell noise from what the "
            "parameters lack: compare `noise` with that of the sensors."
        )
        findings += notes("order", [text])
    depends = np.where(inexact, _dependence(recording, left), 0.0)
    if depends.max() > _DEPENDENT:
        text = (
            f"What is left of the torques of {', '.join(joints[depends > _DEPENDENT])} depends on the motion: the "
            "parameters lack something, such as other friction, or the dimensions or gravity are wrong."
        )
        findings.append(Finding("dependence", depends.max(), _DEPENDENT, text))
    if correlated.any():
        share = float((rms / size)[correlated].max())
        text = (
            f"What is left of the torques of {', '.join(joints[correlated])}, up to {percent(share)} of them, is not "
            "random: filtered noise, or what the parameters lack, such as other friction and elastic gears."
        )
        findings.append(Finding("not random", share, 0, text, harmless=share < _POOR))
    usual = np.sqrt([max(median_variance(column**2, 1), 1e-300) for column in left.T])
    # Where a joint turns round, noise of its rate decides on the sign of dry friction.
    turns = np.diff(np.sign(recording.values["qd"][: len(left)]), axis=0) != 0
    turns = np.pad(turns, ((1, 1), (0, 0)))[1:] | np.pad(turns, ((1, 1), (0, 0)))[:-1]
    is_spike = (left**2 > OUTLIER * usual**2) & inexact & ~correlated & ~turns
    if is_spike.any():
        part = percent(float(is_spike.mean()))
        few = loss is not None or bool((left[is_spike] ** 2).sum() < _FAR_OFF * (left[~is_spike] ** 2).sum())
        text = f"{part} of the torques are outliers, far off the others"
        text += "." if loss is not None else ': loss="cauchy" makes them count little.'
        findings.append(Finding("outliers", is_spike.mean(), 0, text, harmless=few))
    # Ends of nine tenths: where dry friction turns round, single samples are far off.
    ends, ends_test = (_most(rows) for rows in (left, left_test))
    rms_test = _rms(left_test)
    worse = ends_test > np.maximum(_WORSE * ends, 1e-6 * size)
    if worse.any():
        k = int(np.argmax(np.where(worse, ends_test / np.maximum(ends, 1e-300), 0.0)))
        text = (
            f"In the samples kept for the test, the torques of {', '.join(joints[worse])} are off by more than in "
            f"those fitted to, that of {joints[k]} by {rms_test[k]:.3g} instead of {rms[k]:.3g} N m rms: the "
            "parameters do not hold for other motions."
        )
        findings.append(Finding("test", ends_test[k] / max(ends[k], 1e-300), _WORSE, text))
    lag = found.unresolved_lag if correlated.any() else 0
    text = (
        f"What is left of the torques is correlated over {lag} samples and more, too long relative to the whole "
        "recording: the standard deviations are rough."
    )
    return findings + exceeded(Finding("memory", lag, 0, text, harmless=True))


def _data_findings(
    recording: _Recording, found: _Found, left: Float64Array, count: int, parameters: Float64Array
) -> list[Finding]:
    """Return findings on the recording itself: units, torques that are late, tilted gravity, and noise of the motion.
    `parameters` are the fitted inertial parameters.
    """
    findings = []
    of_robot = _rms(recording.torques(slice(0, count)) - recording.left(recording.described)[:count])
    ratio = float(np.median(_rms(recording.torques(slice(0, count))) / np.maximum(of_robot, 1e-300)))
    is_described = not recording.is_partial and recording.robot.inertial_parameters[::10].all()
    if is_described and not 1 / 100 < ratio < 100:
        text = f"The torques are {ratio:.2g} times those of the robot as described: are they in N m, or N of sliders?"
        findings.append(Finding("unit", ratio, 100, text))
    q = recording.values["q"][:count]
    moving = np.ptp(q, axis=0) > 0
    if count < 50 or neighbour_correlation((q - q.mean(axis=0))[:, moving].T) < 0.9:
        return findings  # samples of no order, which tell neither
    part = slice(0, min(count, _ORDERED_SAMPLES))
    rows, noise = recording.rows(part), found.noise[:, None]
    A = (rows / noise).reshape(-1, rows.shape[2])
    rest = left[part] / found.noise

    def amount(change: Float64Array) -> tuple[float, float]:
        """Return how much of a further column (n, dof) the torques have, and its standard deviation."""
        own = (change / found.noise).ravel()
        own = own - A @ np.linalg.lstsq(A, own)[0]
        power, scores = max(float(own @ own), 1e-300), (own.reshape(rest.shape) * rest).sum(axis=1)
        return float(scores.sum()) / power, float(np.sqrt(score_scatter(scores[None])[0][0, 0])) / power

    # Torques that are late are off by their change from sample to sample.
    late, std = amount(-np.gradient(recording.torques(part) - left[part], axis=0))
    if abs(late) > max(5 * std, 0.1):
        order = "late" if late > 0 else "early"
        text = (
            f"The torques are {abs(late):.2g} samples {order} against the motion: friction and masses are off by it."
        )
        findings.append(Finding("delay", abs(late), max(5 * std, 0.1), text))
    # Gravity that is tilted adds horizontal parts of it.
    q, qd, qdd = (recording.values[name][part] for name in ("q", "qd", "qdd"))
    size = float(np.linalg.norm(recording.gravity))
    across = np.linalg.svd(np.reshape(recording.gravity, (1, 3)))[2][1:] if size else np.zeros((0, 3))
    tilts = [
        amount(recording.robot.torque_regressor(q, 0 * qd, 0 * qdd, gravity=size * axis) @ parameters)
        for axis in across
    ]
    tilt = float(np.linalg.norm([each[0] for each in tilts]))
    std = max((each[1] for each in tilts), default=0.0)
    if tilt > max(5 * std, 0.01):
        text = f"Gravity seems to be tilted by {np.degrees(tilt):.2g} deg against `gravity`: how does the base stand?"
        findings.append(Finding("gravity", tilt, max(5 * std, 0.01), text))
    return findings + _motion_noise_finding(recording, found, part, A)


def _motion_noise_finding(
    recording: _Recording, found: _Found, part: slice, weighted_rows: Float64Array
) -> list[Finding]:
    """Return a finding if noise of q, qd and qdd makes parameters wrong by more than their standard deviations.

    Noise in the regressor adds to the normal matrix, by which parameters come out small. Its size is that of fourth
    differences, in which a motion that is sampled well enough has no part.
    """
    rng, noisy, sizes = np.random.default_rng(0), {}, {}
    for name in ("q", "qd", "qdd"):
        values = recording.values[name][part]
        sizes[name] = np.sqrt((np.diff(values, 4, axis=0) ** 2).mean(axis=0) / 70)
        noisy[name] = values + sizes[name] * rng.standard_normal(values.shape)
    moved = recording._replace(values=recording.values | noisy)
    off = moved.rows(slice(0, len(noisy["q"]))) / found.noise[:, None]
    off = off.reshape(weighted_rows.shape) - weighted_rows
    known = np.isfinite(found.std)
    normal = weighted_rows[:, known].T @ weighted_rows[:, known]
    estimate = (recording.described + found.step)[known]
    bias = np.abs(np.linalg.lstsq(normal, off[:, known].T @ (off[:, known] @ estimate), rcond=1e-12)[0])
    scores = bias / np.maximum(found.std[known], 1e-300)
    usual = np.abs(recording.described + found.step)  # beside what such bodies may have
    bodies = len(recording.base.names)
    usual[:bodies] += np.sqrt((recording.base.matrix**2) @ _units(recording.robot) ** 2)
    usual[bodies:] += np.tile(_rms(recording.values["tau"]), len(recording.terms))
    scores[bias < 0.01 * usual[known]] = 0.0
    if not scores.size:
        return []
    worst = int(np.argmax(scores))
    rate = float(np.sqrt(np.mean(sizes["qdd"] ** 2)))
    text = (
        f"Noise of the motion, of accelerations about {rate:.2g} rad/s^2 or m/s^2, makes parameters wrong, by up to "
        f"{scores[worst]:.2g} standard deviations: hp.smooth derives rates and accelerations with less."
    )
    return exceeded(Finding("noise of the motion", scores[worst], 2.0, text))


def _most(rows: Float64Array) -> Float64Array:
    """Return below which size nine tenths of each column are; NaN of no rows."""
    return np.quantile(np.abs(rows), 0.9, axis=0) if len(rows) else np.full(rows.shape[1], np.nan)


def _fitted_robot(recording: _Recording, parameters: Float64Array, estimate: Float64Array) -> Mechanism:
    """Return the robot with fitted masses, rotors and friction, of which what is below 0 counts as none."""
    fitted = {term: np.maximum(values, 0.0) for term, values in recording.parts(estimate)[1].items()}
    robot = recording.robot.with_inertial_parameters(parameters, armature=fitted.get("armature"))
    fields = {field: fitted[term] for term in fitted if (field := _TERMS[term].field)}
    own = {joint.name: k for k, joint in enumerate(tree_of(robot).coordinates)}
    loads = {}
    for joint in tree_of(robot).joints:  # what is fitted counts the loads of followers with the leader's
        k = own.get(joint.name)
        found: dict[str, Any] = {field: 0.0 if k is None else values[k] for field, values in fields.items()}
        loads[joint.name] = replace(joint.load, **found)
    return robot.with_joint_loads(loads)


def _rms(rows: NDArray[np.float64]) -> Float64Array:
    """Return the root mean squares of columns; NaN of no rows."""
    return np.sqrt((rows * rows).mean(axis=0)) if len(rows) else np.full(rows.shape[1], np.nan)
