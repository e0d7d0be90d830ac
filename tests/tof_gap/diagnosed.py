# SPDX-License-Identifier: Apache-2.0
"""Diagnosed sessions of a plane for comparisons of a simulator with a camera: every effect was found rightly."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from tests.tof_gap.quiet_views import CAMERA, SHAPE, VIEWS, chain
from tof_gap.compare.against import against
from tof_gap.config import GapConfig
from tof_gap.limits.report import ReportLimits
from tof_gap.tell.figures.session import Figures, used
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.quantization import Quantization

if TYPE_CHECKING:
    from tof_gap.compare.comparison import Against
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_sensor.effect import Effect

HELD = tuple(range(0, VIEWS, 3))
LEVELS = (Ambient, Dropout, FlyingPixels, PhaseWrap, Quantization)
LAW = PhotonLaw(floor_m=0.0, shot_m=0.004, reference=2000.0)


SCENE = SimpleNamespace(scene=SimpleNamespace(digest=""))
"""Of no scene: every effect of a sensor model holds in it."""


def diagnosis(
    evidence: tuple[ViewEvidence, ...], *effects: Effect, law: PhotonLaw = LAW, ties: tuple[str, ...] = (), std: float = 0.0
) -> Diagnosis:
    """A session in which these effects were found rightly, each with the standard deviation `std` of its coefficients."""
    biases = [e for e in effects if not isinstance(e, LEVELS)]
    maps = {e.NAME: [e.bias(v.frame) for v in evidence] for e in biases}
    residual = [used(v, ()) + sum((m[i] for m in maps.values()), np.zeros(SHAPE)) for i, v in enumerate(evidence)]
    floors = [v.sigma**2 for v in evidence]
    nothing, nowhere = [np.zeros(SHAPE)] * VIEWS, [np.zeros(SHAPE, bool)] * VIEWS
    figures = Figures(
        residual=residual,
        floors=floors,
        maps=maps,
        common=nothing,
        noise2=dict(enumerate(floors)),
        edge=[v.edge for v in evidence],
        gross=nowhere,
        mixed=nowhere,
        held=HELD,
        unsure2=np.zeros(SHAPE),
        step_m=0.0,
        posed_m=0.0,
        rng=np.random.default_rng(0),
        limits=ReportLimits(),
    )
    causes = [
        SimpleNamespace(named=SimpleNamespace(name=e.NAME, effects=(e,), ties=ties, std=(dict.fromkeys(e.LINEAR, std),))) for e in biases
    ]
    findings = [
        SimpleNamespace(effect=e, name=e.NAME, corrects=False, common=None, expected=False) for e in effects if isinstance(e, LEVELS)
    ]
    gap = SimpleNamespace(shrink=None, ci95=None)
    shown = tuple(replace(v, residual=v.residual + sum((m[i] for m in maps.values()), np.zeros(SHAPE))) for i, v in enumerate(evidence))
    account = SimpleNamespace(
        figures=figures,
        solved=SimpleNamespace(
            caster=SCENE,
            chain=chain(),
            maps=maps,
            evidence=shown,
            bare=evidence,
            within=(),
            depends_on=(),
            arms=np.zeros((VIEWS, 6)),
        ),
    )
    made = {
        "verdict": ("none",),
        "config": GapConfig(),
        "evidence": evidence,
        "causes": causes,
        "findings": findings,
        "law": law,
        "floor2": floors,
        "gap": gap,
        "camera": CAMERA,
        "solved": account.solved,
        "unexplained": SimpleNamespace(structured=False),
        "not_testable": {},
    }
    found = SimpleNamespace(account=account, doubted=False, **made)
    found.suspected = lambda _: found.doubted
    return cast("Diagnosis", found)


def compared(real: Diagnosis, simulated: Diagnosis) -> Against:
    return against(real, simulated, ("panel",))


def only(found: Against) -> Any:
    (difference,) = found.differences
    return difference
