"""All mistakes on all machines, through files as a person has them, and sound machines beside them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.measured import sets
from benchmarks.mistakes.making import MISTAKES, Made
from benchmarks.mistakes.rigs import KINDS, Rig, make_rig, with_lost_rows
from benchmarks.targets import Check, Outcome, Show, figure, rate
from daq.errors import InputError
from daq.machine.machine_file import Machine, load_machine
from daq.recordings.recording import read_recording
from fitting.checks.check import check_files
from fitting.checks.findings import Finding

#: Seeds of sound machines begin here, so that none of them has a mistake made on it as well.
_SOUND = 5000
#: What sound recordings have beside, in turn.
BLEMISHES = ("", "lost rows", "", "parked")
#: Hz that measured machines are brought to beside their own rate.
_RATES = (500.0, 200.0, 100.0, 50.0)


@dataclass(frozen=True)
class Line:
    """Findings of the checks in one case.

    Attributes
    ----------
    rig : kind and number of the machine
    mistake : what was made; None: nothing
    effect : effect of the catalogue in the machine, or None
    result : ``right``, ``note`` (named, but as one of two explanations), ``wrong`` (something else was named first),
        ``silent``; of a sound one ``sound``, ``accused`` or
        ``refused``
    reported : first finding, in one line
    seconds : that the checks took
    """

    rig: str
    mistake: str | None
    effect: str | None
    result: str
    reported: str
    seconds: float


def rightly(found: Sequence[Finding], made: Made) -> str:
    """Return ``right`` where the first reported mistake is the one made, at its joint; else what it was.

    ``note`` where nothing is accused, and a note names what was made: an effect of the catalogue explains as much.
    """
    mistakes = [own for own in found if own.severity == "mistake"]
    if not mistakes:
        noted = any(own.code in made.codes and own.joint in made.joints for own in found)
        return "note" if noted else "silent"
    first = mistakes[0]
    there = not made.joints or first.joint in made.joints or (first.joint is None and len(made.joints) > 1)
    named = first.code in made.codes or any(word in first.line for word in made.words)
    return "right" if named and there else "wrong"


def judge(rig: Rig, number: int, name: str | None, seed: int, folder: Path, blemish: str = "") -> Line | None:
    """Make one mistake (or none) on a rig and check its files; None where it cannot be made there."""
    label = f"{rig.kind}-{number}{blemish and ' '}{blemish}"
    if name is None:
        file, files = rig.write(folder)
        made = None
    else:
        made = MISTAKES[name](rig, np.random.default_rng([seed, number, list(MISTAKES).index(name)]))
        if made is None:
            return None
        file, files = made.rig.write(folder, made.machine)
        files = [(made.roles.get(path.stem, role), path) for role, path in files]
    machine = load_machine(file)
    began = time.perf_counter()
    found = check_files(machine, files, file)
    seconds = time.perf_counter() - began
    if made is not None:
        return Line(label, name, rig.effect, rightly(found, made), _first(found, folder), seconds)
    return Line(label, None, rig.effect, *_of_sound(machine, files, found, folder), seconds)


def _of_sound(
    machine: Machine, files: Sequence[tuple[str, Path]], found: Sequence[Finding], folder: Path, resample: bool = False
) -> tuple[str, str]:
    """Test whether files without a mistake were left alone; return what was reported if not."""
    try:
        for role, path in files:
            read_recording(path, machine, role, resample=resample)
    except InputError as error:
        return "refused", str(error).replace(f"{folder}/", "")
    reported = _first(found, folder)
    return ("accused" if reported else "sound"), reported


def _first(found: Sequence[Finding], folder: Path) -> str:
    """Return the line of the first mistake that is reported; empty if there is none."""
    return next((own.line.replace(f"{folder}/", "") for own in found if own.severity == "mistake"), "")


def _measured(data: Path, folder: Path) -> Iterator[Line]:
    """Check every measured machine that is there, at each rate: nothing is wrong with any."""
    for name in sets.FOLDERS:
        found_files = sets.files(name, data, folder)
        if found_files is None:
            continue
        machine, files = load_machine(found_files[0]), found_files[1]
        for hz in (machine.rate_hz, *(r for r in _RATES if r < machine.rate_hz)):
            own = machine.model_copy(update={"rate_hz": hz})
            began = time.perf_counter()
            found = check_files(own, files, resample=hz != machine.rate_hz)
            seconds = time.perf_counter() - began
            result = _of_sound(own, files, found, folder, resample=hz != machine.rate_hz)
            yield Line(f"{name} at {hz:g} Hz", None, None, *result, seconds)


def run(machines: int, sound: int, seed: int, only: str | None, show: Show, data: Path) -> Outcome:
    """Make every mistake on every machine."""
    lines: list[Line] = []
    names = [name for name in MISTAKES if only is None or only in name]
    with TemporaryDirectory(prefix="hilfit-mistakes-") as scratch:
        for number in (*range(machines), *range(_SOUND, _SOUND + sound)):
            blemish, own = BLEMISHES[number % len(BLEMISHES)] if number >= _SOUND else "", 100_000 * seed + number
            kind = KINDS[number % len(KINDS)]
            rig = make_rig(kind, own, effect=number >= _SOUND, parked=blemish == "parked")
            if blemish == "lost rows":
                rig = with_lost_rows(rig, np.random.default_rng([own, 7]))
            for name in names if number < _SOUND else (None,):
                line = judge(rig, number, name, seed, Path(scratch) / str(len(lines)), blemish)
                if line is not None:
                    lines.append(line)
                    _show(line, show)
        for line in _measured(data, Path(scratch)) if data.is_dir() and sound else ():
            lines.append(line)
            _show(line, show)
    cases = [{("said" if key == "reported" else key): own for key, own in asdict(line).items()} for line in lines]
    return Outcome(checks_of(lines), content={"seed": seed, "cases": cases})


def _show(line: Line, show: Show) -> None:
    if line.result not in ("right", "sound"):
        show(f"{line.result:8s} {line.rig:12s} {line.mistake or line.effect or '-'}: {line.reported}")


def checks_of(lines: Sequence[Line]) -> tuple[Check, ...]:
    """Compare the numbers with their targets."""
    made = [line for line in lines if line.mistake is not None]
    sound = [line for line in lines if line.mistake is None]

    def count(of: Sequence[Line], *results: str) -> int:
        return sum(line.result in results for line in of)

    kinds = len({line.mistake for line in made})
    seconds = sorted(line.seconds for line in sound if not line.rig.startswith("one"))
    middle = seconds[len(seconds) // 2] if seconds else 0.0
    timed = [figure("median time of the checks, six joints", middle, "{:.2f} s")] if seconds else []
    return (
        figure("kinds of mistakes", kinds, least=30.0, shown=str(kinds)),
        rate("mistakes: silent", count(made, "silent"), len(made), "at most", 0.0),
        rate("mistakes: named rightly", count(made, "right", "note"), len(made), "at least", 0.97),
        rate("mistakes: of these in a note", count(made, "note"), len(made)),
        rate("sound ones: accused", count(sound, "accused"), len(sound), "at most", 0.0),
        rate("sound ones: refused", count(sound, "refused"), len(sound), "at most", 0.0),
        *timed,
    )
