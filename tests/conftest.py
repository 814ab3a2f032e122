"""What all tests share."""

import gc
import os
import resource
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

# One BLAS thread per process, before numpy is loaded: tests run side by side on two cores.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

# What is imported and collected stays: looking through half a million of such objects, again and again, is left out.
gc.disable()

# python-can loads asammdf, and pandas and SymPy with it, for log files that no test has; what reads MDF loads it later.
sys.modules["asammdf"] = None  # type: ignore[assignment]
import can  # noqa: E402, F401

del sys.modules["asammdf"]

# The same examples in every run, and none fails because the computer was busy. Hypothesis mixes constants of the
# modules that happen to be loaded into them, which are others in each worker and on each computer: none of those.
assert not providers._local_constants and callable(providers._get_local_constants)
providers._get_local_constants = lambda: providers._local_constants
settings.register_profile(
    "hilfit", derandomize=True, database=None, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("hilfit")

#: Seconds of processor time, which depend little on what else the computer does, of a test that is not marked slow,
#: all its cases together. Marked is what took 0.3 s; the rest is for other computers.
QUICK_S = 0.6
#: Hundreds of cases of milliseconds each, which say most of all where nobody looked: routes, links, versions.
MANY = ("tests/project/", "tests/server/access/test_access_matrix.py")
TESTS = Path(__file__).parent
_QUICK_ONLY = "not slow"
_TEMPORARY, _LEFT = pytest.StashKey[Path](), pytest.StashKey[list[str]]()


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Give all tests, and every process that they start, a temporary folder that goes with them.

    Workers find the folder of the process that started them. Matplotlib keeps its list of fonts there as well, not in
    the home of whoever runs the tests.
    """
    if hasattr(config, "workerinput"):
        return
    place = tempfile.mkdtemp(prefix="hilfit-tests-")
    Path(place).chmod(0o711)  # PostgreSQL refuses to run as root, and as somebody else it has to come to its files
    config.stash[_TEMPORARY] = Path(place)
    os.environ.update(TMPDIR=place, MPLCONFIGDIR=f"{place}/matplotlib")
    tempfile.tempdir = place


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """A file that a test or a program left in the temporary folder is a failure, like a warning."""
    if (place := session.config.stash.get(_TEMPORARY, None)) is None:
        return
    session.config.stash[_LEFT] = left = [
        path.name for path in sorted(place.iterdir()) if path.name != "matplotlib" and not path.match("pytest-of-*")
    ]
    if left and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove the temporary folder, whatever came of the tests."""
    if (place := config.stash.get(_TEMPORARY, None)) is not None:
        shutil.rmtree(place, ignore_errors=True)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Files that are slow as a whole are not even imported where slow tests are left out."""
    if config.option.markexpr != _QUICK_ONLY or not collection_path.name.startswith("test_"):
        return None
    return _slow_as_a_whole(collection_path) or None


def _slow_as_a_whole(path: Path) -> bool:
    lines = path.read_text(encoding="utf-8").splitlines()
    return any(line.startswith("pytestmark") and "pytest.mark.slow" in line for line in lines)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest: no worker is left with one at the end.

    Those are the ones that ask for more time, then the ones with most slow tests.
    """
    longest: dict[Path, tuple[float, int]] = {}
    for item in items:
        asked = item.get_closest_marker("timeout")
        seconds, slow = longest.get(item.path, (0.0, 0))
        seconds = max(seconds, float(asked.args[0]) if asked else 0.0)
        longest[item.path] = seconds, slow + (item.get_closest_marker("slow") is not None)
    items.sort(key=lambda item: longest[item.path], reverse=True)


def pytest_collection_finish() -> None:
    """From here on only what tests leave is looked through."""
    gc.freeze()
    gc.enable()


def _processor_s() -> float:
    """Of this process and the children that it has waited for."""
    own, children = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Note what a test took."""
    before = _processor_s()
    try:
        return (yield)
    finally:
        if item.get_closest_marker("slow") is None:
            item.user_properties.append(("processor_s", _processor_s() - before))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say what was left out, which tests should be, and what was left in the temporary folder."""
    if left := config.stash.get(_LEFT, []):
        terminalreporter.section("left in the temporary folder by tests: a failure")
        terminalreporter.line(", ".join(left))
    if config.option.markexpr == _QUICK_ONLY:
        texts = {path: path.read_text(encoding="utf-8") for path in sorted(TESTS.rglob("test_*.py"))}
        whole = [path for path in texts if _slow_as_a_whole(path)]
        part = [path for path, text in texts.items() if "mark.slow" in text and path not in whole]
        terminalreporter.section("left out, since marked slow; make test runs it")
        folders = {folder: [p.stem for p in whole if p.parent == folder] for folder in {p.parent for p in whole}}
        for folder, names in sorted(folders.items()):
            terminalreporter.line(f"{folder.relative_to(TESTS.parent)}: {', '.join(names)}")
        terminalreporter.line(f"and single tests of {len(part)} of the {len(texts)} files")
    took: dict[str, float] = {}
    for report in terminalreporter.getreports("passed"):
        test = report.nodeid.partition("[")[0]
        if not test.startswith(MANY):
            took[test] = took.get(test, 0.0) + dict(report.user_properties).get("processor_s", 0.0)
    if long := sorted(((seconds, test) for test, seconds in took.items() if seconds > QUICK_S), reverse=True):
        terminalreporter.section(f"more than {QUICK_S:g} s of processor time, all cases together, and not marked slow")
        for seconds, test in long:
            terminalreporter.line(f"{seconds:6.1f} s  {test}")
