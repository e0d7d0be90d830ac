# SPDX-License-Identifier: Apache-2.0
"""The running robot: published topics with their QoS; a few seconds of them are recorded and examined as a bag."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from tof_core.errors import ToftwinError
from tof_core.topics import COMPRESSED, IMAGE, INFO, POINTS, TEMPERATURE, TF
from toftwin.doctor.bag import examine_bag
from toftwin.doctor.finding import fix, note, ok

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from tof_core.options import BagOptions
    from tof_ros.survey import Publisher
    from tof_scene.scene import Scene
    from toftwin.doctor.finding import Finding

NEEDED = ((IMAGE, COMPRESSED, POINTS), (INFO,), (TF,))
"""Types without one of which, in each group, no view can be made: they are waited for."""
KINDS = (IMAGE, COMPRESSED, INFO, POINTS, TEMPERATURE, TF)

GRAPH = "the ROS graph"
"""Name of what is examined, in place of the file of its recording."""
SILENT = "start the driver's streams; on another host: is the network's firewall open for UDP, and large messages not cut (MTU)?"


def examine_live(options: BagOptions, scene: Scene | None, initial_pose: str | None, seconds: float) -> Iterator[Finding]:
    """List the ROS graph of this domain, record it for a while, and examine the recording."""
    from tof_ros.survey import survey

    with TemporaryDirectory(prefix="toftwin-doctor-") as folder:
        path = Path(folder) / "live"
        try:
            seen = survey(path, KINDS, seconds, NEEDED)
        except (ToftwinError, ImportError) as error:
            yield fix("live", f"the ROS graph cannot be looked at ({error})", "see the line ROS above")
            return
        yield from publishers(seen.publishers, seen.seconds)
        if seen.own:
            yield ok("live", f"the graph runs: {len(seen.own)} topics of its own, such as {seen.own[0]}, are not examined")
        silent = [t for t in seen.publishers if not seen.counts.get(t) and not t.endswith("tf_static")]
        for topic in silent:
            yield note(
                "live",
                f"{topic} has a publisher, but nothing came in {seen.seconds:.0f} s",
                "is the driver running, and does it publish only on demand?",
            )
        if seen.counts:
            yield from examine_bag(path, options, scene, initial_pose, where=GRAPH)
        elif seen.publishers:
            yield fix("live", f"{len(seen.publishers)} topics have publishers, and not one message came in {seen.seconds:.0f} s", SILENT)


def publishers(seen: Mapping[str, Sequence[Publisher]], seconds: float) -> Iterator[Finding]:
    """Published topics of types that the graph reads, and whether their QoS fits that of the nodes' subscriptions."""
    if not seen:
        yield fix(
            "live",
            f"no publisher of images, clouds or TF was seen in {seconds:.0f} s",
            "same ROS_DOMAIN_ID as the robot? on another host: ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET",
        )
    for topic, offers in sorted(seen.items()):
        yield from _heard(topic, offers)


def _heard(topic: str, offers: Sequence[Publisher]) -> Iterator[Finding]:
    named = ", ".join(sorted({f"{o.node} ({o.reliability}, {o.durability})" for o in offers}))
    if topic.endswith("/tf_static") and any(o.durability == "volatile" for o in offers):
        yield fix(
            "QoS",
            f"{topic}: {named}",
            "a latched subscription hears no volatile publisher (policy DURABILITY): use a StaticTransformBroadcaster",
        )
    elif topic == "/tf" and any(o.reliability == "best_effort" for o in offers):
        yield fix(
            "QoS", f"{topic}: {named}", "a reliable subscription hears no best-effort publisher (policy RELIABILITY): publish /tf reliably"
        )
    elif any(o.reliability == "best_effort" for o in offers):
        yield note("QoS", f"{topic}: {named}", "heard by default; leave live.reliable false, it would hear nothing (policy RELIABILITY)")
    else:
        yield ok("QoS", f"{topic}: {named}")
