"""`report.json` and `report.html`, written together or not at all."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

from daq.messages import with_messages
from daq.whole_files import replacing
from fitting.regression.flags import FLAG_PERCENT
from fitting.report import text, wording
from fitting.report.drawing import draw_course, draw_diagnostics, draw_errors, draw_friction, draw_scatter
from fitting.report.languages import ENGLISH, NAMES, Language
from fitting.report.languages import language as language_of
from fitting.report.model import Figures
from fitting.report.schema.definition import ReportError, validate_report

#: The page's file.
PAGE = "report.html"
#: The page's only script, and what lets it run and nothing else (a content security policy's source).
ZOOM = files("fitting.report").joinpath("zoom.js").read_text("utf-8")
SCRIPT_SOURCE = f"'sha256-{base64.b64encode(hashlib.sha256(ZOOM.encode()).digest()).decode()}'"
#: Where the list of contents goes.
CONTENTS = "<!-- contents -->"
#: A parameter that moved by more than so many standard deviations is flagged.
FLAG_SIGMAS = 3.0


def write_report(
    report: Mapping[str, Any],
    figures: Figures,
    directory: Path,
    *,
    language: str = ENGLISH.code,
    others: Sequence[str] = (),
) -> tuple[Path, Path]:
    """Write ``report.json`` and a self-contained ``report.html``, and return their places.

    Both are rendered completely first, written beside their places, and then renamed: a failure leaves what was
    there before. The same input gives the same bytes.

    Parameters
    ----------
    report : report of schema `hilfit/report/1`; numbers may be numpy's, NaN becomes null
    directory : made if absent
    language : code of the page's language, ``en`` or ``de``; ``report.json`` is English always
    others : codes of languages that the page is written in as well, to ``report.<code>.html``

    Raises
    ------
    ReportError
        If the report is not what the schema asks, or the directory cannot be written.
    InputError
        If there is no such language.
    """
    pages = {PAGE: language_of(language)} | {f"report.{code}.html": language_of(code) for code in others}
    cleaned = validate_report(report)
    contents = {"report.json": json.dumps(cleaned, indent=1, ensure_ascii=False, allow_nan=False) + "\n"}
    contents |= {name: render_html(cleaned, figures, spoken) for name, spoken in pages.items()}
    try:
        with ExitStack() as together:
            for name, content in contents.items():
                temporary = together.enter_context(replacing(directory / name))
                temporary.write_text(content, encoding="utf-8", newline="\n")
    except OSError as error:
        raise ReportError("fitting.report_not_writable", directory=directory, reason=error.strerror) from error
    return directory / "report.json", directory / PAGE


def render_html(report: Mapping[str, Any], figures: Figures, language: Language = ENGLISH) -> str:
    """Render a checked report's page (see :func:`fitting.report.schema.definition.validate_report`)."""
    report = with_messages(report, report.get("messages", {}))
    named = [
        (str(entry["id"]), language.translated(str(entry["title"])), entry.get("joint"))
        for entry in (*(report["loop"].get("candidates") or []), *(report["loop"].get("effects") or []))
        if entry.get("title")
    ]
    titles = {id: title for id, title, _ in named}

    def titles_at(joint: str | None) -> dict[str, str]:
        """Return titles by id; of a joint driven otherwise than others its own."""
        return titles | {id: title for id, title, where in named if where == joint}

    page = (
        _environment(language)
        .get_template("report.html.j2")
        .render(
            report=report,
            result=report["loop"],
            sentence=wording.verdict_sentence(report, titles, language),
            label=wording.label(report["loop"], language),
            titles=titles,
            titles_at=titles_at,
            drawn=_drawn(report, figures, language),
            over_noise=wording.over_noise,
            names=NAMES,
            flag_percent=FLAG_PERCENT,
            flag_sigmas=FLAG_SIGMAS,
            change=text.change,
            ratio=text.ratio,
            offset=wording.is_offset,
            relative_std=text.relative_std,
            diagnostics=figures.diagnostics,
            zoom=Markup(ZOOM),
            script_source=SCRIPT_SOURCE,
        )
    )
    return with_contents(page, language)


