# SPDX-License-Identifier: Apache-2.0
"""Foreign light: the noise that it adds, and when its detector names it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_sensor.plane import CAMERA, plane_frame
from tof_core.config import from_mapping
from tof_scene.builtin import write_builtin
from tof_scene.scene_file import load_scene
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.session import NO_AMPLITUDE, NoiseBins, Session
from tof_virtual.config import VirtualConfig
from tof_virtual.record import record
from toftwin.cli import main
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float

LAW = PhotonLaw(floor_m=3e-4, shot_m=1e-3, reference=1000.0)
VIEWS, BINS = 6, 12


def session(beyond: Float | float, law: PhotonLaw | None = LAW, views: int = VIEWS) -> Session:
    """Bins of the law's noise, known to 3 %, and `beyond` (m^2, per view and bin) besides."""
    amplitude = np.tile(np.geomspace(100.0, 10_000.0, BINS), (views, 1))
    range2 = np.linspace(0.25, 1.5, views)[:, None] * np.ones(BINS)
    surroundings2 = range2 / np.random.default_rng(2).uniform(0.4, 1.0, range2.shape)
    variance = (LAW.variance(amplitude, surroundings2) + beyond) * np.random.default_rng(1).normal(1.0, 0.03, amplitude.shape)
    view = np.repeat(np.arange(float(views)), BINS)
    return Session(
        (),
        law=law,
        noise=NoiseBins(view, amplitude.ravel(), range2.ravel(), surroundings2.ravel(), variance.ravel(), np.full(view.size, 2000.0)),
    )


def light(surface_m: float, uniform_m: float) -> Float:
    """Variance of foreign light in the bins of `session`."""
    noise = session(0.0).noise
    assert noise is not None
    return Ambient(surface_m, uniform_m, LAW.reference).variance(noise.amplitude, noise.surroundings2).reshape(VIEWS, BINS)


def test_noise_off_surfaces_goes_with_range_and_of_every_pixel_with_amplitude_alone() -> None:
    effect = Ambient(surface_m=2e-3, uniform_m=1e-3, reference=100.0)
    np.testing.assert_allclose(effect.variance(np.array([25.0]), np.array([4.0])), 4e-6 * 4 * 4 + 1e-6 * 16)
    frame = plane_frame(amplitude=np.full(CAMERA.shape, 100.0))
    noisy = Ambient(uniform_m=4e-3, reference=100.0).apply(frame, np.random.default_rng(0))
    assert np.std((noisy.depth - frame.depth) * frame.length) == pytest.approx(4e-3, rel=0.1)
    np.testing.assert_allclose(noisy.sigma * frame.length, 4e-3, rtol=1e-12)


def test_foreign_light_is_found_at_its_size() -> None:
    found = Ambient.detect(session(light(4e-3, 1.5e-3)))
    assert found is not None
    effect = found.effect
    assert isinstance(effect, Ambient)
    assert effect.surface_m == pytest.approx(4e-3, rel=0.1)
    assert effect.uniform_m == pytest.approx(1.5e-3, rel=0.1)


def test_a_constant_number_of_electrons_is_reported_as_light_or_read_out() -> None:
    found = Ambient.detect(session(light(0.0, 1.5e-3)))
    assert found is not None
    assert found.effect.rivals == ("noise",)
    assert found.note.endswith("from foreign light or the camera's read-out")
    assert "noise that stays is the camera's read-out" in found.effect.remedy


def test_light_off_the_surfaces_is_no_noise_of_the_read_out() -> None:
    found = Ambient.detect(session(light(4e-3, 1.5e-3)))
    assert found is not None
    assert found.effect.rivals == ()
    assert found.note.endswith("times that of the photon law in --sensor")
    assert found.effect.remedy == Ambient.REMEDY


def test_offsets_of_pixels_beside_it_do_not_hide_foreign_light() -> None:
    """A pattern of 1 mm is noise to its neighbours, as large in bright light as in the dark."""
    found = Ambient.detect(session(light(4e-3, 0.0) + 1e-3**2))
    assert found is not None
    assert isinstance(found.effect, Ambient)
    assert found.effect.surface_m == pytest.approx(4e-3, rel=0.1)


