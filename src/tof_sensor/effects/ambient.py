# SPDX-License-Identifier: Apache-2.0
"""Ambient light: its photons cancel in the phase, but their noise remains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from tof_core.config import param
from tof_core.stats import CHI2_MEDIAN, least_deviations
from tof_sensor.effect import Detection, Effect, Evidence
from tof_sensor.frame import with_noise
from tof_sensor.session import LN_AGREES, NO_AMPLITUDE

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.frame import Frame
    from tof_sensor.session import NoiseBins, Session

LEAST_EXCESS = 0.25
"""Median variance of ambient light, as a share of the law's, from which it may be named: noise 12 % above the law. Terms of the camera's own
noise, fitted beside it, leave 0.12 at most in 28 healthy sessions of the emerging camera, whose variance exceeds the law by up to 220 %, and
0.22 in a later one, whose noise rises toward grazing surfaces."""
LEAST_SHARE = 0.75
"""Least share of the views with half of that excess, of those whose noise is known: ambient light does not come in bursts."""
LEAST_KNOWN = 0.5
"""Least share of all views whose noise is known: few views that are left of a session, where the others lost most pixels, do not speak for it."""
LEAST_BINS = 12
"""Fewest amplitude bins from which a dependence on amplitude can be judged."""
SURFACE_LEAST = 0.1
"""Ratio of the variance by light off the surfaces to that by light uniform over the image (reference amplitude, 1 m), below which the excess
may be read-out noise: uniform light and read-out both add a constant number of electrons. Light off the surfaces does not."""
READ_OUT = (
    "record once more with sunlight and lamps shaded: noise that disappears was theirs, noise that stays is the camera's read-out noise; "
    "longer dwells reduce both"
)
"""Remedy where ambient light and read-out noise cannot be distinguished."""
BETTER = 0.9
"""Ratio of squared misfits, with ambient light and with the camera's own noise alone, above which ambient light is not named: two more terms
reduce the misfit by chance, by 0.99 in healthy sessions."""
KNOWN = 2.0
"""Least ratio of the light's median variance to what all terms together leave of a usual bin. Cameras that average leave 0.3 to 0.5 of the
variance, since creases and textures look like noise: no term of that size is known there. Sunlight in eleven sessions: 2.3 and more."""
DARK = 0.25
"""Share of the bins, the darkest, without which the light must be found again: grazing surfaces and weak light have noise of other causes."""
CONFIRMED = 0.5
"""Least ratio of the light's variance without these bins to that with them. Sunlight in eleven sessions: 0.7 and more; a long pulse: 0.36."""
GROWS = 0.15
"""Least exponent with which the ratio of noise to the law grows over the squared range (over the cosine) at the same amplitude, as light off the
surfaces makes it, or falls with amplitude, as uniform light does. A shorter exposure or a frequency that hardly returns makes the whole law
larger: exponents of 0.04 and 0.06; sunlight in six sessions: 0.28 to 1.8."""
NEARER = 0.5
"""Least ratio of that exponent to the one that light off the surfaces would make of the same excess, where half of that is less than `GROWS`: the
measured one is then nearer to that of light than to 0. A law with much light off the surfaces is enlarged nearly as a whole by more of it: by
0.08 to 0.14 in four sessions under sunlight."""
CONSTANT = 0
"""Of the camera's own terms (`_own_terms`), the noise at every amplitude. `GROWS` is judged without it: beside it all light falls with amplitude,
that of a lamp as well as that of the sun, and bright surfaces, which are the near ones, seem to have gained as much as far ones."""
LEAST_LEFT = 0.2
"""Least share of a bin's variance that is left when noise at every amplitude is taken off: the rest is known no better."""
LESS_LIGHT = slice(1, 3)
"""Of the camera's own terms (`_own_terms`), those of less modulated light."""
WHOLE = 1.0
"""Most of the camera's own noise beyond the law, in variances of the law, where it averages over whole neighbourhoods (`seen.noise.whole_average`): there
the law leaves 0.6 to 1.1 of the variance of two healthy cameras, and 2.5 times it would explain weak sunlight as well as light does."""
CAP2 = 9.0
"""Largest squared misfit of a bin that counts in full, over the median's: beyond three standard deviations a bin holds edges."""


