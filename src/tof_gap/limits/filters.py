# SPDX-License-Identifier: Apache-2.0
"""Limits of what a filter in the camera does: holes that it leaves, edges that it smears."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param


@dataclass(frozen=True, slots=True)
class FilterLimits:
    """When a hole in the depth image is the work of the camera's own outlier filter."""

    shaped: float = param(
        0.9,
        "share of a hole that 3 x 3 neighbourhoods fill",
        low=0.0,
        high=1.0,
        why="thresholds leave ragged rims; the lens's resampling too",
    )
    dimmest: float = param(
        0.002, "quantile of returned amplitudes that is the least", low=0.0, high=0.5, why="single pixels are dimmer by noise"
    )
    rim: float = param(
        1.2,
        "amplitude of a hole's rim, over the least",
        low=1.0,
        why="thresholds of two cameras, 20 sessions: 1.05 at most; around wrong unwrapping, eleven sessions: 1.3 and more",
    )
    dimmer: float = param(
        0.7,
        "chance that a removed pixel has a lower amplitude than a measured one",
        low=0.5,
        high=1.0,
        why="outliers of single pixels occur at any amplitude: 0.5; around wrong unwrapping in nine sessions: 0.79 and more",
    )
    alone: float = param(
        0.8,
        "single lost pixels, over those of pixels that are lost independently, from which a check removes pixels one by one",
        low=0.0,
        why="a check of single pixels: 1.1 and 1.2; filters, thresholds and sunlight, seven sessions: 0.6 at most",
    )
    at_times: float = param(
        0.3,
        "share of the loss that other captures of the same dwell measure, from which outliers of single captures are removed",
        low=0.0,
        high=1.0,
        why="outliers that are removed: 0.53; thresholds 0.05 at most, sunlight 0.18, unstable pixels 0.26 (seven sessions)",
    )
    around_unstable: float = param(
        0.3,
        "share of the holes that contain a pixel with a noise of its own, from which such pixels are what a filter removed",
        low=0.0,
        high=1.0,
        why="unstable pixels: 0.69; wrong unwrapping beside unstable pixels: 0.05 (one session each)",
    )
    quiet_lines: float = param(
        0.3, "loss of the quietest quarter of lines, over that of all", low=0.0, high=1.0, why="lost at random: 0.8; by a filter: 0.1"
    )
    outliers: float = param(
        0.05,
        "share of the pixels up to which loss at random may be outliers of noise at every amplitude",
        low=0.0,
        high=1.0,
        why="normal noise exceeds two standard deviations in 5 %",
    )
    same_pixels: float = param(
        0.3,
        "correlation of the pixels that even and odd views lose, beside what is lost around them, from which a filter takes offsets of pixels for edges",
        low=0.0,
        high=1.0,
        why="by light, of dark parts or at random: 0.02 at most; steps of columns that a filter takes for edges: 0.65",
    )
    line_loss: float = param(
        0.5,
        "standard deviation of the shares that the lines of a view lose, over their mean, from which loss follows lines",
        low=0.0,
        why="lost at random: 0; where rows have noise of their own: 0.9 to 3.0",
    )
    line_near: float = param(
        0.5,
        "covariance of lines six apart, over the variance of lines, up to which loss follows lines and no surface",
        low=0.0,
        high=1.0,
        why="lines of their own: -0.05 and 0; loss of weak light and at random: 0.57 to 0.90",
    )
    noise_of_steps: float = param(
        1.25,
        "variance of noise where a fixed pattern is steepest, over that where it is smoothest, from which the pattern makes it",
        low=1.0,
        why="noise of the camera's own: 0.9 to 1.1; of averages over steps of columns 3 and 4, of a bilateral filter 1.4",
    )
    noise_sigma: float = param(
        3.0, "standard deviations of noise that nine pixels span", low=1.0, why="expected range of nine normal values"
    )


@dataclass(frozen=True, slots=True)
class SmearLimits:
    """When a filter in the camera mixed the depths of neighbours across edges."""

    away_px: float = param(
        2.0,
        "distance from mixed pixels beyond which no pixel sees both surfaces",
        unit="px",
        low=1.0,
        why="blur of the lens and half a pixel of pose reach the next pixel",
    )
    afar: float = param(
        0.02,
        "share of the pixels beyond that lie between both surfaces",
        low=0.0,
        high=1.0,
        why="light: 0.003 at most, also beside a filter that stops at edges; means over 5 to 15 pixels: 0.035 to 0.24",
    )
    own: float = param(
        0.25, "distance of such a pixel from its own surface, over the step", low=0.0, high=0.5, why="surfaces slope and bend"
    )
