"""One identification's data: machine, recordings, and everything that is computed from them once.

A :class:`Session` is built from files only, so any stage can be run in a process of its own: what earlier stages
found is handed over as plain JSON, and what is large (signals, columns) is computed again from the recordings.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from daq.errors import InputError, RecordingError
from daq.machine.machine_file import Machine, load_machine
from daq.messages import Sentence
from daq.recordings.column_map import load_map
from daq.recordings.recording import Recording, read_recording
from daq.recordings.recording_checks import runs
from daq.scratch import Scratch
from fitting.arm.base_parameters import BaseParameters, base_regressor, reduce_parameters, unidentifiable
from fitting.arm.geometry import geometry_of
from fitting.arm.joint_side import at_joints
from fitting.estimators.effort_fit import EffortRows
from fitting.loop.noise_scale import on_fitted_rows
from fitting.loop.search_pieces import choose_pieces, thinned
from fitting.loop.weighting import Weighed, Weights, weighed
from fitting.regression.design import Design, NoiseModel, build_design, reduced_residual, with_efforts, with_targets
from fitting.regression.noise import Pairing, noise_model, pair_repeats
from fitting.regression.plausible_arm import plausible_arm
from fitting.regression.prior import Prior, expected_delays, mass_prior
from fitting.regression.stored import storing
from fitting.regression.streamed import triangle
from fitting.regression.unsure_signs import unsure_speeds
from fitting.residual.kinematics import SensorErrors, checkable
from fitting.residual.terms import Model, fit_model
from fitting.signals.corrections import Corrections
from fitting.signals.filters import FilterBank, asked_filter_bank, filter_bank
from fitting.signals.lost_rows import bridged, longest_bridge, with_lost_rows
from fitting.signals.motion_frequency import motion_frequency
from fitting.signals.position_sensors import reading_error
from fitting.signals.preparation import (
    PositionNoise,
    position_noise,
    segments_of,
    with_delays,
    with_efforts_of,
)
from fitting.signals.rods import with_declared_rods
from fitting.signals.spectrum import Whitening, unit_whitening

#: Roles that parameters are fitted on. `validate` is never among them.
FITTED_ROLES = ("unloaded", "train", "repeat", "operation")
#: s for which a joint has to move without a rest: noise alone passes for less.
_MOVING_S = 0.5
_BANDWIDTH_FACTOR = 5.0
_LEAST_BANDWIDTH = 3.0
#: Samples of all joints together above which signals and columns are kept in a file (eight minutes of six joints at
#: 50 Hz, some 200 MB): each takes up to 1.5 kB in memory.
LONG_SAMPLES = 150_000
#: The same with the loop, whose candidates' columns take some 6 kB for each in memory (five minutes of six joints).
LOOP_SAMPLES = 90_000
#: Samples of all joints together in the pieces of hours that the loop searches (3.2 minutes of six joints): what else
#: is kept of ten hours takes the room of the rest. Up to twice `LOOP_SAMPLES` so many are searched as of shorter ones:
#: whoever adds a motion, to separate two effects, has no less searched than before.
SEARCH_SAMPLES = 57_600


@dataclass(frozen=True)
class Options:
    """Choices of an identification.

    Attributes
    ----------
    loop : False stops after both stages
    bandwidth_hz : identification bandwidth; None takes five times the motion's own, at least 3 Hz, at most an
        eighth of the rate
    bootstrap : most replicas of the recordings that a candidate's null distribution is drawn from; 0 for none
    forgetting : forgetting factor of stage 1's recursion; 1 forgets nothing
    estimator : id of stage 2's estimator; ``gls`` is the joint refit of both stages
    covariance : what its deviations make of coloured residuals: ``hac``, ``bootstrap`` or ``white``
    prior : file with what is known of the links beforehand (:mod:`fitting.regression.body_prior`)
    columns : file with a map of the recordings' columns (:mod:`daq.recordings.column_map`)
    resample : whether recordings of other rates are brought to the machine's (:mod:`daq.recordings.resampling`)
    """

    loop: bool = True
    bandwidth_hz: float | None = None
    bootstrap: int = 18
    forgetting: float = 1.0
    estimator: str = "gls"
    covariance: str = "hac"
    prior: str | None = None
    columns: str | None = None
    resample: bool = False


@dataclass(frozen=True)
class Request:
    """Order of an identification.

    Attributes
    ----------
    machine : machine file
    recordings : (role, file) in any order
    output : directory of the results
    options : choices
    languages : codes of the languages of `report.html`; it has the first, `report.<code>.html` each of the others
    """

    machine: Path
    recordings: tuple[tuple[str, Path], ...]
    output: Path
    options: Options = field(default_factory=Options)
    languages: tuple[str, ...] = ("en",)


@dataclass(frozen=True)
class Prepared:
    """A design with its noise, for one state of corrections; ``rescaled`` is :mod:`fitting.loop.noise_scale`'s."""

    design: Design
    pairs: tuple[Pairing, ...]
    noise: NoiseModel
    fitted: tuple[int, ...]
    validate: tuple[int, ...]
    rescaled: tuple[float, ...] = ()