def test_of_two_surfaces_with_the_same_amplitude_the_oblique_one_returns_more_foreign_light() -> None:
    frame = plane_frame(amplitude=np.full(CAMERA.shape, 100.0))
    cosine = np.cos(frame.rendering.incidence.astype(float))
    noise = Ambient(surface_m=2e-3, reference=100.0).noise(frame) * frame.length
    np.testing.assert_allclose(noise, 2e-3 * frame.radial / np.sqrt(cosine), rtol=1e-6)
    law = PhotonLaw(floor_m=0.0, shot_m=0.0, far_m=2e-3, reference=100.0)
    np.testing.assert_allclose(law.apply(frame, np.random.default_rng(0)).sigma * frame.length, noise, rtol=1e-6)


@pytest.mark.parametrize(
    "beyond",
    [
        pytest.param(0.0, id="no noise beyond the law"),
        pytest.param((3e-3) ** 2, id="the same at every amplitude"),
        pytest.param(2.0 * LAW.variance(np.geomspace(100.0, 10_000.0, BINS), np.ones(1)), id="the law three times over"),
        pytest.param(light(4e-3, 1.5e-3) * (np.arange(VIEWS) < 3)[:, None], id="half of the views"),
        pytest.param(light(3e-4, 1e-4), id="too little to be sure"),
    ],
)
def test_other_noise_is_no_foreign_light(beyond: Float | float) -> None:
    assert Ambient.detect(session(beyond)) is None


@pytest.mark.parametrize(("unseen", "found"), [(6, True), (7, False)])
def test_the_noise_of_half_of_all_views_must_be_known(unseen: int, *, found: bool) -> None:
    """Views that lost most pixels do not know their noise: of a session of which six of thirteen are left, they do not speak for it."""
    lit = session(light(4e-3, 1.5e-3))
    nothing: Any = None
    assert (Ambient.detect(replace(lit, views=(nothing,) * (VIEWS + unseen))) is not None) == found


@pytest.mark.parametrize(
    ("lit", "ending"), [(0.0, "where near views move more"), (1.0, "here noise is 1.4 times that of the photon law in --sensor")]
)
def test_under_automatic_exposure_the_noise_is_stated_and_its_cause_is_not(lit: float, ending: str) -> None:
    noise = session(0.0).noise
    assert noise is not None
    usual = LAW.variance(noise.amplitude, noise.surroundings2).reshape(VIEWS, BINS)
    reason = Ambient.not_testable(replace(session(lit * usual), has_amplitude=True, exposed=True))
    assert reason is not None
    assert reason.startswith("brighter views or pixels are noisier")
    assert reason.endswith(ending)


@pytest.mark.parametrize(("twice", "found"), [("light", True), ("law", False)])
def test_where_most_of_the_law_is_light_off_the_surfaces_more_of_it_is_told_from_a_larger_law(twice: str, *, found: bool) -> None:
    """More light enlarges such a law nearly as a whole: the excess grows over range by an exponent of 0.1, and of 0 under half of the exposure."""
    law = replace(LAW, far_m=1.5e-3)
    noise = session(0.0).noise
    assert noise is not None
    usual, own = (of.variance(noise.amplitude, noise.surroundings2).reshape(VIEWS, BINS) for of in (law, LAW))
    brighter = replace(law, far_m=law.far_m * np.sqrt(2.0)).variance(noise.amplitude, noise.surroundings2).reshape(VIEWS, BINS)
    assert (Ambient.detect(session((brighter if twice == "light" else 2.0 * usual) - own, law=law)) is not None) == found


@pytest.mark.parametrize(("lit", "times"), [(0.0, "1.4"), (0.3, "1.5"), (1.0, None)])
def test_a_law_that_is_larger_as_a_whole_is_no_foreign_light(lit: float, times: str | None) -> None:
    """The whole law twice, as with half of the exposure, beside foreign light of a share of the law at the median amplitude."""
    noise = session(0.0).noise
    assert noise is not None
    usual = LAW.variance(noise.amplitude, noise.surroundings2).reshape(VIEWS, BINS)
    sunlight = light(1e-3, 0.0)
    sunlight *= lit / np.median(sunlight / usual)
    noisy = replace(session((1.0 if lit < 1.0 else 0.5) * usual + sunlight), has_amplitude=True)
    assert (Ambient.detect(noisy) is None) == (times is not None)
    reason = Ambient.not_testable(noisy)
    assert reason is None if times is None else reason is not None and reason.startswith(f"noise is {times} times that of the photon law")


