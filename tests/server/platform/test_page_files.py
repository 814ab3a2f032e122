"""What is sent of a file, whatever it holds. No service runs beside it, whose threads draw random numbers, too."""

from __future__ import annotations

import gzip

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.datastructures import Headers

from server.platform.http.pages import PageFile


@pytest.mark.slow
@given(st.text(min_size=1, max_size=20), st.binary(max_size=3000))
def test_a_file_is_the_same_however_it_is_sent(name: str, content: bytes) -> None:
    made = PageFile.of(name, content)
    assert made.compressed is None or gzip.decompress(made.compressed) == content
    for accepted in ("", "gzip"):
        response = made.response(Headers({"accept-encoding": accepted}))
        body = bytes(response.body)
        assert (gzip.decompress(body) if "content-encoding" in response.headers else body) == content
