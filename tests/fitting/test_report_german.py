"""`report.html` in German: nothing in it stays English, numbers have commas, and what is a name stays one."""

from __future__ import annotations

import ast
import html
import re
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from said_report import DRIVES, said_report
from test_report import sample_figures, sample_report

from daq.errors import InputError
from daq.messages import Sentence, texts
from fitting.pipeline.stage_names import ReportLanguage
from fitting.report import html as pages
from fitting.report import wording
from fitting.report.html import render_html, write_report
from fitting.report.languages import ENGLISH, NAMES, codes, content_of, language
from fitting.report.model import Figures, JointDiagnostics

GERMAN = language("de")
CONTENT = content_of("de")
#: Words of no German text; names of joints, files and parameters have none of them.
ENGLISH_WORDS = re.compile(
    r"\b(the|and|is|of|not|with|that|has|no|to|from|node|unit|are|be|by|for|it|its|this|these|which|only|more|less|than|"
    r"joints?|speed|efforts?|errors?|friction|law|before|after|found|validation|training|motions?|mean|measured|"
    r"predicted|sensors?|pressure|position|piston|force|without|value|time|correlation|recordings?|sample|yes|noise|"
    r"nothing|something|missing|effect|reason|cause|parameters|deviation|January|March|May|changed|gains)\b"
)
#: A number with a point; versions have two.
POINT = re.compile(r"(?<![\d.])\d+\.\d+(?![\d.])")


def figures(verdict: str) -> Figures:
    """All kinds of figures."""
    values = np.linspace(0.1, 1.0, 20)
    own = JointDiagnostics("joint2", "N m", 91.25, 95.5, *[values] * 8, 0.1, *[values] * 3)
    drawn = sample_figures(verdict != "nothing_missing")
    return Figures(drawn.scatter, drawn.worst, drawn.friction, (own,))


def lines(page: str) -> list[str]:
    """What a page says and what a screen reader is told, without what is a name: quotes, code, files, roles."""
    page = re.sub(
        r'<style>.*?</style>|<script>.*?</script>|<code>.*?</code>|<td class="hash">.*?</td>',
        " ",
        page,
        flags=re.DOTALL,
    )
    told = re.findall(r'(?:aria-label|title|alt)="([^"]*)"', page)
    found = [html.unescape(part).strip() for part in (*re.split(r"<[^>]*>", page), *told)]
    return [
        re.sub(r"„boom“|[\w-]+\.(parquet|mf4|yaml)|\((train|validate|repeat|unloaded)\)", "", one)
        for one in found
        if one
    ]


#: Terms that German has as well, names of keys and options, and those that a value stands for here.
NAMED = re.compile(
    r"can/node 31|--[\w-]+|\b\w+=|valve\.json|hilfit \w+|\b(limits\.position|rate_hz|noise_std|time|theta|command)\b|"
    r"\b(joints|cylinder|rigid_body)\.\S+"
)
CASES = [(v, d) for v in NAMES["verdicts"] for d in DRIVES]


@pytest.mark.slow
@pytest.mark.parametrize(("verdict", "drive"), CASES)
def test_no_english_and_no_decimal_point_is_left(verdict: str, drive: str) -> None:
    page = render_html(said_report(verdict, drive), figures(verdict), GERMAN)
    assert '<html lang="de">' in page and 'aria-label="Inhalt"' in page
    said = [NAMED.sub("", line) for line in lines(page)]
    english = [line for line in said if ENGLISH_WORDS.search(line)]
    assert not english, f"add what an effect or a code says to `words` of fitting/texts/de.json: {english}"
    # Two numbers in a row may be a version: dates and software have their own place.
    assert [line for line in said if POINT.search(line)] == []
    assert "1,25" in page and "hilfit 0.1.0" in page and "2. März 2026, 09:14 UTC" in page


def test_what_is_a_name_stays() -> None:
    page = render_html(said_report("ambiguous", "cylinder"), figures("ambiguous"), GERMAN)
    for name in (
        "joint2.f_c",
        "folding-arm",
        "train-1.parquet",
        "k1",
        "f_s",
    ):
        assert name in page, name
    assert "0,8464 (m2 + m6)" in page  # a combination, whose number is one
    assert "12\u202f500" in GERMAN.number(12500.0) and GERMAN.number(-1.5e7) == "−1,50\u202f×\u202f10⁷"


def test_the_verdict_is_a_german_sentence() -> None:
    report = sample_report()
    report["loop"]["effects"][0]["title"] = "friction that depends on the piston position"
    assert wording.verdict_sentence(report, {}, GERMAN).replace("\u202f", " ") == (
        "Dem Modell fehlte: Reibung, die vom Kolbenweg abhängt (an joint2; k1 = 8123 ± 96 N/m; k2 = −12 100 ± 5200 "
        "N/m²); mit dieser Ergänzung sank der Fehler von joint2 auf der Validierungsbewegung von 210 auf 56,0 N m "
        "(−73 %); der aller Gelenke zusammen sank um 45 % (95-%-Intervall: −50 % bis −39 %)."
    )
    law = {"joint": "joint2", "variable": "joint3.piston_speed", "second_variable": "cylinder_force"}
    assert wording.follows(law, GERMAN) == (
        "der Fehler an joint2 hängt von der Größe „Kolbengeschwindigkeit von joint3“ und der Größe „Zylinderkraft“ ab"
    )
    placed = Sentence("fitting.at_joint", effect="load_dependent_friction", joint="joint2.piston_speed")
    assert wording.readable(placed, {"load_dependent_friction": "Reibung"}) == (
        "reibung at joint2 piston speed"  # English has small letters and no quotes
    )
    rivals = ["position_dependent_friction", "stribeck"]
    said = Sentence("fitting.leave_same_trace", effect=rivals[0], rivals=rivals[1])
    titles = {"position_dependent_friction": "Reibung, die vom Kolbenweg abhängt"}
    assert wording.readable(said, titles, GERMAN) == (
        "„Reibung, die vom Kolbenweg abhängt“ und stribeck hinterlassen in diesen Aufzeichnungen dieselbe Spur"
    )


