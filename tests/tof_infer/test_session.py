# SPDX-License-Identifier: Apache-2.0
"""Inference: uncertain pixels keep the raw depth and are marked; foreign files and cameras are refused."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_infer.made import CAMERA, OFFSET_M, measured, wall
from tof_core.camera import Camera
from tof_core.errors import ModelError, RefusedError
from tof_infer import session as session_module
from tof_infer.card import KEY
from tof_infer.config import InferConfig
from tof_infer.frames import Mark, padded_size, unit_rays
from tof_infer.session import Session

onnx = pytest.importorskip("onnx", reason="making foreign models needs the extra `train`")

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytestmark = pytest.mark.train


def opened(model: Path, **values: Any) -> Session:
    return Session(InferConfig(model=str(model), **values))


def changed(model: Path, out: Path, change: Callable[[Any, dict[str, Any]], None]) -> Path:
    """A copy of the model after `change(onnx model, card)`."""
    proto = onnx.load(model)
    card = json.loads({p.key: p.value for p in proto.metadata_props}[KEY])
    change(proto, card)
    onnx.helper.set_model_props(proto, {KEY: json.dumps(card)})
    onnx.save(proto, out)
    return out


def test_applies_the_learnt_correction(model: Path) -> None:
    capture = measured(500)
    repaired = opened(model).repair(capture)
    error = np.abs(repaired.depth - wall(500))[repaired.known]
    assert np.nanmedian(np.abs(capture.depth - wall(500))) == pytest.approx(OFFSET_M, abs=2e-3)
    assert error.mean() < 0.3 * OFFSET_M
    assert repaired.known.mean() > 0.7


def test_pixels_without_depth_stay_without(model: Path) -> None:
    repaired = opened(model).repair(measured(500))
    assert np.isnan(repaired.depth[2, 3])
    assert np.isnan(repaired.sigma[2, 3])
    assert repaired.mark[2, 3] == Mark.INVALID
    assert (repaired.mark == Mark.INVALID).sum() == 1


def test_where_sigma_is_too_large_the_raw_depth_is_kept_and_marked(model: Path) -> None:
    capture = measured(501)
    repaired = opened(model, max_sigma_mm=0.001).repair(capture)
    kept = repaired.mark == Mark.RAW_KEPT
    assert kept.sum() == np.isfinite(capture.depth).sum()
    np.testing.assert_array_equal(repaired.depth[kept], capture.depth[kept])
    assert np.isposinf(repaired.sigma[kept]).all()


def test_a_range_outside_training_keeps_the_raw_depth(model: Path) -> None:
    capture = measured(501)
    capture.depth[10:14, 10:14] = 6.0
    repaired = opened(model).repair(capture)
    assert (repaired.mark[10:14, 10:14] == Mark.RAW_KEPT).all()
    assert (repaired.depth[10:14, 10:14] == np.float32(6.0)).all()


def test_a_frame_all_invalid_comes_back_all_invalid(model: Path) -> None:
    capture = measured(502)
    repaired = opened(model).repair(replace(capture, depth=np.full_like(capture.depth, np.nan)))
    assert np.isnan(repaired.depth).all()
    assert (repaired.mark == Mark.INVALID).all()


def test_nan_and_inf_in_amplitude_count_as_missing_amplitude(model: Path) -> None:
    capture = measured(503)
    assert capture.amplitude is not None
    damaged, absent = capture.amplitude.copy(), capture.amplitude.copy()
    damaged[3:6, 4:9], damaged[8, 8], damaged[9, 9], damaged[9, 10] = np.nan, np.inf, -np.inf, -5.0
    absent[3:6, 4:9] = absent[8, 8] = absent[9, 9:11] = 0.0
    run = opened(model)
    a = run.repair(replace(capture, amplitude=damaged))
    b = run.repair(replace(capture, amplitude=absent))
    assert np.isfinite(a.depth[np.isfinite(capture.depth)]).all()
    np.testing.assert_array_equal(a.depth, b.depth)


def test_amplitude_and_temperature_may_be_absent(model: Path) -> None:
    capture = replace(measured(504), amplitude=None, temperature=float("nan"))
    repaired = opened(model).repair(capture)
    known = repaired.known
    assert known.any()
    assert np.abs(repaired.depth - wall(504))[known].mean() < 0.6 * OFFSET_M


def test_inf_in_depth_is_no_depth(model: Path) -> None:
    capture = measured(505)
    capture.depth[0, 0], capture.depth[0, 1], capture.depth[0, 2] = np.inf, -np.inf, 0.0
    repaired = opened(model).repair(capture)
    assert np.isnan(repaired.depth[0, :3]).all()


def test_a_frame_does_not_influence_the_next(model: Path) -> None:
    run = opened(model)
    first = run.repair(measured(506))
    run.repair(replace(measured(507), depth=np.full(CAMERA.shape, np.nan, np.float32)))
    np.testing.assert_array_equal(run.repair(measured(506)).depth, first.depth)


def test_the_padding_contract() -> None:
    assert padded_size((300, 400), 16) == (304, 400)
    assert padded_size((171, 224), 16) == (176, 224)
    rays = unit_rays(CAMERA)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=0), 1, atol=1e-6)
    assert rays.shape == (3, 30, 44)


@pytest.mark.parametrize(
    "camera", [Camera(48, 30, 40.0, 40.0, 21.5, 14.5), Camera(44, 30, 44.0, 44.0, 21.5, 14.5), Camera(44, 30, 40.0, 40.0, 27.5, 14.5)]
)
def test_another_camera_is_refused_unless_forced(model: Path, camera: Camera) -> None:
    capture = replace(measured(508), camera=camera, depth=np.full(camera.shape, 0.8, np.float32), amplitude=None)
    with pytest.raises(RefusedError, match=r"walls\.onnx: the model was made for another camera: .*pass --force"):
        opened(model).repair(capture)
    assert opened(model, force=True).repair(capture).depth.shape == camera.shape


def test_a_range_far_outside_is_refused_unless_forced(model: Path) -> None:
    capture = replace(measured(509), depth=np.full(CAMERA.shape, 5.0, np.float32))
    with pytest.raises(RefusedError, match=r"the frame is 5\.00 m away, the model was trained on"):
        opened(model).repair(capture)
    repaired = opened(model, force=True).repair(capture)
    assert (repaired.mark == Mark.RAW_KEPT).all()


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="there is no such model"):
        opened(tmp_path / "none.onnx")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.98])
def test_a_truncated_file(model: Path, tmp_path: Path, share: float) -> None:
    data = model.read_bytes()
    short = tmp_path / "short.onnx"
    short.write_bytes(data[: int(share * len(data))])
    with pytest.raises(ModelError, match=r"short\.onnx"):
        opened(short)


def test_a_huge_file_is_not_even_read(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "MAX_BYTES", 1000)
    with pytest.raises(ModelError, match="MB large, too large for a depth network"):
        opened(model)


def test_a_model_from_elsewhere_has_no_card(model: Path, tmp_path: Path) -> None:
    proto = onnx.load(model)
    del proto.metadata_props[:]
    onnx.save(proto, tmp_path / "foreign.onnx")
    with pytest.raises(ModelError, match="was not made by `toftwin train`"):
        opened(tmp_path / "foreign.onnx")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("inputs", ["depth"], "takes depth, amplitude, ray, temperature .* its card lists depth"),
        ("schema", "other/9", "has schema 'other/9'"),
        ("multiple", 0, "impossible values"),
        ("range_m", [2, 1], "impossible values"),
        ("camera", 7, "its card is damaged"),
    ],
)
def test_a_card_that_does_not_fit(model: Path, tmp_path: Path, key: str, value: object, message: str) -> None:
    other = changed(model, tmp_path / "other.onnx", lambda _, card: card.__setitem__(key, value))
    with pytest.raises(ModelError, match=message):
        opened(other)


def test_other_inputs_in_the_graph(model: Path, tmp_path: Path) -> None:
    def rename(proto: Any, card: dict[str, Any]) -> None:
        proto.graph.input[1].name = "secret"
        for node in proto.graph.node:
            node.input[:] = ["secret" if n == "amplitude" else n for n in node.input]
        card["inputs"] = ["depth", "secret", "ray", "temperature"]

    with pytest.raises(ModelError, match="takes 'secret', which is no input of toftwin"):
        opened(changed(model, tmp_path / "other.onnx", rename))


def test_weights_that_lie_beside_the_file_are_not_followed(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "outside.onnx"
    onnx.save(onnx.load(model), out, save_as_external_data=True, location="weights.bin", size_threshold=0)
    with pytest.raises(ModelError, match=r"outside\.onnx"):
        opened(out)


def test_a_pixel_without_a_ray_looks_along_the_axis() -> None:
    """A lens model that folds over gives rays that are not a number."""
    folded = replace(CAMERA, distortion_model="plumb_bob", distortion=(-1.5, 0.0, 0.0, 0.0, 0.0))
    none = np.isnan(folded.rays()).any(axis=-1)
    assert 0.0 < none.mean() < 0.9
    rays = unit_rays(folded)
    np.testing.assert_array_equal(rays[:, none].T, np.broadcast_to([0.0, 0.0, 1.0], (int(none.sum()), 3)))
    np.testing.assert_allclose(np.linalg.norm(rays, axis=0), 1.0, atol=1e-6)
