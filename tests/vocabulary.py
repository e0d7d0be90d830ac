# SPDX-License-Identifier: Apache-2.0
"""The effects by name, as docs/effects.md has them: what simulator, sensor model and diagnosis must all know."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[1] / "docs" / "effects.md"
EFFECT_NAMES = set(re.findall(r"^## ([a-z_]+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE))
