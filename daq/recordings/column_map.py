"""Which column of a file is which channel: by name, by a header like ``p1 [bar]``, or as a person's map says.

A map is a YAML file of channels (and ``time``), each with the column that holds it::

    time: t_ms
    joint1.angle: {column: "q1 (deg)"}
    joint1.head_pressure: {column: ai3, unit: bar, scale: 25.0, offset: -2.5}   # unit = scale * column + offset

Columns that a map does not name are looked up by their names; what belongs to no channel is then left out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from daq import safe_yaml
from daq.errors import InputError, RecordingError
from daq.machine.machine_file import Channel, Machine
from daq.machine.machine_file_errors import short
from daq.messages import named
from daq.recordings.recording_files import UNITS, Table
from daq.recordings.time_columns import seconds
from daq.units import conversion
from daq.validation_words import in_words

#: Bytes of a map's text; a machine of a thousand channels has a tenth of it.
MAXIMUM_MAP = 1 << 20
#: What a column of time may be called.
_TIME = frozenset({"time", "t", "timestamp", "timestamps", "datetime", "date_time", "epoch", "stamp", "zeit", "temps"})
_HEADER = re.compile(r"(?P<name>.+?)\s*(?:\[(?P<square>[^\[\]:]*)\]|\((?P<round>[^():]*)\))\s*")
#: Spellings that pint does not know, or takes for something else (``Nm`` is nanometre's neighbour to it).
_SPELLINGS = {
    "°": "deg", "nm": "N m", "n·m": "N m", "n.m": "N m", "n-m": "N m", "n*m": "N m", "knm": "kN m", "kpa": "kPa",
    "sec": "s", "secs": "s", "seconds": "s", "msec": "ms", "usec": "us",
    **{unit: unit for unit in ("bar", "mbar", "psi", "deg", "rad", "mrad")},
}  # fmt: skip
#: Units that two countries read otherwise.
_TWO_MEANINGS = {"grad": "deg or gon", "barg": "bar (and an offset in a map)", "bara": "bar (and an offset in a map)"}


class Source(BaseModel):
    """Where a channel's values are: ``scale * column + offset`` is the channel in ``unit`` (None: as declared)."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    column: Annotated[str, Field(min_length=1)]
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class ColumnMap:
    """Sources by channel name (and ``time``); ``name`` is what errors call the map."""

    sources: Mapping[str, Source] = field(default_factory=dict)
    name: str = "map"


def load_map(path: str | Path, machine: Machine, name: str | None = None) -> ColumnMap:
    """Read a map of ``machine``'s channels; ``name`` is what errors call it, its path if None.

    Raises
    ------
    InputError
        One line: file, channel, what is wrong and what to do.
    """
    path = Path(path)
    try:
        content = path.read_bytes()[: MAXIMUM_MAP + 1]
        text = content.decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError("daq.no_such_file_give_map", path=path) from None
    except UnicodeDecodeError:
        raise InputError("daq.not_text_file_give_map", path=path) from None
    except OSError as error:
        raise InputError("daq.cannot_read_give_map", path=path, reason=error.strerror) from None
    return parse_map(text, machine, name or str(path))


def parse_map(text: str, machine: Machine, name: str = "map") -> ColumnMap:
    """Parse a map from its text (errors as :func:`load_map`)."""
    if len(text) > MAXIMUM_MAP:
        raise InputError("daq.map_too_long", name=name)
    try:
        _, content = safe_yaml.read(text)
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        raise InputError("daq.map_no_yaml", name=name, line=line) from None
    if not isinstance(content, dict) or not content:
        raise InputError("daq.not_a_map", name=name)
    known = {"time", *(channel.name for channel in machine.channels)}
    sources: dict[str, Source] = {}
    taken: dict[str, str] = {}
    for channel, entry in content.items():
        if channel not in known:
            raise InputError(
                "daq.map_no_such_channel", name=name, channel=channel, machine=machine.name, known=sorted(known)
            )
        source = _source(name, str(channel), entry)
        if source.column in taken:
            raise InputError(
                "daq.map_column_taken", name=name, channel=channel, column=source.column, taken=taken[source.column]
            )
        taken[source.column] = sources_name = str(channel)
        sources[sources_name] = source
    return ColumnMap(sources, name)


def _source(name: str, channel: str, entry: Any) -> Source:
    if isinstance(entry, str):
        entry = {"column": entry}
    if not isinstance(entry, dict):
        raise InputError("daq.map_give_column", name=name, channel=channel)
    try:
        given = Source.model_validate(entry)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError("daq.map_correct_it", name=name, channel=channel, place=place, first=in_words(first)) from None
    if given.scale == 0:
        raise InputError("daq.map_scale_zero", name=name, channel=channel)
    return given