@dataclass(frozen=True, slots=True)
class Ambient(Effect):
    """sigma_r^2 = surface^2 (r^2 / cos theta) A0 / A + uniform^2 (A0 / A)^2, beyond the photon law (Lange and Seitz 2001; docs/effects.md).

    A count B of ambient photons causes phase noise B / 2 A^2. Ambient light reflected by surfaces has B ~ albedo ~ A r^2 / cos theta;
    light uniform over the image has a constant B.
    """

    NAME: ClassVar[str] = "ambient"
    ORDER: ClassVar[int] = 71
    MEANING: ClassVar[str] = "light that is not the camera's own makes the depth noisier"
    REMEDY: ClassVar[str] = "shade the cell from sunlight and lamps, or record longer dwells"
    SEPARATED_BY: ClassVar[str] = "the same poses with the foreign light switched off"
    EVIDENCE: ClassVar[Evidence] = Evidence.NOISE
    MODULATED: ClassVar[bool] = True

    surface_m: float = param(
        0.0, "noise of foreign light off the surface, at the reference amplitude, 1 m and head-on", unit="m", low=0.0, high=0.2
    )
    uniform_m: float = param(0.0, "noise of foreign light on every pixel alike at the reference amplitude", unit="m", low=0.0, high=0.2)
    reference: float = param(1.0, "reference amplitude in the camera's unit", low=1e-12)

    @property
    def like_read_out(self) -> bool:
        """Whether read-out noise of the camera would leave the same trace."""
        return self.surface_m**2 < SURFACE_LEAST * self.uniform_m**2

    @property
    def rivals(self) -> tuple[str, ...]:
        """Noise, if no light off the surfaces is found."""
        return ("noise",) if self.like_read_out else ()

    @property
    def remedy(self) -> str:
        """Shade the cell; where read-out noise is possible, find out by shading."""
        return READ_OUT if self.like_read_out else self.REMEDY

    def variance(self, amplitude: Float, surroundings2: Float) -> Float:
        """m^2 along the ray at amplitudes and squared ranges over the cosine of incidence (`Frame.surroundings_m2`)."""
        ratio = self.reference / np.maximum(amplitude, 1e-12)
        return np.asarray(self.surface_m**2 * surroundings2 * ratio + (self.uniform_m * ratio) ** 2)

    def noise(self, frame: Frame) -> Float:
        """(H, W) metres of z."""
        return np.asarray(np.sqrt(self.variance(frame.amplitude, frame.surroundings_m2)) / frame.length)

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Add the noise of the foreign photons."""
        return with_noise(frame, self.noise(frame), rng)

    def added_to(self, law: PhotonLaw) -> PhotonLaw:
        """The photon law of the camera under this light."""
        ratio = self.reference / law.reference
        return replace(
            law,
            far_m=float(np.sqrt(law.far_m**2 + self.surface_m**2 * ratio)),
            ambient_m=float(np.sqrt(law.ambient_m**2 + (self.uniform_m * ratio) ** 2)),
        )

    @classmethod
    def lacks(cls, session: Session) -> str:
        """An amplitude image, one exposure, an average over the same neighbours everywhere, or a photon law to compare with."""
        if not session.has_amplitude:
            return NO_AMPLITUDE
        if session.exposed:
            found = _compared(session)
            more = (
                ""
                if found is None or found.excess < LEAST_EXCESS
                else f"; here noise is {found.times:.1f} times that of the photon law in --sensor"
            )
            return f"brighter views or pixels are noisier at the same amplitude, as under automatic or merged exposures, or where near views move more{more}"
        if session.noise_of_steps:
            return "noise grows with the steps of the fixed pattern: the camera averages over fewer neighbours there than the photon law assumes"
        if session.law is None:
            return "no noise to compare with: pass --sensor with the sensor.yaml of a session of this camera without ambient light"
        if session.noise is not None and len(session.noise.view) < LEAST_BINS:
            if session.law.darkest > 0.0:
                return f"the photon law in --sensor was measured at amplitudes from {session.law.darkest:.3g} on, and hardly a surface is as bright here"
            return "the views share too few amplitudes away from edges to compare their noise with the photon law in --sensor"
        found = None if session.averages else _compared(session)
        if found is None or found.less + found.light < LEAST_EXCESS or found.is_light:
            return ""
        return (
            f"noise is {found.times:.1f} times that of the photon law in --sensor at all amplitudes, as with a shorter exposure, a weaker lamp or a "
            "frequency that hardly returns: compare the camera's mode with that of the session of sensor.yaml"
        )

    @classmethod
    def detect(cls, session: Session) -> Detection | None:
        """Noise beyond the law of `--sensor`, in most views, with the amplitude dependence of ambient light."""
        found = _compared(session)
        if (
            found is None
            or found.light < LEAST_EXCESS
            or found.views < LEAST_SHARE
            or found.known_views < LEAST_KNOWN
            or not (found.is_light and found.known)
        ):
            return None
        assert session.law is not None
        surface, uniform = np.sqrt(found.terms)
        effect = cls(surface_m=min(float(surface), 0.2), uniform_m=min(float(uniform), 0.2), reference=session.law.reference)
        times = float(np.sqrt(1.0 + found.light))
        or_own = ", from foreign light or the camera's read-out" if effect.like_read_out else ""
        return Detection(effect, 0.95, note=f"noise {times:.1f} times that of the photon law in --sensor{or_own}")


class _Compared(NamedTuple):
    """Noise beyond the law of `--sensor`, medians over the bins in variances of the law.

    excess: as measured; light: by foreign light; less: by less light of the camera's own, the law times a factor or 1/A; grows: exponent
    (`GROWS`); by_light: the exponent if all of the excess were light off the surfaces; known_views: share of all views whose noise is
    known; views: share of these that show at least half of `LEAST_EXCESS`; terms: (2,) m^2, light off the surfaces and uniform light;
    known: whether light is needed, and found without the darkest bins.
    """

    excess: float
    light: float
    less: float
    grows: float
    by_light: float
    views: float
    known_views: float
    terms: Float
    known: bool

    @property
    def times(self) -> float:
        """Median standard deviation over the law's."""
        return float(np.sqrt(1.0 + self.excess))

    @property
    def is_light(self) -> bool:
        """Whether the law is not only larger as a whole."""
        return self.grows >= min(GROWS, NEARER * self.by_light)