@pytest.mark.parametrize(("change", "words"), [(-30.0, "sank"), (30.0, "stieg"), (0.01, "änderte sich")])
def test_all_joints_together_fall_rise_or_stay(change: float, words: str) -> None:
    report = sample_report()
    report["overall"]["change_percent"] = change
    for joints in (["joint2"], []):
        said = wording.improvement(report, joints, GERMAN)
        assert words in said and not ENGLISH_WORDS.search(said)


def test_all_languages_are_offered_and_another_one_is_refused(tmp_path: Path) -> None:
    assert codes() == get_args(ReportLanguage) and [language(code).code for code in codes()] == list(codes())
    with pytest.raises(InputError, match="no report in the language 'tlh'; use one of en, de"):
        write_report(sample_report(), Figures(), tmp_path / "none", language="tlh")
    assert not (tmp_path / "none").exists()


def test_further_languages_are_written_beside_the_first(tmp_path: Path) -> None:
    write_report(sample_report(), Figures(), tmp_path, others=("de",))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.de.html", "report.html", "report.json"]
    pages_ = {name: (tmp_path / name).read_text("utf-8") for name in ("report.html", "report.de.html")}
    assert '<html lang="en">' in pages_["report.html"] and '<html lang="de">' in pages_["report.de.html"]


def test_english_is_what_stands_in_the_program() -> None:
    assert ENGLISH.phrase("{} of {}, 5.5", "1.5", "{}") == "1.5 of {}, 5.5"
    assert ENGLISH.translated(own := "gains 3.2 of chi-square") == own and ENGLISH.formula("1.5 x") == "1.5 x"


# --- the table ----------------------------------------------------------------------------------------------------


def _own_texts() -> set[str]:
    """Texts of the page that stand in its template, and all texts in the report's modules."""
    folder = Path(pages.__file__).parent
    template = (folder / "report.html.j2").read_text("utf-8")
    said = {text.replace('\\"', '"') for text in re.findall(r'\bphrase\("((?:[^"\\]|\\.)*)"', template)}
    trees = [
        ast.parse(path.read_text("utf-8")) for path in (*folder.glob("*.py"), folder / "languages" / "__init__.py")
    ]
    nodes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    named = {text for name, group in NAMES.items() if name != "drives" for text in group.values()}
    return said | named | {node.value for node in nodes if isinstance(node.value, str)}


def _composed() -> set[str]:
    """Texts that are put together before they are looked up."""
    moved = ("fell by {}{}", "rose by {}{}", "did not change{}", "is not known{}")
    where = ("the error of all joints on the validation motion", "that of all joints together")
    own = "the error of {} on the validation motion"
    entry: dict[str, Any] = {"indistinguishable_from": [{}]}
    added = [wording._added(*case) for case in (([entry], [], 1), ([entry] * 2, [], 2), ([{}], [], 1), ([{}], [], 2))]
    added += [wording._added([], [{}], 1), wording._added([], [{}, {}], 2)]
    return {
        *(f"{place} {how}" for place in where for how in moved),
        *(f"{own} {way} from {{}} to {{}} {{}} ({{}})" for way in ("fell", "rose")),
        f"{own} stayed at {{}} {{}}",
        *(f"{{}}; with {one}, {{}}" for one in added),
        *(f", only while the speed of the joint is {way}" for way in ("positive", "negative")),
        *(f"{{}}, and no known effect explains {what}" for what in ("it", "them")),
        *(f"{{}}, and no known effect explains {what} for certain; it may be {{}}" for what in ("it", "them")),
    }


def test_every_text_of_the_page_is_in_the_table_and_nothing_else() -> None:
    template = (Path(pages.__file__).parent / "report.html.j2").read_text("utf-8")
    table = {english for group in CONTENT["page"].values() for english in group}
    known = table | texts("fitting", "de")["words"].keys()
    said = {text.replace('\\"', '"') for text in re.findall(r'\bphrase\("((?:[^"\\]|\\.)*)"', template)}
    named = [group for name, group in NAMES.items() if name not in ("open", "drives")]
    said |= (
        {text for texts in named for text in texts.values()}
        | set(wording._FORMULAS.values())
        | {*wording._UP_TO.values()}
        | _composed()
    )
    assert sorted(said - known) == []
    # Roles, units, events and keys of the report are words of it.
    left = table - _own_texts() - _composed() - set(CONTENT["page"]["names"])
    assert sorted(left) == []


def test_a_translation_has_the_values_of_its_text() -> None:
    both = [pair for group in CONTENT["page"].values() for pair in group.items()]
    for english, german in both:
        count = english.count("{}")
        assert set(re.findall(r"\$(\d)", german)) <= {str(n + 1) for n in range(count)}, english
        if count and english not in DROPPED:
            assert len(set(re.findall(r"\$(\d)", german))) == count, english
        assert not re.search(r'["”]|fuer|ueber|koenn|muess', german), german


#: Translations that say less.
DROPPED: set[str] = set()
