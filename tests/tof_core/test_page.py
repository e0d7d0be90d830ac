# SPDX-License-Identifier: Apache-2.0
"""Pages: what the frame says, that values are escaped, and that images come back pixel by pixel."""

from __future__ import annotations

import base64
import io
import re
from importlib.metadata import version as installed
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from tof_core import page

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def command() -> Iterator[None]:
    """The command line of a call, forgotten afterwards."""
    page.set_command(["label", "my bag", "--scene", "a&b.yaml"])
    yield
    page.set_command([])


def decoded(uri: str) -> np.ndarray:
    head, _, data = uri.partition(",")
    assert head == "data:image/png;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))


@pytest.mark.usefixtures("command")
def test_the_frame_names_title_date_version_and_command() -> None:
    html = page.render_page("tof_core", "frame.html.j2", "A <b>bold</b> bag")
    assert "<h1>A &lt;b&gt;bold&lt;/b&gt; bag</h1>" in html
    assert f"toftwin {installed('toftwin')}, " in html
    assert re.search(r"20\d\d-\d\d-\d\d \d\d:\d\d", html)
    assert "toftwin label &#39;my bag&#39; --scene &#39;a&amp;b.yaml&#39;" in html


@pytest.mark.usefixtures("command")
def test_a_process_started_beside_notes_the_same_command() -> None:
    assert page.noted_command() == ["label", "my bag", "--scene", "a&b.yaml"]


def test_without_a_command_line_the_frame_shows_none() -> None:
    assert "<code>" not in page.render_page("tof_core", "frame.html.j2", "a bag")


def test_a_page_loads_nothing_from_the_network() -> None:
    html = page.render_page("tof_core", "frame.html.j2", "a bag")
    assert not re.search(r"https?://|src=|href=", html)
    assert all(f"--{name}: {colour};" in html for name, colour in page.PALETTE.items())


def test_an_image_comes_back_pixel_by_pixel() -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (7, 11, 3), dtype=np.uint8)
    np.testing.assert_array_equal(decoded(page.image_uri(rgb)), rgb)


def test_a_figure_has_the_paper_s_colour_and_the_size_asked_for() -> None:
    figure, axes = page.axes(4.0, 2.0, rows=1, columns=2)
    assert axes.shape == (1, 2)
    axes[0, 0].plot([0, 1], [0, 1])
    pixels = decoded(page.figure_uri(figure))
    assert pixels[0, 0, :3].tolist() == [255, 255, 255]
    assert pixels.shape[:2] == pytest.approx((2 * page.PLOT_DPI, 4 * page.PLOT_DPI), rel=0.1)


def test_the_ends_of_a_colour_bar_keep_their_colour_beside_noise() -> None:
    """Most pixels are of the noise's pale colours and greys; the bar's ends are few."""
    figure, axes = page.axes(6.0, 3.0, rows=1, columns=2)
    rng = np.random.default_rng(0)
    drawn = axes[0, 0].imshow(rng.normal(0, 1, (300, 300)), cmap="RdBu_r", vmin=-7, vmax=7)
    axes[0, 1].imshow(rng.random((300, 300)), cmap="gray")
    figure.colorbar(drawn, ax=axes[0, 0])
    pixels = decoded(page.figure_uri(figure)).reshape(-1, 3).astype(int)
    for end in ((5, 48, 97), (103, 0, 31)):
        assert np.abs(pixels - end).max(axis=1).min() <= 16
