# SPDX-License-Identifier: Apache-2.0
"""Light from lamp to surface to lens, by its true path; then what the lens does to it. Pixels get phasors of every order."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from scipy import fft

from benchmarks.emerging.waveform import ORDERS
from tof_virtual.sight import Rays
from tof_virtual.taps import SPEED_OF_LIGHT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.emerging.device import Device
    from benchmarks.emerging.surfaces import Surfaces
    from tof_core.arrays import Float
    from tof_virtual.sight import Sight

SIGNAL_RANGE_M = 0.8
"""Range at which `signal_ke` is stated, for albedo 0.5."""
NEIGHBOUR_M = np.array([0.5, -0.3, -0.1])
"""Another camera's lamp beside this camera, in this camera's frame."""
COAT_GRAZING = 24.0
"""Reflectance of a coat (refractive index 1.5) at grazing incidence over that at normal incidence, less one."""
BEAT_HZ = 150.0
"""Difference of the two cameras' modulation frequencies: crystals of the same type."""
BEAT_STEP_S = 1e-3
"""Time between sub-frames, for the beat."""


@dataclass(slots=True, eq=False)
class Light:
    """Light on P pixels, in electrons of a sub-frame at full exposure.

    `steady` (P,): all light. `orders` (F, N, P): phasors of the own lamp's light at each frequency and order of
    `waveform.ORDERS`, e^(-j n omega path / c). `other` (P,): another lamp's phasor at the first frequency and order, `phase` its
    phase at the capture's start.
    """

    steady: Float
    orders: NDArray[np.complex128]
    shape: tuple[int, int]
    other: NDArray[np.complex128] = field(default_factory=lambda: np.zeros(0, np.complex128))
    phase: float = 0.0

    def beat(self, f: int, k: int) -> NDArray[np.complex128]:
        """The other lamp's phasor in step k of frequency f; it modulates at the first frequency alone."""
        if f or not self.other.size:
            return np.zeros(0, np.complex128)
        return np.asarray(self.other * np.exp(1j * (self.phase + 2 * np.pi * BEAT_HZ * BEAT_STEP_S * k)))


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """N ways of light: electrons (N,), length lamp to lens in metres (N,), mean delay within the surface as a length (N,)."""

    strength: Float
    length: Float
    within: Float


def lamp_place(device: Device, T_cell_camera: Float) -> Float:
    """The lamp (3,) in the cell: beside the lens, to the right and down in the image."""
    lamp = device.lamp
    local = 1e-3 * np.array([lamp.baseline_mm + lamp.offset_x_mm, lamp.offset_y_mm, 0.0])
    return np.asarray(T_cell_camera[:3, :3] @ local + T_cell_camera[:3, 3])


def direct(rays: Rays, points: Float, real: Surfaces, device: Device, lamp: Float, power: float) -> tuple[Paths, Float]:
    """Light that one surface sends back, where the lamp sees it; and its true albedo (N,).

    Lambert's law and the inverse square of the way from the lamp: the radiance of a surface does not fall on the way to the lens.
    """
    soup = real.world.soup
    hit = rays.face >= 0
    points = np.where(hit[:, None], points, 0.0)
    albedo = real.albedo_at(points, rays.face)
    unit = 1e3 * device.world.signal_ke / 0.5 * SIGNAL_RANGE_M**2 * power
    to_lamp, from_lens = lamp - points, points - rays.origin
    far, back = np.linalg.norm(to_lamp, axis=1), np.linalg.norm(from_lens, axis=1)
    normals = soup.normals[rays.face]
    facing = normals * -np.sign(np.einsum("ij,ij->i", normals, from_lens))[:, None]
    cosine = np.einsum("ij,ij->i", facing, to_lamp) / np.maximum(far, 1e-9)
    lit = hit & (cosine > 0)
    lit[lit] = ~real.world.tree.blocked(points[lit] + 1e-6 * facing[lit], np.broadcast_to(lamp, points[lit].shape))
    reflect = albedo.copy()
    if real.gloss.any():
        reflect += _lobe(real, rays.face, facing, to_lamp / far[:, None], -from_lens / back[:, None])
    strength = np.where(lit, unit * reflect * cosine / np.maximum(far, 0.05) ** 2, 0.0)
    length = far + back + real.crosses(rays.origin, points) + real.crosses(lamp, points)
    within = np.where(hit, real.translucent_m[soup.body[rays.face]], 0.0)
    return Paths(strength, np.where(hit, length, 0.0), within), albedo


