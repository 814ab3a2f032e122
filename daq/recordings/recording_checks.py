"""Checks that a recording has to pass; each raises a :class:`~daq.errors.RecordingError` or returns nothing.

Rows are counted from 1 and always come with their time, so that a place can be found in any viewer.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from daq.arrays import BoolArray, FlagArray, FloatArray, IntArray
from daq.errors import RecordingError
from daq.machine.machine_file import JOINT_QUANTITIES, Channel, Machine
from daq.machine.quantities import SENT_QUANTITIES
from daq.messages import Sentence
from daq.quality import Quality
from daq.recordings.map_draft import UnknownColumnsError
from daq.recordings.recording_files import Table

PRESSURES = frozenset(
    {"head_pressure", "rod_pressure", "supply_pressure", "tank_pressure", "head_port_pressure", "rod_port_pressure"}
)

RATE_TOLERANCE = 0.01  # of the nominal period, on the median step: below any clock, above rounding of printed times
STEP_TOLERANCE = 0.25  # of the nominal period, on a single step: sampling jitter, not a lost row
GAP_SHARE = 0.02  # of the steps: a foreign file may have this many uneven ones before its rate is in doubt
LOST_SHARE = 0.25  # of the steps may be several periods long: where every fifth row is lost, so many are
SATURATED_ROWS = 3  # consecutive samples at a limit; noise alone hardly makes three
STUCK_ROWS = 8  # consecutive samples at the extreme of a signal that elsewhere hardly ever repeats itself
KEPT, AS_FAST = 4, 0.5  # rows that a value is kept at least, share of the usual change in them at which it is reached
BESIDE_ROWS = 25  # before and behind it, in which it may repeat other values
REPEATS = 0.1  # share of equal neighbours up to which a signal hardly ever repeats itself
PILE, PILE_RANGE = 10.0, 0.05  # times the mean of the levels within this share of the range
LEVELS = 64  # a signal of fewer levels sits on its extreme for lack of resolution, not for saturation
MISMATCH = 0.1  # of the stroke, between piston encoder and linkage: far above offsets and pin errors


def regular_steps(time: FloatArray, rate_hz: float) -> BoolArray:
    """Return for every step between rows if it is one period (within jitter); (N-1,)."""
    return np.asarray(np.abs(np.diff(time) * rate_hz - 1.0) <= STEP_TOLERANCE)


def lost_between(time: FloatArray, rate_hz: float) -> IntArray:
    """Count rows lost in every step between two: 0 also where a step is no whole number of periods; (N-1,)."""
    periods = np.diff(time) * rate_hz
    whole = np.rint(periods)
    return np.where(np.abs(periods - whole) <= STEP_TOLERANCE, np.maximum(whole - 1, 0), 0).astype(np.int64)


def uneven_steps(time: FloatArray, rate_hz: float) -> IntArray:
    """Find steps that contradict a rate: too many that are no whole number of periods, or rows lost."""
    irregular, lost = ~regular_steps(time, rate_hz), lost_between(time, rate_hz) > 0
    odd = irregular & ~lost
    if np.count_nonzero(odd) > max(1, int(GAP_SHARE * len(odd))):
        return np.flatnonzero(odd)
    many = np.count_nonzero(lost) > max(1, int(LOST_SHARE * len(lost)))
    return np.flatnonzero(lost) if many else np.zeros(0, dtype=np.int64)


def runs(inside: BoolArray, joined: BoolArray | None = None) -> tuple[slice, ...]:
    """Find maximal runs of true rows; ``joined`` (N-1,): neighbouring rows belong together at all."""
    if len(inside) == 0:
        return ()
    together = inside[1:] & inside[:-1]
    if joined is not None:
        together &= joined
    starts = np.flatnonzero(inside & ~np.concatenate(([False], together)))
    stops = np.flatnonzero(inside & ~np.concatenate((together, [False]))) + 1
    return tuple(slice(int(a), int(b)) for a, b in zip(starts, stops, strict=True))


def long_runs(inside: BoolArray, least: float) -> BoolArray:
    """Keep of the true rows those in runs of ``least`` or more."""
    result = np.zeros_like(inside)
    for run in runs(inside):
        result[run] = run.stop - run.start >= least
    return result


def metadata_fits(path: Path, metadata: Mapping[str, str], machine: Machine, role: str) -> None:
    """Check that the schema is known, the machine this one, and unloaded used as such."""
    schema = metadata.get("hilfit.schema")
    if schema is None:
        return
    if schema != "hilfit/recording/1":
        raise RecordingError("daq.recording_schema", path=path, schema=schema)
    owner = metadata.get("hilfit.machine", machine.name)
    if owner != machine.name:
        raise RecordingError("daq.recording_machine_not", path=path, owner=owner, machine=machine.name)
    recorded = metadata.get("hilfit.role", role)
    if (recorded == "unloaded") != (role == "unloaded"):
        raise RecordingError("daq.recorded_cannot_serve", path=path, recorded=recorded, role=role)


def columns_fit(path: Path, table: Table, machine: Machine, seen: Sequence[str] = ()) -> None:
    """Check that columns are time, the machine's channels, our recorder's; only what no joint needs may be missing.

    ``seen`` are the columns as the file has them.
    """
    found = list(table.columns)
    names = [channel.name for channel in machine.channels]
    known = {"time", "cycle", "utc_ns", *names, *(f"{n}.{extra}" for n in names for extra in ("quality", "age"))}
    missing = [c.name for c in machine.channels if c.name not in table.columns and c.quantity in JOINT_QUANTITIES]
    extra = [name for name in found if name not in known]
    unknown = len(missing) + ("time" not in table.columns)
    if extra and unknown > 1 and "hilfit.schema" not in table.metadata:
        columns = seen or found
        shown = ", ".join(columns[:12]) + (", ..." if len(columns) > 12 else "")
        raise UnknownColumnsError(
            Sentence("daq.columns_not_tell_channels", path=path, shown=shown, machine=machine.name, names=_some(names)),
            path,
            columns,
        )
    if "time" not in table.columns:
        near = _near("time", extra)
        raise RecordingError("daq.no_column_time", path=path, near=near)
    if missing and extra and len(missing) > len(names) / 2:
        raise RecordingError(
            "daq.another_machine_channels", path=path, extra=_some(extra), machine=machine.name, names=_some(names)
        )
    if missing:
        near = _near(missing[0], extra)
        raise RecordingError(
            "daq.channel_missing",
            path=path,
            missing=missing[0],
            missing_2=_more(missing),
            near=near,
            machine=machine.name,
        )
    if extra:
        raise RecordingError(
            "daq.no_such_channel", path=path, extra=extra[0], machine=machine.name, extra_2=_more(extra)
        )


def same_rate(one_hz: float, other_hz: float) -> bool:
    """Return whether two rates agree within the tolerance of printed times."""
    return abs(other_hz / one_hz - 1.0) <= RATE_TOLERANCE


def runs_at(time: FloatArray, rate_hz: float) -> bool:
    """Return whether an increasing clock fits a rate, with few holes: as :func:`time_runs` asks."""
    few = not len(uneven_steps(time, rate_hz))
    return few and same_rate(1.0 / float(np.median(np.diff(time))), rate_hz)


def time_increases(path: Path, time: FloatArray) -> None:
    """Check that time is finite and increases strictly."""
    if not np.all(np.isfinite(time)):
        row = int(np.flatnonzero(~np.isfinite(time))[0])
        raise RecordingError("daq.time_row_not_number", path=path, row=row + 1)
    steps = np.diff(time)
    if np.any(steps <= 0):
        row = int(np.flatnonzero(steps <= 0)[0]) + 1
        raise RecordingError("daq.time_not_increase_row", path=path, row=row + 1, time=time[row], time_2=time[row - 1])


def time_runs(path: Path, time: FloatArray, rate_hz: float) -> None:
    """Check that time is finite, increases strictly, at the machine's rate, few holes."""
    time_increases(path, time)
    steps = np.diff(time)
    if len(steps) == 0:
        return
    rate = 1.0 / float(np.median(steps))
    if not same_rate(rate, rate_hz):
        thousand = same_rate(1e3 * rate, rate_hz)
        cure = Sentence("daq.if_time_counts_milliseconds") if thousand else Sentence("daq.give_resample_bring_rate")
        raise RecordingError("daq.time_sampled_hz_machine", path=path, rate=rate, rate_hz=rate_hz, cure=cure)
    irregular = uneven_steps(time, rate_hz)
    if len(irregular):
        row = int(irregular[0])
        raise RecordingError(
            "daq.time_steps_not_first",
            path=path,
            count=len(irregular),
            count_2=len(steps),
            rate_hz=rate_hz,
            row=row + 1,
            time=time[row],
            time_2=time[row + 1],
        )