def wanted_columns(machine: Machine, columns: ColumnMap | None = None) -> Callable[[str], bool]:
    """Choose column names that may be channels, or time: others need no look in a large file."""
    own = {"time", *(channel.name for channel in machine.channels)}
    keys = {_key(name): name for name in own}
    asked = set() if columns is None else {source.column for source in columns.sources.values()}
    aside = {"cycle", "utc_ns", *(f"{name}.{kind}" for name in own for kind in ("quality", "age"))}

    def wanted(name: str) -> bool:
        return bool({name, _split(name)[0]} & (asked | aside)) or _channel_of(name, keys, machine) is not None

    return wanted


#: A column that belongs to a channel (or ``time``): its name in the file, and the unit that its header states.
_Found = tuple[str, str | None]


def in_channels(
    path: Path, table: Table, machine: Machine, columns: ColumnMap | None = None, *, all_known: bool = True
) -> Table:
    """Return the table with the machine's channel names, time in seconds, and the file's units in its metadata.

    Parameters
    ----------
    columns : what a person declared of the columns
    all_known : False where a file has columns of other things by nature (bags, measurement files): they are left out;
        otherwise they keep their names, for :func:`daq.recordings.recording_checks.columns_fit` to name

    Raises
    ------
    RecordingError
        One line: the column, and what is uncertain about it.
    """
    names = list(table.columns)
    own = {"time", *(channel.name for channel in machine.channels)}
    aside = {"cycle", "utc_ns", *(f"{name}.{kind}" for name in own for kind in ("quality", "age"))}
    if columns is None and set(names) <= own | aside and _is_seconds(table):
        return table
    mapped = {} if columns is None else dict(columns.sources)
    found = _found(path, [n for n in names if n not in {s.column for s in mapped.values()}], machine, own, aside)
    stated = _stated(table)
    result: dict[str, Any] = {}
    units: dict[str, str] = {}
    used: set[str] = set()
    there = {*names, *(_split(name)[0] for name in names)}  # a column is known without its unit, too
    for channel in ("time", *(channel.name for channel in machine.channels)):
        source = mapped.get(channel)
        if source is not None and not (all_known or source.column in there):
            continue  # in another of the file's tables
        if source is not None:
            assert columns is not None
            column, header_unit = _mapped_column(path, columns.name, channel, source, names)
            unit = source.unit or header_unit
            values = np.asarray(table.columns[column]) if channel == "time" else table.columns[column]
            if (source.scale, source.offset) != (1.0, 0.0):
                values = source.scale * np.asarray(values, dtype=np.float64) + source.offset
        elif channel in found:
            column, unit = found[channel]
            values = table.columns[column]
        else:
            continue
        used.add(column)
        unit = _unit(path, column, unit) if unit is not None else stated.get(column) or None
        if channel == "time":
            try:
                result["time"] = seconds(np.asarray(values), _fits(path, column, unit, "s"))
            except ValueError as error:
                raise RecordingError(named(str(path), named(column, str(error)))) from None
            continue
        result[channel] = values
        if unit is not None:
            spec = next(own for own in machine.channels if own.name == channel)
            units[channel] = str(_fits(path, column, unit, machine.si_unit(spec), spec))
    for name in names:
        if name not in used and (name in aside or (all_known and columns is None)):
            result[name] = table.columns[name]
    kept = {name: unit for name, unit in stated.items() if name in result and name != "time"}
    return Table(result, {**table.metadata, UNITS: json.dumps(kept | units)}, table.sha256)


def _stated(table: Table) -> dict[str, str]:
    """Read units of columns that the file itself carries."""
    try:
        return table.units
    except ValueError:
        return {}  # said where the units are used


def _is_seconds(table: Table) -> bool:
    """Return whether the column of time already holds seconds, not moments."""
    if "time" not in table.columns or table.rows == 0:
        return True
    if "hilfit.schema" in table.metadata:
        return True
    if _stated(table).get("time", "s") != "s":
        return False
    time = table.columns["time"]
    return time.dtype.kind in "iuf" and not abs(float(time[0])) >= 1e8


def mapped_columns_are_there(path: Path, columns: ColumnMap | None, names: Sequence[str]) -> None:
    """Refuse a map of which a column is in none of a file's tables (errors as :func:`in_channels`)."""
    for channel, source in ({} if columns is None else columns.sources).items():
        assert columns is not None
        _mapped_column(path, columns.name, channel, source, names)


