"""Recordings of other tools that are no plain table: MDF4 (asammdf), MAT (scipy), ROS 2 bags (rosbags).

Each reader gives rasters: columns that stand on one time base, with what the file says of their units. Libraries are
imported when they are used; asammdf is under the LGPL and not part of this distribution. What a file holds is read as
numbers only.
"""

from __future__ import annotations

import gc
import hashlib
import json
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from daq.errors import RecordingError
from daq.messages import Sentence, named
from daq.recordings.recording_files import UNITS, Table
from daq.whole_files import digest_of

#: Values of all columns of a file that are read into memory (2 GB); more is for Parquet.
MAXIMUM_VALUES = 1 << 28
_MAT_73 = b"MATLAB 7.3"
_MDF = b"MDF     "
_MESSAGES = ("sensor_msgs/msg/JointState", "std_msgs/msg/Float64")

Wanted = Callable[[str], bool]
_Raster = tuple[dict[str, Any], dict[str, str]]  # columns, and units of some


class _Kind(NamedTuple):
    """A kind of file: in words, the package that reads it, and how."""

    what: str
    package: str
    read: Callable[[Path, Wanted], list[_Raster]]


def is_foreign(path: Path) -> bool:
    """Return whether a file or folder is one of these, by content (a bag also by its folder's)."""
    return _kind(path) is not None


def read_rasters(path: Path, wanted: Wanted) -> list[Table]:
    """Read the tables of a file, one per time base, each with ``time`` in seconds.

    Parameters
    ----------
    wanted : whether a column of that name is looked for; others are left where they are

    Raises
    ------
    RecordingError
        One line: what the file is, and what to do.
    """
    kind = _kind(path)
    if kind is None:
        raise RecordingError("daq.none_mdf_mat_ros", path=path)
    rasters = _guarded(path, kind, wanted)
    digest = digest_of(path) if path.is_file() else _digest_of_folder(path)
    return [_table(path, columns, units, digest) for columns, units in rasters]


def _kind(path: Path) -> _Kind | None:
    if path.is_dir():
        return _BAG if (path / "metadata.yaml").is_file() else None
    try:
        with path.open("rb") as file:
            head = file.read(128)
    except OSError:
        return None
    if head.startswith(_MDF):
        return _MDF4
    if head.startswith((b"MATLAB 5.0 MAT-file", _MAT_73)):
        return _MAT
    if head.startswith((b"SQLite format 3\0", b"\x89MCAP0\r\n")):
        return _BAG
    return None


def _guarded(path: Path, kind: _Kind, wanted: Wanted) -> list[_Raster]:
    """Read a file's rasters; report what goes wrong in its library in one plain line.

    A library that dies half-way may complain once more when its objects are taken down; nobody has use for that.
    """
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        try:
            return kind.read(path, wanted)
        except (MemoryError, RecordingError):
            raise
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != kind.package:
                raise
            problem = Sentence("daq.kind_needs_extra", what=kind.what)
        except Exception:  # a library that reads any bytes as offsets raises anything
            problem = Sentence("daq.kind_damaged", what=kind.what)
        gc.collect()
        raise RecordingError(named(str(path), problem))
    finally:
        sys.unraisablehook = hook


def _table(path: Path, columns: dict[str, Any], units: dict[str, str], digest: str) -> Table:
    if sum(len(values) for values in columns.values()) > MAXIMUM_VALUES:
        raise RecordingError("daq.holds_more_values", path=path, maximum_values=MAXIMUM_VALUES)
    return Table(columns, {UNITS: json.dumps(units)}, digest)


def _mdf(path: Path, wanted: Wanted) -> list[_Raster]:
    """Read one raster per time base of an MDF file."""
    from asammdf import MDF

    rasters: list[_Raster] = []
    # It copies a file that was not closed properly, and forgets the copy if it cannot be read.
    with TemporaryDirectory(prefix="hilfit-") as scratch, MDF(path, temporary_folder=scratch) as file:
        for name, places in file.channels_db.items():
            if name == "time" or not wanted(name):
                continue
            if len(places) > 1:
                raise RecordingError("daq.channel_repeated", path=path, name=name, count=len(places))
            signal = file.get(name, ignore_invalidation_bits=True)
            _numbers_only(path, name, signal.samples)
            stamps = np.asarray(signal.timestamps, dtype=np.float64)
            same = [raster for raster in rasters if np.array_equal(raster[0]["time"], stamps)]
            if not same:
                same = [({"time": stamps}, {})]
                rasters += same
            columns, units = same[0]
            columns[name] = np.asarray(signal.samples)
            if signal.unit:
                units[name] = str(signal.unit)
    return rasters