def _lobe(real: Surfaces, face: NDArray[np.int32], normals: Float, to_lamp: Float, to_lens: Float) -> Float:
    """Reflectance of a glossy coat over a matt surface of albedo 1 (Blinn-Phong, normalised)."""
    half = to_lamp + to_lens
    half /= np.maximum(np.linalg.norm(half, axis=1), 1e-9)[:, None]
    exponent = 2 / real.gloss_rough**2 - 2
    shine = np.clip(np.einsum("ij,ij->i", normals, half), 0, 1) ** exponent
    return np.asarray(np.where(face >= 0, real.gloss[real.world.soup.body[face]], 0.0) * (exponent + 8) / 8 * shine)


def mirrored(rays: Rays, points: Float, real: Surfaces, device: Device, lamp: Float, power: float) -> tuple[NDArray[np.int64], Paths]:
    """What a glossy surface mirrors: rays whose mirror image meets a lit surface, and the light of that."""
    soup = real.world.soup
    hit = rays.face >= 0
    shiny = np.flatnonzero(hit & (real.gloss[soup.body[rays.face]] > 0))
    seen = points[shiny] - rays.origin
    back = np.linalg.norm(seen, axis=1)
    along = seen / back[:, None]
    n = soup.normals[rays.face[shiny]]
    cosine = np.einsum("ij,ij->i", along, n)
    away = along - 2 * cosine[:, None] * n
    start = points[shiny] - 1e-5 * np.sign(cosine)[:, None] * n
    t, face = real.world.tree.cast(start, away)
    met = face >= 0
    second = start[met] + away[met] * t[met, None]
    image = _from(second, face[met], start[met], along[met], t[met])
    shiny, cosine = shiny[met], np.abs(cosine[met])
    paths, _ = direct(image, second, real, device, lamp, power)
    # a coat's reflectance grows towards grazing incidence as Schlick's approximation has it, in proportion to its cover
    reflectance = np.minimum(real.gloss[soup.body[rays.face[shiny]]] * (1 + COAT_GRAZING * (1 - cosine) ** 5), 1.0)
    return shiny, Paths(reflectance * paths.strength, paths.length + back[met], paths.within)


def _from(points: Float, face: NDArray[np.int32], start: Float, direction: Float, distance: Float) -> Rays:
    """Rays that each begin at their own point; `direct` needs origins and faces alone."""
    return Rays(distance, face, np.ones(len(points)), direction, start)


def gather(
    device: Device,
    real: Surfaces,
    sight: Sight,
    omega: Float,
    indirect: NDArray[np.complex128] | None,
    power: float,
) -> Light:
    """Light on all pixels of a view. `indirect` (F, N, P): irradiance by other surfaces over the lamp's intensity, with phase.

    Pixels that see an edge sum all rays of their footprint.
    """
    lamp = lamp_place(device, sight.T_cell_camera)
    steady, orders, albedo = _of(sight.main, sight.main.points, device, real, lamp, omega, power)
    if sight.edge.size:
        E, S = sight.edge.size, sight.samples
        part, part_orders, _ = _of(sight.parts, sight.parts.points, device, real, lamp, omega, power)
        steady[sight.edge] = part.reshape(E, S).mean(axis=1)
        orders[..., sight.edge] = part_orders.reshape(*orders.shape[:2], E, S).mean(axis=-1)
    if indirect is not None:
        scale = device.lamp.flood_share * 1e3 * device.world.signal_ke / 0.5 * SIGNAL_RANGE_M**2 * power * albedo
        orders += scale * indirect
        steady += scale * np.abs(indirect[0, 0])
    light = Light(steady, orders, sight.shape)
    if device.world.neighbour > 0:
        _neighbour(light, sight, real, device, omega[0])
    return through_lens(light, device)


