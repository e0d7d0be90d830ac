# SPDX-License-Identifier: Apache-2.0
"""Filters that look at one pixel alone: range, amplitude, the robot itself."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import ConfigError, DecodeError
from tof_core.png import decode_png
from tof_core.reasons import Reason

if TYPE_CHECKING:
    from tof_core.arrays import Mask
    from tof_preproc.config import PreprocConfig
    from tof_preproc.frame import Frame


def remove_range(frame: Frame, config: PreprocConfig) -> int:
    """Remove depth outside [low, high] metres along z."""
    return frame.remove((frame.depth < config.range.low) | (frame.depth > config.range.high), Reason.OUT_OF_RANGE)


def remove_amplitude(frame: Frame, config: PreprocConfig) -> int:
    """Remove pixels whose amplitude is out of bounds or unknown; frames without amplitude pass."""
    bounds = config.amplitude
    if frame.amplitude is None or (bounds.low == 0 and bounds.high == 0):
        return 0
    high = bounds.high or np.inf
    return frame.remove(~((frame.amplitude >= bounds.low) & (frame.amplitude <= high)), Reason.MASKED_AMPLITUDE)


def remove_self(frame: Frame, config: PreprocConfig) -> int:
    """Remove the pixels that the mask image marks as the robot itself."""
    if not config.self_mask.path:
        return 0
    mask = load_mask(config.self_mask.path)
    if mask.shape != frame.camera.shape:
        msg = f"is {mask.shape[1]}x{mask.shape[0]}, the camera {frame.camera.width}x{frame.camera.height}"
        raise ConfigError(msg, where=config.self_mask.path, todo="draw the mask on an image of this camera")
    return frame.remove(mask, Reason.SELF)


@lru_cache(maxsize=4)
def load_mask(path: str) -> Mask:
    """(H, W) where a PNG image is not black; an alpha channel is ignored.

    Raises:
        ConfigError: no file, no PNG, or more pixels than a camera has.
    """
    try:
        raster = decode_png(Path(path).read_bytes())
    except OSError as error:
        raise ConfigError(f"cannot be read: {error.strerror}", where=path, todo="give self_mask.path a PNG") from None
    except DecodeError as error:
        raise ConfigError(error.what, where=path, todo="give self_mask.path a PNG of the camera's size") from None
    mask = np.asarray(raster > 0 if raster.ndim == 2 else (raster[..., :3] > 0).any(axis=-1))
    mask.setflags(write=False)
    return mask