def _mapped_column(
    path: Path, map_name: str, channel: str, source: Source, names: Sequence[str]
) -> tuple[str, str | None]:
    """Find the column that a map names (with or without its header's unit), and its unit."""
    if source.column in names:
        as_it_is = source.unit is None and (source.scale, source.offset) == (1.0, 0.0)
        return source.column, _split(source.column)[1] if as_it_is else None
    bare = [name for name in names if _split(name)[0] == source.column]
    if len(bare) == 1:
        return bare[0], _split(bare[0])[1]
    shown = ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
    raise RecordingError(
        "daq.map_no_such_column",
        path=path,
        column=short(source.column),
        map_name=map_name,
        channel=channel,
        shown=shown,
    )


def named_columns(names: Sequence[str], machine: Machine) -> dict[str, str]:
    """Find for channels (and ``time``) the one column whose name identifies them."""
    keys = {_key(name): name for name in ("time", *(channel.name for channel in machine.channels))}
    matches = [match for match in (_channel_of(name, keys, machine) for name in names) if match is not None]
    all_of = [channel for channel, _ in matches]
    return {channel: column for channel, (column, _) in matches if all_of.count(channel) == 1}


def _found(path: Path, names: Sequence[str], machine: Machine, own: set[str], aside: set[str]) -> dict[str, _Found]:
    """Find the column of each channel; two for one are refused."""
    keys = {_key(name): name for name in own}
    if len(keys) < len(own):  # names that only differ in case or signs have to be met exactly
        keys = {name: name for name in own}
    found: dict[str, list[_Found]] = {}
    for name in names:
        if name in aside:
            continue
        match = _channel_of(name, keys, machine)
        if match is not None:
            found.setdefault(match[0], []).append(match[1])
    for channel, several in found.items():
        if len(several) > 1:
            listed = " and ".join(f"'{column}'" for column, _ in several)
            raise RecordingError("daq.several_columns", path=path, channel=channel, listed=listed)
    return {channel: several[0] for channel, several in found.items()}


def _channel_of(name: str, keys: Mapping[str, str], machine: Machine) -> tuple[str, _Found] | None:
    """Return the channel that a header names, and its unit."""
    if name in keys.values():
        return name, (name, None)
    bare, unit = _split(name)
    channel = keys.get(_key(bare)) or keys.get(bare) or ("time" if _key(bare) in _TIME else None)
    if channel is not None:
        return channel, (name, unit)
    if bare != name or "_" not in name:
        return None
    bare, _, ending = name.rpartition("_")  # t_ms, j1_angle_deg: only where the ending measures what the channel does
    channel = keys.get(_key(bare)) or ("time" if _key(bare) in _TIME else None)
    if channel is None:
        return None
    spec = next((own for own in machine.channels if own.name == channel), None)
    try:
        conversion(_spelt(ending), "s" if spec is None else machine.si_unit(spec))
    except ValueError:
        return None
    return channel, (name, ending)


def _split(header: str) -> tuple[str, str | None]:
    """Split a header, ``p1 [bar]``, into name and unit; all of it and None without one."""
    found = _HEADER.fullmatch(header)
    return (header, None) if found is None else (found["name"], found["square"] or found["round"] or None)


def _key(name: str) -> str:
    """Reduce a name to what tools keep of it: no case, no signs between its parts."""
    return re.sub(r"[\s._/:-]+", "_", name.strip().strip("/")).casefold()


def _spelt(unit: str) -> str:
    """Write a unit as pint knows it."""
    text = unit.strip().replace("²", "^2").replace("³", "^3").replace("μ", "u").replace("µ", "u")
    return _SPELLINGS.get(text.casefold(), text)


def _unit(path: Path, column: str, unit: str) -> str:
    text = _spelt(unit)
    if text.casefold() in _TWO_MEANINGS:
        raise RecordingError(
            "daq.unit_two_meanings", path=path, column=column, unit=unit, two_meaning=_TWO_MEANINGS[text.casefold()]
        )
    # pint multiplies powers out: a header is no place for large ones.
    if len(text) > 24 or "**" in text or len(re.findall(r"\d", text)) > 3 or re.search(r"\d\d", text):
        raise RecordingError("daq.column_no_unit", path=path, column=column, unit=unit[:40])
    return text


def _fits(path: Path, column: str, unit: str | None, si: str, channel: Channel | None = None) -> str | None:
    """Return the unit, if it measures what the channel (or time) does."""
    if unit is None:
        return None
    try:
        conversion(unit, si)
    except ValueError:
        what = "time" if channel is None else f"{channel.name}, a {channel.quantity.replace('_', ' ')}"
        raise RecordingError("daq.column_other_unit", path=path, column=column, unit=unit, what=what, si=si) from None
    return unit
