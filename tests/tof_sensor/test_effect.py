# SPDX-License-Identifier: Apache-2.0
"""What an effect owns besides its formula: it is found by itself, and says when it can be tested and which forms to try."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_sensor.plane import CAMERA, plane_frame
from tof_core import se3
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.quantization import Quantization
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.frame import Context
from tof_sensor.registry import EFFECTS, VOCABULARY
from tof_sensor.session import NO_AMPLITUDE, Session, SessionView

if TYPE_CHECKING:
    from pathlib import Path

    from tof_sensor.effect import Effect

NEW = '''
"""An effect that is in no list."""
from dataclasses import dataclass
from typing import ClassVar
from tof_sensor.effect import Effect

@dataclass(frozen=True, slots=True)
class Wobbling(Effect):
    NAME: ClassVar[str] = "wobbling"
    ORDER: ClassVar[int] = 51
    MEANING: ClassVar[str] = "it wobbles"
'''


def session(*contexts: Context, **lacks: Any) -> Session:
    """Views of one plane under other conditions."""
    pixels = np.arange(CAMERA.width * CAMERA.height)
    return Session(tuple(SessionView(plane_frame(c), pixels) for c in contexts or (Context(),)), ("plane", "unseen"), **lacks)


def moving() -> Context:
    return Context(twist=np.array([0.05, 0, 0, 0, 0, 0]))


def test_an_effect_is_found_by_standing_in_the_folder(tmp_path: Path) -> None:
    (tmp_path / "wobbling.py").write_text(NEW)
    code = (
        f"import tof_sensor.effects as e; e.__path__.append({str(tmp_path)!r})\n"
        "from tof_sensor.registry import EFFECTS, PHYSICAL_ORDER, VOCABULARY\n"
        "names = [k.NAME for k in PHYSICAL_ORDER]\n"
        "print('wobbling' in EFFECTS, 'wobbling' in VOCABULARY, names[names.index('wobbling') - 1], names[names.index('wobbling') + 1])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True", "wiggling", "amplitude_bias"]


@pytest.mark.parametrize(
    ("kind", "seen", "reason"),
    [
        (Motion, session(), "no view was taken in motion"),
        (Motion, session(moving()), None),
        (TimeSync, session(), "no view was taken in motion"),
        (TimeSync, session(moving()), None),
        (
            TemperatureDrift,
            session(Context(temperature=30.0), Context(temperature=30.2)),
            "the temperature is steady, and the session is shorter than 60 s",
        ),
        (
            TemperatureDrift,
            session(Context(temperature=30.0), Context()),
            "1 of 2 views have no temperature, and the session is shorter than 60 s",
        ),
        (TemperatureDrift, session(Context(temperature=30.0), Context(temperature=31.0)), None),
        (TemperatureDrift, session(Context(time_s=0.0), Context(time_s=90.0)), None),
        # A thermometer lags: its reading hardly moves while lamp and sensor warm up.
        (TemperatureDrift, session(Context(temperature=30.0), Context(temperature=30.03, time_s=90.0)), None),
        (AmplitudeBias, session(has_amplitude=False), NO_AMPLITUDE),
        (Noise, session(has_amplitude=False), f"{NO_AMPLITUDE}; rows and single pixels alone can show it"),
        (
            Multipath,
            session(modulated=False),
            "the noise grows with the square of range and does not depend on amplitude: this is no time-of-flight camera",
        ),
        (RangeOffset, session(modulated=False), None),
        (PhaseWrap, session(), None),
        (
            PhaseWrap,
            session(stated_mhz=(50.0,)),
            "the only modulation frequency that is stated repeats after 3.0 m, and the farthest surface lies at 1.5 m",
        ),
        (PhaseWrap, session(stated_mhz=(200.0,)), None),
        (PhaseWrap, session(stated_mhz=(100.0, 80.0)), None),
    ],
)
def test_the_reason_why_a_session_cannot_test_an_effect(kind: type[Effect], seen: Session, reason: str | None) -> None:
    assert kind.not_testable(seen) == reason


def test_forms_follow_what_the_session_has() -> None:
    def drifts(*contexts: Context) -> list[TemperatureDrift]:
        return [f.effect for f in TemperatureDrift.hypotheses(session(*contexts)) if isinstance(f.effect, TemperatureDrift)]

    pairs = [(60.0, 300.0), (60.0, 1200.0), (300.0, 1200.0)]
    alone = [(60.0, 0.0), (300.0, 0.0), (1200.0, 0.0)]
    timed = drifts(Context(time_s=0.0), Context(time_s=90.0))
    assert [(e.tau_s, e.housing_s, e.gain) for e in timed] == [(*t, False) for t in (*alone, *pairs)] + [(*t, True) for t in alone]
    warm = drifts(Context(temperature=30.0), Context(temperature=34.0))
    constants = [TemperatureDrift(reference_c=32.0, tau_s=tau, housing_s=slow) for tau, slow in ((0.0, 0.0), *alone, *pairs)]
    assert warm == constants + [TemperatureDrift(reference_c=32.0, tau_s=tau, gain=True) for tau in (0.0, 60.0, 300.0, 1200.0)]
    # While the thermometer stands, a warm-up of 300 s that changes by 26 % in 90 s is mostly a range offset.
    standing = drifts(Context(temperature=30.0), Context(temperature=30.0, time_s=90.0))
    assert [(e.tau_s, e.gain) for e in standing] == [(0.0, False), (60.0, False), (0.0, True), (60.0, True)]
    usual = float(np.median(plane_frame().amplitude))
    walks = [form.effect for form in AmplitudeBias.hypotheses(session())]
    tried = [("log", 0.0), ("log", 0.3), ("slope", 0.0), ("inverse", 0.0), ("inverse", 0.3), ("direct", 0.0)]
    assert walks == [AmplitudeBias(reference=usual, form=form, ambient=k) for form, k in tried]
    assert [form.note for form in CadDeviation.hypotheses(session())] == ["plane"]  # nothing is seen of the other part


def test_every_form_of_every_effect_lies_within_its_own_bounds() -> None:
    seen = session(moving(), Context(time_s=90.0))
    for name in VOCABULARY:
        for form in EFFECTS[name].hypotheses(seen):
            assert name == form.effect.NAME
            for field in fields(form.effect):  # type: ignore[arg-type]
                low, high, value = field.metadata.get("low"), field.metadata.get("high"), getattr(form.effect, field.name)
                assert low is None or value >= low, (name, field.name)
                assert high is None or value <= high, (name, field.name)


def test_lateness_is_the_delay_and_the_mean_time_of_the_taps() -> None:
    assert TimeSync(delay_s=0.02).late_s == 0.02
    assert Motion(axial_s=-0.01, edge=1.0).late_s == -0.01
    assert Wiggling(sine_m=0.01).late_s == 0.0


def test_the_mount_is_hand_eyes_and_the_lens_is_intrinsics() -> None:
    X = HandEye(x_m=0.01, rz_rad=0.02)
    np.testing.assert_allclose(X.mount, se3.exp([0.01, 0, 0, 0, 0, 0.02]))
    assert Intrinsics(cx_px=2.0).camera(CAMERA).cx == CAMERA.cx + 2.0
    others = [kind() for kind in EFFECTS.values() if kind not in (HandEye, Intrinsics)]
    assert all(e.mount is None and e.camera(CAMERA) is CAMERA for e in others)


def test_noise_that_every_capture_has_is_added_to_the_law() -> None:
    law = PhotonLaw(floor_m=3e-3)
    assert Noise(extra_m=4e-3).added_to(law).floor_m == pytest.approx(5e-3)
    assert Noise(extra_m=4e-3, duty=0.5).added_to(law) == law
    assert Noise(extra_m=4e-3, duty=0.5).in_bursts
    assert Quantization(step_m=1e-3 * np.sqrt(12)).added_to(law).floor_m == pytest.approx(np.hypot(3e-3, 1e-3))


def test_noise_in_bursts_states_its_share_and_asks_what_disturbs_the_camera() -> None:
    steady, some = Noise(extra_m=6e-3), Noise(extra_m=6e-3, duty=1 / 36)
    assert steady.stated == "6.0 mm of noise beside the photon noise"
    assert some.stated == "6.0 mm of noise beside the photon noise, in 3 % of the captures"
    assert steady.remedy == Noise.REMEDY
    assert "look for what disturbs the camera there" in some.remedy


def test_priors_hold_a_part_by_what_it_can_do_and_anything_else_by_its_column() -> None:
    np.testing.assert_allclose(RangeOffset().prior_sd(np.array([1.0])), 0.05)
    sd = CadDeviation().prior_sd(np.repeat([1.0, 1e-3], [8, 1]))
    np.testing.assert_allclose(sd, np.repeat([0.008, 2e-5], [8, 1]))


def test_coefficients_are_clipped_to_their_bounds_and_a_pattern_is_smooth_without_its_pixels() -> None:
    assert RangeOffset().plausible(np.array([9.0])) == RangeOffset(offset_m=0.2)
    pattern = FixedPattern(values=(1.0,), pixels="abc")
    assert pattern.smooth == replace(pattern, pixels="")
    assert RangeOffset(offset_m=0.1).smooth == RangeOffset(offset_m=0.1)
