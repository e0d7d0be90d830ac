# SPDX-License-Identifier: Apache-2.0
"""Views less often than captures: the same numbers, and each frame has one fate."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core.bag import open_bag
from tof_core.config import from_mapping
from tof_preproc.config import PreprocConfig
from tof_preproc.stream import ACCUMULATED, KEPT, PreprocStream
from tof_preproc.stream_config import StreamConfig

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.bag import BagReader
    from tof_core.capture import View
    from tof_preproc.stream import Processed

GOLDEN = Path(__file__).parents[1] / "data" / "golden" / "bag"
"""Four dwells of three captures."""


def feed(reader: BagReader, stream: PreprocStream) -> Iterator[Processed]:
    """What becomes ready with each message, without the end."""
    topics, builder = reader.topics, stream.builder
    takes = {topics.depth: builder.depth, topics.info: builder.info, topics.amplitude: builder.amplitude}
    for message in reader.messages(tuple(takes)):
        takes[message.topic](reader.deserialize(message))
        yield from stream.ready()


def played(view_every: int, preproc: PreprocConfig | None = None, *, unfiltered_from: int = -1) -> list[Processed]:
    """All results of the bag; `unfiltered_from`: the result after which views without filters are wanted."""
    with open_bag(GOLDEN) as reader:
        config = replace(StreamConfig(), preproc=preproc or PreprocConfig())
        stream = PreprocStream(config, reader.topics, reader.transforms, view_every=view_every)
        stream.want_unfiltered(wanted=unfiltered_from == 0)
        results = []
        for result in feed(reader, stream):
            results.append(result)
            stream.want_unfiltered(wanted=0 <= unfiltered_from <= len(results))
        return [*results, *stream.ready(final=True)]


def fates(results: list[Processed]) -> list[str]:
    return [r.fate for r in sorted(results, key=lambda r: r.stamp_ns)]


def same_views(some: list[Processed], others: list[Processed]) -> None:
    """Each of `some` has the view that `others` have at its stamp."""
    at = {r.stamp_ns: r for r in others}
    for result in some:
        if result.view is None:
            continue
        for view, other in ((result.view, at[result.stamp_ns].view), (result.unfiltered, at[result.stamp_ns].unfiltered)):
            assert (view is None) == (other is None)
            if view is not None and other is not None:
                assert (view.captures, view.dwell_ns, view.station) == (other.captures, other.dwell_ns, other.station)
                for name in ("depth", "sigma", "count", "reason", "amplitude", "noise"):
                    np.testing.assert_array_equal(getattr(view, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize(
    ("view_every", "dwell"),
    [
        (1, [KEPT, KEPT, KEPT]),
        (2, [ACCUMULATED, KEPT, KEPT]),
        (3, [ACCUMULATED, ACCUMULATED, KEPT]),
        (0, [ACCUMULATED, ACCUMULATED, KEPT]),
    ],
)
def test_the_views_between_are_left_out_and_the_last_of_each_dwell_is_the_same(view_every: int, dwell: list[str]) -> None:
    results, each = played(view_every, None, unfiltered_from=0), played(1, None, unfiltered_from=0)
    assert fates(results) == 4 * dwell
    assert [r.stamp_ns for r in results if r.view is not None] == sorted(r.stamp_ns for r in results if r.view is not None)
    same_views(results, each)


def test_a_view_without_filters_that_is_asked_for_within_a_dwell_is_of_the_captures_up_to_its_stamp() -> None:
    results, each = played(0, None, unfiltered_from=1), played(1, None, unfiltered_from=2)
    assert [r.unfiltered.captures for r in results if r.unfiltered is not None] == [1, 3, 3, 3]
    same_views(results, each)


def test_a_dwell_with_its_most_captures_gives_its_view_at_once() -> None:
    results = played(0, from_mapping(PreprocConfig, {"accumulate.max_captures": 2}))
    assert fates(results) == 4 * [ACCUMULATED, KEPT, KEPT]
    assert [r.view.captures for r in results if r.view is not None] == 4 * [2, 1]
    moving = played(0, from_mapping(PreprocConfig, {"accumulate.max_captures": 1}))
    assert Counter(fates(moving)) == {KEPT: 12}


def test_what_is_held_is_released_where_a_dwell_is_ended_and_forgotten_at_a_reset() -> None:
    with open_bag(GOLDEN) as reader:
        stream = PreprocStream(StreamConfig(), reader.topics, reader.transforms, view_every=0)
        results = feed(reader, stream)
        first = next(results)
        assert (first.fate, first.view) == (ACCUMULATED, None)
        held = stream.held_ns
        assert held is not None
        assert held > first.stamp_ns
        stream.end_dwell()
        (ended,) = stream.ready()
        assert (ended.stamp_ns, ended.fate, stream.held_ns) == (held, KEPT, None)
        assert ended.view is not None
        assert ended.view.captures == 2
        next(r for r in results if r.fate == ACCUMULATED)
        assert stream.held_ns is not None
        stream.reset()
        assert stream.held_ns is None
        assert list(stream.ready(final=True)) == []


@pytest.mark.parametrize(
    ("view_every", "most", "with_view", "afterwards"),
    [
        (1, 15, [], [3, 3, 3]),  # the end shows once the next dwell begins; the last dwell stays open
        (2, 15, [3, 3, 3], []),  # the third capture was held
        (0, 15, [3, 3, 3], []),
        (0, 3, [3, 3, 3, 3], []),  # a dwell with its most captures has ended
        (1, 3, [3, 3, 3, 3], []),
    ],
)
def test_the_end_of_each_dwell_is_said_once_with_its_last_view(
    view_every: int, most: int, with_view: list[int], afterwards: list[int]
) -> None:
    order: list[tuple[str, int]] = []
    with open_bag(GOLDEN) as reader:
        config = replace(StreamConfig(), preproc=from_mapping(PreprocConfig, {"accumulate.max_captures": most}))
        stream = PreprocStream(config, reader.topics, reader.transforms, view_every=view_every)
        stream.on_ended = lambda view: order.append(("ended", view.stamp_ns))
        results = []
        for result in feed(reader, stream):
            results.append(result)
            order += [("view", result.stamp_ns)] if result.view is not None else []
        results += stream.ready(final=True)
    views = {r.stamp_ns: r.view for r in results if r.view is not None}
    assert [r.view.captures for r in results if r.last and r.view is not None] == with_view
    ended = [stamp for what, stamp in order if what == "ended"]
    assert [views[stamp].captures for stamp in ended] == afterwards
    assert all(order[order.index(("ended", stamp)) - 1] == ("view", stamp) for stamp in ended)


def noted(stamps: list[int], view: View) -> None:
    stamps.append(view.stamp_ns)


def test_a_dwell_that_is_ended_on_request_is_said_to_have_ended_and_none_at_a_reset() -> None:
    for view_every in (0, 1):
        with open_bag(GOLDEN) as reader:
            stream = PreprocStream(StreamConfig(), reader.topics, reader.transforms, view_every=view_every)
            ended: list[int] = []
            stream.on_ended = partial(noted, ended)
            results = feed(reader, stream)
            stamp = next(results).stamp_ns if view_every else next(results).stamp_ns + 1
            held = stream.held_ns
            stream.end_dwell()
            assert ended == ([stamp] if view_every else [])
            assert [(r.stamp_ns, r.last) for r in stream.ready()] == ([] if view_every else [(held, True)])
            next(results)
            ended.clear()
            stream.reset()
            stream.end_dwell()
            assert ended == []


def test_while_nobody_hears_the_views_none_is_computed_and_the_fates_are_the_same() -> None:
    for view_every in (0, 1, 2):
        with open_bag(GOLDEN) as reader:
            stream = PreprocStream(StreamConfig(), reader.topics, reader.transforms, view_every=view_every)
            stream.heard = False
            results = []
            for result in feed(reader, stream):
                results.append(result)
                stream.heard = len(results) >= 7  # somebody subscribes within the third dwell
            results += stream.ready(final=True)
        each = played(view_every)
        assert fates(results) == fates(each)
        assert [r.view is None for r in results[:7]] == 7 * [True]
        assert [r.view is None for r in results[9:]] == [r.fate == ACCUMULATED for r in each[9:]]
        same_views(results, each)
