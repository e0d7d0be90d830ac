# SPDX-License-Identifier: Apache-2.0
"""Numbers that decide whether another camera's light lies in the views, as stripes or as a bias, and whether its fringes show where the lamp stands."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param


@dataclass(frozen=True, slots=True)
class BeatLimits:
    """When stripes of another light source cross some of the views."""

    rows: int = param(43, "rows of cells that are averaged", low=5, high=999, why="two per period of the finest wave")
    turns: float = param(
        3.0,
        "least number of periods over the image height",
        low=0.0,
        why="fewer look like slopes of other effects; a scanned camera had 3.2",
    )
    band: float = param(1.5, "periods to either side that belong to the stripes", low=0.0, why="a beat's envelope widens its spectrum")
    chi2: float = param(25.0, "chi-square (2 degrees of freedom) of a view with stripes", low=0.0, why="chance: 4 in a million")
    share: float = param(
        0.03, "the same, over that of the strongest view", low=0.0, high=1.0, why="a weak pattern of all views is no stripe"
    )
    phase: float = param(
        5.0, "Rayleigh's n R^2 from which the views share one phase", low=0.0, why="0.7 % by chance; a fixed pattern has n"
    )
    stands_out: float = param(
        8.0, "energy of the best wave over the median wave's", low=1.0, why="noise of rows contains all waves equally"
    )
    views: int = param(3, "views with stripes", low=1, why="one or two may be another kind of scene")
    explains: float = param(
        0.5,
        "share of the error that neighbours have in common, in the views with stripes, that the stripes explain",
        low=0.0,
        high=1.0,
        why="less than half is a part of another structure: 0.22 beside multipath that is too small to be named",
    )
    cells: int = param(100, "least cells of a view", low=20, why="the smooth field has ten terms")
    cosine: float = param(0.1, "least cosine of incidence", low=1e-3, high=1.0, why="grazing surfaces would outweigh all")
    ridge: float = param(1e-3, "ridge of the fitted waves, of the mean diagonal", low=0.0, why="neighbouring waves are nearly alike")


@dataclass(frozen=True, slots=True)
class CapturesLimits:
    """When the captures of a dwell differ by another camera's light."""

    ratio: float = param(
        1.25,
        "median variance between the captures of a dwell, over that among neighbours, from which they step",
        low=1.0,
        why="healthy dwells: 0.8 to 1.1; under another camera's light half of them exceed 1.6",
    )
    share: float = param(
        0.5, "share of the dwells that step", low=0.0, high=1.0, why="of two or three captures, some have nearly the same phase by chance"
    )
    dwells: int = param(3, "least number of dwells whose captures step", low=1, why="one or two may have been bumped")
    of_light: float = param(
        0.5,
        "share of that variance beyond the neighbours' that goes with range^2 / cos(incidence), beside what a hand that sways makes",
        low=0.0,
        high=1.0,
        why="under another camera's light: 0.74 and 0.86",
    )


@dataclass(frozen=True, slots=True)
class ForeignLightLimits:
    """When another camera's light shifts captures along the optical axis."""

    chance: float = param(
        1e-3, "probability of arm errors along the optical axis by the robot's prior", low=0.0, high=1.0, why="a session in a thousand"
    )
    chance_across: float = param(
        0.01,
        "probability of these errors given those across the axis",
        low=0.0,
        high=1.0,
        why="an arm worse than its prior has errors across the axis too; foreign light makes few there",
    )
    chance_across_fields: float = param(
        0.03,
        "the same, where nearly every view has a field of its own",
        low=0.0,
        high=1.0,
        why="two signs, each rare without foreign light",
    )
    across_known: float = param(
        0.7,
        "standard deviation of the cameras' places across the axis, over the arm's prior, up to which errors there are known",
        low=0.0,
        why="half of the prior's variance; beyond, the estimates are smaller than the errors",
    )
    chance_follows: float = param(
        1e-4,
        "probability at which these errors follow distance and amplitude of the views, or turns the camera's weight",
        low=0.0,
        high=1.0,
        why="an arm's errors do so in one session of ten thousand; a hazy lens without a name did at 9e-6",
    )
    follows_mm: float = param(
        0.7,
        "RMS of what follows distance and amplitude",
        unit="mm",
        low=0.0,
        why="healthy cameras err by up to 0.46 mm alike over a view, where poses take it up; a hazy lens without a name by 1.2",
    )
    sag: float = param(
        0.5,
        "RMS of the turns by the camera's weight, over the arm's prior per axis, from which its mount gives way",
        low=0.0,
        why="healthy arms err smoothly with their pose: 0.38 at most in 720 drawn ones; a sag of 0.1 degrees is found in nine of ten",
    )
    field_chi2: float = param(100.0, "chi-square that the field of a view explains", low=0.0, why="by chance, thirteen terms explain 13")
    field_mm: float = param(
        0.2,
        "least RMS of the smooth field of a view",
        unit="mm",
        low=0.0,
        why="healthy emerging cameras leave 0.05, foreign light of 2 mm 0.3",
    )
    field_share: float = param(
        0.1, "the same, over the size of the named effects", low=0.0, high=1.0, why="maps are not exact: wiggling of 4.3 mm leaves 0.26 mm"
    )
    field_views: float = param(0.75, "share of the views with such a field", low=0.0, high=1.0, why="foreign light is in every capture")
    drift_terms: int = param(3, "parameters of a drift over time", low=1, why="amount, time constant, and the choice of a form")
    cosine: float = param(0.1, "least cosine of incidence", low=1e-3, high=1.0, why="grazing surfaces would outweigh all")
    ridge: float = param(1e-6, "ridge of a view's field, whose terms have norm 1", low=0.0, why="in small views terms look alike")


