# SPDX-License-Identifier: Apache-2.0
"""Report pages: one palette, one frame, all values escaped, images embedded, nothing loaded from the network."""

from __future__ import annotations

import base64
import io
import shlex
from datetime import datetime
from typing import TYPE_CHECKING, Any

from tof_core.shares import in_percent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from tof_core.arrays import Bytes
    from tof_core.hover import Numbers

PALETTE = {
    "ink": "#1c2733",
    "soft": "#5c6b7a",
    "line": "#dee2e6",
    "wash": "#f6f8fa",
    "paper": "#ffffff",
    "accent": "#0b7285",
    "contrast": "#e8590c",
    "third": "#7048e8",
    "neutral": "#868e96",
    "good": "#1b7a3d",
    "warning": "#a15c00",
    "bad": "#b3261e",
}
"""Colours of pages and plots. Series take accent, contrast, third, neutral; verdicts take good, warning, bad."""
PLOT_DPI = 110
"""A figure of 11 inches is about as wide as a page, 1200 pixels."""
PAD_IN = 0.06
"""Inches of margin around a figure."""
_STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.edgecolor": PALETTE["line"],
    "axes.labelcolor": PALETTE["ink"],
    "text.color": PALETTE["ink"],
    "xtick.color": PALETTE["soft"],
    "ytick.color": PALETTE["soft"],
    "grid.color": PALETTE["line"],
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
_command = ""


def set_command(arguments: Sequence[str]) -> None:
    """Keep the arguments of the command line, for the head of every page."""
    global _command  # noqa: PLW0603 (one command line a process)
    _command = shlex.join(["toftwin", *arguments]) if arguments else ""


def noted_command() -> list[str]:
    """The arguments that `set_command` keeps, for another process that writes pages."""
    return shlex.split(_command)[1:]


def render_page(package: str, template: str, title: str, **values: Any) -> str:
    """A page as HTML text: the template of a package, which extends `frame.html.j2`, with a title and values.

    The frame adds the date, the version of toftwin and the command line. Values are escaped. The filter `in_percent` states a share.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("tof_core")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["in_percent"] = in_percent
    made = {"date": f"{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}", "version": version(), "command": _command}
    return environment.get_template(template).render(palette=PALETTE, title=title, made=made, **values)


def version() -> str:
    """The installed version of toftwin."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("toftwin")
    except PackageNotFoundError:
        return "not installed"


def axes(
    width: float, height: float, rows: int = 1, columns: int = 1, *, gaps_in: tuple[float, float] | None = None, **kwargs: Any
) -> tuple[Figure, Any]:
    """A figure (`width` by `height` inches) and its axes, an array (rows, columns), in the style of the pages.

    gaps_in: inches between columns and between rows, where the text between axes is known; None: room for it is measured, which takes
    half the time of the picture.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    mpl.rcParams.update(_STYLE)
    figure = Figure(figsize=(width, height), layout="constrained" if gaps_in is None else None)
    if gaps_in is not None:  # `figure_uri` cuts to what is drawn: the margin around takes no room.
        across, down = (gap / ((size - (n - 1) * gap) / n) for gap, size, n in zip(gaps_in, (width, height), (columns, rows), strict=True))
        figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=1.0, wspace=across, hspace=down)
    return figure, figure.subplots(rows, columns, squeeze=False, **kwargs)


def figure_uri(figure: Figure) -> str:
    """A figure as an embedded PNG image, with its values for the pointer (`tof_core.hover`)."""
    from tof_core.hover import numbers_of

    stream = io.BytesIO()
    figure.set_dpi(PLOT_DPI)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)  # With an engine, also one that does nothing, `savefig` draws the figure twice.
    box = figure.get_tightbbox().padded(PAD_IN)
    numbers = numbers_of(figure, box)
    figure.savefig(stream, format="png", dpi=PLOT_DPI, facecolor=PALETTE["paper"], bbox_inches=box, pil_kwargs={"compress_level": 0})
    return _data_uri(numbers.into(_small(stream)))


def _small(png: io.BytesIO) -> bytes:
    """A picture in 256 colours, as many as a colour map has: a third of the size, so that a page with a dozen pictures stays below 5 MB.

    The palette covers all colours of the picture, so that colours of few pixels, such as the ends of a colour bar, stay right.
    """
    from PIL import Image

    out = io.BytesIO()
    Image.open(png).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(out, "PNG")
    return out.getvalue()


def image_uri(rgb: Bytes, numbers: Numbers | None = None) -> str:
    """An image (H, W, 3) as an embedded PNG image; `numbers`: its values for the pointer."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(rgb).save(stream, "PNG", optimize=True)
    return _data_uri(stream.getvalue() if numbers is None else numbers.into(stream.getvalue()))


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode()
