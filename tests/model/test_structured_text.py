"""The interpreter that judges Structured Text, and the text's own places: strict types, words, indices, histories."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import erf
from test_conformance import everything

from benchmarks.exports.structured_text import Library
from fitting.arm.expected import expected_power
from fitting.model.export import export_model
from fitting.model.export.functions import identifier, rendered

SUM = """
FUNCTION_BLOCK total
VAR_INPUT
    x : ARRAY[1..3] OF LREAL;
END_VAR
VAR_IN_OUT
    kept : ARRAY[0..0] OF LREAL;
END_VAR
VAR_OUTPUT
    y : LREAL;
END_VAR
VAR
    k : INT;
    runs : LREAL;
END_VAR
    k := 1; (* a comment, "END_VAR" *)
    y := 0.0;
    WHILE k <= 9 DO
        IF k > 3 THEN EXIT; ELSIF k = 2 THEN y := y - 2.0 * X[k]; ELSE y := y + x[k]; END_IF;
        k := k + 1;
    END_WHILE;
    runs := runs + 1.0;
    kept[0] := kept[0] + y / 2.0 - -runs;
END_FUNCTION_BLOCK
"""


def test_the_interpreter_runs_what_the_grammar_says() -> None:
    block, kept = Library(SUM).block("TOTAL"), [1.0]
    assert block(x=[1.0, 10.0, 100.0], kept=kept) == {"y": 81.0} and kept == [1.0 + 40.5 + 1.0]
    block(x=[0.0, 0.0, 0.0], kept=kept)  # variables of an instance stay
    assert kept == [44.5]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("k := 1;", "k := 1.0;", "is lreal, wants int"),
        ("2.0 * X[k]", "2 * X[k]", "int \\* lreal"),
        ("x[k];", "z[k];", "z is not declared"),
        ("runs : LREAL", "dt : LREAL", "wants a name"),
        ("runs : LREAL", "K : LREAL", "k is there twice"),
        ("y := 0.0;", "x[1] := 0.0;", "x is not to be written"),
        ("y := 0.0;", "y := 1e-5;", "1e-5"),
        ("y := 0.0;", "y := 0.0", "wants ;"),
        ("END_WHILE;", "", "wants|EXIT"),
    ],
)
def test_the_interpreter_refuses_what_the_language_has_not(old: str, new: str, words: str) -> None:
    with pytest.raises(SyntaxError, match=words):
        Library(SUM.replace(old, new))


def test_an_index_beyond_an_array_is_an_error() -> None:
    with pytest.raises(IndexError, match=r"4 is not within 1\.\.3"):
        Library(SUM.replace("k > 3", "k > 4")).block("total")(x=[0.0] * 3, kept=[0.0])


@pytest.fixture(scope="module")
def text(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("st") / "arm.st"
    export_model(everything(), "st", path)
    return path.read_text(encoding="utf-8")


@pytest.mark.slow
@given(st.floats(-8.0, 8.0))
def test_helpers_are_the_functions_of_their_names(x: float) -> None:
    def helper(name: str, *given: float) -> float:
        return float(HELPERS.function(f"test_arm_{name}")(*given))

    assert helper("erf", x) == pytest.approx(float(erf(x)), rel=1e-14, abs=1e-300)
    assert helper("expm1", x) == pytest.approx(math.expm1(x), rel=1e-14)
    assert helper("tanh", x) == pytest.approx(math.tanh(x), rel=1e-14)
    factor = 0.3 ** (1 / 3) * 2 ** (2 / 3) * math.gamma(7 / 6) / math.sqrt(math.pi)
    right = float(expected_power(np.array([x]), 0.3, 1 / 3)[0])
    assert helper("power", x, 0.3, 1 / 3, factor) == pytest.approx(right, rel=1e-12, abs=1e-300)


@pytest.mark.slow
def test_a_wrong_memory_shows(text: str) -> None:
    """The judge would see an error: a memory that goes on a hundredth too large."""
    assert "    memory[1] := " in text
    name = identifier(everything().machine.name)
    efforts = []
    for own in (text, text.replace("    memory[1] := ", "    memory[1] := 1.01 * ")):
        library, memory = Library(own), [0.0] * 12
        moment = {"q": [0.1, 0.1], "qd": [0.1, -0.1], "qdd": [0.0, 0.0], "dt_s": 0.02}
        library.block(f"{name}_init")(**moment, t_s=0.0, memory=memory)
        efforts.append(library.block(f"{name}_step")(**moment, t_s=0.02, memory=memory)["tau"])
    assert efforts[0] != efforts[1]


USED = {"sign", "erf", "tanh", "expm1", "hypot", "any_power"}
HELPERS = Library(rendered("arm.st.j2", name="test_arm", card=[], used=USED, curves=[], blocks=[]))