def test_noise_of_the_darkest_bins_alone_is_no_foreign_light() -> None:
    """Half above the law, as with less modulated light, and more on grazing surfaces, which are the darkest."""
    noise = session(0.0).noise
    assert noise is not None
    usual = LAW.variance(noise.amplitude, noise.surroundings2).reshape(VIEWS, BINS)
    assert Ambient.detect(session(usual * (0.5 + 2.0 * (np.arange(BINS) < BINS // 4)))) is None


@pytest.mark.parametrize(("uneven", "found"), [(0.2, True), (0.4, False)])
def test_foreign_light_is_not_known_beside_bins_that_no_term_explains(uneven: float, found: bool) -> None:  # noqa: FBT001
    """Creases and textures look like noise, by another amount in each bin."""
    sunlight = light(1e-3, 0.0)
    shape = np.exp(uneven * np.random.default_rng(3).standard_normal(sunlight.shape)) - 1.0
    noise = session(0.0).noise
    assert noise is not None
    usual = LAW.variance(noise.amplitude, noise.surroundings2).reshape(sunlight.shape)
    assert (Ambient.detect(session(sunlight + shape * (usual + sunlight))) is not None) == found


def test_a_camera_that_averages_is_noisier_where_its_average_takes_in_fewer_neighbours() -> None:
    """Noise grows with the step from pixel to pixel, range times the tangent of incidence; real light is found beside it."""
    noise = session(0.0).noise
    assert noise is not None
    usual = LAW.variance(noise.amplitude, noise.surroundings2)
    fewer = (2.0 * usual * (noise.surroundings2**2 / noise.range2 - noise.range2)).reshape(VIEWS, BINS)
    assert Ambient.detect(replace(session(fewer), averages=True)) is None
    found = Ambient.detect(replace(session(fewer + light(4e-3, 0.0)), averages=True))
    assert found is not None
    assert isinstance(found.effect, Ambient)
    assert found.effect.surface_m == pytest.approx(4e-3, rel=0.15)


def test_without_a_law_or_an_amplitude_image_the_reason_is_given() -> None:
    assert Ambient.not_testable(session(0.0)) is None
    assert (
        Ambient.not_testable(session(0.0, law=None))
        == "no noise to compare with: pass --sensor with the sensor.yaml of a session of this camera without ambient light"
    )
    assert Ambient.not_testable(replace(session(0.0), has_amplitude=False)) == NO_AMPLITUDE
    steps = Ambient.not_testable(replace(session(0.0), noise_of_steps=True))
    assert steps is not None
    assert steps.startswith("noise grows with the steps of the fixed pattern")


@pytest.mark.parametrize(
    ("darkest", "reason"),
    [
        (0.0, "the views share too few amplitudes away from edges to compare their noise with the photon law in --sensor"),
        (900.0, "the photon law in --sensor was measured at amplitudes from 900 on, and hardly a surface is as bright here"),
    ],
)
def test_where_few_amplitudes_can_be_compared_the_reason_is_the_law_or_the_views(darkest: float, reason: str) -> None:
    few = session(0.0, law=replace(LAW, darkest=darkest))
    bins = few.noise
    assert bins is not None
    assert Ambient.not_testable(replace(few, noise=bins.of(np.arange(len(bins.view)) < 11))) == reason


@pytest.mark.slow
@pytest.mark.usefixtures("no_page")
def test_a_session_under_foreign_light_is_named_by_the_law_of_one_without_it(tmp_path: Path) -> None:
    """Three times the noise; and a second session without that light has none."""
    scene = write_builtin("body_section", tmp_path / "scene")
    bodies = bodies_of(load_scene(scene))
    small = {"camera.width": 112, "camera.height": 86, "plan.views": 7, "camera.full_well_ke": 5000.0, "camera.adc_bits": 14}
    for name, seed, ambient_ke in (("law", 21, 5.0), ("healthy", 22, 5.0), ("sunny", 23, 800.0)):
        record(bodies, tmp_path / name, from_mapping(VirtualConfig, small | {"seed": seed, "camera.ambient_ke": ambient_ke}))

    def report(name: str, *sensor: str) -> dict[str, Any]:
        out = tmp_path / f"{name}_gap"
        assert main(["gap", str(tmp_path / name), "--scene", str(scene), "--out", str(out), *sensor]) == 0
        return dict(json.loads((out / "gap.json").read_text()))

    assert report("law")["verdict"] == ["none"]
    known = ("--sensor", str(tmp_path / "law_gap" / "sensor.yaml"))
    assert report("healthy", *known)["verdict"] == ["none"]
    sunny = report("sunny", *known)
    assert sunny["verdict"] == ["ambient"]
    assert sunny["words"][0]["rivals"] == [], "the virtual sun shines on surfaces"
