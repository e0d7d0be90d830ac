# SPDX-License-Identifier: Apache-2.0
"""Effects on the path of the light: gloss, translucency, footprints over two surfaces, scattering in the lens."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import fft
from typing_extensions import override

from tof_virtual.effect import UNIT_M, Effect, Moment
from tof_virtual.pipeline import expose
from tof_virtual.taps import metres_per_radian

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_virtual.optics import Echo, Light
    from tof_virtual.session import Session
    from tof_virtual.sight import Rays, Sight
    from tof_virtual.taps import Charge


class EmitterOffset(Effect):
    """The lamp stands beside the lens: light comes from there, lights what it sees from there, and leaves shadows."""

    name, unit, start, limit = "emitter_offset", "m", 0.03, 0.1

    @override
    def draw(self, rng: np.random.Generator) -> None:
        angle = rng.uniform(0, 2 * np.pi)
        self._direction = np.array([np.cos(angle), np.sin(angle), 0.0])

    @override
    def params(self) -> dict[str, Any]:
        return {"lamp_m": (self.size * self._direction).tolist()}

    @override
    def reflect(self, echo: Echo, rays: Rays, moment: Moment) -> None:
        sight = next(s for s in moment.sights if rays is s.main or rays is s.parts)
        direction = rays.direction if rays is sight.main else np.repeat(sight.main.direction[sight.edge], sight.samples, axis=0)
        lamp = sight.T_cell_camera[:3, :3] @ (self.size * self._direction)
        hit = np.flatnonzero(rays.face >= 0)
        straight, normal = rays.distance[hit], moment.world.soup.normals[rays.face[hit]]
        way = direction[hit] * straight[:, None] - lamp
        length = np.linalg.norm(way, axis=1)
        met, _ = moment.world.tree.cast(np.ascontiguousarray(rays.origin + lamp), np.ascontiguousarray(way / length[:, None]))
        lit = ~(met < length - SHADOW_M)
        cosine = np.abs(np.einsum("ij,ij->i", way, normal)) / length
        echo.strength[hit] *= lit * (straight / length) ** 2 * cosine / np.maximum(rays.cosine[hit], 1e-6)
        echo.distance[hit] += 0.5 * (length - straight)


SHADOW_M = 0.01
"""What stands nearer to the lamp than the seen point by this casts a shadow on it."""


class Ambient(Effect):
    """Light that is not the camera's own falls on the parts: electrons that carry no phase, and their noise."""

    name, unit = "ambient", "e- of a tap from albedo 0.5"
    natural = True
    kind = "scatter"

    @override
    def draw(self, rng: np.random.Generator) -> None:
        c = self.config.camera
        own, noise_rad = 1e3 * c.contrast * c.signal_ke, self.strength * UNIT_M / metres_per_radian(c.modulation_mhz)
        # variance of the phase: electrons of a tap over twice the amplitude's square
        self.size = float(min(2 * (own * noise_rad) ** 2, MOST_FOREIGN * 1e3 * c.full_well_ke))

    @override
    def params(self) -> dict[str, Any]:
        return {"electrons": self.size}

    def _electrons(self, moment: Moment) -> Float:
        main = moment.sight.main
        return self.size * np.where(main.face >= 0, moment.world.soup.albedo[main.face], 0.0) / 0.5

    @override
    def expose(self, charge: Charge, moment: Moment) -> None:
        charge.steady = charge.steady + self._electrons(moment)

    @override
    def level(self, moment: Moment) -> Float:
        frame, scale = expose(moment, ()), metres_per_radian(moment.config.camera.modulation_mhz)
        sigma = scale * np.sqrt(0.5 * self._electrons(moment)) / np.maximum(frame.amplitude, 1.0)
        return np.where(np.isfinite(frame.depth), sigma, np.nan)


MOST_FOREIGN = 0.3
"""Share of the full well that foreign light from albedo 0.5 fills at most: more saturates bright parts."""


