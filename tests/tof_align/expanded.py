# SPDX-License-Identifier: Apache-2.0
"""The columns of a view written out from their definition: what `tof_align.view_columns` must agree with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_align.bounced import bounced_columns
from tof_align.discrepancy import image_columns, spline_entries, surface_columns
from tof_align.parts import MOTIONS, part_entries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_align.discrepancy import Basis
    from tof_align.linearise import Linearised
    from tof_align.parts import PartFrames
    from tof_core.arrays import Float


def written_out(entries: tuple[NDArray[np.int32], Float], count: int) -> Float:
    """(n, count) columns from places and values (n, e)."""
    place, value = entries
    out = np.zeros((len(place), count))
    if not count:
        return out
    np.add.at(out, (np.arange(len(place))[:, None], place), value)
    return out


def part_columns(parts: PartFrames, view: Linearised) -> Float:
    """(n, 6 P) metres of z per metre of each part's motions."""
    return written_out(part_entries(parts, view), MOTIONS * len(parts.index))


def shared_columns(basis: Basis, view: Linearised) -> Float:
    """(n, sum(basis.shared)) columns of the kinds all views share; unit-variance coefficients."""
    blocks = [np.zeros((len(view.residual), 0))]
    if basis.root_range.size:
        blocks.append(
            written_out(spline_entries(basis.knots_range, view.depth * view.ray_length), len(basis.knots_range)) @ basis.root_range
        )
    if basis.root_amplitude.size:
        a = view.log_amplitude if view.log_amplitude is not None else np.full(len(view.residual), np.nan)
        blocks.append(written_out(spline_entries(basis.knots_amplitude, a), len(basis.knots_amplitude)) @ basis.root_amplitude)
    if basis.root_object.size:
        blocks.append(surface_columns(basis, view) @ basis.root_object)
    if basis.order > 0:
        blocks.append(image_columns(view, basis.order))
    blocks.append(bounced_columns(basis.emitters, view))
    if basis.lens_m > 0 and view.lens is not None:
        blocks.append(view.lens / basis.lens_m)
    return np.concatenate([*blocks, part_columns(basis.parts, view)], axis=1)


def local_columns(basis: Basis, view: Linearised) -> Float:
    """(n, sum(basis.local)) columns of one view's own kinds: an offset, and what is smooth in the image."""
    n = len(view.residual)
    if basis.order < 0:
        return np.zeros((n, 0))
    return np.concatenate([np.ones((n, 1)), image_columns(view, basis.order)], axis=1)