def counter_runs(path: Path, cycle: IntArray, time: FloatArray) -> None:
    """Check that the cycle counter increases strictly."""
    steps = np.diff(cycle)
    if np.any(steps <= 0):
        row = int(np.flatnonzero(steps <= 0)[0]) + 1
        raise RecordingError("daq.cycle_not_increase_row", path=path, row=row + 1, time=time[row])


def values_are_numbers(path: Path, name: str, values: FloatArray, time: FloatArray, quality: FlagArray | None) -> None:
    """Check that every value is finite unless its quality marks it as unmeasured."""
    if np.any(np.isinf(values)):
        row = int(np.flatnonzero(np.isinf(values))[0])
        raise RecordingError("daq.infinite_row", path=path, name=name, row=row + 1, time=time[row])
    unmarked = np.isnan(values)
    if quality is not None:
        unmarked &= quality == Quality.FRESH
    if np.any(unmarked):
        first = runs(unmarked)[0]
        last = min(first.stop, len(time)) - 1
        raise RecordingError(
            "daq.rows_nan_without_being",
            path=path,
            name=name,
            unmarked=int(unmarked.sum()),
            start=first.start + 1,
            last=last + 1,
            time=time[first.start],
            time_2=time[last],
            missing=int(Quality.MISSING),
        )


