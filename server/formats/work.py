"""``python -m server.formats.work WHAT SOURCE TARGET MACHINE_FILE SHOWN``: one piece of work on one file.

``WHAT`` is ``parquet``, ``csv``, ``mdf4`` or ``mcap`` (write SOURCE as that), ``read-mdf4`` (write SOURCE, an MDF file,
as Parquet) or ``statistics`` (JSON into TARGET). Speaks the protocol of :mod:`server.children`.
"""

from __future__ import annotations

import json
import resource
import sys
from pathlib import Path

import pyarrow as pa

from daq import InputError, load_machine
from daq.machine_file import Machine
from daq.recording_files import Table, read_table, write_columns, write_table
from server.formats import mcap_file, mdf4
from server.formats.statistics import statistics

#: Address space of the child.
MAXIMUM_BYTES = 8 * 2**30
#: Library and extra that a form needs.
NEEDS = {"asammdf": "export", "mcap": "export"}


def do(what: str, source: Path, target: Path, machine: Machine, shown: str) -> None:
    """Do one piece of work.

    Raises
    ------
    InputError
        One line: what is wrong with the file.
    """
    if what == "read-mdf4":
        wanted = {c.name for c in machine.channels}
        wanted |= {f"{name}.{kind}" for name in wanted for kind in ("quality", "age")} | {"cycle", "utc_ns"}
        columns, units = mdf4.read(source, wanted, shown)
        metadata = {"hilfit.units": json.dumps({k: v for k, v in units.items() if machine_has(machine, k)})}
        write_table(target, pa.table(columns).replace_schema_metadata(metadata))
        return
    table = read_table(source)
    if what == "statistics":
        target.write_text(json.dumps(statistics(table, machine)), encoding="utf-8")
    elif what in ("parquet", "csv"):
        write_columns(target, table)
    else:
        (mdf4 if what == "mdf4" else mcap_file).write(table, units_of(table, machine), target)


def machine_has(machine: Machine, channel: str) -> bool:
    """Whether it is a channel of the machine."""
    return any(own.name == channel for own in machine.channels)


def units_of(table: Table, machine: Machine) -> dict[str, str]:
    """Units of the columns: what the file says, else what the machine file declares."""
    said = json.loads(table.metadata.get("hilfit.units", "{}"))
    return {**{c.name: c.unit for c in machine.channels}, **said}


def main(arguments: list[str]) -> int:
    """Entry of the process."""
    what, source, target, machine_file, shown = arguments
    resource.setrlimit(resource.RLIMIT_AS, (MAXIMUM_BYTES, MAXIMUM_BYTES))
    try:
        do(what, Path(source), Path(target), load_machine(machine_file), shown)
    except InputError as error:
        print(json.dumps({"error": str(error)}))
        return 2
    except MemoryError:
        print(json.dumps({"error": f"{shown}: needs too much memory; use a shorter recording"}))
        return 2
    except ModuleNotFoundError as error:
        extra = NEEDS.get((error.name or "").partition(".")[0])
        if extra is None:
            raise
        print(json.dumps({"error": f"this needs {error.name}; run: pip install 'hilfit[{extra}]'"}))
        return 1
    print(json.dumps({"summary": {}}))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
