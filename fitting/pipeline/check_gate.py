"""The checks at the doors of other commands: what is reported beside a refusal, and what an identification keeps."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from daq.errors import HilfitError, InputError
from daq.machine.machine_file import load_machine
from daq.recordings.column_map import load_map
from fitting.checks.check import check_files
from fitting.checks.findings import Finding
from fitting.loop.session import Options, Request

_T = TypeVar("_T")
_log = logging.getLogger(__name__)


def explained(
    error: InputError, machine_file: Path, files: Sequence[tuple[str, Path]], options: Options | None = None
) -> InputError:
    """Explain the error by what the checks find in the files if that is more; one line.

    Never raises: a search for a cause must not hide what happened.
    """
    try:
        machine = load_machine(machine_file)
        how = options or Options()
        columns = None if how.columns is None else load_map(how.columns, machine)
        findings = check_files(machine, files, machine_file, columns=columns, resample=how.resample)
    except HilfitError:
        return error  # the machine file or a table itself cannot be read: that is what the error states
    except Exception:
        _log.exception("the checks failed on %s", machine_file)
        return error
    causes = [f for f in findings if f.severity == "mistake" and f.text not in str(error)]
    if not causes:
        return error
    return type(error)(f"{error}; a check of the files says: {causes[0].line}")


def with_explanation(request: Request, of: Callable[[], _T]) -> _T:
    """Run ``of`` on a request; explain its refusal of an input as far as the checks can.

    Raises
    ------
    InputError
        As ``of`` does.
    """
    try:
        return of()
    except InputError as error:
        raise explained(error, request.machine, request.recordings, request.options) from None


def for_report(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Make ``checks`` of report.json: findings with the schema's keys, and how serious each is."""
    kept = ("code", "severity", "joint", "channel", "recording", "text", "cure")
    return [{key: getattr(finding, key) for key in kept} for finding in findings]