class Specular(Effect):
    """A glossy coat: near the mirror direction a lobe is added that may saturate the pixel.

    The coat itself reflects the lobe, while diffuse light travels a little way inside the paint. The calibration takes that
    path as zero, so highlights are measured too near by up to `size`. Blinn-Phong lobe, exponent 2 / roughness^2 - 2.
    """

    name, unit, start, limit = "specular", "m of paint", 5e-3, 0.1
    local = True

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._gloss = float(rng.uniform(0.08, 0.2))
        self._roughness = float(rng.uniform(0.22, 0.4))

    @override
    def params(self) -> dict[str, Any]:
        return {"gloss": self._gloss, "roughness": self._roughness}

    @override
    def reflect(self, echo: Echo, rays: Rays, moment: Moment) -> None:
        hit = rays.face >= 0
        soup = moment.world.soup
        roughness = np.minimum(soup.roughness[rays.face], self._roughness)
        exponent = 2 / np.clip(roughness, 0.03, 1) ** 2 - 2
        cosine = np.where(hit, rays.cosine, 0.0)
        # radiance of the lobe over that of the diffuse light, both for the same irradiance
        lobe = self._gloss * (exponent + 2) / 2 * cosine ** (exponent - 1) / np.maximum(soup.albedo[rays.face], 0.02)
        lobe = np.where(hit, lobe, 0.0)
        echo.strength *= 1 + lobe
        echo.distance -= self.size * lobe / (1 + lobe)


class Subsurface(Effect):
    """One part is translucent: light returns from inside, later and with a tail."""

    name, unit, start, limit = "subsurface", "m of delay", 3e-3, 0.2
    local = True

    @override
    def prepare(self, session: Session) -> None:
        share = session.shares()
        seen = np.where((share > 0.01) & (share < 0.5), share, 0.0)
        weight = seen if seen.any() else share
        self._part = int(self.rng(1).choice(share.size, p=weight / weight.sum()))
        self._name = session.bodies[self._part].name

    @override
    def params(self) -> dict[str, Any]:
        return {"part": self._name, "delay_m": self.size}

    @override
    def reflect(self, echo: Echo, rays: Rays, moment: Moment) -> None:
        inside = (rays.face >= 0) & (moment.world.soup.body[rays.face] == self._part)
        cosine = np.where(inside, rays.cosine, 0.0)
        # light at oblique incidence leaves earlier; the tail of the response reduces the contrast
        delay = self.size * (0.7 + 0.3 * cosine)
        echo.distance = np.where(inside, echo.distance + delay, echo.distance)
        echo.strength = np.where(inside, echo.strength / np.hypot(1, 4 * delay), echo.strength)


class FlyingPixels(Effect):
    """Pixels over an edge sum the light of both surfaces; a strength of 1 is a footprint of just the pixel."""

    name, unit = "flying_pixels", "px"
    local = natural = True

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self.size = float(np.clip(np.sqrt(self.strength), 0.4, 2.5))

    @override
    def footprint(self) -> float:
        return self.size


class LensScatter(Effect):
    """A share of all light spreads over the image: z' = z + s (h * z), with a kernel that has a core and a far tail."""

    name, unit, start, limit = "lens_scatter", "share of the light", 0.01, 0.12
    local = True

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._core = float(rng.uniform(0.04, 0.15))
        self._veil = float(rng.uniform(0.0, 0.4))

    @override
    def params(self) -> dict[str, Any]:
        return {"share": self.size, "core_of_width": self._core, "veil": self._veil}

    def _kernel(self, shape: tuple[int, int]) -> Float:
        """Transform of the kernel on the doubled raster."""
        height, width = shape
        v, u = (np.minimum(np.arange(2 * n), 2 * n - np.arange(2 * n)) for n in shape)
        r2 = (v[:, None] ** 2 + u[None] ** 2) / (self._core * width) ** 2
        core = (1 + r2) ** -1.5
        h = (1 - self._veil) * core / core.sum() + self._veil / (height * width)
        return np.asarray(fft.rfft2(h).real)

    @override
    def spread(self, light: Light, sight: Sight, moment: Moment) -> None:
        kernel = self._kernel(sight.shape)

        def spread(values: Float) -> Float:
            height, width = sight.shape
            image = np.zeros((2 * height, 2 * width))
            image[:height, :width] = values.reshape(sight.shape)
            return np.asarray(self.size * fft.irfft2(fft.rfft2(image) * kernel, s=image.shape)[:height, :width].ravel())

        for name in ("first", "third", "fifth"):
            values = getattr(light, name)
            if values.size:
                values += spread(values.real) + 1j * spread(values.imag)
        light.total += spread(light.total)
        light.ambient += spread(light.ambient)