def _compared(session: Session) -> _Compared | None:
    """The session's noise against the stated law; None without a law, or with too few bins."""
    law, bins = session.law, session.noise
    if law is None or bins is None or len(bins.view) < LEAST_BINS:
        return None
    bins, law = replace(bins, variance=law.of_whole(bins.variance)), law.whole
    predicted = law.variance(bins.amplitude, bins.surroundings2)
    excess = bins.variance - predicted
    of_view = np.array([np.median((excess / predicted)[bins.view == v]) for v in np.unique(bins.view)])
    ratio = law.reference / bins.amplitude
    own, most = _own_terms(law, bins, predicted, averages=session.averages)
    foreign = np.stack([bins.surroundings2 * ratio, ratio**2], axis=1)
    either, free = np.concatenate([own, foreign], axis=1), np.append(most, [np.inf, np.inf])
    fitted = _fitted(either, excess, bins, free)
    light, model = foreign @ fitted[own.shape[1] :], either @ fitted
    bright = bins.amplitude >= np.quantile(bins.amplitude, DARK)
    again = foreign @ _fitted(either[bright], excess[bright], bins.of(bright), free)[own.shape[1] :]
    of_light = float(np.median(light / predicted))
    known = (
        of_light >= KNOWN * float(np.median(np.abs(excess - model) / bins.variance))
        and _misfit2(model, excess, bins) <= BETTER * _misfit2(own @ _fitted(own, excess, bins, most), excess, bins)
        and np.median((again / predicted)[bright]) >= CONFIRMED * np.median((light / predicted)[bright])
    )
    return _Compared(
        excess=float(np.median(excess / predicted)),
        light=of_light,
        less=float(np.median(own[:, LESS_LIGHT] @ fitted[LESS_LIGHT] / predicted)),
        grows=_grows(bins, np.maximum(bins.variance - own[:, CONSTANT] * fitted[CONSTANT], LEAST_LEFT * bins.variance), predicted),
        by_light=_grows(bins, predicted + foreign[:, 0] * max(float(np.median(excess / foreign[:, 0])), 0.0), predicted),
        views=float((of_view > 0.5 * LEAST_EXCESS).mean()),
        known_views=len(of_view) / max(len(session.views), len(of_view)),
        terms=fitted[own.shape[1] :],
        known=bool(known),
    )