def _numbers_only(path: Path, name: str, samples: Any) -> None:
    samples = np.asarray(samples)
    if samples.ndim != 1 or samples.dtype.kind not in "iufb":
        raise RecordingError("daq.no_channel_numbers", path=path, name=name)


def _mat(path: Path, wanted: Wanted) -> list[_Raster]:
    """Read a MAT file's vectors (also in structures, ``data.q``, and matrix columns, ``q(:,1)``)."""
    with path.open("rb") as file:
        if file.read(len(_MAT_73)) == _MAT_73:
            raise RecordingError("daq.mat_file_version", path=path)
    from scipy.io import loadmat, whosmat

    if sum(math.prod(shape) for _, shape, _ in whosmat(path)) > MAXIMUM_VALUES:  # known before a byte is unpacked
        raise RecordingError("daq.holds_more_values_save", path=path, maximum_values=MAXIMUM_VALUES)
    content = loadmat(path, simplify_cells=True)
    columns = {name: values for name, values in _vectors(content, "") if wanted(name)}
    lengths = {len(values) for values in columns.values()}
    if len(lengths) > 1:
        listed = ", ".join(f"{name} ({len(values)})" for name, values in list(columns.items())[:4])
        raise RecordingError("daq.vectors_differ_length", path=path, listed=listed)
    return [(columns, {})] if columns else []


def _vectors(content: dict[str, Any], prefix: str) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    for name, value in content.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict):
            yield from _vectors(value, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size > 1:
            squeezed = np.squeeze(value)
            if squeezed.ndim == 1:
                yield prefix + name, squeezed
            elif squeezed.ndim == 2:
                for number in range(min(squeezed.shape[1], 1000)):
                    yield f"{prefix}{name}(:,{number + 1})", squeezed[:, number]


def _bag(path: Path, wanted: Wanted) -> list[_Raster]:
    """Read a raster per topic: ``/topic/joint/position`` (velocity, effort) of JointState, ``/topic`` of Float64."""
    found = [(times, columns) for times, columns in _bag_topics(path, wanted).values() if columns]
    begin = min((min(times) for times, _ in found), default=0)
    rasters: list[_Raster] = []
    for times, columns in found:
        time = 1e-9 * (np.array(times, dtype=np.int64) - begin).astype(np.float64)
        rasters.append(({"time": time, **{name: np.array(values) for name, values in columns.items()}}, {}))
    return rasters


def _bag_topics(path: Path, wanted: Wanted) -> dict[str, tuple[list[int], dict[str, list[float]]]]:
    """Read per topic the stamps in ns, and the columns."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    found: dict[str, tuple[list[int], dict[str, list[float]]]] = {}
    count = 0
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        chosen = [connection for connection in reader.connections if connection.msgtype in _MESSAGES]
        for connection, stamp, raw in reader.messages(connections=chosen):
            message: Any = reader.deserialize(raw, connection.msgtype)
            if connection.msgtype == "std_msgs/msg/Float64":
                values = {connection.topic: float(message.data)}
            else:
                own = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
                stamp = own or stamp
                values = {
                    f"{connection.topic}/{joint}/{kind}": float(value)
                    for kind in ("position", "velocity", "effort")
                    for joint, value in zip(message.name, getattr(message, kind), strict=False)
                }
            values = {name: value for name, value in values.items() if wanted(name)}
            times, columns = found.setdefault(connection.topic, ([], {}))
            for name, value in values.items():
                columns.setdefault(name, [np.nan] * len(times)).append(value)
            times.append(int(stamp))
            for column in columns.values():  # a joint that this message does not have
                column.extend([np.nan] * (len(times) - len(column)))
            count += len(values)
            if count > MAXIMUM_VALUES:
                raise RecordingError("daq.holds_too_many_messages", path=path)
    return found


def _digest_of_folder(path: Path) -> str:
    whole = hashlib.sha256()
    for file in sorted(entry for entry in path.iterdir() if entry.is_file()):
        whole.update(file.name.encode() + b"\0" + bytes.fromhex(digest_of(file)))
    return whole.hexdigest()


_MDF4 = _Kind("an MDF file", "asammdf", _mdf)
_MAT = _Kind("a MAT file", "scipy", _mat)
_BAG = _Kind("a ROS 2 bag", "rosbags", _bag)
