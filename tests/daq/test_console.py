"""Tables on narrow terminals: every word of every cell is there, whole. What a command reads is not written over."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.table import Table

from daq.console import reported, show_table

HEADER = ("joint", "unit", "RMS before", "after", "mean before", "after", "relative before", "after")
ROWS = [("joint1", "N m", "1.19", "1.18", "0.0599", "-0.0681", "0.0355 %", "0.0354 %"), ("joint2", *7 * ("12345.678",))]


def shown(width: int, header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    table = Table(*header, title="error on the validation motion")
    for row in rows:
        table.add_row(*row)
    text = io.StringIO()
    show_table(table, Console(file=text, width=width))
    return text.getvalue()


@pytest.mark.parametrize("width", [40, 60, 80])
def test_no_number_is_cut(width: int) -> None:
    text = shown(width, HEADER, ROWS)
    assert max(map(len, text.splitlines())) <= width
    words = re.findall(r"[\w.%-]+", text)
    for row in ROWS:
        for word in " ".join(row).split():
            assert word in words
    assert text.lstrip().startswith("error on the")


def test_a_table_that_fits_is_one() -> None:
    assert "┃ joint  ┃ unit ┃" in shown(60, HEADER[:4], [ROWS[0][:4]])
    assert "joint1: unit N m, RMS before 1.19, after 1.18" in shown(60, HEADER, ROWS)


@pytest.mark.slow
@given(st.integers(30, 200), st.lists(st.tuples(*4 * (st.text("0123456789", min_size=1, max_size=12),)), min_size=1))
def test_every_cell_is_there_at_any_width(width: int, rows: list[tuple[str, ...]]) -> None:
    words = re.findall(r"\d+", shown(width, ("joint", "before", "after", "change"), rows))
    assert sorted(words) == sorted(cell for row in rows for cell in row)


def test_an_output_does_not_replace_what_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def copy(sources: list[Path], output: Path, force: bool = False) -> None:
        output.write_text("other")

    source, link = tmp_path / "source", tmp_path / "link"
    source.write_text("measured")
    link.symlink_to(source)
    for same in (source, link, tmp_path / "." / "source"):
        with pytest.raises(typer.Exit) as ended:
            reported(copy)(sources=[source], output=same)
        assert ended.value.exit_code == 2
        assert capsys.readouterr().err == f"hilfit: --output {same}: is read by this command; give another name\n"
        assert source.read_text() == "measured"
    reported(copy)(sources=[source], output=tmp_path / "new")
    reported(copy)(sources=[source], output=source, force=True)
    assert (tmp_path / "new").read_text() == source.read_text() == "other"
