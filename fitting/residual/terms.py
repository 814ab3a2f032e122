"""Terms: what has been added to the base model, and its columns."""

from __future__ import annotations

from collections.abc import MutableMapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import linalg

from daq.machine.machine_file import Machine
from daq.scratch import ScratchArrays
from fitting.arrays import FloatArray, LateSequence
from fitting.effects.base import DriveView, Effect, FoundBy, Shape
from fitting.regression.design import Design, Extra, NoiseModel, Parameters, whitened
from fitting.regression.prior import Late, Prior, with_prior
from fitting.regression.solving import Fit, WhiteRows
from fitting.regression.streamed import fit_rows
from fitting.residual.laws import Law
from fitting.residual.views import SegmentViews, Views

#: Share of a direction's information that has to come from the data for the data to determine it.
_DETERMINED = 1e-8


@dataclass(frozen=True)
class Term:
    """One effect or law on one joint (None: on the whole machine), with its shape fixed.

    Attributes
    ----------
    rebuilt : values already applied to the signals themselves, per parameter; the fitted value is what is left of it
    resampled : of a delay: its samples were handed on late, interpolated; else what was sampled was late itself
    held : numbers of parameters that are at zero, as they would be beyond what is physically possible
    expected : of a law: rows (r, k) of unit noise around zero, of what is expected of its parameters
    """

    content: Effect | Law
    joint: int | None
    shape: Shape = field(default_factory=dict)
    rebuilt: tuple[float, ...] = ()
    resampled: bool = False
    held: tuple[int, ...] = ()
    expected: FloatArray | None = field(default=None, compare=False, repr=False)

    @property
    def id(self) -> str:
        """Effect id, or ``law``."""
        return "law" if isinstance(self.content, Law) else self.content.id

    @property
    def family(self) -> tuple[str, int | None]:
        """Reported identity: effect and joint, whatever the shape."""
        return self.id, self.joint

    @property
    def label(self) -> tuple[object, ...]:
        """Key of a candidate, whatever was rebuilt."""
        content = self.content if isinstance(self.content, Law) else self.id
        return (content, self.joint, tuple(sorted(self.shape.items())))

    @property
    def confined(self) -> bool:
        """True where it acts in single recordings, so that another recording does not show it."""
        return not isinstance(self.content, Law) and self.content.confined(self.shape)

    @property
    def is_line(self) -> bool:
        """True where it is a spectral line, which is looked for in the residual's spectrum, not by its columns."""
        return not isinstance(self.content, Law) and self.content.found_by is FoundBy.LINES

    @property
    def delays_effort(self) -> bool:
        """True where it is moved in the signal itself; its column is a beginning only."""
        return not isinstance(self.content, Law) and self.content.delays_effort

    @property
    def discrete(self) -> frozenset[str]:
        """Entries of its shape that are choices, not numbers to be searched between."""
        return frozenset() if isinstance(self.content, Law) else self.content.discrete_shapes

    @property
    def uses_model(self) -> bool:
        """True where the columns hold the model's own force, not the measured motion only."""
        return self.content.uses_model or self.everywhere

    def columns(self, views: Sequence[DriveView]) -> FloatArray:
        """Compute columns in one segment from views of all joints: (N, k), or (N, n, k) where it acts on all."""
        view = views[self.joint or 0]
        if isinstance(self.content, Law):
            return self.content.columns(view)
        columns = self.content.columns(view, self.shape)
        if self.held:
            columns = np.array(columns)
            columns[..., list(self.held)] = 0.0
        return columns

    @property
    def everywhere(self) -> bool:
        """True where it acts on the efforts of all joints."""
        return not isinstance(self.content, Law) and (self.content.machine_wide or self.content.spreads)

    @property
    def place(self) -> int | None:
        """The one joint on whose effort it acts; None where it acts on those of all."""
        return None if self.everywhere else self.joint or 0

    @property
    def width(self) -> int:
        """Number of its linear parameters."""
        return self.content.functions if isinstance(self.content, Law) else len(self.content.parameters)

    def names(self, joints: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of its linear parameters, with the joint."""
        place = "machine" if self.joint is None else joints[self.joint]
        if isinstance(self.content, Effect):
            return tuple(f"{place}.{self.content.id}.{p.name}" for p in self.content.parameters)
        law = self.content
        signed = " sgn v" if law.signed else f" {law.only}" if law.only else ""
        return tuple(f"{place}.law({law.variable(joints)}){signed}.{k}" for k in range(law.functions))


def extra_columns(design: Design, views: Views, terms: Sequence[Term]) -> Extra:
    """Compute full-rate columns of all terms in all segments."""
    joints = tuple(j.name for j in design.machine.joints)
    names = tuple(name for term in terms for name in term.names(joints))
    widths = [term.width for term in terms]

    def made(index: int) -> list[FloatArray | None]:
        row: list[FloatArray | None] = [None] * len(joints)
        start = 0
        for term, width in zip(terms, widths, strict=True):
            columns = term.columns(views[index])
            for joint in range(len(joints)) if term.everywhere else (term.joint or 0,):
                own = row[joint]
                if own is None:
                    own = row[joint] = np.zeros((len(design.segments[index]), len(names)))
                own[:, start : start + width] = columns[:, joint] if term.everywhere else columns
            start += width
        return row

    table: list[MutableMapping[int | None, FloatArray]]
    table = [ScratchArrays() if design.stored else {} for _ in joints]
    for index in range(len(design.segments)):
        for kept, own in zip(table, made(index), strict=True):
            if own is not None:
                kept[index] = own
    expected = _expected([term.expected for term in terms], widths)
    return Extra(names, tuple(LateSequence(kept.get, len(design.segments)) for kept in table), expected)


def _expected(parts: Sequence[FloatArray | None], widths: Sequence[int]) -> FloatArray | None:
    """Join what is expected of several terms' parameters."""
    rows = [np.zeros((0, k)) if own is None else own for own, k in zip(parts, widths, strict=True)]
    return linalg.block_diag(*rows) if any(map(len, rows)) else None


def beside(parts: Sequence[Extra]) -> Extra:
    """Join columns of several terms, zero where one has none."""
    widths = [len(part.names) for part in parts]

    def joined(columns: Sequence[FloatArray | None]) -> FloatArray | None:
        there = next((own for own in columns if own is not None), None)
        if there is None:
            return None
        both = zip(columns, widths, strict=True)
        return np.hstack([np.zeros((len(there), k)) if own is None else own for own, k in both])

    names = tuple(name for part in parts for name in part.names)
    joints = zip(*(part.columns for part in parts), strict=True)
    expected = _expected([part.expected for part in parts], widths)
    return Extra(names, [[joined(own) for own in zip(*joint, strict=True)] for joint in joints], expected)


@dataclass(frozen=True)
class Model:
    """A fitted model: design, noise, terms, and the joint refit of everything.

    ``earlier`` has the parameters of the fits whose forces the columns of the next one were made of, the base model's
    first; it is empty where there are no terms. ``prior`` is what it was fitted with, at the point of the fit.
    """

    design: Design
    noise: NoiseModel
    fitted: tuple[int, ...]
    terms: tuple[Term, ...]
    extra: Extra
    fit: Fit
    views: Views
    earlier: tuple[FloatArray, ...] = ()
    prior: Prior | None = None

    @cached_property
    def unpriored(self) -> FloatArray | None:
        """Matrix that turns products ``Q'C`` with the fit's basis into those with a basis of the data's rows alone.

        ``(k, rank)``; None where the fit has no plausible arm. With ``Q_p`` the basis in the arm's rows, the data's are
        ``I - Q_p'Q_p`` long: directions that only the arm determines are left out.
        """
        if self.prior is None or self.prior.point is None:
            return None
        Q = self.fit.orthonormal[-1]
        arm = Q[self._arm_rows]
        values, vectors = np.linalg.eigh(np.eye(Q.shape[1]) - arm.T @ arm)
        determined = values > _DETERMINED
        return np.asarray((vectors[:, determined] / np.sqrt(values[determined])).T)

    @cached_property
    def held(self) -> tuple[FloatArray, FloatArray]:
        """Return the basis (h, rank) and the residual (h,) in the prior's rows of parameters that it keeps from being
        negative."""
        Q, left = self.fit.orthonormal[-1], self.fit.residual[-1]
        if self.prior is None or self.prior.point is None:
            return Q[:0], left[:0]
        arm, phi = self.prior.point.arm, self.prior.point.phi
        # Its first rows are those of the drives' parameters of which something is known.
        rows = np.flatnonzero((arm.signed & (phi < 0))[np.flatnonzero(arm.own[: arm.drives])])
        return Q[self._arm_rows][rows], left[self._arm_rows][rows]

    @property
    def _arm_rows(self) -> slice:
        """Place of the plausible arm's rows among the last joint's: before those of its own priors."""
        assert self.prior is not None and self.prior.point is not None
        joints = len(self.fit.orthonormal)
        stop = len(self.fit.residual[-1]) - self.prior.own_rows(joints - 1)
        return slice(stop - len(self.prior.point.rows[1]), stop)

    def term_slice(self, number: int) -> slice:
        """Return the slice of term ``number``'s parameters in ``fit.theta``."""
        start = len(self.design.parameters) + sum(term.width for term in self.terms[:number])
        return slice(start, start + self.terms[number].width)

    def sections(self, joint: int) -> list[tuple[int, slice]]:
        """Return fitted segments and their slices of a joint's rows; a prior's come after them."""
        counts = [int(np.count_nonzero(self.design.kept(self.noise, joint, index))) for index in self.fitted]
        ends = np.cumsum(counts).tolist()
        return [(i, slice(end - count, end)) for i, end, count in zip(self.fitted, ends, counts, strict=True)]

    def rows(self) -> tuple[WhiteRows, ...]:
        """Return the whitened rows that this model was fitted on, prior included: by joint, then what laws expect."""
        rows = whitened(self.design, self.noise, self.fitted, self.extra)
        late = late_terms(self.terms, self.design.parameters)
        if self.prior is not None:
            rows = with_prior(rows, self.design.parameters, self.prior, late)
        return (*rows, *self.extra.expected_rows(len(self.design.parameters)))

    def values(self, number: int) -> FloatArray:
        """Return parameters of term ``number``, with what was moved into the signals."""
        fitted = self.fit.theta[self.term_slice(number)]
        return np.asarray(fitted + np.asarray(self.terms[number].rebuilt or np.zeros(len(fitted))))

    def wald(self, number: int) -> float:
        """Compute the chi-square cost of dropping term ``number``, with what was moved into the signals (Wald's)."""
        part = self.term_slice(number)
        determined = self.fit.determined[part]
        if not determined.any():
            return 0.0
        values = self.values(number)
        inverse = np.linalg.pinv(self.fit.covariance[part, part][np.ix_(determined, determined)], hermitian=True)
        return float(values[determined] @ inverse @ values[determined])

    def contribution(self, number: int, joint: int, index: int) -> FloatArray:
        """Compute what term ``number`` adds to a joint's drive effort in a segment, (N,)."""
        own = self.extra.columns[joint][index]
        if own is None:
            return np.zeros(len(self.design.segments[index]))
        part = self.term_slice(number)
        first = len(self.design.parameters)
        return np.asarray(own[:, part.start - first : part.stop - first] @ self.fit.theta[part])


def late_terms(terms: Sequence[Term], parameters: Parameters) -> dict[int, Late]:
    """Return each delayed joint's column among the terms and the seconds by which its efforts were moved."""
    found: dict[int, Late] = {}
    column = len(parameters)
    for term in terms:
        if term.delays_effort and term.joint is not None:
            found[term.joint] = (column, sum(term.rebuilt))
        column += term.width
    return found


def delays(machine: Machine, terms: Sequence[Term]) -> tuple[dict[str, float], frozenset[str]]:
    """Return by joint name the seconds its effort is late by accepted terms, and whose samples were passed on late."""
    joints = machine.joints
    late = [(joints[t.joint].name, t) for t in terms if t.delays_effort and t.rebuilt and t.joint is not None]
    return {name: t.rebuilt[0] for name, t in late}, frozenset(name for name, t in late if t.resampled)


def fit_model(
    design: Design,
    noise: NoiseModel,
    fitted: Sequence[int],
    terms: Sequence[Term],
    prior: Prior,
    start: Model | None = None,
    passes: int = 2,
) -> Model:
    """Refit drive, base and terms jointly.

    Columns that hold the model's own force depend on the fit; where there are any, they are rebuilt from the last one,
    ``passes`` times, the first time from ``start``.
    Which of the drives' parameters the prior holds is found anew for these terms.
    """
    fitted = tuple(fitted)
    empty = extra_columns(design, (), ())
    settled: Prior | None = prior

    def fit_with(extra: Extra) -> Fit:
        nonlocal settled
        late = late_terms(terms if extra.names else (), design.parameters)
        fit, settled = fit_rows(design, noise, fitted, extra, settled, late)
        return fit

    if start is None or not terms:
        fit, extra = fit_with(empty), empty
    else:
        fit, extra = start.fit, start.extra
    views = SegmentViews(design, fit.theta, fitted, extra)
    earlier = [] if start is None or not terms else list(start.earlier)
    moving = any(term.uses_model for term in terms)
    for _ in range(passes if moving else bool(terms)):
        earlier.append(fit.theta)
        extra = extra_columns(design, views, terms)
        fit = fit_with(extra)
        views = SegmentViews(design, fit.theta, fitted, extra)
    return Model(design, noise, fitted, tuple(terms), extra, fit, views, tuple(earlier), settled)
