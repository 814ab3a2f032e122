"""CSV as people's tools write it: any usual separator, decimal sign and encoding, read where there is no doubt.

Excel in a German locale writes semicolons and decimal commas, loggers write tabs, Windows programs a byte order mark or
UTF-16. Which of them a file has is decided from the file alone. Where two readings are possible (``1,234``) the file is
refused with the way out; nothing is guessed.
"""

from __future__ import annotations

import contextlib
import csv
import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from daq.errors import RecordingError
from daq.messages import Sentence, named
from daq.recordings.time_columns import looks_like_moment

#: Bytes of a text that is read at once; more is for Parquet.
MAXIMUM_TEXT = 1 << 30
_PREAMBLE_LINES = 64
_SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas"}
_LOOKED_AT = 40  # lines that have to agree with the header about the separator
_NO_TABLE = Sentence("daq.not_a_table")

#: A comma that cannot separate thousands: after a lone 0 or four digits, or before other than three digits.
_SURE_COMMA = re.compile(rb"(?<![\d.,])[-+]?(?:0|\d{4,}),\d|(?<![\d,])[-+]?\d+,(?:\d{1,2}|\d{4,})(?![\d,])")
_ANY_COMMA = re.compile(rb"\d,\d")
_THOUSANDS = re.compile(rb"\d{1,3}(?:,\d{3}){2,}(?!\d)|\d{1,3}(?:\.\d{3})+,\d|\d{1,3}(?:,\d{3})+\.\d")


@dataclass(frozen=True)
class _Layout:
    """Layout of a text.

    Attributes
    ----------
    separator, decimal : signs between columns and in numbers
    names : header, trimmed
    units : of a second line of units, empty where there is none
    skipped : lines before the first row of numbers
    moments : numbers of the columns that hold moments like ``2026-03-02T09:14:05.020``
    """

    separator: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    skipped: int
    moments: tuple[int, ...]


def read_csv(path: Path, head: bytes) -> tuple[pa.Table, dict[str, str]]:
    """Read a CSV file's table, columns under the header's names, and a line of units by name.

    Columns of moments remain text; ``cycle`` and ``utc_ns`` are whole numbers, all else is float64.

    Parameters
    ----------
    head : the first bytes of the file, by which its encoding is recognised

    Raises
    ------
    RecordingError
        One line: file, line or column, what to do.
    """
    plain = _is_plain(head)
    long = path.stat().st_size > MAXIMUM_TEXT
    too_long = Sentence("daq.text_too_large", path=path, maximum_text=MAXIMUM_TEXT >> 30)
    if long and not plain:
        raise RecordingError(too_long)
    content = path.read_bytes() if not plain else b""
    text = head if plain else _decoded(path, content)
    body = text if not plain else _whole(path)
    layout = _layout(path, text, body)
    usual = plain and layout.separator == "," and layout.decimal == "."
    if long and not usual:
        raise RecordingError(too_long)
    source = path if usual else pa.BufferReader(body)
    table = _parsed(path, source, layout, body)
    units = dict(zip(layout.names, layout.units, strict=False))
    return table, {name: unit for name, unit in units.items() if unit}


def _whole(path: Path) -> bytes:
    """Read the bytes of a file, no more than may be in memory."""
    with path.open("rb") as file:
        return file.read(MAXIMUM_TEXT)


