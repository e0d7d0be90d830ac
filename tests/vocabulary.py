# SPDX-License-Identifier: Apache-2.0
"""The effects of docs/effects.md by name: simulator, sensor model and diagnosis must know all of them."""

EFFECT_NAMES = {
    "multipath",
    "wiggling",
    "flying_pixels",
    "lens_scatter",
    "temperature_drift",
    "amplitude_bias",
    "fixed_pattern",
    "noise",
    "motion",
    "intrinsics",
    "hand_eye",
    "time_sync",
    "phase_wrap",
    "dropout",
    "cad_deviation",
    "radial_depth",
    "depth_scale",
    "range_offset",
    "quantization",
    "specular",
    "subsurface",
    "interference",
    "ambient",
    "emitter_offset",
}
