# SPDX-License-Identifier: Apache-2.0
"""The columns of one view, kept as products, and what is computed with them.

A column of the discrepancy is a combination of raw columns by the root of a covariance. Raw columns of range, amplitude and part motion
have few entries in a row (four cubic B-splines, six motions). Therefore products are summed over raw columns, and the small roots are
applied to the sums. The results are the same to rounding, in a tenth of the operations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_align.bounced import bounced_columns
from tof_align.discrepancy import LOCAL, SHARED, empty_basis, image_columns, image_count, spline_entries, surface_columns
from tof_align.parts import MOTIONS, part_entries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_align.discrepancy import Basis
    from tof_align.limits import SharedLimits
    from tof_align.linearise import Linearised
    from tof_core.arrays import Float

ORDER = ("camera", *SHARED, "extra", "offset", "image", "residual")
"""Order of the columns in the normal equations; those of the image appear twice, shared by all views and for each view."""
SPARSE = ("range", "amplitude", "part")
"""Kinds whose raw columns are sparse, kept as entries."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewColumns:
    """[camera 6 | shared | extra | own | residual] for the n pixels of a view.

    at: places of the raw columns of each kind; roots: root of the covariance that combines them, per kind (none: not combined);
    dense (n, d): raw columns of all kinds but `SPARSE`; entries: per kind of `SPARSE` the places (n, e) among all raw columns, ascending,
    and the values (n, e) there.
    """

    at: dict[str, slice]
    roots: dict[str, Float]
    dense: Float
    entries: dict[str, tuple[NDArray[np.int32], Float]]
    bend: int

    def gram(self, weight: Float) -> Float:
        """(p, p) products of all columns, weighted with inverse variances (n,)."""
        root = np.sqrt(weight)[:, None]
        dense, size = self.dense * root, max(s.stop for s in self.at.values())
        raw = np.zeros((size, size))
        if self.entries:
            places, values = zip(*self.entries.values(), strict=True)
            _add_entries(dense, np.concatenate(places, axis=1), np.concatenate(values, axis=1) * root, raw)
            raw += np.tril(raw, -1).T
        raw[: dense.shape[1], : dense.shape[1]] = dense.T @ dense
        return self._combined(self._combined(raw).T)

    def unmodelled(self, shared: Float, own: Float) -> Float:
        """(n, kinds) metres that each kind of `SHARED` and `LOCAL` explains, for the coefficients of its columns."""
        out, of = np.zeros((len(self.dense), len(SHARED) + len(LOCAL))), np.zeros((self.dense.shape[1], len(SHARED) + len(LOCAL)))
        start = 0
        for k, kind in enumerate(SHARED):
            at, root = self.at[kind], self.roots.get(kind)
            count = at.stop - at.start if root is None else root.shape[1]
            mine = shared[start : start + count]
            mine, start = mine if root is None else root @ mine, start + count
            if kind in self.entries:
                place, value = self.entries[kind]
                out[:, k] = np.einsum("ij,ij->i", mine[place - at.start], value)
            elif kind not in SPARSE:
                of[at, k] = mine
        offset, image = self.at["offset"], self.at["image"]
        edges = (offset.stop - offset.start, self.bend, len(own))
        of[offset, len(SHARED)] = own[: edges[0]]
        of[image.start : image.start + self.bend, len(SHARED) + 1] = own[edges[0] : edges[0] + self.bend]
        of[image.start + self.bend : image.stop, len(SHARED) + 2] = own[edges[0] + self.bend :]
        out += self.dense @ of
        return out

    def of_extra(self, coefficients: Float) -> Float:
        """(n,) metres that the extra columns explain."""
        return np.asarray(self.dense[:, self.at["extra"]] @ coefficients)

    def beyond(self, sizes: dict[str, float], limits: SharedLimits) -> Float:
        """(n,) standard deviation in metres of errors of the surface that the columns cannot describe.

        A few dozen centres describe the smooth part of a rough process; the variance left at each place is known (the Schur complement
        in Nystroem's approximation). One bounce between matt surfaces leaves the share `limits.light` of the light of other parts, so
        concave places count less.
        """
        out = np.zeros(len(self.dense))
        if "object" in self.roots and "object" in sizes:
            described = self.dense[:, self.at["object"]] @ self.roots["object"]
            rest = 1.0 - np.einsum("ij,ij->i", described, described)
            out = np.asarray(sizes["object"] * np.sqrt(np.maximum(rest, 0.0)))
        bounce = self.at["bounce"]
        if bounce.stop > bounce.start and "bounce" in sizes:
            out = np.hypot(out, limits.light * sizes["bounce"] * self.dense[:, bounce.start])
        return out

    def _combined(self, raw: Float) -> Float:
        """Rows of raw columns to rows of columns, in their order."""
        return np.concatenate([self.roots[kind].T @ raw[self.at[kind]] if kind in self.roots else raw[self.at[kind]] for kind in ORDER])


def columns_of(view: Linearised, basis: Basis | None = None, extra: Float | None = None) -> ViewColumns:
    """The columns of a view: its camera's, those of a basis (default: none), and extra ones (n, k)."""
    basis, n = basis or empty_basis(), len(view.residual)
    dense = {
        "camera": view.jacobian,
        "residual": view.residual[:, None],
        "offset": np.ones((n, int(basis.order >= 0))),
        "image": image_columns(view, basis.order) if basis.order > 0 else np.zeros((n, 0)),
        "object": surface_columns(basis, view) if basis.root_object.size else np.zeros((n, 0)),
        "bounce": bounced_columns(basis.emitters, view),
        "lens": view.lens / basis.lens_m if basis.lens_m > 0 and view.lens is not None else np.zeros((n, 0)),
        "extra": np.zeros((n, 0)) if extra is None else extra,
    }
    counts = {kind: block.shape[1] for kind, block in dense.items()}
    counts |= {"range": len(basis.knots_range), "amplitude": len(basis.knots_amplitude), "part": MOTIONS * len(basis.parts.index)}
    ends = np.cumsum([0, *counts.values()]).tolist()
    at = {kind: slice(a, e) for kind, a, e in zip(counts, ends, ends[1:], strict=False)}
    entries = {}
    if counts["range"]:
        entries["range"] = spline_entries(basis.knots_range, view.depth * view.ray_length)
    if counts["amplitude"]:
        entries["amplitude"] = spline_entries(
            basis.knots_amplitude, np.full(n, np.nan) if view.log_amplitude is None else view.log_amplitude
        )
    if counts["part"]:
        entries["part"] = part_entries(basis.parts, view)
    placed = {kind: (place + np.int32(at[kind].start), value) for kind, (place, value) in entries.items()}
    roots = {"range": basis.root_range, "amplitude": basis.root_amplitude, "object": basis.root_object}
    bend = image_count(min(basis.order, 2))
    return ViewColumns(
        at, {kind: root for kind, root in roots.items() if root.size}, np.concatenate(list(dense.values()), axis=1), placed, bend
    )


@njit(cache=True, nogil=True)
def _add_entries(dense: Float, place: NDArray[np.int32], value: Float, out: Float) -> None:
    """Add to `out` the lower triangle of the products of sparse columns with dense and sparse ones; places ascend in each row."""
    d = dense.shape[1]
    for i in range(len(place)):
        for a in range(place.shape[1]):
            v = value[i, a]
            if v == 0.0:
                continue
            row = out[place[i, a]]
            for j in range(d):
                row[j] += v * dense[i, j]
            for b in range(a + 1):
                row[place[i, b]] += v * value[i, b]
