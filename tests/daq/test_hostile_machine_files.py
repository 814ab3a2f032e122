"""Machine files that were written to do harm: refused with one line, at a bounded cost.

Every text here made the reader of plain PyYAML or pint work for minutes, take memory without end, or raise something
that is no :class:`daq.errors.MachineFileError`.
"""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from itertools import pairwise
from types import ModuleType

import pint
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from test_machine_files import plain

from daq import MachineFileError, parse_machine, safe_yaml
from daq.units import NAMES, USUAL, conversion, is_known


def laughs(line: str) -> str:
    """Nine levels, each of which names the one before nine times: 9^9 values."""
    levels = "abcdefghi"
    rows = [f"a: &a {line}"]
    for before, own in pairwise(levels):
        rows.append(f"{own}: &{own} " + ("[" + ",".join([f"*{before}"] * 9) + "]"))
    return "\n".join(rows) + "\n"


MERGES = laughs("{x: 1}").replace("[*", "{<<: [*").replace("]", "]}")
HOSTILE = {
    "aliases of aliases": laughs("[x, x]"),
    "merges of merges": MERGES,
    "an alias to itself": "joints: &j [*j]\n",
    "a number to the base 60": "rate_hz: 1" + ":00" * 300_000 + "\n",
    "a tagged number to the base 60": "rate_hz: !!int '1" + ":00" * 300_000 + "'\n",
    "a long number": "schema: " + "9" * 100_000 + "\n",
    "a long hexadecimal number": "schema: 0x" + "f" * 100_000 + "\n",
    "a flat list": "joints: [" + "1," * 500_000 + "]\n",
    "a deep list": "joints: " + "[" * 5_000 + "\n",
    "a date that is none": "schema: 2001-99-99\n",
    "a tagged date": "schema: !!timestamp 2001-99-99\n",
    "binary data": "schema: !!binary AA==\n",
    "an object of Python": "schema: !!python/object/apply:os.getcwd []\n",
}
#: Those that are read as text, which is no schema.
TEXT = {"a date that is none", "a number to the base 60", "a long number"}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_text_is_refused_with_one_short_line(text: str) -> None:
    with pytest.raises(MachineFileError) as refusal:
        parse_machine(text)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 400


@pytest.fixture
def without_libyaml(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The reader where PyYAML was built without libyaml."""
    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    spec = spec_from_file_location("plain_yaml", safe_yaml.__file__)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", sorted(HOSTILE.keys() - TEXT))
def test_without_libyaml_the_same_is_refused(name: str, without_libyaml: ModuleType) -> None:
    with pytest.raises(yaml.YAMLError):
        without_libyaml.read(HOSTILE[name])


def test_without_libyaml_a_machine_file_has_the_same_content_on_the_same_lines(without_libyaml: ModuleType) -> None:
    (fast, content), (plainly, same) = safe_yaml.read(plain()), without_libyaml.read(plain())
    assert content == same
    assert fast is not None and plainly is not None
    assert places(fast) == places(plainly)


def places(node: yaml.Node) -> list[tuple[int, int]]:
    """Line and column of a node and of all below it."""
    below = node.value if isinstance(node.value, list) else []
    parts = [part for entry in below for part in (entry if isinstance(entry, tuple) else (entry,))]
    return [(node.start_mark.line, node.start_mark.column), *(place for part in parts for place in places(part))]


@pytest.mark.timeout(60)
@pytest.mark.parametrize("unit", ["rad*9**9**9", "9**9**9**9", "rad**9**9", "(" * 40, "m " * 25, "rad*" + "1" * 12_000])
def test_a_unit_is_not_evaluated(unit: str) -> None:
    with pytest.raises(MachineFileError, match="unknown unit") as refusal:
        parse_machine(plain().replace("joint: j1, unit: deg}", f"joint: j1, unit: '{unit}'}}"))
    assert len(str(refusal.value)) < 400


def test_the_budget_counts_an_alias_as_what_it_stands_for() -> None:
    # 1 document + 2 keys + list of ten + alias of eleven: 25 values.
    text = "a: &a [0,1,2,3,4,5,6,7,8,9]\nb: *a\n"
    assert safe_yaml.read(text)[1] == {"a": list(range(10)), "b": list(range(10))}
    rows = safe_yaml.MOST_NODES // 11
    with pytest.raises(yaml.YAMLError, match="more than"):
        safe_yaml.read(text.replace("b: *a", "b: [" + ",".join(["*a"] * rows) + "]"))


@pytest.mark.slow
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | st.text(max_size=20),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
        max_leaves=20,
    )
)
def test_what_pyyaml_writes_is_read_as_pyyaml_reads_it(content: object) -> None:
    text = yaml.safe_dump(content)
    assert safe_yaml.read(text)[1] == yaml.safe_load(text)
    assert safe_yaml.read(safe_yaml.write(content))[1] == yaml.safe_load(text)


@pytest.mark.parametrize("text", ["12:30", "2026-03-01", "1:00:00"])
def test_times_and_dates_stay_text(text: str) -> None:
    assert safe_yaml.read(f"a: {text}")[1] == {"a": text}


def test_every_name_of_the_closed_list_is_a_unit_of_pint() -> None:
    registry = pint.UnitRegistry()
    for name in NAMES:
        assert name in registry, name


def test_what_needs_no_pint_is_as_pint_has_it() -> None:
    registry = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    for (unit, si), (factor, offset) in USUAL.items():
        assert is_known(unit)
        for value in (0.0, 1.0, -40.0):
            there = registry.Quantity(value, unit).to(si).magnitude
            assert factor * value + offset == pytest.approx(there, rel=1e-15, abs=1e-12)


@pytest.mark.parametrize(
    ("unit", "si", "one"),
    [
        ("N·m", "N m", 1.0),
        ("kN m", "N m", 1e3),
        ("lbf*ft", "N m", 4.4482216152605 * 0.3048),  # NIST SP 811, table B.9
        ("kgf/cm^2", "Pa", 98066.5),
        ("kgf/cm²", "Pa", 98066.5),
        ("N/(mm^2)", "Pa", 1e6),
        ("newton per square millimeter", "Pa", 1e6),
        ("kg m^2 / s^2", "N m", 1.0),
        ("°", "rad", 0.017453292519943295),
        ("µm", "m", 1e-6),
    ],
)
def test_products_of_known_names_are_units(unit: str, si: str, one: float) -> None:
    assert conversion(unit, si).factor == pytest.approx(one, rel=1e-12)


@given(st.text(alphabet="mNrad29*^/() .-e", max_size=60))
def test_no_text_of_the_list_holds_a_power_of_a_power(text: str) -> None:
    if is_known(text):
        assert not any(digit * 2 in text for digit in "29")
        conversion_or_refusal(text)


def conversion_or_refusal(unit: str) -> None:
    try:
        conversion(unit, "N m")
    except ValueError:
        return
