"""Blank pictures in tests of commands: `tests/outputs` tests the drawings."""

from __future__ import annotations

import base64

import pytest

CONTENT = {
    "png": base64.b64decode(
        "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGP4DwABAQEAsTj2FAAA"
        "AABJRU5ErkJggg=="
    ),
    "svg": b"<svg xmlns='http://www.w3.org/2000/svg'/>",
    "pdf": b"%PDF-1.4\n%%EOF\n",
}


class Blank:
    """Canvas that draws nothing: layout and drawing take a quarter of a second."""

    def __init__(self, figure):
        """Store a figure, without a change of it."""

    def print_png(self, file, **_):
        """Write a picture of one pixel."""
        file.write(CONTENT["png"])

    def print_svg(self, file, **_):
        """Write an empty picture."""
        file.write(CONTENT["svg"])

    def print_pdf(self, file, **_):
        """Write an empty document."""
        file.write(CONTENT["pdf"])


@pytest.fixture(autouse=True)
def blank_pictures(request, monkeypatch):
    """Write blank files in place of pictures, except in tests marked `drawn`."""
    if request.node.get_closest_marker("drawn") is None:
        from lagsim.outputs import figure

        monkeypatch.setattr(figure, "get_registered_canvas_class", lambda _form: Blank)
        monkeypatch.setattr(figure.Picture, "settle", lambda _picture: None)
