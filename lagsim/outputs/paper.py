"""What a sheet is drawn on: the pixels of a PNG, or an SVG or PDF file.

None of them tells a date, a version or who made it: the same rows give the same bytes.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import io
import struct
import zlib
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from matplotlib.backends.backend_agg import RendererAgg

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Of pixels, and of the points in which vector files count.
DPI, POINTS = 200, 72


class Paper(Protocol):
    """A renderer of matplotlib, how it counts, and the file it makes."""

    renderer: Any
    dpi: int

    def content(self) -> bytes:
        """Give the file; nothing can be drawn after."""


class Pixels:
    """A white picture in pixels."""

    dpi = DPI

    def __init__(self, width: float, height: float) -> None:
        size = (round(width * DPI), round(height * DPI))
        self.renderer: Any = RendererAgg(*size, DPI)  # type: ignore[no-untyped-call]
        self.pixels()[:] = 255

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture: (height, width, 4), its last colour opaque."""
        return np.asarray(self.renderer.buffer_rgba())

    def content(self) -> bytes:
        """Return the picture as a PNG file."""
        return png(self.pixels())


class Svg:
    """An SVG file; letters are outlines, so that no font is missed anywhere."""

    dpi = POINTS

    def __init__(self, width: float, height: float) -> None:
        from matplotlib.backends.backend_svg import RendererSVG
        from matplotlib.path import Path
        from matplotlib.transforms import Affine2D

        self._file = io.StringIO()
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        size = (width * POINTS, height * POINTS)
        self.renderer: Any = RendererSVG(  # type: ignore[no-untyped-call]
            *size, self._file, image_dpi=POINTS, metadata=nothing
        )
        # What shows it may be dark.
        paint = self.renderer.new_gc()
        paint.set_linewidth(0.0)
        white, whole = (1.0, 1.0, 1.0, 1.0), Affine2D().scale(*size)
        self.renderer.draw_path(  # type: ignore[no-untyped-call]
            paint, Path.unit_rectangle(), whole, white
        )

    def content(self) -> bytes:
        """Give the file."""
        self.renderer.finalize()
        return self._file.getvalue().encode()


class Pdf:
    """A PDF file of one page of the sheet's size."""

    dpi = POINTS

    def __init__(self, width: float, height: float) -> None:
        from matplotlib.backends.backend_pdf import PdfFile, RendererPdf

        self._bytes = io.BytesIO()
        nothing = dict.fromkeys(("Creator", "Producer", "CreationDate"))
        self._file = PdfFile(self._bytes, metadata=nothing)  # type: ignore[no-untyped-call]
        self._file.newPage(width, height)  # type: ignore[no-untyped-call]
        self.renderer: Any = RendererPdf(  # type: ignore[no-untyped-call]
            self._file, POINTS, height, width
        )

    def content(self) -> bytes:
        """Give the file."""
        self.renderer.finalize()
        self._file.finalize()  # type: ignore[no-untyped-call]
        self._file.close()  # type: ignore[no-untyped-call]
        return self._bytes.getvalue()


# By the ending of the file.
PAPERS: dict[str, type[Pixels | Svg | Pdf]] = {"png": Pixels, "svg": Svg, "pdf": Pdf}


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Return a PNG file of pixels : (height, width, 3 or more); needs no matplotlib.

    No date, no version, nothing but the picture and its size on paper.
    """
    height, width, _ = pixels.shape
    # Filter 2 of the standard: each row as its difference from the one above. Pictures
    # of lines shrink by it as well as by trying all five, in a third of the time.
    filtered = np.empty((height, 1 + 3 * width), np.uint8)
    filtered[:, 0] = 2
    for k in range(3):
        colour, place = pixels[:, :, k], filtered[:, 1 + k :: 3]
        place[0] = colour[0]
        np.subtract(colour[1:], colour[:-1], out=place[1:])
    per_metre = round(DPI / 0.0254)
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        (
            _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
            _chunk(b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)),
            _chunk(b"IDAT", zlib.compress(filtered.data, 2)),
            _chunk(b"IEND", b""),
        )
    )


def _chunk(kind: bytes, data: bytes) -> bytes:
    check = zlib.crc32(data, zlib.crc32(kind))
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)