def _grows(bins: NoiseBins, variance: Float, predicted: Float) -> float:
    """Exponent of a noise variance over the law in squared range over the cosine, at one amplitude, or minus that in amplitude if larger."""
    log = np.log(np.maximum(variance, 1e-14) / predicted)
    X = np.stack([np.ones_like(log), np.log(bins.amplitude), np.log(bins.surroundings2)], axis=1)
    _, of_amplitude, of_surroundings = least_deviations(X, log, LN_AGREES)
    return float(max(of_surroundings, -of_amplitude))


def _own_terms(law: PhotonLaw, bins: NoiseBins, predicted: Float, *, averages: bool) -> tuple[Float, Float]:
    """(n, k) the camera's own noise beyond its law, and (k,) the largest coefficients.

    Constant, as by pixel offsets; by less modulated light; the law times a factor. A camera that averages takes in fewer neighbours the
    more the surface steps from pixel to pixel, and its noise is higher there: by the square of range times the tangent of incidence. Where
    it averages over whole neighbourhoods, its other noise is not twice the law's.
    """
    columns = [np.ones_like(predicted), law.reference / bins.amplitude, predicted]
    if not averages:
        return np.stack(columns, axis=1), np.full(3, np.inf)
    columns.append(predicted * np.maximum(bins.surroundings2**2 / bins.range2 - bins.range2, 0.0))
    return np.stack(columns, axis=1), np.array([np.inf, WHOLE * max(law.shot_m**2, 1e-14), WHOLE, np.inf])


def _fitted(X: Float, excess: Float, bins: NoiseBins, most: Float) -> Float:
    """Coefficients from 0 to `most` (k,) by least squares on relative errors, without outlying bins."""
    from scipy.optimize import lsq_linear  # loads slowly, and only a fit needs it

    weight = np.sqrt(bins.samples / 2) / np.maximum(bins.variance, 1e-14)
    scale = np.maximum(np.median(X, axis=0), 1e-30)
    keep: Mask = np.ones(len(excess), bool)
    c = np.zeros(X.shape[1])
    for _ in range(3):
        A = X[keep] / scale * weight[keep, None]
        c = lsq_linear(A, excess[keep] * weight[keep], (0.0, most * scale), method="bvls").x / scale
        off = np.abs((excess - X @ c) / np.maximum(bins.variance, 1e-14))
        keep = off <= 4.0 * np.median(off[keep]) + 1e-12
    return np.asarray(c)


def _misfit2(model: Float, excess: Float, bins: NoiseBins) -> float:
    """Mean squared error of a model of the excess variance, in variances of each bin's estimate; outlying bins count as `CAP2` medians."""
    error2 = ((excess - model) / np.maximum(bins.variance, 1e-14)) ** 2 * bins.samples / 2
    return float(np.mean(np.minimum(error2, CAP2 / CHI2_MEDIAN * np.median(error2))))
