# SPDX-License-Identifier: Apache-2.0
"""Fill Numba's cache with the kernels of filters, ray casting, alignment, labels, diagnosis and inference, so that no first run compiles them."""

from __future__ import annotations

from tof_gap import warm_up
from tof_infer.session import Session
from tof_preproc import preprocessor
from tof_scene.builtin import open_scene
from tof_scene.raycast import Raycaster
from tof_sim_label import stream

if __name__ == "__main__":
    preprocessor.warm_up()
    Session()
    stream.warm_up(Raycaster(open_scene("body_section")))
    warm_up.warm_up()