def _is_plain(head: bytes) -> bool:
    """Return whether this is unmarked UTF-8 that can be read in place."""
    if head.startswith((b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")) or b"\0" in head:
        return False
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as error:
        return error.start > len(head) - 4 and error.reason == "unexpected end of data"
    return True


def _decoded(path: Path, content: bytes) -> bytes:
    """Decode the text to UTF-8."""
    if content.startswith(b"\xef\xbb\xbf"):
        encodings = ["utf-8-sig"]
    elif content.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    elif b"\0" in content[:4096]:
        # Every second byte of a text in UTF-16 without a mark is 0; bytes that are no text have their zeros anywhere.
        sample = content[:4096]
        low, high = sample[1::2].count(0), sample[0::2].count(0)
        if min(low, high) > 0.02 * len(sample) or max(low, high) < 0.45 * len(sample):
            raise RecordingError(named(str(path), _NO_TABLE))
        encodings = ["utf-16-le" if low > high else "utf-16-be"]
    else:
        encodings = ["utf-8", "cp1252"]
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text and not re.search(r"[\x01-\x08\x0e-\x1f]", text[:4096]):
            return text.encode("utf-8")
    raise RecordingError(named(str(path), _NO_TABLE))


def _layout(path: Path, head: bytes, body: bytes) -> _Layout:
    lines = head[: 1 << 16].decode("utf-8", errors="replace").splitlines()
    if lines and lines[0].startswith("# hilfit/motion"):
        raise RecordingError("daq.motion_file_not_recording", path=path)
    first, declared, commented = 0, "", ""
    while first < min(len(lines), _PREAMBLE_LINES):
        line = lines[first].strip()
        excel = re.fullmatch(r"sep=(.)", line, re.IGNORECASE)
        if excel is not None:
            declared = excel[1]
        elif line.startswith(("#", "%")):
            commented = line.lstrip("#% ")
        elif line:
            break
        first += 1
    else:
        raise RecordingError(named(str(path), _NO_TABLE))
    header = lines[first]
    if "\0" in header or "\ufffd" in header:
        raise RecordingError(named(str(path), _NO_TABLE))
    separator = declared or _separator(path, header, lines[first + 1 : first + 1 + _LOOKED_AT])
    names = _cells(header, separator)
    skipped = first + 1
    if all(_is_number(name) for name in names):
        under = _cells(commented, separator)
        if len(under) != len(names) or any(_is_number(name) for name in under):
            raise RecordingError(named(str(path), _NO_TABLE))
        names, skipped = under, first  # what some programs do: the header as a comment
    if len(names) < 2 or any(_is_number(name) for name in names):
        raise RecordingError(named(str(path), _NO_TABLE))
    row = _cells(lines[skipped], separator) if skipped < len(lines) else []
    units: tuple[str, ...] = ()
    valued = any(_is_number(cell.replace(",", ".")) or looks_like_moment(cell) for cell in row)
    if len(row) == len(names) and any(row) and not valued:
        units, skipped = tuple(cell.strip("[]() ") for cell in row), skipped + 1
        row = _cells(lines[skipped], separator) if skipped < len(lines) else []
    moments = tuple(number for number, cell in enumerate(row[: len(names)]) if looks_like_moment(cell))
    numbers = body.split(b"\n", skipped)[-1]
    decimal = _decimal(path, numbers, separator, bool(moments))
    return _Layout(separator, decimal, tuple(names), units, skipped, moments)


def _separator(path: Path, header: str, rows: list[str]) -> str:
    """Find the one separator that the header and the first rows share."""
    found = []
    for separator in _SEPARATORS:
        width = len(_cells(header, separator))
        if width > 1 and all(len(_cells(row, separator)) == width for row in rows if row.strip()):
            found.append(separator)
    if len(found) > 1:
        names = " or ".join(_SEPARATORS[separator] for separator in found)
        raise RecordingError("daq.line_columns_separated_both", path=path, names=names)
    # Where no sign fits all rows the usual ones are tried in turn, so that the row that does not fit is named.
    return found[0] if found else next((s for s in _SEPARATORS if s in header), ",")


def _decimal(path: Path, numbers: bytes, separator: str, moments: bool) -> str:
    """Find the decimal sign of all numbers of the rows."""
    if separator == ",":
        quoted = b'"' in numbers and re.search(rb'"[-+]?\d+,\d+"', numbers)
        if not quoted:
            return "."
        numbers = b" ".join(re.findall(rb'"[^"\n]*"', numbers))
    if moments:
        numbers = re.sub(rb"\d{4}-\d\d-\d\d[T ][\d:]+(?:[.,]\d+)?", b"", numbers)
    grouped = _THOUSANDS.search(numbers)
    if grouped is not None:
        raise RecordingError("daq.signs_between_thousands", path=path, decode=grouped[0].decode())
    comma = _ANY_COMMA.search(numbers)
    if comma is None:
        return "."
    if re.search(rb"\d\.\d", numbers):
        raise RecordingError("daq.some_numbers_decimal_point", path=path)
    if _SURE_COMMA.search(numbers) is None:
        first = re.search(rb"[-+]?\d+,\d+", numbers)
        shown = "1,234" if first is None else first[0].decode()
        raise RecordingError("daq.may_decimal_comma_thousands", path=path, shown=shown)
    return ","


def _parsed(path: Path, source: Path | pa.BufferReader, layout: _Layout, body: bytes) -> pa.Table:
    names = list(layout.names)
    dropped = bool(names) and not names[-1]
    if dropped:
        names[-1] = "\0"  # a separator at the end of every line
    if any(not name for name in names):
        number = names.index("") + 1
        raise RecordingError("daq.column_header_no_name", path=path, number=number)
    names_differ(path, names)
    counted = {name: pa.int64() if name in ("cycle", "utc_ns") else pa.float64() for name in names}
    types = counted | {names[number]: pa.string() for number in layout.moments}
    if dropped:
        types["\0"] = pa.null()
    try:
        table = pa.csv.read_csv(
            source,
            read_options=pa.csv.ReadOptions(column_names=names, skip_rows=layout.skipped),
            parse_options=pa.csv.ParseOptions(delimiter=layout.separator),
            convert_options=pa.csv.ConvertOptions(
                column_types=types, strings_can_be_null=True, decimal_point=layout.decimal
            ),
        )
    except pa.ArrowInvalid as error:
        empty = not any(line.strip() for line in body.splitlines()[layout.skipped :])
        if "Empty CSV file" in str(error) or ("CSV parse error: Expected" not in str(error) and empty):
            return pa.table({name: pa.array([], type=kind) for name, kind in types.items() if name != "\0"})
        raise RecordingError(named(str(path), _problem(str(error), names, layout, body))) from None
    return table.drop_columns(["\0"]) if dropped else table


def names_differ(path: Path, names: list[str]) -> None:
    """Refuse a table in which two columns have one name."""
    for name in names:
        if names.count(name) > 1:
            raise RecordingError("daq.column_times", path=path, name=name, name_2=names.count(name))


def _problem(text: str, names: list[str], layout: _Layout, body: bytes) -> str:
    """Word what is wrong with a row, with the line of the file."""
    bad = re.search(r"column #(\d+).*invalid value '(.*?)'", text, re.DOTALL)
    if bad is not None and int(bad[1]) < len(names):
        column, value = int(bad[1]), bad[2]
        where = _where(body, layout, lambda row: column < len(row) and row[column].strip() == value.strip())
        return Sentence("daq.csv_no_number", name=names[column], value=value[:40], where=where)
    width = re.search(r"Expected (\d+) columns, got (\d+)", text)
    if width is not None:
        expected = int(width[1])
        where = _where(body, layout, lambda row: bool(row) and len(row) != expected)
        commas = layout.separator == "," and int(width[2]) > int(width[1])
        more = Sentence("daq.csv_decimal_commas") if commas else ""
        return Sentence("daq.csv_widths_differ", header=width[1], found=width[2], where=where, more=more)
    return Sentence("daq.csv_not_readable")


def _where(body: bytes, layout: _Layout, wrong: Callable[[list[str]], bool]) -> str:
    """Word the file's line of the first row that is wrong; empty where none is found."""
    reader = csv.reader(io.StringIO(body.decode("utf-8", errors="replace"), newline=""), delimiter=layout.separator)
    with contextlib.suppress(csv.Error):  # an unclosed quote or the like
        for row in reader:
            if reader.line_num > layout.skipped and wrong(row):
                return Sentence("daq.csv_in_line", line_num=reader.line_num)
    return ""


def _cells(line: str, separator: str) -> list[str]:
    """Split one line into cells, trimmed, without quotes."""
    try:
        row = next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        row = line.split(separator)
    return [cell.strip().strip('"').strip() for cell in row]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
