# SPDX-License-Identifier: Apache-2.0
"""The CAD scene: depth against closed forms, footprints against brute force, the two ray casters, time per view."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from benchmarks.figure import Figure, at_most
from tests.tof_scene.solids import ball, bar, bar_depth, block, camera, looking, rays_in_cell, scene, sphere_depth, wall
from tof_scene.builtin import builtin_names, make_builtin
from tof_scene.builtin.shapes import join
from tof_scene.raycast import Raycaster
from tof_scene.render import render

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask
    from tof_core.camera import Camera
    from tof_scene.render import Rendering

CAMERA = camera(400, 300)
EYES = ((1.0, 0.05, 0.95), (0.7, -0.5, 1.2))
SEED = 4
STEP_M = 1e-3
LOOKED_AT = 500


def run() -> list[Figure]:
    """All figures of this bench."""
    return [*closed_forms(), *footprints(), *casters(), *times()]


def closed_forms() -> list[Figure]:
    """Label depth at a known pose against surfaces with a formula, averaged over 24 x 24 points of each pixel."""
    corner = join(wall(), block(0, -0.05, 0, (8, 0.1, 8)), block(0, 0, -0.05, (8, 8, 0.1)))
    cases: dict[str, tuple[Raycaster, Float, Callable[[Camera, Float], Float]]] = {
        "plane": (Raycaster(scene(wall=wall())), looking((1, 0.2, 0.3), (0, 0, 0)), lambda c, T: -T[0, 3] / rays_in_cell(c, T)[..., 0]),
        "sphere, 0.25 m": (
            Raycaster(scene(b=ball(0.25, 1200))),
            looking((0.8, 0.1, 0.2), (0, 0, 0)),
            lambda c, T: sphere_depth(c, T, 0.25),
        ),
        "cylinder, 0.1 m": (Raycaster(scene(b=bar(0.1))), looking((0.8, 0.1, 0.2), (0, 0, 0)), lambda c, T: bar_depth(c, T, 0.1)),
        "corner of three planes": (Raycaster(scene(c=corner)), looking((0.9, 0.7, 0.6), (0, 0, 0)), corner_depth),
    }
    return [closed_form(name, *case) for name, case in cases.items()]


def closed_form(name: str, caster: Raycaster, T: Float, depth: Callable[[Camera, Float], Float]) -> Figure:
    """The largest error of one case."""
    view = render(caster, CAMERA, T)
    truth = over_pixels(depth, T, 24)
    whole = np.isfinite(truth) & (np.degrees(view.incidence) < 70)
    error = np.abs(view.depth - truth)[whole] * 1e3
    remark = f"largest of {whole.sum()} pixels up to 70 degrees of incidence; mean {error.mean():.4f} mm"
    return at_most(f"ray-cast label against a {name}", float(error.max()), 0.01, "mm", remark=remark)


def corner_depth(cam: Camera, T: Float) -> Float:
    """Depth of three planes through the origin seen from between them."""
    with np.errstate(divide="ignore"):
        t = -T[:3, 3] / rays_in_cell(cam, T)
    return np.asarray(np.where(t > 0, t, np.inf).min(axis=-1))


def over_pixels(depth: Callable[[Camera, Float], Float], T: Float, n: int) -> Float:
    """Mean of a formula over n x n points of each pixel of CAMERA."""
    fine = CAMERA.scaled(n)
    rows = []
    for top in range(0, CAMERA.height, 10):
        strip = type(fine)(fine.width, 10 * n, fine.fx, fine.fy, fine.cx, fine.cy - top * n)
        rows.append(depth(strip, T).reshape(10, n, CAMERA.width, n).mean(axis=(1, 3)))
    return np.concatenate(rows)


def footprints() -> list[Figure]:
    """Interior depth and coverage of mixed pixels on all built-in scenes, against rays of the other library where installed."""
    inner, cover, worst, pixels = [], [], 0, 0
    for name in builtin_names():
        cell = make_builtin(name)
        caster, oracle = Raycaster(cell, "embree"), Raycaster(cell, other())
        for eye in EYES:
            T = looking(eye, (0, 0, 0.8))
            view = render(caster, CAMERA, T)
            rng = np.random.default_rng(SEED)
            where = rng.choice(view.depth.size, 12000, replace=False)
            error, two = interior_error(oracle, view, where)
            inner.append(error)
            mixed = np.union1d(where[two], np.flatnonzero(view.mixed > 0))
            some = rng.choice(mixed, min(LOOKED_AT, len(mixed)), replace=False)
            cover.append(view.mixed.ravel()[some] - second_share(oracle, view, some, 64))
            worst, pixels = max(worst, len(mixed)), pixels + 1
    error, share = np.abs(np.concatenate(inner)) * 1e3, np.concatenate(cover) * 100
    return [
        at_most("footprints: interior depth against 16x16 rays a pixel, 99.9 % of pixels", float(np.quantile(error, 0.999)), 0.02, "mm",
                remark=f"{len(error)} pixels of {pixels} views: rms {np.sqrt(np.mean(error**2)):.4f} mm, largest {error.max():.3f} mm"),
        at_most("footprints: share of the second surface against 64x64 rays a pixel, rms", float(np.sqrt(np.mean(share**2))), 0.5, "%",
                remark=f"{len(share)} mixed pixels; 99 % within {np.quantile(np.abs(share), 0.99):.2f} %, {np.mean(np.abs(share) > 5):.2%} off by over 5 %"),
        at_most("footprints: rays cast per pixel", rays_per_pixel(), 4, "", remark="the rest is drawn: triangles at 89 to 987 points of the pixels that need it"),
    ]  # fmt: skip


def other() -> str:
    """The caster that is not under test, where it is installed."""
    try:
        import open3d  # noqa: F401
    except ImportError:
        return "embree"
    return "open3d"


def samples(oracle: Raycaster, view: Rendering, pixels: NDArray[np.int64], n: int) -> tuple[Float, NDArray[np.int16], Float]:
    """z and part (k, n * n) and slope of z per pixel along u and v (k, n * n, 2) at n x n points of each pixel, by rays."""
    offset = (np.arange(n) + 0.5) / n - 0.5
    dv, du = (a.ravel() for a in np.meshgrid(offset, offset, indexing="ij"))
    v, u = np.divmod(pixels, view.camera.width)
    rays = view.camera.rays_at(np.stack([u[:, None] + du, v[:, None] + dv], -1)).reshape(-1, 3)
    hits = oracle.cast(view.T_cell_camera[:3, 3], rays @ view.T_cell_camera[:3, :3].T)
    normal = hits.normal @ view.T_cell_camera[:3, :3]
    slope = -hits.t[:, None] * normal[:, :2] / np.einsum("ij,ij->i", normal, rays)[:, None] / [view.camera.fx, view.camera.fy]
    return hits.t.reshape(len(pixels), -1), hits.part.reshape(len(pixels), -1), slope.reshape(len(pixels), -1, 2)


def interior_error(oracle: Raycaster, view: Rendering, pixels: NDArray[np.int64]) -> tuple[Float, Mask]:
    """Depth error of the pixels that see one surface, and which of `pixels` see more."""
    z, part, _ = samples(oracle, view, pixels, 16)
    one = (part == part[:, :1]).all(axis=1) & (part[:, 0] >= 0)
    one &= np.diff(np.sort(z, axis=1), axis=1).max(axis=1) < STEP_M
    return (view.depth.ravel()[pixels] - z.mean(axis=1))[one], ~one & (part >= 0).any(axis=1)


def second_share(oracle: Raycaster, view: Rendering, pixels: NDArray[np.int64], n: int) -> Float:
    """Share of the second largest surface of each pixel, by n x n rays."""
    return np.concatenate([_second(*samples(oracle, view, some, n), n) for some in np.array_split(pixels, max(1, len(pixels) // 50))])


def _second(z: Float, part: NDArray[np.int16], slope: Float, n: int) -> Float:
    """A surface: neighbours of one part where the plane of one meets the other within a millimetre, and what continues it in depth."""
    k = len(z)
    at = np.arange(k * n * n).reshape(k, n, n)
    z, part, slope = z.reshape(k, n, n), part.reshape(k, n, n), slope.reshape(k, n, n, 2)
    pairs = []
    for axis, (one, next_one) in enumerate(((np.s_[:, :, :-1], np.s_[:, :, 1:]), (np.s_[:, :-1], np.s_[:, 1:]))):
        step = z[next_one] - z[one]
        miss = np.minimum(np.abs(step - slope[one][..., axis] / n), np.abs(step - slope[next_one][..., axis] / n))
        linked = (part[one] == part[next_one]) & (part[one] >= 0) & (miss < STEP_M)
        pairs.append(np.stack([at[one][linked], at[next_one][linked]]))
    i, j = np.concatenate(pairs, axis=1)
    piece = connected_components(coo_matrix((np.ones(len(i), bool), (i, j)), shape=(at.size, at.size)), directed=False)[1].reshape(k, -1)
    return np.array([_next_largest(*pixel) / n**2 for pixel in zip(z.reshape(k, -1), part.reshape(k, -1), piece, strict=True)])


def _next_largest(z: Float, part: NDArray[np.int16], piece: NDArray[np.int32]) -> int:
    """Samples of the second largest surface; pieces of a part whose depths follow on each other are one."""
    _, first, which, size = np.unique(piece[part >= 0], return_index=True, return_inverse=True, return_counts=True)
    if not len(size):
        return 0
    low, high = np.full(len(size), np.inf), np.full(len(size), -np.inf)
    np.minimum.at(low, which, z[part >= 0])
    np.maximum.at(high, which, z[part >= 0])
    owner = part[part >= 0][first]
    sizes: list[int] = []
    for one in np.unique(owner):
        mine = np.flatnonzero(owner == one)
        mine = mine[np.argsort(low[mine])]
        apart = np.append(True, low[mine][1:] > np.maximum.accumulate(high[mine])[:-1] + STEP_M)
        sizes += np.add.reduceat(size[mine], np.flatnonzero(apart)).tolist()
    return sorted(sizes)[-2] if len(sizes) > 1 else 0


def rays_per_pixel() -> float:
    """Rays that one rendering asks its library for, over all pixels of a view."""
    caster = Raycaster(make_builtin("pipework"))
    inner, cast = caster._backend.nearest, [0]  # noqa: SLF001

    def counted(origins: NDArray[np.float32], directions: NDArray[np.float32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        cast[0] += len(directions)
        return inner(origins, directions)

    caster._backend.nearest = counted  # type: ignore[method-assign]  # noqa: SLF001
    render(caster, CAMERA, looking(EYES[1], (0, 0, 0.8)))
    return cast[0] / (CAMERA.width * CAMERA.height)


def casters() -> list[Figure]:
    """The two libraries on the same 480 000 rays, in turns; `auto` takes the first of tof_scene.backends.ORDER."""
    cell = make_builtin("body_section")
    T = looking(EYES[0], (0, 0, 0.8))
    rays = np.tile(CAMERA.rays().reshape(-1, 3) @ T[:3, :3].T, (4, 1))
    found = {name: Raycaster(cell, name) for name in ("embree", other())}
    start, along = np.tile((T[:3, 3] - cell.bounds().mean(axis=0)).astype(np.float32), (len(rays), 1)), rays.astype(np.float32)
    taken = {name: best(partial(caster._backend.nearest, start, along), 15) for name, caster in found.items()}  # noqa: SLF001
    figures = [
        Figure(f"{name}: 480 000 rays, 73 000 triangles, both cores", wall_ms, "ms", remark=f"processor time {cpu_ms:.0f} ms; best of 15")
        for name, (wall_ms, cpu_ms) in taken.items()
    ]
    if len(found) > 1:
        one, two = (caster.cast(T[:3, 3], rays[:120000]) for caster in found.values())
        differ = float(np.mean(~np.isclose(one.t, two.t, atol=1e-9, equal_nan=True)))
        figures.append(at_most("rays on which embree and open3d differ by more than a nanometre", differ * 100, 0.05, "%"))
    return figures


def times() -> list[Figure]:
    """One 400x300 view of each scene: with footprints, and one ray a pixel; both cores."""
    full, plain = [], []
    for name in builtin_names():
        caster = Raycaster(make_builtin(name))
        for eye in EYES:
            T = looking(eye, (0, 0, 0.8))
            full.append(best(partial(render, caster, CAMERA, T)))
            plain.append(best(partial(render, caster, CAMERA, T, footprints=False)))
    return [
        time_figure("render of one 400x300 view with footprints", full, 200),
        time_figure("render of one 400x300 view, one ray a pixel", plain, 40),
    ]


def time_figure(what: str, taken: list[tuple[float, float]], bar: float) -> Figure:
    """The slowest view's wall time, with the processor time beside it: on a busy machine only the latter says what the work costs."""
    wall_ms, cpu_ms = zip(*taken, strict=True)
    remark = f"slowest of {len(taken)} views, median {np.median(wall_ms):.0f} ms; processor time of both cores {max(cpu_ms):.0f} ms"
    return at_most(what, max(wall_ms), bar, "ms", remark=remark)


def best(work: Callable[[], object], rounds: int = 9) -> tuple[float, float]:
    """Shortest wall and processor time of several runs in milliseconds: what else runs here only ever adds."""
    taken = []
    for _ in range(rounds):
        start, busy = time.perf_counter(), time.process_time()
        work()
        taken.append((time.perf_counter() - start, time.process_time() - busy))
    return min(t for t, _ in taken) * 1e3, min(t for _, t in taken) * 1e3