@dataclass(frozen=True, slots=True)
class RepeatedLimits:
    """When the captures of a dwell show the same bias, so that it is no light of another clock."""

    ratio: float = param(
        2.0,
        "variance of the bias over the squared standard error of the mean of a dwell",
        low=1.0,
        why="1 with a new phase in each capture, and two captures may be alike; a supply that sags with the scene had 5 and 150",
    )
    views: int = param(3, "views without the bias that tell how captures differ without the light", low=1, why="a median of three")
    without: float = param(
        1.3,
        "ratio of the squared errors by captures and by neighbours in these views",
        low=1.0,
        why="noise alone has 1; beyond, others act",
    )
    share: float = param(
        0.5,
        "share of the bias's variance by which captures differ more than in these views",
        low=0.0,
        why="light that is new in each has 1",
    )
    sigma: float = param(3.0, "standard deviations of that ratio from view to view", low=0.0, why="chance: 1 in 370")


@dataclass(frozen=True, slots=True)
class ForeignLampLimits:
    """When fringes show where another camera's lamp stands."""

    rows: int = param(16, "rows of cells that are averaged", low=4, high=999, why="fringes are a quarter of the image wide, or wider")
    cells: int = param(60, "least cells of a view", low=20, why="smooth field and waves have eleven terms")
    rough_mm: float = param(0.2, "error of a cell's mean beside its noise", unit="mm", low=0.0, why="errors of the other effects' maps")
    chi2: float = param(1.2, "chi-square per cell beside smooth fields from which a lamp is looked for", low=0.0, why="chance: 1")
    share: float = param(
        0.33,
        "share of that chi-square that one lamp must explain",
        low=0.0,
        high=1.0,
        why="another camera: 0.44 to 0.70 in seven sessions; other causes: 0.24 at most in twenty",
    )
    common_share: float = param(
        0.18,
        "the same beside errors of pose, what all views share, and the part with most of what is left",
        low=0.0,
        high=1.0,
        why="another camera: 0.25 to 0.52 in seven sessions; a cover glass: 0.02 to 0.12 in seven",
    )
    stands_out: float = param(
        2.0, "either, over that of the median place in the cell", low=1.0, why="any wave explains a little of any structure"
    )
    view_chi2: float = param(50.0, "chi-square (4 degrees of freedom) of a view that has the light", low=0.0, why="beyond any chance")
    view_share: float = param(0.03, "the same, over that of the strongest view", low=0.0, high=1.0, why="other views share a weak pattern")
    views: int = param(3, "least number of views with the light", low=1, why="one or two may be another kind of scene")


@dataclass(frozen=True, slots=True)
class LitLimits:
    """When noise shows that foreign light falls on a part of the cell."""

    cube_mm: float = param(
        100.0,
        "side of the cubes that the cell is divided into",
        unit="mm",
        low=1.0,
        why="a patch of sun is wider; some hundred pixels at 1 m",
    )
    pixels: int = param(40, "pixels of a cube in one view", low=2, why="the median of their squared noise is known to 25 %")
    cubes: int = param(12, "cubes that even and odd views see", low=3, why="a correlation of 0.7 by chance: 1 in 100")
    lit: float = param(
        2.0, "variance of noise in a lit cube, over that in quiet ones", low=1.0, why="places of one healthy cell differ by 1.5"
    )
    quiet: float = param(
        1.4, "the same in a cube that keeps to the law; and of the quietest quarter over the law", low=1.0, why="as `law_excess`"
    )
    share: float = param(0.1, "share of the pixels that is lit, and that is quiet", low=0.0, high=0.5, why="less may be one rough part")
    alike: float = param(
        0.8,
        "correlation of ln variance by cube between even and odd views",
        low=0.0,
        high=1.0,
        why="noise of the camera's own follows no place",
    )
