"""Files that are written whole take the place of files only."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from daq.whole_files import write_whole


def test_a_pipe_or_a_device_keeps_its_name(tmp_path: Path) -> None:
    """Else `-o` with one, given by a superuser, would leave every other program without it."""
    pipe, nothing = tmp_path / "pipe", tmp_path / "nothing"
    os.mkfifo(pipe)
    nothing.symlink_to(os.devnull)
    for place in (pipe, nothing):
        with pytest.raises(OSError, match="Is a device or a pipe and no file") as refused:
            write_whole(place, b"content")
        assert refused.value.filename == str(place)
    assert pipe.is_fifo() and nothing.is_symlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["nothing", "pipe"]
    write_whole(tmp_path / "file", b"one")
    write_whole(tmp_path / "file", b"two")
    assert (tmp_path / "file").read_bytes() == b"two"
