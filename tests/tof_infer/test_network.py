# SPDX-License-Identifier: Apache-2.0
"""The network: invalid pixels change nothing, padding changes nothing, and PyTorch and ONNX agree."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_infer.made import CAMERA, measured
from tof_core.config import to_mapping
from tof_core.errors import ConfigError, ModelError
from tof_infer.config import NetConfig
from tof_infer.frames import unit_rays

torch = pytest.importorskip("torch", reason="training needs the extra `train`")

from tof_infer.batches import pad  # noqa: E402
from tof_infer.card import Card  # noqa: E402
from tof_infer.export import export, restore  # noqa: E402
from tof_infer.loss import loss_of  # noqa: E402
from tof_infer.network import RepairNet  # noqa: E402
from tof_infer.sigma_calibration import Calibration  # noqa: E402
from tof_infer.sigma_correction import SigmaCorrection, cells_of  # noqa: E402

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor

pytestmark = pytest.mark.train
CONFIG = NetConfig(base=4, levels=3)
SEPARABLE = NetConfig(base=4, levels=3, separable=True)
BOTH = pytest.mark.parametrize("config", [CONFIG, SEPARABLE], ids=["full", "separable"])


def net(config: NetConfig = CONFIG) -> RepairNet:
    """Random weights everywhere, also where training begins with zeros."""
    torch.manual_seed(3)
    made = RepairNet(config)
    made.eval()
    for p in made.parameters():
        if p.ndim > 1:
            p.data += 0.05 * torch.randn_like(p)
    return made


@torch.no_grad()
def random_correction(run: RepairNet) -> SigmaCorrection:
    """A frame-level correction of sigma with random weights."""
    _, log, features = run.look(images(1, (32, 48)))
    made = SigmaCorrection(cells_of(*features, log)[0].shape[1])
    made.tell.weight += 0.1 * torch.randn_like(made.tell.weight)
    return made


def images(number: int, size: tuple[int, int]) -> dict[str, Tensor]:
    capture = measured(number)
    assert capture.amplitude is not None
    ray = pad(unit_rays(CAMERA), size, 0.0)
    ray[2][ray[2] == 0] = 1.0
    return {
        "depth": torch.from_numpy(pad(capture.depth, size, np.nan))[None, None],
        "ray": torch.from_numpy(ray)[None],
        "amplitude": torch.from_numpy(pad(capture.amplitude, size, np.nan))[None, None],
        "temperature": torch.tensor([30.0]),
    }


@BOTH
@torch.no_grad()
def test_invalid_values_do_not_matter(config: NetConfig) -> None:
    """NaN, inf, 0 and negative values all count as missing."""
    run, given = net(config), images(1, (32, 48))
    depth, log = run(given)
    for nothing in (0.0, float("inf"), -1.0, 1e9):
        other = {**given, "depth": torch.nan_to_num(given["depth"], nan=nothing, posinf=nothing)}
        changed_depth, changed_log = run(other)
        there = torch.isfinite(given["depth"])
        torch.testing.assert_close(changed_depth[there], depth[there])
        torch.testing.assert_close(changed_log[there], log[there])


@BOTH
@torch.no_grad()
def test_the_output_is_finite_everywhere(config: NetConfig) -> None:
    depth, log = net(config)(images(2, (32, 48)))
    assert torch.isfinite(depth).all()
    assert torch.isfinite(log).all()


@torch.no_grad()
def test_more_padding_changes_only_the_rim() -> None:
    run = net()
    small, large = run(images(3, (32, 48)))[0], run(images(3, (64, 96)))[0]
    np.testing.assert_allclose(small[0, 0, :8, :8], large[0, 0, :8, :8], atol=2e-3)


@BOTH
@torch.no_grad()
@pytest.mark.parametrize(("size", "kind"), [((32, 48), "plain"), ((64, 64), "with correction"), ((176, 224), "with correction")])
def test_onnx_and_pytorch_agree_at_any_size(tmp_path: Path, config: NetConfig, size: tuple[int, int], kind: str) -> None:
    import onnxruntime as ort

    run = net(config)
    run.doubt = random_correction(run) if kind == "with correction" else None
    card = Card(config.names, config.multiple, CAMERA, (0.3, 2.0), 0.01, {"net": to_mapping(config)})
    export(run, Calibration(0.3, 1.1), card, tmp_path / "m.onnx")
    session = ort.InferenceSession(tmp_path / "m.onnx", providers=["CPUExecutionProvider"])
    given = images(4, size)
    depth, sigma, *own = session.run(None, {n: given[n].numpy() for n in config.names})
    want, log, alone = run.with_correction(given)
    there = torch.isfinite(given["depth"]).numpy()
    np.testing.assert_allclose(depth[there], want.numpy()[there], atol=1e-5)
    np.testing.assert_allclose(sigma[there], np.exp(0.3 + 1.1 * log.numpy()[there]), rtol=1e-4)
    assert np.isnan(depth[~there]).all()
    assert len(own) == (kind == "with correction")
    for image in own:
        np.testing.assert_allclose(image[there], np.exp(0.3 + 1.1 * alone.numpy()[there]), rtol=1e-4)
    again, read = restore(tmp_path / "m.onnx")
    torch.testing.assert_close(again.with_correction(given), (want, log, alone), rtol=0, atol=0)
    assert read == card


@BOTH
@torch.no_grad()
def test_the_frame_level_correction_changes_sigma_alone_and_ignores_invalid_pixels(config: NetConfig) -> None:
    run, given = net(config), images(1, (32, 48))
    depth, log = run(given)
    run.doubt = random_correction(run)
    same, with_correction, own = run.with_correction(given)
    torch.testing.assert_close((same, own), (depth, log), rtol=0, atol=0)
    assert (with_correction - log).abs().max() > 0.01
    for nothing in (0.0, float("inf")):
        other = {**given, "depth": torch.nan_to_num(given["depth"], nan=nothing, posinf=nothing)}
        there = torch.isfinite(given["depth"])
        torch.testing.assert_close(run.with_correction(other)[1][there], with_correction[there])
    run.doubt = SigmaCorrection(run.doubt.see.in_channels)  # an untrained one
    torch.testing.assert_close(run.with_correction(given)[1], log, rtol=0, atol=0)


def test_a_file_without_weights_is_not_restored(tmp_path: Path) -> None:
    (tmp_path / "m.onnx").write_bytes(b"no model")
    with pytest.raises(ModelError, match=r"m\.onnx: its weights cannot be read"):
        restore(tmp_path / "m.onnx")


def test_an_unknown_input_is_refused() -> None:
    with pytest.raises(ConfigError, match="input 'smell' is unknown"):
        NetConfig(inputs="depth,smell")
    with pytest.raises(ConfigError, match="inputs lack 'depth'"):
        NetConfig(inputs="amplitude")
    with pytest.raises(ConfigError, match="are no periods"):
        NetConfig(waves_m="1.5,-1")


def test_the_multiple_is_what_blocks_and_levels_need() -> None:
    assert NetConfig(levels=4, unshuffle=2).multiple == 16
    assert NetConfig(levels=5, unshuffle=1).multiple == 16
    assert NetConfig(levels=2, unshuffle=2).multiple == 8
    assert NetConfig(levels=2, unshuffle=2, separable=True).multiple == 16
    assert NetConfig(levels=4, unshuffle=2, separable=True).multiple == 16


@torch.no_grad()
def test_a_cell_of_the_correction_has_as_many_pixels_in_either_network() -> None:
    given = images(1, (32, 48))
    for config in (CONFIG, SEPARABLE):
        run = net(config)
        _, log, features = run.look(given)
        cells, share = cells_of(*features, log)
        assert cells.shape[2:] == share.shape[2:] == (4, 6)
        torch.testing.assert_close(share[0, 0], torch.isfinite(given["depth"])[0, 0].float().reshape(4, 8, 6, 8).mean((1, 3)))


@torch.no_grad()
def test_pixels_reach_the_separable_network_once() -> None:
    """Moving a frame by a block of the coarsest level moves the output by as much: no level is shifted against another."""
    run, size = net(SEPARABLE), (96, 96)
    given = images(3, size)
    given["ray"] = torch.zeros(1, 3, *size) + torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1)
    moved = {n: x if n == "temperature" else torch.roll(x, (16, 16), (2, 3)) for n, x in given.items()}
    depth, there = run(given)[0], torch.isfinite(given["depth"])
    again = torch.roll(run(moved)[0], (-16, -16), (2, 3))
    middle = there.clone()
    middle[..., :20, :] = middle[..., :, :20] = False
    torch.testing.assert_close(again[middle], depth[middle], atol=2e-3, rtol=0)


@pytest.mark.parametrize(("kind", "value"), [("mse", 4e-4), ("laplace", 2 + np.log(0.01)), ("normal", 2 + np.log(0.01))])
def test_losses(kind: str, value: float) -> None:
    one = torch.ones(1, 1, 2, 2)
    given = {"depth": one.clone()}
    given["depth"][0, 0, 0, 0] = float("nan")
    target = {"label": one * 0.98, "sigma": one * 0, "mask": torch.ones(1, 1, 2, 2, dtype=torch.bool)}
    target["mask"][0, 0, 1, 1] = False
    target["label"][0, 0, 1, 1] = float("nan")
    assert float(loss_of(kind, one, one * float(np.log(0.01)), given, target)) == pytest.approx(value, rel=1e-4)


def test_the_labels_own_sigma_adds_to_the_predicted_scale() -> None:
    one = torch.ones(1, 1, 1, 1)
    target = {"label": one * 0.98, "sigma": one * 0.02, "mask": one > 0}
    wide = float(loss_of("normal", one, one * float(np.log(1e-4)), {"depth": one}, target))
    assert wide == pytest.approx(0.5 + np.log(0.02), abs=1e-3)
