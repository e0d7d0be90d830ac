# SPDX-License-Identifier: Apache-2.0
"""Where a camera that averages over neighbours takes in all of them: there its noise follows the photon law."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.correlation import NoiseCorrelation
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.session import NoiseBins

LEAST_GROWTH, MOST_GROWTH = 0.6, 2.0
"""Growth of the variance from next neighbours to pixels two apart, over that of the whole session, where an average is whole: a bin of 2000
differences knows its growth to a fifth."""
BROKEN = 1.5
"""Ratio of a variance to that of a whole average, by a law that knows the camera's threshold, from which the noise itself makes the average take in
fewer neighbours: the law says how much noisier that is."""
LEAST_OF_VIEW = 3
"""Fewest such bins of a view whose noise is compared with that of others: the median of two is the mean of one and an outlier."""


def wholly_averaged(bins: NoiseBins, correlation: NoiseCorrelation, law: PhotonLaw | None = None) -> NoiseBins:
    """The bins whose pixels share noise with their neighbours as usual, if the camera averages over them; all bins of other cameras.

    law: a stated one; where it knows from which noise on the camera averages over fewer neighbours, bins with such noise are kept.

    Beside edges, lost pixels and noise beyond a filter's threshold an average takes in fewer neighbours. Noise is higher there, and next
    neighbours share less of it. Creases and steps of the depth code grow faster with the distance of the samples than noise does. In ten
    sessions the noise of views differs by 20 to 30 % in variance over all bins, and by 7 to 12 % over these.
    """
    if not correlation.correlated or bins.growth is None:
        return bins
    flat = without_structure(bins, correlation)
    known = np.zeros(len(flat.view), bool) if law is None else flat.variance > BROKEN * law.of_whole(flat.variance)
    whole = flat.of((_growth(flat, correlation) > LEAST_GROWTH) | known)
    views, number = np.unique(whole.view, return_counts=True)
    return whole.of(np.isin(whole.view, views[number >= LEAST_OF_VIEW]))


def without_structure(bins: NoiseBins, correlation: NoiseCorrelation) -> NoiseBins:
    """The bins of a camera that averages without those whose variance grows faster with the distance of the samples than noise does."""
    return bins if not correlation.correlated or bins.growth is None else bins.of(_growth(bins, correlation) < MOST_GROWTH)


def _growth(bins: NoiseBins, correlation: NoiseCorrelation) -> Float:
    """(n,) growth of the variance from next neighbours to pixels two apart, over that of the whole session."""
    assert bins.growth is not None
    return np.asarray((bins.growth - 1.0) / (correlation.growth - 1.0))
