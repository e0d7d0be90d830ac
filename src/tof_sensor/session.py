# SPDX-License-Identifier: Apache-2.0
"""Properties of a recorded session that effects use: views at their reference poses, parts, the camera's images."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float, Ints, Mask
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.frame import Frame

NO_AMPLITUDE = "no amplitude image (if the recording has one under another name, pass --amplitude-topic)"
"""Why an effect that depends on amplitude cannot be tested."""
LN_AGREES = 0.02
"""Deviation of ln variance below which a bin agrees with a fit: 1 % of the noise."""
WARMING_K = 0.5
"""Least change of temperature that counts, kelvin: the resolution of a usual camera's thermometer."""
WARMING_S = 60.0
"""Seconds from which a camera may warm up with a steady thermometer."""
PART_PIXELS = 150
"""Fewest drawn pixels of a part, over the session, for hypotheses on it."""


class Course(NamedTuple):
    """A session's duration in seconds, and the temperature of its first and of its last view in degrees Celsius, NaN where unknown."""

    seconds: float
    first_c: float = float("nan")
    last_c: float = float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class NoiseBins:
    """Temporal noise by amplitude, in bins of every view, each (n,).

    view: index of the view; amplitude: mean, camera's unit; range2: mean squared range, m^2; surroundings2: mean of `Frame.surroundings_m2`;
    variance: of one capture by its neighbours, m^2 along the ray; samples: their number; between: variance between the captures of a dwell,
    m^2 along the ray, NaN in views of one capture; growth: variance of differences of pixels two apart over that of next neighbours, above 1
    where the camera averages over neighbours.
    """

    view: Float
    amplitude: Float
    range2: Float
    surroundings2: Float
    variance: Float
    samples: Float
    between: Float | None = None
    growth: Float | None = None

    def of(self, keep: Mask) -> NoiseBins:
        """The bins of a mask."""
        return replace(self, **{f.name: v[keep] for f in fields(self) if (v := getattr(self, f.name)) is not None})


@dataclass(frozen=True, slots=True, eq=False)
class SessionView:
    """One view: rendering with measured amplitude, temperature, time and twist; flat indices (n,) of the pixels drawn for fits."""

    frame: Frame
    pixels: Ints


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """A recorded session, for the effects.

    parts: names of the scene's parts, in the scene's order; has_amplitude: whether any view has an amplitude image; modulated: whether
    noise depends on light, as for time-of-flight cameras, and not on range squared, as for stereo cameras; law: the camera's photon law
    from `--sensor`; noise: temporal noise by amplitude; exposed: whether exposure is automatic, or exposures are merged; noise_of_steps:
    whether noise grows with the steps of a fixed pattern, over which the camera averages or not; averages: whether the camera averages
    over neighbours; posed_apart: whether all poses are independent of depth and have a covariance, as poses from a board's corners do; stated_mhz: modulation frequencies by
    the camera's data sheet, empty where none is stated.
    """

    views: tuple[SessionView, ...]
    parts: tuple[str, ...] = ()
    has_amplitude: bool = True
    modulated: bool = True
    law: PhotonLaw | None = None
    noise: NoiseBins | None = None
    exposed: bool = False
    noise_of_steps: bool = False
    averages: bool = False
    posed_apart: bool = False
    stated_mhz: tuple[float, ...] = ()

    def frequencies(self, *usual: float) -> tuple[float, ...]:
        """Modulation frequencies to try, MHz: the stated ones and, of several, their mean, since the camera merges them; else the usual ones."""
        return merged(self.stated_mhz) or usual

    @property
    def moving(self) -> bool:
        """Whether a view was taken in motion."""
        return any(v.frame.context.moving for v in self.views)

    @property
    def temperatures(self) -> Float:
        """(V,) degrees Celsius, NaN where unknown."""
        return np.array([v.frame.context.temperature for v in self.views])

    @property
    def warming(self) -> bool:
        """Whether the temperature changes by `WARMING_K`, or the session lasts `WARMING_S`: a thermometer lags minutes behind lamp and sensor."""
        return self.temperature_changes or self.duration_s >= WARMING_S

    @property
    def temperature_changes(self) -> bool:
        """Whether the thermometer's reading changes by `WARMING_K`."""
        temperature = self.temperatures
        return bool(np.isfinite(temperature).all() and np.ptp(temperature) >= WARMING_K)

    @property
    def duration_s(self) -> float:
        """Seconds from the first view to the last."""
        times = [v.frame.context.time_s for v in self.views]
        return max(times) - min(times)

    @property
    def farthest_m(self) -> float:
        """Range of the farthest drawn pixel, metres."""
        return max(float(v.frame.radial.ravel()[v.pixels].max(initial=0.0)) for v in self.views)

    @property
    def range_span(self) -> float:
        """Metres between the 2 % and 98 % quantiles of range over the drawn pixels."""
        r = np.concatenate([v.frame.radial.ravel()[v.pixels] for v in self.views])
        low, high = np.quantile(r, [0.02, 0.98])
        return float(high - low)

    @property
    def median_amplitude(self) -> float:
        """Median amplitude of the drawn pixels, camera's unit."""
        seen = np.concatenate([v.frame.amplitude.ravel()[v.pixels] for v in self.views])
        return float(np.median(seen[seen > 0]))

    def parts_seen(self) -> Iterator[tuple[int, str]]:
        """Index and name of every part with at least `PART_PIXELS` drawn pixels."""
        counts = np.zeros(len(self.parts), int)
        for v in self.views:
            seen = v.frame.rendering.part.ravel()[v.pixels]
            counts += np.bincount(seen[seen >= 0], minlength=len(self.parts))
        yield from ((i, name) for i, name in enumerate(self.parts) if counts[i] >= PART_PIXELS)

    def surface(self, part: int) -> tuple[Float, Float]:
        """(n, 3) points, metres, and (n, 3) normals of a part's drawn pixels, in the cell frame."""
        points, normals = [], []
        for v in self.views:
            rendering = v.frame.rendering
            here = v.pixels[rendering.part.ravel()[v.pixels] == part]
            T = rendering.T_cell_camera
            points.append(v.frame.points.reshape(-1, 3)[here] @ T[:3, :3].T + T[:3, 3])
            normals.append(rendering.normal.reshape(-1, 3)[here].astype(np.float64) @ T[:3, :3].T)
        return np.concatenate(points), np.concatenate(normals)


def merged(stated_mhz: tuple[float, ...]) -> tuple[float, ...]:
    """The stated modulation frequencies, MHz, and of several their mean, since the camera merges them; empty without any."""
    return (*stated_mhz, float(np.mean(stated_mhz))) if len(stated_mhz) > 1 else stated_mhz
