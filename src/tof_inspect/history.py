# SPDX-License-Identifier: Apache-2.0
"""Trend of each part over sessions, which shows a creeping part before it leaves its tolerance."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import chdtri, digamma, fdtrc, polygamma

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_core.arrays import Float

LEAST = 5
"""Fewest sessions of a trend: two parameters, and three sessions that may contradict. The errors of a part often have one direction: with
four sessions, one part in sixty was reported by chance."""
CREEPS = 4.0
"""Chi of the rate (3 degrees of freedom) from which a part counts as creeping; 1 part in 900 exceeds it by chance."""
LEAST_SCALE = 0.01
"""Least scale of variances: no session is ten times better than it states."""
KNOWN_MM = 6.0
"""Standard deviation from which an axis is unknown: half of the largest displacement that is searched."""
MANY, RAREST = 1e6, 1e-300
"""Degrees of freedom that stand for infinitely many; least probability that is used, near the smallest double."""
SCHEMA = "toftwin.inspection/"


@dataclass(frozen=True, slots=True)
class Trend:
    """Trend of a part over sessions.

    rate_mm (3,): displacement per session in the cell; std_mm: its standard deviation along the rate; chi: chi of 3 degrees of freedom
    with the probability of the rate; scale: spread of the sessions about the line, divided by their stated standard deviations; now_mm:
    displacement in the last session by the trend; left: sessions until the part leaves its tolerance, None if it does not creep or is
    out of tolerance.
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
        """Whether the rate is significant."""
        return self.chi > CREEPS

    def words(self) -> str:
        """The trend in one line."""
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
    """Save this inspection in the folder, one file per session; returns all inspections of the same scene, oldest first.

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

    A part's covariance contains the camera's errors at its place, which repeat in every session: they shift the line and do not change
    its rate. The variance between sessions is estimated from the spread about the lines, of the part and of all parts.
    """
    names = dict.fromkeys(p["name"] for s in sessions for p in s["parts"])
    lines = []
    for name in names:
        rows = [(k, p) for k, s in enumerate(sessions) for p in s["parts"] if p["name"] == name and p.get("shift_mm")]
        if len(rows) >= LEAST:
            lines.append(_line(name, np.array([k for k, _ in rows], float), [p for _, p in rows], len(sessions) - 1))
    inflation = Inflation.of(np.array([line.spread for line in lines]), np.array([line.free for line in lines], float))
    return sorted((line.trend(inflation) for line in lines), key=lambda t: -t.chi)


@dataclass(frozen=True, slots=True)
class Inflation:
    """Ratio of the variances between sessions to the stated variances, which differs from part to part (Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3, 3).

    scale: of a typical part; free: degrees of freedom of the prior of a part's scale, inf if all parts have one scale; total: degrees of
    freedom of all parts together.
    """

    scale: float
    free: float
    total: float

    @classmethod
    def of(cls, spread: Float, free: Float) -> Inflation:
        """Estimate from the chi-squares `spread` (n,) of parts about their lines, with `free` (n,) degrees of freedom (Smyth's section 6.2)."""
        spread, free = spread[free > 0], free[free > 0]
        if not len(free):
            return cls(1.0, np.inf, 0.0)
        half = 0.5 * free
        log = np.log(np.maximum(spread / free, LEAST_SCALE)) - digamma(half) + np.log(half)
        differs = float(np.var(log) * len(log) / max(len(log) - 1, 1) - polygamma(1, half).mean())
        if differs <= 0:
            return cls(float(np.exp(log.mean())), np.inf, float(free.sum()))
        prior = _trigamma_inverse(differs)
        return cls(float(np.exp(log.mean() + digamma(prior) - np.log(prior))), 2.0 * prior, float(free.sum()))

    def at(self, spread: float, free: float) -> tuple[float, float]:
        """Scale of the variances of a part with chi-square `spread`, and the degrees of freedom of that scale."""
        scale = self.scale if np.isinf(self.free) else (self.free * self.scale + spread) / (self.free + free)
        return max(scale, LEAST_SCALE), min(self.free + free, self.total)


def _trigamma_inverse(value: float) -> float:
    """x with trigamma(x) = value (Newton's method on 1 / trigamma, which is nearly linear; Smyth's appendix)."""
    x = 0.5 + 1.0 / value
    for _ in range(20):
        here = float(polygamma(1, x))
        x += here * (1.0 - here / value) / float(polygamma(2, x))
    return x


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """Weighted least squares of place = start + rate * session, of one part.

    now, rate (3,): displacement in the last session and rate, mm; cov (3, 3): covariance of the rate from the stated ones; spread:
    chi-square of the sessions about the line; free: its degrees of freedom.
    """

    name: str
    sessions: int
    now: Float
    rate: Float
    cov: Float
    spread: float
    free: int
    tolerance: float

    def trend(self, inflation: Inflation) -> Trend:
        """The trend with the estimated scale of the variances."""
        scale, free = inflation.at(self.spread, self.free)
        cov = scale * self.cov
        size = float(np.linalg.norm(self.rate))
        chi = _chi(float(self.rate @ np.linalg.solve(cov, self.rate)), free)
        direction = self.rate / max(size, 1e-12)
        std = float(np.sqrt(direction @ cov @ direction))
        left = _left(self.now, self.rate, self.tolerance, chi)
        now = float(np.linalg.norm(self.now))
        return Trend(self.name, self.sessions, tuple(self.rate.tolist()), std, chi, float(np.sqrt(scale)), now, self.tolerance, left)


def _chi(square: float, free: float) -> float:
    """Chi of 3 degrees of freedom with the probability of `square`, a squared rate over a covariance whose scale has `free` degrees of freedom."""
    if free <= 0:
        return 0.0
    chance = float(fdtrc(3, min(free, MANY), square / 3.0))
    return float(np.sqrt(chdtri(3, max(chance, RAREST))))


def _line(name: str, number: Float, parts: Sequence[dict[str, Any]], last: int) -> _Line:
    """The line of one part; axes that are unknown in a session have hardly any weight."""
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
    """Sessions k until |now + k rate| reaches the tolerance; None if the part does not creep or is out of tolerance."""
    if chi <= CREEPS or np.linalg.norm(now) >= tolerance:
        return None
    a, half, c = float(rate @ rate), float(now @ rate), float(now @ now) - tolerance**2
    return float((-half + np.sqrt(half * half - a * c)) / a)