def long_enough(path: Path, values: Mapping[str, FloatArray], machine: Machine, minimum_seconds: float) -> None:
    """Check for ``minimum_seconds`` of rows with every channel of a joint measured."""
    rows = len(next(iter(values.values())))
    if rows < minimum_seconds * machine.rate_hz:
        raise RecordingError(
            "daq.too_short_rows_least",
            path=path,
            rows=rows,
            rows_2=rows / machine.rate_hz,
            minimum_seconds=minimum_seconds,
        )
    complete = np.ones(rows, dtype=bool)
    worst, fewest = "", rows + 1
    for channel in machine.channels:
        if channel.quantity in JOINT_QUANTITIES:
            present = np.isfinite(values[channel.name])
            complete &= present
            if int(present.sum()) < fewest:
                worst, fewest = channel.name, int(present.sum())
    if complete.sum() < minimum_seconds * machine.rate_hz:
        raise RecordingError(
            "daq.too_little_measured_all",
            path=path,
            worst=worst,
            complete=complete.sum() / machine.rate_hz,
            minimum_seconds=minimum_seconds,
        )


def not_saturated(path: Path, channel: Channel, machine: Machine, values: FloatArray, time: FloatArray) -> None:
    """Check that no sensor sat at its limit; a command may (full speed is one), and a spool.

    With a declared range: three consecutive samples at or beyond it. Without: a pressure that is exactly at its
    extreme value although it is noisy elsewhere, or whose extreme value is repeated exactly for a second or more in all
    and in 2 % of the samples and far more often than any value near it, which neither noise nor coarse steps do.
    """
    known = np.isfinite(values)
    if not np.any(known) or channel.quantity in SENT_QUANTITIES:
        return
    if channel.range is not None:
        limits = machine.conversion(channel).to_si(channel.range)
        low, high = float(limits.min()), float(limits.max())
        slack = 1e-9 * (high - low)  # rounding of the unit's conversion, not a tolerance
        for beyond in (known & (values >= high - slack), known & (values <= low + slack)):
            for run in runs(beyond):
                if run.stop - run.start >= SATURATED_ROWS:
                    raise RecordingError(_saturated(path, channel, time, run, "its range"))
        return
    if channel.quantity not in PRESSURES or len(np.unique(values[known])) < LEVELS:
        return
    enough = max(machine.rate_hz, 0.02 * known.sum())
    for extreme in (np.max(values[known]), np.min(values[known])):
        at = values == extreme
        longest = max(runs(at), key=lambda run: run.stop - run.start)
        elsewhere = known & ~at
        # Where a signal rests near its end a fine sensor repeats the values beside that, too.
        beside = slice(max(0, longest.start - BESIDE_ROWS), longest.stop + BESIDE_ROWS)
        repeats = max(_repeats(values[elsewhere]), _repeats(values[beside][elsewhere[beside]]))
        noisy = np.any(elsewhere) and repeats < REPEATS and _noise_covers_steps(values[known])
        clipped = at.sum() >= enough and piled_up(values[known], extreme)
        if clipped or (noisy and longest.stop - longest.start >= STUCK_ROWS):
            raise RecordingError(_saturated(path, channel, time, longest, Sentence("daq.exact_value")))


