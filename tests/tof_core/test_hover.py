# SPDX-License-Identifier: Apache-2.0
"""Numbers inside a picture: the PNG stays a picture, and the values come out as they went in."""

from __future__ import annotations

import base64
import io
import json
import shutil
import struct
import subprocess
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from tof_core.hover import CHUNK, MOST_PIXELS, NOTHING, Numbers
from tof_core.page import axes, figure_uri, image_uri
from tof_core.panels import panels

if TYPE_CHECKING:
    from pathlib import Path

HEAD = "data:image/png;base64,"


def read(uri: str) -> tuple[list[dict[str, Any]], bytes]:
    """Axes and arrays of a picture, by the PNG specification's walk over its chunks."""
    png = base64.b64decode(uri.removeprefix(HEAD))
    at = 8
    while at + 12 <= len(png):
        (length,) = struct.unpack(">I", png[at : at + 4])
        name, body = png[at + 4 : at + 8], png[at + 8 : at + 8 + length]
        assert struct.unpack(">I", png[at + 8 + length : at + 12 + length]) == (zlib.crc32(name + body),)
        if name == CHUNK:
            raw = zlib.decompress(body)
            (text,) = struct.unpack("<I", raw[:4])
            return json.loads(raw[4 : 4 + text])["axes"], raw[4 + text :]
        at += 12 + length
    return [], b""


def values_of(shown: dict[str, Any], data: bytes) -> Any:
    counts = np.frombuffer(data, "<i2", int(np.prod(shown["shape"])), shown["at"]).reshape(shown["shape"])
    return np.where(counts == NOTHING, np.nan, shown["low"] + shown["step"] * counts)


def test_an_error_map_holds_its_millimetres_and_its_gaps() -> None:
    error = np.random.default_rng(0).normal(0, 0.004, (30, 40))
    error[:5] = np.nan
    found, data = read(panels([("left", error, "error"), ("right", 2 * error, "error")], columns=2))
    assert [a["title"] for a in found] == ["left", "right"]
    assert [a["image"]["unit"] for a in found] == ["mm", "mm"]
    for a, factor in zip(found, (1e3, 2e3), strict=True):
        values = values_of(a["image"], data)
        np.testing.assert_allclose(values, factor * error, atol=0.011)  # half of a thousandth of the scale's 20 mm
        left, top, right, bottom = a["box"]
        assert 0 <= left < right <= 1
        assert 0 <= top < bottom <= 1
    assert found[0]["box"][2] < found[1]["box"][0]


def test_a_large_image_keeps_fewer_values() -> None:
    numbers = Numbers()
    numbers.image((0, 0, 1, 1), "", np.arange(400 * 300.0).reshape(300, 400), (0, 120000), "m")
    rows, columns = numbers.axes[0]["image"]["shape"]
    assert rows * columns <= MOST_PIXELS
    assert numbers.axes[0]["image"]["every"] == 2
    assert values_of(numbers.axes[0]["image"], bytes(numbers.data))[1, 1] == pytest.approx(802, abs=60)


def test_lines_and_bars_are_found_where_they_are_drawn() -> None:
    figure, ((ax,),) = axes(5, 3)
    ax.set_xlim(0, 10)
    ax.set_ylim(0, 4)
    ax.plot([0, 5, 10], [0, 1, 2], label="raw")
    found, data = read(figure_uri(figure))
    (series,) = found[0]["series"]
    rows = np.frombuffer(data, "<f4", 4 * series["count"], series["at"]).reshape(-1, 4)
    np.testing.assert_allclose(rows[:, 2:], [[0, 0], [5, 1], [10, 2]])
    left, top, right, bottom = found[0]["box"]
    np.testing.assert_allclose(rows[:, 0], [left, (left + right) / 2, right], atol=1e-3)
    np.testing.assert_allclose(rows[:, 1], [bottom, bottom - 0.25 * (bottom - top), (top + bottom) / 2], atol=1e-3)
    assert series["name"] == "raw"


def test_the_picture_stays_the_same_picture() -> None:
    rgb = np.random.default_rng(1).integers(0, 255, (8, 9, 3)).astype(np.uint8)
    numbers = Numbers()
    numbers.image((0, 0, 1, 1), "crop", rgb[..., 0].astype(float), (0, 255), "mm")
    uri = image_uri(rgb, numbers)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.removeprefix(HEAD))))), rgb)
    assert len(read(uri)[0]) == 1
    assert read(image_uri(rgb)) == ([], b"")


@pytest.mark.browser
def test_the_pointer_finds_the_value_in_a_browser(tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium on this machine")
    from jinja2 import Environment, PackageLoader

    script = Environment(loader=PackageLoader("tof_core"), autoescape=True).get_template("hover.js").render()
    page = tmp_path / "page.html"
    point = "z.dispatchEvent(new PointerEvent('pointermove', {clientX: r.left + r.width * 0.3, clientY: r.top + r.height * 0.5}))"
    page.write_text(
        f'<figure><img src="{panels([("flat", np.full((30, 40), 0.0042), "error")], columns=1)}"></figure><script>{script}</script>'
        "<script>setTimeout(() => { const z = document.querySelector('.zoom'), r = z.getBoundingClientRect();"
        f"{point}; document.title = document.querySelector('.tip').textContent; }}, 1500)</script>"
    )
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=5000", "--dump-dom", f"--user-data-dir={tmp_path}"]
    shown = subprocess.run([browser, *flags, page.as_uri()], capture_output=True, text=True, timeout=120, check=True)
    assert "4.20 mm" in shown.stdout
    assert "flat, column" in shown.stdout
