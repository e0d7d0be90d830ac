# SPDX-License-Identifier: Apache-2.0
"""Values under the pointer in a report's picture, which `templates/hover.js` shows.

The values are in a chunk of the PNG image (PNG specification, 5.4: ancillary, private), so the picture is used like any other, and
other programs skip the chunk. It holds, compressed by zlib: the length of a JSON text (uint32), that text, and the arrays that the
text refers to. Axes have: box in fractions of the picture (left, top, right, bottom), title, one image, and series.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

    from tof_core.arrays import Float

CHUNK = b"twNm"
"""Name of the chunk: ancillary, private, not safe to copy once the picture has changed."""
MOST_PIXELS = 30_000
"""Most pixels of an image; of a larger one, every second, third, ... row and column is kept: pages stay below 5 MB."""
MOST_POINTS = 3000
"""Most points of a series."""
STEPS = 1000
"""Steps into which the colour scale is divided: finer differences are invisible in the picture."""
NOTHING = -32768
"""Value of a pixel without one."""
END = b"\x00\x00\x00\x00IEND\xaeB`\x82"


@dataclass(slots=True)
class Numbers:
    """Axes of a picture, and the arrays of their values."""

    axes: list[dict[str, Any]] = field(default_factory=list)
    data: bytearray = field(default_factory=bytearray)

    def image(self, box: tuple[float, float, float, float], title: str, values: Any, scale: tuple[float, float], unit: str) -> None:
        """Add an image (H, W): its box in the picture, its values (NaN: none), the ends of its colour scale, its unit."""
        every = 1
        while values[::every, ::every].size > MOST_PIXELS:
            every += 1
        kept = np.asarray(values[::every, ::every], float)
        step = (scale[1] - scale[0]) / STEPS or 1.0
        counts = np.where(np.isfinite(kept), np.clip(np.round((kept - scale[0]) / step), NOTHING + 1, -NOTHING - 1), NOTHING)
        shown = {"shape": kept.shape, "at": len(self.data), "low": scale[0], "step": step, "unit": unit, "every": every}
        self.axes.append({"box": [round(b, 5) for b in box], "title": title, "image": shown, "series": []})
        self.data += counts.astype("<i2").tobytes()

    def plot(self, box: tuple[float, float, float, float], title: str, series: list[tuple[str, Float]]) -> None:
        """Add axes with series: name and rows (n, 4), place in the picture as fractions (right, down), x and y."""
        shown = []
        for name, rows in series:
            kept = rows[:: -(-len(rows) // MOST_POINTS)]
            shown.append({"name": name, "count": len(kept), "at": len(self.data)})
            self.data += kept.astype("<f4").tobytes()
        self.axes.append({"box": [round(b, 5) for b in box], "title": title, "image": None, "series": shown})

    def into(self, png: bytes) -> bytes:
        """The PNG image with these values in its chunk."""
        if not self.axes or not png.endswith(END):
            return png
        text = json.dumps({"axes": self.axes}).encode()
        body = zlib.compress(struct.pack("<I", len(text)) + text + bytes(self.data))
        chunk = struct.pack(">I", len(body)) + CHUNK + body + struct.pack(">I", zlib.crc32(CHUNK + body))
        return png[: -len(END)] + chunk + END


def numbers_of(figure: Figure, bbox: Bbox) -> Numbers:
    """Images, lines, bars and points of a figure that is saved within `bbox` (inches)."""
    out = Numbers()
    units = _units(figure)
    for ax in figure.axes:
        if ax.get_label() == "<colorbar>" or not ax.get_visible():
            continue
        frame = ax.get_window_extent()
        ends = _fractions(np.array([[frame.x0, frame.y1], [frame.x1, frame.y0]]), figure, bbox).ravel()
        box = (float(ends[0]), float(ends[1]), float(ends[2]), float(ends[3]))
        title = ax.get_title(loc="left") or ax.get_title()
        if ax.images:
            shown = ax.images[-1]
            values: Float = np.ma.filled(np.ma.asarray(shown.get_array(), dtype=float), np.nan)
            if values.ndim == 2:
                low, high = shown.get_clim()
                out.image(box, title, values, (float(low or 0.0), float(high or 1.0)), units.get(_scale_of(shown), ""))
        elif series := [(name, _placed(ax, xy, figure, bbox)) for name, xy in _series(ax) if len(xy)]:
            out.plot(box, title, series)
    return out


def _units(figure: Figure) -> dict[Any, str]:
    """Units by colour scale, from the labels of the colour bars."""
    out = {}
    for ax in figure.axes:
        bar: Any = getattr(ax, "_colorbar", None)
        if bar is not None:
            words = [w.strip() for w in ax.get_ylabel().replace(" along", ",").split(",")]
            out[_scale_of(bar.mappable)] = next((w for w in words if w in {"mm", "m", "%", "degrees"}), "")
    return out


def _scale_of(shown: Any) -> Any:
    return shown.get_cmap().name, shown.get_clim()


def _series(ax: Axes) -> list[tuple[str, Float]]:
    """Name and points (n, 2) in data of lines, bars and points."""
    out: list[tuple[str, Float]] = []
    for line in ax.lines:
        xy = np.column_stack([np.asarray(line.get_xdata(orig=False), float), np.asarray(line.get_ydata(orig=False), float)])
        if len(xy) > 1 and line.get_transform() == ax.transData:
            out.append((_name(line), xy[np.isfinite(xy).all(axis=1)]))
    for bars in ax.containers:
        ends = [(p.get_x() + p.get_width(), p.get_y() + p.get_height()) for p in getattr(bars, "patches", [])]
        out.append((_name(bars), np.asarray(ends, float).reshape(-1, 2)))
    return out + [(_name(c), np.ma.filled(np.ma.asarray(c.get_offsets(), dtype=float), np.nan).reshape(-1, 2)) for c in ax.collections]


def _name(artist: Any) -> str:
    name = str(artist.get_label())
    return "" if name.startswith("_") else name


def _placed(ax: Axes, xy: Float, figure: Figure, bbox: Bbox) -> Float:
    """(n, 4) places in the picture and values of points (n, 2)."""
    return np.column_stack([_fractions(np.asarray(ax.transData.transform(xy)), figure, bbox), xy])


def _fractions(display: Float, figure: Figure, bbox: Bbox) -> Float:
    """(n, 2) fractions of the saved picture, right and down, of points (n, 2) on the figure's canvas."""
    inches = display / figure.dpi
    return np.column_stack([(inches[:, 0] - bbox.x0) / bbox.width, (bbox.y1 - inches[:, 1]) / bbox.height])