def with_contents(page: str, language: Language = ENGLISH) -> str:
    """Fill in the page's contents at its mark, each heading a link."""
    titles: list[str] = []

    def numbered(heading: re.Match[str]) -> str:
        titles.append(heading[1])
        return f'<h2 id="part-{len(titles)}">{heading[1]}</h2>'

    page = re.sub(r"<h2>(.*?)</h2>", numbered, page)
    links = "".join(f'<li><a href="#part-{n}">{title}</a></li>' for n, title in enumerate(titles, 1))
    label = escape(language.phrase("Contents"))
    return page.replace(CONTENTS, f'<nav class="contents" aria-label="{label}"><ol>{links}</ol></nav>', 1)


@cache
def _environment(language: Language) -> jinja2.Environment:
    """Build the template's environment; cached: compiling the template takes longer than filling it in."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fitting.report", ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.ChainableUndefined,
    )

    def phrase(english: str, *values: object) -> Markup:
        """Return a template's own text, which may hold markup; inserted values are escaped."""
        return Markup(language.phrase(english, *(str(escape(value)) for value in values)))

    environment.globals.update(
        phrase=phrase,
        language=language.code,
        alternatives=partial(wording.alternatives, language=language),
        explanation=partial(wording.explanation, language=language),
        resolution=partial(wording.resolution, language=language),
    )
    environment.filters.update(
        number=lambda value, digits=3: language.number(_defined(value), digits),
        fixed=lambda value, decimals: language.numeral(text.fixed(value, decimals)),
        count_of=lambda value: text.fixed(int(value), 0),
        percent=lambda value: language.percent(_defined(value)),
        share=lambda value: language.share(_defined(value)),
        unit=language.unit,
        words=lambda value: language.words(str(value)),
        own=lambda value: language.phrase(str(value)),
        translated=lambda value: language.translated(str(value)),
        title_of=partial(wording.title, language=language),
        capital=wording.capital,
        follows=partial(wording.follows, language=language),
        nearest=partial(wording.nearest, language=language),
        separated=lambda item, titles: wording.separated(_plain(item, language), titles, language),
        chance=partial(wording.as_chance, language=language),
        readable=partial(wording.readable, language=language),
        evidence=partial(wording.evidence, language=language),
        formula=language.formula,
        moment=language.moment,
        listed=language.listed,
        effort=language.effort,
        plain=lambda value: _plain(value, language),
        value=lambda entry: language.with_std(_defined(entry.get("value")), _defined(entry.get("std"))),
    )
    return environment


def _defined(value: Any) -> Any:
    return None if isinstance(value, jinja2.Undefined) else value


def _plain(value: Any, language: Language = ENGLISH) -> str:
    """Write any JSON value as a short text."""
    if value is None or isinstance(value, jinja2.Undefined):
        return text.NONE
    if isinstance(value, bool):
        return language.phrase("yes" if value else "no")
    if isinstance(value, int):
        return text.fixed(value, 0)
    if isinstance(value, float):
        return language.number(value)
    if isinstance(value, Mapping):
        entries = (f"{language.words(str(key))}: {_plain(entry, language)}" for key, entry in value.items())
        return "; ".join(entries) or text.NONE
    if isinstance(value, list):
        return language.phrase(", ").join(_plain(entry, language) for entry in value) or text.NONE
    return language.translated(str(value))


def _drawn(report: Mapping[str, Any], figures: Figures, language: Language) -> dict[str, Any]:
    """Draw the figures as SVG; Markup is given our own drawing only, its texts escaped."""
    overview = []
    for joint, entry in report["errors"].items():
        floor = entry.get("noise_floor")
        before, after = (text.ratio(wording.validate(entry[state]), floor) for state in ("before", "after"))
        if before is not None and after is not None:
            overview.append((joint, before, after))
    return {
        "overview": Markup(draw_errors(overview, language)) if overview else None,
        "scatter": [
            (item, Markup(draw_scatter(item, f"scatter{i}", language))) for i, item in enumerate(figures.scatter)
        ],
        "worst": Markup(draw_course(figures.worst, "worst", language)) if figures.worst else None,
        "worst_data": figures.worst,
        "courses": [
            (own.joint, Markup(draw_course(own.course, f"course{i}", language)))
            for i, own in enumerate(figures.diagnostics)
        ],
        "diagnostics": [
            Markup(draw_diagnostics(own, f"diagnostics{i}", language)) for i, own in enumerate(figures.diagnostics)
        ],
        "friction": Markup(draw_friction(figures.friction, language)) if figures.friction else None,
    }