def _repeats(values: FloatArray) -> float:
    """Compute the share of values that equal the one before."""
    return float(np.mean(np.diff(values) == 0)) if len(values) > 1 else 0.0


def _noise_covers_steps(values: FloatArray) -> bool:
    """Return whether noise changes every resting value: else a fine sensor repeats itself at rest.

    With a standard deviation of two steps eight equal values in a row have a chance of 3e-6; the lower quartile of the
    second differences shows it, because motion makes the larger ones.
    """
    step = float(np.diff(np.unique(values)).min(initial=np.inf))
    return bool(np.percentile(np.abs(np.diff(values, 2)), 25) > 1.5 * step)


def cut_off(values: FloatArray, extreme: float) -> bool:
    """Return whether a signal reaches (or leaves) a value at its usual speed; at rest it slows down."""
    kept = [(run.start, run.stop) for run in runs(values == extreme) if run.stop - run.start >= KEPT]
    usual = float(np.median(np.abs(values[KEPT:] - values[:-KEPT])))
    before = [abs(extreme - values[a - KEPT]) for a, _ in kept if a >= KEPT]
    behind = [abs(extreme - values[b + KEPT - 1]) for _, b in kept if b + KEPT <= len(values)]
    steps = [*before, *behind]
    return bool(steps) and float(np.median(steps)) > AS_FAST * usual


def piled_up(values: FloatArray, extreme: float) -> int:
    """Count finite ``values`` exactly at ``extreme``, their largest or smallest; 0 if as many are near it.

    Clipping piles up there what would have gone beyond. A coarse signal that dwells near its end has as many values on
    the levels beside it, to within chance: ten times their mean within a twentieth of the range is no chance, unless
    one of them has more still (what rests there, and its noise is a step or two).
    """
    span = float(np.subtract(*np.percentile(values, [99, 1]))) or float(np.ptp(values))
    near = values[(np.abs(values - extreme) < PILE_RANGE * span) & (values != extreme)]
    count = int(np.count_nonzero(values == extreme))
    counts = np.unique(near, return_counts=True)[1] if len(near) else np.ones(1)
    return count if count > max(PILE * float(counts.mean()), float(counts.max())) else 0


