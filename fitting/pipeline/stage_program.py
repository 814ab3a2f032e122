"""A program that runs stages of an identification, of an arm or of its valves.

It is started as ``python -m fitting.pipeline.stage_program [--stay] REQUEST.json STAGE``.

It prints one JSON object a line: ``{"fraction", "text"}`` while it works, then ``{"summary"}`` or ``{"error"}``; exit
code 0, 1 (failed) or 2 (input). With ``--stay`` it waits after ``{"summary", "stays": true}`` for
``{"arguments": [REQUEST.json, STAGE], "log": FILE}`` on standard input, until that ends: libraries and recordings are
then loaded once. ``log`` takes standard error from there on.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from daq.errors import HilfitError, InputError
from daq.messages import with_their_messages
from fitting.loop.session import Options, Request, Session
from fitting.pipeline.stage_names import VALVE_STAGE
from fitting.pipeline.stages import run_stage
from fitting.pipeline.valve_stage import identified_and_written
from fitting.valve.export import formats


def load_request(path: Path) -> Request:
    """Read a request file: keys ``machine, recordings, options, output, languages``."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return Request(
            machine=Path(content["machine"]),
            recordings=tuple((str(role), Path(file)) for role, file in content["recordings"]),
            output=Path(content["output"]),
            options=Options(**content.get("options", {})),
            languages=tuple(str(code) for code in content.get("languages", Request.languages)),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError("fitting.not_request_identification", path=path, error=error) from None


def _keeping() -> Callable[[Request], Session]:
    """Wrap ``Session.load`` to give the same session for the same input again."""
    kept: list[tuple[Request, Session]] = []

    def load(request: Request) -> Session:
        key = replace(request, output=Path())
        if not kept or kept[0][0] != key:
            kept[:] = [(key, Session.load(request))]
        return kept[0][1]

    return load


def main(arguments: Sequence[str], orders: Iterable[str] = ()) -> int:
    """Run ``python -m fitting.pipeline.stage_program``.

    Parameters
    ----------
    orders : lines with what to do next, with ``--stay``
    """
    resident = arguments[:1] == ["--stay"]
    load = _keeping() if resident else Session.load
    code = _one(arguments[1:] if resident else arguments, load, resident)
    for line in orders if resident and code == 0 else ():
        order = json.loads(line)
        with Path(order["log"]).open("ab") as log:
            os.dup2(log.fileno(), sys.stderr.fileno())
        code = _one(order["arguments"], load, resident)
        if code:
            break
    return code


def _one(arguments: Sequence[str], load: Callable[[Request], Session], resident: bool) -> int:
    """Run one stage, report its progress, and return the exit code."""

    def send(content: dict[str, Any]) -> None:
        print(json.dumps(with_their_messages(content)), flush=True)

    if len(arguments) != 2:
        send({"error": "usage: python -m fitting.pipeline.stage_program [--stay] REQUEST.json STAGE"})
        return 2
    try:
        request = load_request(Path(arguments[0]))

        def progress(fraction: float, text: str) -> None:
            send({"fraction": fraction, "text": text})

        if arguments[1] == VALVE_STAGE:
            written = identified_and_written(request, tuple(formats()), progress)[1]
            summary = {"inverses": [path.name for path in written]}
        else:
            summary = run_stage(arguments[1], request, progress, load)
    except HilfitError as error:
        send({"error": str(error)})
        return 2 if isinstance(error, InputError) else 1
    send({"summary": summary} | ({"stays": True} if resident else {}))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], sys.stdin))