def _of(
    rays: Rays, points: Float, device: Device, real: Surfaces, lamp: Float, omega: Float, power: float
) -> tuple[Float, NDArray[np.complex128], Float]:
    """All light (N,), phasors (F, orders, N) and true albedo (N,) of rays."""
    paths, albedo = direct(rays, points, real, device, lamp, power)
    orders = _phasors(paths.strength, paths.length, paths.within, omega / SPEED_OF_LIGHT, len(ORDERS))
    steady = paths.strength + 1e3 * device.world.ambient_ke / 0.5 * albedo
    if real.gloss.any():
        shiny, more = mirrored(rays, points, real, device, lamp, power)
        orders[..., shiny] += _phasors(more.strength, more.length, more.within, omega / SPEED_OF_LIGHT, len(ORDERS))
        steady[shiny] += more.strength
    return steady, orders, albedo


def _neighbour(light: Light, sight: Sight, real: Surfaces, device: Device, omega: float) -> None:
    """Add the light of another camera's lamp, which stands beside this one's place."""
    T = sight.T_cell_camera
    lamp = T[:3, :3] @ NEIGHBOUR_M + T[:3, 3]
    paths, _ = direct(sight.main, sight.main.points, real, device, lamp, device.world.neighbour)
    light.other = paths.strength * np.exp(-1j * omega / SPEED_OF_LIGHT * paths.length)
    light.steady += paths.strength


@njit(cache=True)
def _phasors(strength: Float, length: Float, within: Float, wavenumbers: Float, orders: int) -> NDArray[np.complex128]:
    """(F, orders, N): strength times e^(-j n k length), less and later by an exponential way within the surface."""
    F, N = wavenumbers.size, strength.size
    out = np.zeros((F, orders, N), np.complex128)
    for f in range(F):
        for i in range(N):
            if strength[i] <= 0:
                continue
            turn = wavenumbers[f] * length[i]
            z1 = complex(np.cos(turn), -np.sin(turn))
            z2 = z1 * z1
            z = strength[i] * z1
            for n in range(orders):
                if n:
                    z *= z2
                out[f, n, i] = z / complex(1.0, (2 * n + 1) * wavenumbers[f] * within[i]) if within[i] > 0 else z
    return out


def through_lens(light: Light, device: Device) -> Light:
    """Scattering, ghost and cover glass, on the light of every order."""
    o = device.optics
    F, N = light.orders.shape[:2]
    if o.ghost_share > 0:
        light.orders += o.ghost_share * light.orders[..., ::-1]
        light.steady += o.ghost_share * light.steady[::-1]
    if o.cover_share > 0:
        across = np.broadcast_to(1 + 0.5 * np.linspace(-1, 1, light.shape[1]), light.shape).ravel()
        electrons = o.cover_share * 1e3 * device.world.signal_ke * across
        nominal = 2 * np.pi * np.array(device.frequencies) * (1 + 1e-6 * device.clock.pll_ppm) / SPEED_OF_LIGHT
        turns = np.exp(-1j * nominal[:, None] * np.array(ORDERS) * 1e-3 * o.cover_mm)
        light.orders += turns[..., None] * electrons
        light.steady += electrons
    if o.stray_share > 0:
        planes = np.concatenate([light.orders.reshape(F * N, -1), light.steady[None].astype(complex)])
        spread = _scattered(planes.reshape(-1, *light.shape), o.stray_px).reshape(planes.shape)
        mixed = (1 - o.stray_share) * planes + o.stray_share * spread
        light.orders, light.steady = mixed[:-1].reshape(light.orders.shape), mixed[-1].real.copy()
    return light


def _scattered(planes: NDArray[np.complex128], width: float) -> NDArray[np.complex128]:
    """Images (n, H, W) convolved with a point spread of unit sum that falls as 1 / (1 + (r / width)^2)^1.5; nothing outside."""
    H, W = planes.shape[1:]
    size = (fft.next_fast_len(2 * H), fft.next_fast_len(2 * W))
    v, u = (np.minimum(np.arange(n), n - np.arange(n)) for n in size)
    spread = (1 + (v[:, None] ** 2 + u[None] ** 2) / width**2) ** -1.5
    blurred = fft.ifft2(fft.fft2(planes, size) * fft.fft2(spread / spread.sum()))
    return np.asarray(blurred[:, :H, :W])