@dataclass(frozen=True)
class Search:
    """Where the loop searches.

    Attributes
    ----------
    session : of the recordings, or of pieces of them on the recordings' own clocks
    numbers : which recordings of the whole it has
    pieces : how many stretches
    seconds, of_seconds : how long they are, and how long the recordings are, s
    gap : longest time between two pieces of a recording, s
    """

    session: Session
    numbers: tuple[int, ...]
    pieces: int
    seconds: float
    of_seconds: float
    gap: float = 0.0

    @property
    def whole(self) -> bool:
        """True where everything is searched."""
        return self.seconds >= self.of_seconds


class Session:
    """Data of one identification; attributes are computed when first asked for.

    Attributes
    ----------
    machine, described : with channels at the joints, and as the machine file has it
    given : the recordings as they were given
    measured : the same with channels at the joints, and with a row of missing values for every one that was lost
    left_out : a line for each recording of which rows are left out
    file : the machine file, if it came from one
    in_memory : True where signals and columns are kept in memory, however many they are
    synthetic : True where the recordings were made of a model: they are taken as they are
    """

    def __init__(
        self,
        machine: Machine,
        recordings: Sequence[Recording],
        options: Options | None = None,
        file: Path | None = None,
        *,
        in_memory: bool = False,
        synthetic: bool = False,
    ) -> None:
        options = options or Options()
        self.described = machine
        if not any(r.role in ("train", "operation") for r in recordings):
            raise InputError("fitting.no_training_recording")
        self.given = tuple(recordings)
        self.machine, self.measured, self.left_out = machine, tuple(recordings), tuple[str, ...]()
        self.synthetic = synthetic
        if not synthetic:
            self.machine, measured = at_joints(machine, [with_lost_rows(own) for own in recordings])
            self.measured, self.left_out = with_declared_rods(self.machine, measured)
        self.options = options
        self.file = file
        self.in_memory = in_memory

    @classmethod
    def load(cls, request: Request) -> Session:
        """Read the files of a request.

        Raises
        ------
        InputError
            One line that names file, key or channel.
        """
        machine = load_machine(request.machine)
        columns = None if request.options.columns is None else load_map(request.options.columns, machine)
        recordings = [
            read_recording(path, machine, role, columns=columns, resample=request.options.resample)
            for role, path in request.recordings
        ]
        for number, recording in enumerate(recordings):
            for earlier in recordings[:number]:
                if "validate" in (recording.role, earlier.role) and recording.sha256 == earlier.sha256:
                    raise RecordingError(
                        "fitting.same_recording_role", file=recording.file, other=earlier.file, role=earlier.role
                    )
        return cls(machine, recordings, request.options, request.machine)

    def with_recording(self, recording: Recording) -> Session:
        """Return the same machine and options with one recording more, everything computed anew."""
        return Session(self.described, (*self.given, recording), self.options, self.file)

    def at_bandwidth(self, bandwidth_hz: float) -> Session:
        """Return the same recordings at another identification bandwidth, all computed anew."""
        options = replace(self.options, bandwidth_hz=bandwidth_hz)
        return Session(self.machine, self.measured, options, in_memory=self.in_memory)

    @cached_property
    def recordings(self) -> tuple[Recording, ...]:
        """The recordings with channels at the joints, and with what few rows are missing bridged."""
        return tuple(bridged(own, longest_bridge(self.bank)) for own in self.measured)

    @cached_property
    def bank(self) -> FilterBank:
        """The filters."""
        rate = self.machine.rate_hz
        chosen = self.options.bandwidth_hz
        if chosen is None:
            least = min(_LEAST_BANDWIDTH, rate / 8)
            chosen = float(np.clip(_BANDWIDTH_FACTOR * self.motion_frequency, least, rate / 8))
            return filter_bank(rate, chosen)
        return asked_filter_bank(rate, chosen, max(recording.duration for recording in self.measured))

    @cached_property
    def motion_frequency(self) -> float:
        """Frequency in Hz below which the motion is (:func:`fitting.signals.motion_frequency.motion_frequency`)."""
        return motion_frequency(self.machine, self.measured, in_pieces=self.long)

    @property
    def long(self) -> bool:
        """True where the recordings' signals and columns are too many to be kept in memory.

        The loop has thousands of columns, so with it that is sooner; it may search pieces only (:attr:`search`), which
        are in memory even where the shortest that a filter allows are more than was asked for.
        """
        return not self.in_memory and self._samples > (LOOP_SAMPLES if self.options.loop else LONG_SAMPLES)

    @property
    def _samples(self) -> int:
        """Of all joints together."""
        return sum(len(r) for r in self.measured) * len(self.machine.joints)

    @cached_property
    def search(self) -> Search:
        """Recordings that the loop searches: all of them, or pieces of long ones."""
        numbers = tuple(range(len(self.recordings)))
        seconds = sum(r.duration for r in self.recordings)
        if not self.long:
            return Search(self, numbers, len(numbers), seconds, seconds)
        samples = LOOP_SAMPLES if self._samples <= 2 * LOOP_SAMPLES else SEARCH_SAMPLES
        budget = samples // len(self.machine.joints)
        chosen = choose_pieces(self.machine, self.recordings, self.bank, budget)
        recordings = [thinned(self.recordings[own.number], own.pieces) for own in chosen]
        options = replace(self.options, bandwidth_hz=self.bank.bandwidth_hz)
        return Search(
            Session(self.machine, recordings, options, in_memory=True),
            tuple(own.number for own in chosen),
            sum(len(own.pieces) for own in chosen),
            sum(own.rows for own in chosen) / self.machine.rate_hz,
            seconds,
            max(own.gap for own in chosen) / self.machine.rate_hz,
        )

    def forget_search(self) -> None:
        """Free the memory of :attr:`search`."""
        self.__dict__.pop("search", None)

    @cached_property
    def base(self) -> BaseParameters:
        """The machine's base parameters."""
        return reduce_parameters(self.machine)

    @cached_property
    def position_noise(self) -> tuple[PositionNoise, ...]:
        """Noise of every joint's position."""
        return position_noise(self.machine, self.recordings, self.bank)

    @cached_property
    def sensor_errors(self) -> SensorErrors:
        """Noise and steps of both position sensors of every joint that has two."""
        joints = {number: self.machine.joints[number].name for number in checkable(self.machine)}
        loaded = [own for own in self.measured if own.role != "unloaded"]
        channels = [[self.machine.channel(f"{s}_position", n) for s in ("joint", "piston")] for n in joints.values()]
        found = [[reading_error(loaded, own.name) for own in both if own is not None] for both in channels]
        return {number: (both[0], both[1]) for number, both in zip(joints, found, strict=True)}

    @cached_property
    def prior(self) -> Prior:
        """Prior knowledge of the moving masses, of delays between buses, and the plausible arm for these efforts."""
        delays = expected_delays(self.machine)
        known = mass_prior(self.machine)
        if delays is not None:
            known = replace(known, delay=delays[0], delay_std=delays[1])
        drives, rows = self.plain.design.parameters.drives, self._effort_rows
        arm = plausible_arm(geometry_of(self.machine), self.base, drives, rows.triangles)
        return rows.settled(replace(known, arm=arm))

    @cached_property
    def _effort_rows(self) -> EffortRows:
        """Rows of joint efforts of the base model."""
        return EffortRows(self.plain.design, self.plain.fitted)

    @cached_property
    def plain(self) -> Prepared:
        """Design without any correction."""
        return self.prepared(Corrections(self.machine))

    def prepared(
        self,
        corrections: Corrections,
        latency: Mapping[str, float] | None = None,
        resampled: Collection[str] = (),
        known: Model | None = None,
    ) -> Prepared:
        """Design with corrections of positions, linkages and delays rebuilt into the signals.

        Where noise and unsure speeds are ``known``, they are a model's, and no runs of one motion are looked for: there
        are no pairs.
        """
        machine = corrections.machine
        segments = segments_of(
            machine,
            self.recordings,
            self.bank,
            noise=self.position_noise,
            latency=latency,
            resampled=resampled,
            position_error=corrections.position_error,
            play=corrections.play,
            long=self.long,
            synthetic=self.synthetic,
        )
        store = storing(self.bank, Scratch()) if self.long else None
        speeds = known.design.noise if known else self.position_noise
        design = build_design(machine, self.base, self.bank, speeds, segments, store)
        fitted, validate = design.indices(*FITTED_ROLES), design.indices("validate")
        if known:
            return Prepared(design, (), known.noise, fitted, validate)
        pairs = pair_repeats(design)
        noise = noise_model(design, fitted, pairs)
        speeds = unsure_speeds(design, noise, fitted, self.position_noise, range(len(machine.joints)))
        if unsure := _moved(speeds, design):
            store = storing(self.bank, Scratch()) if self.long else None
            design = build_design(machine, self.base, self.bank, speeds, design.segments, store)
            noise = noise_model(design, fitted, pairs, start=noise, anew=unsure)
        noise, rescaled = on_fitted_rows(design, noise, fitted)
        return Prepared(design, pairs, noise, fitted, validate, rescaled)

    def delayed(self, prepared: Prepared, latency: Mapping[str, float], resampled: Collection[str] = ()) -> Prepared:
        """Return a design without delays in memory with some joints' efforts moved; all else is shared."""
        design, fitted, pairs = prepared.design, prepared.fitted, prepared.pairs
        segments = [
            with_delays(design.machine, self.recordings[own.recording], own, self.bank, latency, resampled)
            for own in design.segments
        ]
        late = [number for number, joint in enumerate(design.machine.joints) if joint.name in latency]
        design = with_efforts(design, segments, late)
        noise = noise_model(design, fitted, pairs, start=prepared.noise, anew=late)
        speeds = unsure_speeds(design, noise, fitted, self.position_noise, late)
        if unsure := _moved(speeds, design):
            design = with_efforts(replace(design, noise=speeds), segments, unsure)
            noise = noise_model(design, fitted, pairs, start=noise, anew=unsure)
        noise, rescaled = on_fitted_rows(design, noise, fitted, late)
        return replace(prepared, design=design, noise=noise, rescaled=rescaled)

    @staticmethod
    def with_efforts(prepared: Prepared, recordings: Sequence[Recording]) -> Prepared:
        """Return a design without delays, in memory, with the efforts of other recordings of the very same motion."""
        design = prepared.design
        machine, bank = design.machine, design.bank
        on_time = {joint.name: 0.0 for joint in machine.joints}
        segments = [with_efforts_of(machine, recordings[own.recording], own, bank, on_time) for own in design.segments]
        return replace(prepared, design=with_targets(design, segments))

    @cached_property
    def base_model(self) -> Model:
        """Joint fit of the base model on the uncorrected design."""
        return self.fit(self.plain)

    @cached_property
    def weighted_base(self) -> Weighed:
        """The base model with the weights that suit it."""
        return weighed(self.base_model, self.prior, settled_on=self._effort_rows)

    def base_with(self, weights: Weights) -> Model:
        """Fit the base model with given weights: the reference of the errors before the loop."""
        if self.weighted_base.weights == weights:
            return self.weighted_base.model
        return weighed(self.base_model, self.prior, weights, self._effort_rows).model

    @cached_property
    def stage_noise(self) -> NoiseModel:
        """Noise of stage 1's rows in situ: the measured one, or each joint's own misfit where that is no noise."""
        if self.weighted_base.weights == "whitened":
            return self.plain.noise
        design, fit = self.plain.design, self.weighted_base.model.fit
        joints = range(len(design.machine.joints))

        def misfit(joint: int, loaded: bool) -> Whitening:
            own = (i for i in self.plain.fitted if design.segments[i].loaded == loaded)
            rows = [reduced_residual(design, fit.theta, joint, i)[design.blocks[joint][i].keep] for i in own]
            return unit_whitening(float(np.sqrt(np.mean(np.concatenate(rows) ** 2))) if any(map(len, rows)) else 1.0)

        return NoiseModel(tuple(misfit(j, True) for j in joints), False, tuple(misfit(j, False) for j in joints))

    def fit(self, prepared: Prepared) -> Model:
        """Fit the base model jointly on a design."""
        return fit_model(prepared.design, prepared.noise, prepared.fitted, (), self.prior)

    def _require_motion(self, roles: tuple[str, ...], consequence: str) -> None:
        """Refuse recordings in none of which a joint moves; noise alone seems to move for a moment now and then."""
        design = self.plain.design
        indices, least = design.indices(*roles), _MOVING_S * self.bank.reduced_rate_hz
        moving = (run for i in indices for blocks in design.blocks for run in runs(blocks[i].keep))
        if indices and not any(run.stop - run.start >= least for run in moving):
            files = ", ".join(r.file for r in self.recordings if r.role in roles)
            raise RecordingError("fitting.no_joint_moves", files=files, consequence=consequence)

    def require_excitation(self) -> None:
        """Refuse recordings without motion, and a motion that does not determine the base parameters.

        Raises
        ------
        RecordingError
            Naming the recordings in which nothing moves, or the undetermined parameters. Recordings of role
            `operation` are not refused for what they do not determine.
        """
        design = self.plain.design
        self._require_motion(("train", "repeat", "operation"), Sentence("fitting.nothing_can_fitted"))
        self._require_motion(("validate",), Sentence("fitting.nothing_can_judged"))
        indices = design.indices("train", "repeat")
        if not indices or design.indices("operation"):
            return
        triangles = []
        for i in indices:
            segment = design.segments[i]
            # A joint at rest has noise for an acceleration, and that would pass for excitation.
            qd, qdd = (np.where(segment.rest, 0.0, motion) for motion in (segment.qd, segment.qdd))
            body = base_regressor(self.machine, self.base, segment.q, qd, qdd) / segment.r[:, :, None]
            rows = [self.bank.reduce(body[:, joint]) for joint in range(len(self.machine.joints))]
            triangles.append(triangle([np.vstack(rows)]))
        missing = unidentifiable(np.vstack(triangles), self.base, rtol=1e-4)
        if missing:
            files = ", ".join(r.file for r in self.recordings if r.role == "train")
            names = ", ".join(missing[:6]) + (f" and {len(missing) - 6} more" if len(missing) > 6 else "")
            raise RecordingError("fitting.motion_not_excite", files=files, names=names)


def _moved(speeds: Sequence[PositionNoise], design: Design) -> list[int]:
    """Return the joints whose speeds are unsure by another width than a design has."""
    return [joint for joint, (own, there) in enumerate(zip(speeds, design.noise, strict=True)) if own != there]
