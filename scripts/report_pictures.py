# SPDX-License-Identifier: Apache-2.0
"""Pictures of the report pages for the docs, as headless Chromium shows them: `python scripts/report_pictures.py out/demo`."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parent.parent / "docs" / "pictures"
PAGES = {
    "report_demo": "report.html",
    "report_gap": "gap/report.html",
    "report_inspect": "inspection/inspection.html",
    "report_correct": "correct/correction.html",
    "report_evaluate": "evaluation/report.html",
}
"""Pictures by name, and the page of each in the demo's folder; pages that are not there are left out."""
WIDTH, HEIGHT, SHOWN = 1400, 1700, 800
"""Window in pixels, and the width of the picture."""


def main() -> int:
    """Write the pictures; 1 where there is no Chromium or no page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="folder that toftwin demo wrote")
    folder = parser.parse_args().demo.resolve()
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    pages = {name: folder / page for name, page in PAGES.items() if (folder / page).exists()}
    if browser is None or not pages:
        print("no Chromium on this host" if browser is None else f"no report in {folder}", file=sys.stderr)
        return 1
    DOCS.mkdir(parents=True, exist_ok=True)
    for name, page in pages.items():
        print(picture(browser, page, DOCS / f"{name}.png"))
    return 0


def picture(browser: str, page: Path, out: Path) -> Path:
    """The upper part of a page."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as profile:
        shot = Path(profile) / "page.png"
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={profile}"]
        subprocess.run(
            [browser, *flags, f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={shot}", page.as_uri()],
            check=True,
            timeout=120,
            capture_output=True,
        )
        image = Image.open(shot).convert("RGB").resize((SHOWN, round(SHOWN * HEIGHT / WIDTH)), Image.Resampling.LANCZOS)
    image.quantize(128).save(out, optimize=True)
    return out


if __name__ == "__main__":
    sys.exit(main())
