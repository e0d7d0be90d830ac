# SPDX-License-Identifier: Apache-2.0
"""Trend of each part over sessions: a part that creeps is seen before it leaves its tolerance."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import gammaincinv

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_core.arrays import Float

LEAST = 4
"""Sessions from which a trend is estimated: two parameters, and two sessions that may contradict."""
CREEPS = 4.0
"""Chi of the rate (3 degrees of freedom) from which a part creeps; by chance in 1 of 900 parts."""
SURE = 0.05
"""Share of chance at either side of the interval in which the spread of the sessions puts the scale of their covariance."""
LEAST_SCALE = 0.01
"""Least scale of variances: no session is ten times better than it states."""
KNOWN_MM = 6.0
"""Standard deviation from which an axis states nothing: half of the largest displacement that is searched."""
SCHEMA = "toftwin.inspection/"


@dataclass(frozen=True, slots=True)
class Trend:
    """A part over its sessions.

    rate_mm (3,): displacement per session in the cell; std_mm: its standard deviation along the rate; chi: the rate over its covariance;
    scale: spread of the sessions about the line, over their stated standard deviations;
    now_mm: displacement that the trend states for the last session; left: sessions until it leaves its tolerance, None where it does not
    creep or is out already.
    """

    name: str
    sessions: int
    rate_mm: tuple[float, float, float]
    std_mm: float
    chi: float
    scale: float
    now_mm: float
    tolerance_mm: float
    left: float | None

    @property
    def creeps(self) -> bool:
        """Whether the rate is more than chance."""
        return self.chi > CREEPS

    def words(self) -> str:
        """One line."""
        rate = float(np.linalg.norm(self.rate_mm))
        x, y, z = (component / max(rate, 1e-9) for component in self.rate_mm)
        along = f"{self.name} creeps by {rate:.2f} ± {self.std_mm:.2f} mm a session along ({x:.1f}, {y:.1f}, {z:.1f})"
        if self.left is None:
            return f"{along}; now {self.now_mm:.1f} mm from its place, beyond its tolerance of {self.tolerance_mm:g} mm"
        return f"{along}; it leaves its tolerance of {self.tolerance_mm:g} mm in about {max(1, round(self.left))} sessions"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {name: getattr(self, name) for name in self.__slots__} | {"creeps": self.creeps}


def add(folder: Path, content: dict[str, Any]) -> list[dict[str, Any]]:
    """Keep this inspection in the folder, one file a session; returns all of the same scene, oldest first.

    Raises:
        UsageError: a file in the folder is no inspection.
    """
    folder.mkdir(parents=True, exist_ok=True)
    stamp = max(v["stamp_ns"] for v in content["views"])
    (folder / f"{stamp}.json").write_text(json.dumps(content, indent=1), encoding="utf-8")
    kept = []
    for path in sorted(folder.glob("*.json")):
        try:
            read = json.loads(path.read_text(encoding="utf-8"))
            kept.append((max(int(v["stamp_ns"]) for v in read["views"]), read))
            known = str(read["schema"]).startswith(SCHEMA)
        except (ValueError, KeyError, TypeError):
            known = False
        if not known:
            raise UsageError("is no inspection.json", where=str(path), todo="give --history a folder of its own")
    return [read for _, read in sorted(kept, key=lambda k: k[0]) if read["scene"] == content["scene"]]


def trends(sessions: Sequence[dict[str, Any]]) -> list[Trend]:
    """The trend of every part that was fitted in at least `LEAST` of the sessions; the largest chi first.

    A part's covariance holds what the camera does there, which repeats from session to session: it moves the start of the line and not
    its rate. How much changes between sessions is measured by their spread about the lines, of all parts together.
    """
    names = dict.fromkeys(p["name"] for s in sessions for p in s["parts"])
    lines = []
    for name in names:
        rows = [(k, p) for k, s in enumerate(sessions) for p in s["parts"] if p["name"] == name and p.get("shift_mm")]
        if len(rows) >= LEAST:
            lines.append(_line(name, np.array([k for k, _ in rows], float), [p for _, p in rows], len(sessions) - 1))
    together = nearest_scale(1.0, sum(line.spread for line in lines), sum(line.free for line in lines))
    return sorted((line.trend(nearest_scale(together, line.spread, line.free)) for line in lines), key=lambda t: -t.chi)


def nearest_scale(believed: float, spread: float, free: int) -> float:
    """Scale of variances next to the `believed` one that a chi-square `spread` with `free` degrees of freedom does not contradict."""
    if free <= 0:
        return believed
    low, high = (spread / (2.0 * float(gammaincinv(0.5 * free, p))) for p in (1.0 - SURE, SURE))
    return max(min(max(believed, low), high), LEAST_SCALE)


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """Weighted least squares of place = start + rate * session, of one part.

    now, rate (3,): of the last session, mm; cov (3, 3): of the rate, as the sessions state it; spread: chi-square of the sessions about the
    line, free: its degrees of freedom.
    """

    name: str
    sessions: int
    now: Float
    rate: Float
    cov: Float
    spread: float
    free: int
    tolerance: float

    def trend(self, scale: float) -> Trend:
        """With variances `scale` times as large as stated."""
        cov = scale * self.cov
        size = float(np.linalg.norm(self.rate))
        chi = float(np.sqrt(self.rate @ np.linalg.solve(cov, self.rate)))
        direction = self.rate / max(size, 1e-12)
        std = float(np.sqrt(direction @ cov @ direction))
        left = _left(self.now, self.rate, self.tolerance, chi)
        now = float(np.linalg.norm(self.now))
        return Trend(self.name, self.sessions, tuple(self.rate.tolist()), std, chi, float(np.sqrt(scale)), now, self.tolerance, left)


def _line(name: str, number: Float, parts: Sequence[dict[str, Any]], last: int) -> _Line:
    """The line of one part; axes that a session does not know weigh next to nothing."""
    H, b = np.zeros((6, 6)), np.zeros(6)
    rows = []
    for k, part in zip(number - last, parts, strict=True):
        D = np.concatenate([np.eye(3), k * np.eye(3)], axis=1)
        cov, shift = np.array(part["cov_mm2"]), np.array(part["shift_mm"])
        W = np.linalg.inv(cov)
        H += D.T @ W @ D
        b += D.T @ W @ shift
        rows.append((D, W, shift, int((np.linalg.eigvalsh(cov) < KNOWN_MM**2).sum())))
    full = np.linalg.inv(H)
    x = full @ b
    spread = sum(float((shift - D @ x) @ W @ (shift - D @ x)) for D, W, shift, _ in rows)
    known = [row[3] for row in rows]
    tolerance = float(parts[-1]["tolerance_mm"])
    return _Line(name, len(parts), x[:3], x[3:], np.asarray(full[3:, 3:], float), spread, max(sum(known) - 2 * max(known), 0), tolerance)


def _left(now: Float, rate: Float, tolerance: float, chi: float) -> float | None:
    """Sessions until |now + k rate| reaches the tolerance."""
    if chi <= CREEPS or np.linalg.norm(now) >= tolerance:
        return None
    a, half, c = float(rate @ rate), float(now @ rate), float(now @ now) - tolerance**2
    return float((-half + np.sqrt(half * half - a * c)) / a)
