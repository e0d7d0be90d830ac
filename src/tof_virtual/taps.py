# SPDX-License-Identifier: Apache-2.0
"""The pixel: four correlation samples a quarter period apart, charge, noise, converter, and the phase made of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask
    from tof_virtual.config import CameraConfig

SPEED_OF_LIGHT = 299_792_458.0


@dataclass(slots=True, eq=False)
class Charge:
    """What falls on P pixels during one frame; electrons throughout.

    `phasor` (4, P) complex: the modulated signal as each tap sees it (its argument is the phase travelled);
    `third`, `fifth` (4, P): the same of the waveform's odd harmonics, or None for a pure sine; `steady` (4, P):
    all unmodulated charge of each tap; `lag` (P,): phase the pixel adds; `extra` (4, P): charge of other sources.
    `coarse` (P,): distance by the coarse frequency, which only selects the number of whole periods.
    """

    phasor: NDArray[np.complex128]
    steady: Float
    coarse: Float
    lag: Float
    third: NDArray[np.complex128] | None = None
    fifth: NDArray[np.complex128] | None = None
    extra: Float | None = None


def metres_per_radian(modulation_mhz: float) -> float:
    """Distance of one radian of phase: c / (4 pi f)."""
    return SPEED_OF_LIGHT / (4 * math.pi * modulation_mhz * 1e6)


def measure(
    charge: Charge,
    config: CameraConfig,
    rng: np.random.Generator | None,
) -> tuple[Float, Float, Mask]:
    """Distance (P,) in metres, amplitude (P,) in electrons, and which pixels saturated, of one frame.

    Without `rng` the converter and all noise are omitted; the result is the mean measurement.
    """
    P = charge.lag.size
    none = np.zeros((4, 0))
    empty = np.zeros((4, 0), np.complex128)
    noise = none.astype(np.float32) if rng is None else rng.standard_normal((4, P), dtype=np.float32)
    phase, amplitude, full = _taps(
        charge.phasor,
        empty if charge.third is None else charge.third,
        empty if charge.fifth is None else charge.fifth,
        charge.steady,
        charge.lag,
        none if charge.extra is None else charge.extra,
        noise,
        config.read_noise_e,
        config.full_well_ke * 1e3,
        config.full_well_ke * 1e3 / 2**config.adc_bits,
    )
    scale = metres_per_radian(config.modulation_mhz)
    unambiguous = 2 * math.pi * scale
    fine = phase * scale
    return fine + unambiguous * np.round((charge.coarse - fine) / unambiguous), amplitude, full


@njit(cache=True, error_model="numpy")
def _taps(
    first: NDArray[np.complex128],
    third: NDArray[np.complex128],
    fifth: NDArray[np.complex128],
    steady: Float,
    lag: Float,
    extra: Float,
    noise: NDArray[np.float32],
    read: float,
    full_well: float,
    step: float,
) -> tuple[Float, Float, Mask]:
    P = lag.size
    phase, amplitude, full = np.zeros(P), np.zeros(P), np.zeros(P, np.bool_)
    noisy, harmonic, added = noise.shape[1] > 0, third.shape[1] > 0, extra.shape[1] > 0
    electrons = np.empty(4)
    for p in range(P):
        turn = complex(math.cos(lag[p]), math.sin(lag[p]))
        for k in range(4):
            # correlation with the reference shifted by k quarter periods: Re(z e^{-j k pi/2})
            z = first[k, p] * turn
            n = steady[k, p] + (z.real, z.imag, -z.real, -z.imag)[k]
            if harmonic:
                z = third[k, p] * turn**3
                n += (z.real, -z.imag, -z.real, z.imag)[k]
                z = fifth[k, p] * turn**5
                n += (z.real, z.imag, -z.real, -z.imag)[k]
            if added:
                n += extra[k, p]
            if noisy:
                n += math.sqrt(max(n, 0.0) + read * read) * noise[k, p]
                n = math.floor(n / step + 0.5) * step
            if n >= full_well:
                n = full_well
                full[p] = True
            electrons[k] = n
        x, y = electrons[0] - electrons[2], electrons[1] - electrons[3]
        phase[p] = math.atan2(y, x)
        amplitude[p] = 0.5 * math.sqrt(x * x + y * y)
    return phase, amplitude, full