def _saturated(path: Path, channel: Channel, time: FloatArray, run: slice, at: str) -> str:
    return Sentence(
        "daq.saturated_end_rows",
        path=path,
        channel=channel.name,
        at=at,
        start=run.start + 1,
        stop=run.stop,
        time=time[run.start],
        time_2=time[run.stop - 1],
    )


def nothing_constant(path: Path, machine: Machine, role: str, values: Mapping[str, FloatArray]) -> None:
    """Check that every channel of a joint changes, at least by its noise.

    Temperatures, supply, tank and base may be constant, and a valve that nobody moves. In ``unloaded`` the joint
    encoder may (the arm is parked) and so may the piston of a cylinder that is not moved, known from a dead encoder by
    its pressures, which then only carry noise. In ``operation`` any joint may be parked.
    """
    for channel in machine.channels:
        if channel.quantity not in JOINT_QUANTITIES or not _constant(values[channel.name]):
            continue
        quantity = channel.quantity
        if quantity in SENT_QUANTITIES:
            continue
        if role == "operation" and quantity.endswith(("_position", "_velocity")):
            continue
        if role == "unloaded" and quantity in ("joint_position", "joint_velocity", "joint_effort", "cylinder_force"):
            continue
        if role == "unloaded" and quantity == "piston_position" and not _driven(machine, channel.joint, values):
            continue
        known = values[channel.name][np.isfinite(values[channel.name])]
        value = float(machine.conversion(channel).from_si(known[0]))
        raise RecordingError(
            "daq.constant_over_whole_recording", path=path, channel=channel.name, value=value, unit=channel.unit
        )


def _constant(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.ptp(known)) <= 1e-12 * float(np.max(np.abs(known)))


def _driven(machine: Machine, joint: str | None, values: Mapping[str, FloatArray]) -> bool:
    """Return whether a pressure of the joint exceeds its noise, shown by successive differences."""
    for quantity in ("head_pressure", "rod_pressure"):
        channel = machine.channel(quantity, joint)
        if channel is not None:
            known = values[channel.name][np.isfinite(values[channel.name])]
            if len(known) > 2 and np.std(known) > 3.0 * np.std(np.diff(known)) / np.sqrt(2.0):
                return True
    return False


def positions_agree(path: Path, machine: Machine, role: str, values: Mapping[str, FloatArray]) -> None:
    """Check that a loaded joint's joint and piston encoder agree through the linkage, roughly.

    Encoder offsets and pin errors, which identification is to find, are below a tenth of the stroke; another
    machine's recording under the same channel names, or a wrong unit, does not.
    """
    for joint in machine.joints:
        angle = machine.channel("joint_position", joint.name)
        piston = machine.channel("piston_position", joint.name)
        if joint.cylinder is None or piston is None:
            continue
        x = values[piston.name]
        stroke = joint.cylinder.stroke
        if np.isfinite(x).any() and (np.nanmin(x) < -0.5 * stroke or np.nanmax(x) > 1.5 * stroke):
            raise RecordingError(
                "daq.reaches_stroke",
                path=path,
                piston=piston.name,
                value=np.nanmin(x),
                value_2=np.nanmax(x),
                stroke=stroke,
            )
        if role == "unloaded" or angle is None:
            continue
        both = np.isfinite(x) & np.isfinite(values[angle.name])
        if not np.any(both):
            continue
        off = x[both] - joint.cylinder.linkage.piston_position(values[angle.name][both])
        if np.median(np.abs(off)) > MISMATCH * stroke:
            raise RecordingError(
                "daq.mm_where_linkage_put",
                path=path,
                piston=piston.name,
                off=1000.0 * float(np.median(off)),
                angle=angle.name,
            )


def _near(word: str, options: list[str]) -> str:
    near = difflib.get_close_matches(word, options, n=1)
    return Sentence("daq.there_is", near=near[0]) if near else ""


def _more(names: list[str]) -> str:
    return Sentence("daq.and_more_named", count=len(names) - 1, name=_some(names[1:])) if len(names) > 1 else ""


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
