"""Coverage-guided fuzzing of what ``fuzz_targets.py`` lists: ``fuzz_parsers.py [--seconds 60] [TARGET ...]``.

Each target runs in a process of its own. What reached new lines is kept in ``.fuzz/TARGET``, and the next run begins
with it; an input that broke something stays there as ``crash-*``, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import importlib.util
import subprocess
import sys
from pathlib import Path

KEPT = Path(".fuzz")
PACKAGES = ["daq", "canopen", "cantools", "textparser", "pymodbus", "can.io"]
SLACK_S = 300.0  # that a process may take beyond its time on a busy computer: loading with every branch counted
MEMORY_MB = 2048


def main() -> int:
    """Run every target that is named, or all; the exit code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("targets", nargs="*")
    given = parser.parse_args()
    if given.one:
        fuzz(given.one, given.seconds)  # which ends the process
    if importlib.util.find_spec("atheris") is None:
        print("fuzzing is skipped: atheris is not installed; .venv/bin/pip install -e '.[fuzz]' brings it (Linux)")
        return 0
    from fuzz_targets import TARGETS

    unknown = [name for name in given.targets if name not in TARGETS]
    if unknown:
        print(f"there is no target {unknown[0]}; there are {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    broken = [name for name in given.targets or TARGETS if not run(name, given.seconds)]
    print("broken: " + ", ".join(broken) if broken else "nothing broke")
    return 1 if broken else 0


def run(name: str, seconds: int) -> bool:
    """Whether a target survived."""
    from fuzz_targets import TARGETS

    folder = KEPT / name
    folder.mkdir(parents=True, exist_ok=True)
    for number, whole in enumerate(TARGETS[name].wholes()):
        (folder / f"whole-{number}").write_bytes(whole)
    command = [sys.executable, __file__, "--one", name, "--seconds", str(seconds)]
    log = folder.with_suffix(".txt")
    with log.open("w") as output:
        try:
            code = subprocess.run(command, stdout=output, stderr=output, timeout=seconds + SLACK_S).returncode
        except subprocess.TimeoutExpired:
            print(f"{name}: did not end in {SLACK_S:g} s more: an input that never ends, or a busy computer")
            code = -1
    lines = log.read_text(errors="replace").splitlines()
    said = [line for line in lines if line.startswith(("Done ", " === Uncaught"))]
    print(f"{name:16s} {'survived' if code == 0 else f'BROKE, see {log}'}  {said[-1] if said else ''}", flush=True)
    return code == 0


def fuzz(name: str, seconds: int) -> None:
    """Never returns."""
    import atheris

    with atheris.instrument_imports(include=PACKAGES):
        from fuzz_targets import TARGETS

        # Libraries that are loaded when they are needed: loaded later, no line of theirs would be seen.
        with TARGETS[name].opened() as check:
            for whole in TARGETS[name].wholes():
                check(whole)
    from hypothesis import given, settings

    target = TARGETS[name]
    with target.opened() as check:
        if target.strategy is None:
            once = check
        else:
            once = settings(database=None, deadline=None)(given(target.strategy)(check)).hypothesis.fuzz_one_input
        folder = KEPT / name
        options = [f"-max_total_time={seconds}", f"-rss_limit_mb={MEMORY_MB}", "-timeout=20"]
        options += [f"-artifact_prefix={folder}/", str(folder)]
        atheris.Setup([sys.argv[0], *options], lambda data: void(once(data)))
        atheris.Fuzz()


def void(_: object) -> None:
    """Libfuzzer takes what is returned for a verdict."""


if __name__ == "__main__":
    sys.exit(main())
