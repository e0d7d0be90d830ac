# SPDX-License-Identifier: Apache-2.0
"""Finds the topics of depth, amplitude and others: by type, by words in the name, by sibling; an ambiguous choice is an error.

Default names are spot_ros2's (`/depth/hand/image`, ...) under any namespace.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from tof_core.compressed import DEPTH_TRANSPORT
from tof_core.decode import AMPLITUDE_ENCODINGS, COLOUR_ENCODINGS, DEPTH_ENCODINGS
from tof_core.errors import NoTopicError, TopicError
from tof_core.options import NOT_WANTED, BagOptions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
INFO = "sensor_msgs/msg/CameraInfo"
POINTS = "sensor_msgs/msg/PointCloud2"
TEMPERATURE = "sensor_msgs/msg/Temperature"
TF = "tf2_msgs/msg/TFMessage"

TRANSPORTS = (DEPTH_TRANSPORT, "compressed")
"""Last parts of image_transport's names of compressed topics."""

DEPTH_WORDS = frozenset({"depth", "distance", "range"})
AMPLITUDE_WORDS = frozenset(
    {"ir", "amplitude", "infra", "infrared", "intensity", "nir", "photons", "reflectance", "reflectivity", "signal"}
)
COLOUR_WORDS = frozenset({"camera", "color", "colour", "rgb"})
REGISTERED_WORDS = frozenset({"aligned", "registered"})
"""Words of depth images that a driver has registered to another camera."""
DERIVED_WORDS = REGISTERED_WORDS | {"confidence", "mask", "sigma", "noise", "count", "reason", "label", "preproc", "infer"}
"""Words of images derived from a depth image: candidates only where there is no other."""
OWN_WORDS = frozenset({"preproc", "label", "infer"})
"""Rooms whose nodes publish depth images and clouds."""
OWN_ROOMS = OWN_WORDS | {"correction", "inspect", "gap"}
"""Namespaces in which the nodes of this project publish."""


def is_compressed(topic: str) -> bool:
    """Whether a topic has image_transport's name of a compressed topic."""
    return topic.rpartition("/")[2] in TRANSPORTS


def is_own(topic: str) -> bool:
    """Whether a topic is an output of this project's nodes, in any robot's namespace."""
    return len(parts := base_topic(topic).strip("/").split("/")) > 1 and parts[-2] in OWN_ROOMS


def base_topic(topic: str) -> str:
    """The raw topic of a compressed one of image_transport; any other topic unchanged."""
    return topic.rpartition("/")[0] if is_compressed(topic) else topic


def is_rectified(topic: str) -> bool:
    """Whether an image topic has image_proc's name of a rectified image: CameraInfo's P is then valid, not K and D."""
    return base_topic(topic).rpartition("/")[2].startswith("image_rect")


def is_registered(topic: str) -> bool:
    """Whether a topic has the name of a depth image that is registered to another camera (RealSense's aligned_depth_to_color, depth_registered)."""
    return bool(_words(topic) & REGISTERED_WORDS)


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of one depth camera; an empty name where the recording has none."""

    depth: str = ""
    info: str = ""
    points: str = ""
    amplitude: str = ""
    colour: str = ""
    colour_info: str = ""
    temperature: str = ""

    def named(self) -> tuple[str, ...]:
        """All topics that are not empty."""
        return tuple(name for f in fields(self) if (name := getattr(self, f.name)))


def find_topics(
    types: Mapping[str, str],
    options: BagOptions,
    *,
    encodings: Mapping[str, str] | None = None,
    where: str = "bag",
) -> Topics:
    """The topics of a recording's depth camera.

    Args:
        types: type of each topic.
        options: names that the user gave; they must exist and be of the right type.
        encodings: encoding of each image topic, as far as known.
        where: name of the recording in error messages.

    Raises:
        TopicError: no depth, no CameraInfo, or several that fit; it lists them and the flag to pass.
    """
    return _Finder(types, options, encodings or {}, where).find()


def depth_candidates(types: Mapping[str, str]) -> list[str]:
    """Topics that may hold a camera's depth: depth images, else clouds, else images without a word of another kind; none of this project's.

    Args:
        types: type of each topic.
    """
    foreign = {topic: kind for topic, kind in types.items() if not _words(topic) & OWN_WORDS}
    return _Finder(foreign, BagOptions(), {}, "").candidates()


@dataclass(frozen=True, slots=True)
class _Finder:
    types: Mapping[str, str]
    options: BagOptions
    encodings: Mapping[str, str]
    where: str

    def find(self) -> Topics:
        o = self.options
        depth, points = self._depth_or_points()
        source = depth or points
        colour = self._optional(o.colour_topic, "--colour-topic", self._images(COLOUR_WORDS, COLOUR_ENCODINGS, depth), source)
        return Topics(
            depth=depth,
            points=points,
            info=self._given(o.info_topic, INFO, "--info-topic") or self._info_beside(source, "--info-topic"),
            amplitude=self._optional(
                o.amplitude_topic, "--amplitude-topic", self._images(AMPLITUDE_WORDS, AMPLITUDE_ENCODINGS, depth), source
            ),
            colour=colour,
            colour_info=self._given(o.colour_info_topic, INFO, "--colour-info-topic") or self._sibling(colour),
            temperature=self._optional(o.temperature_topic, "--temperature-topic", self._of_type(TEMPERATURE), source),
        )

    def candidates(self) -> list[str]:
        """Depth images, else clouds, else images without a word of another kind."""
        unnamed = [t for t in self._rasters() if not _words(t) & (AMPLITUDE_WORDS | COLOUR_WORDS | DERIVED_WORDS)]
        return self._images(DEPTH_WORDS, DEPTH_ENCODINGS, "") or self._of_type(POINTS) or unnamed

    def _depth_or_points(self) -> tuple[str, str]:
        o = self.options
        depth, points = self._given(o.depth_topic, IMAGE, "--depth-topic"), self._given(o.points_topic, POINTS, "--points-topic")
        if depth or points:
            return depth, "" if depth else points
        if images := self._images(DEPTH_WORDS, DEPTH_ENCODINGS, "") or self._unnamed_depth():
            return self._one(images, "depth image", "--depth-topic", ""), ""
        if clouds := self._of_type(POINTS):
            return "", self._one(clouds, "point cloud", "--points-topic", "")
        raise TopicError("has no depth image and no point cloud", where=self.where, todo=self._all())

    def _rasters(self) -> list[str]:
        """Image topics; a compressed one only without its raw topic, and compressedDepth before compressed."""
        raw, packed = self._of_type(IMAGE), self._of_type(COMPRESSED)
        bases = {base_topic(t) for t in packed if t.endswith(DEPTH_TRANSPORT)}
        wanted = [t for t in packed if t.endswith(DEPTH_TRANSPORT) or base_topic(t) not in bases]
        return sorted(raw + [t for t in wanted if base_topic(t) not in raw])

    def _images(self, words: frozenset[str], encodings: Sequence[str], depth: str) -> list[str]:
        """Image topics with one of the words and without a word of the other kinds."""
        others = (DEPTH_WORDS | AMPLITUDE_WORDS) - words if words is COLOUR_WORDS else DEPTH_WORDS - words
        fitting = [
            t
            for t in self._rasters()
            if t != depth and _words(t) & words and not _words(t) & others and self.encodings.get(t, encodings[0]) in encodings
        ]
        return [t for t in fitting if not _words(t) & DERIVED_WORDS] or fitting

    def _unnamed_depth(self) -> list[str]:
        """Images without a word of any kind whose encoding can hold depth and that have a CameraInfo."""
        named = AMPLITUDE_WORDS | COLOUR_WORDS | DERIVED_WORDS
        return [t for t in self._rasters() if self.encodings.get(t) in DEPTH_ENCODINGS and self._sibling(t) and not _words(t) & named]

    def _one(self, candidates: list[str], what: str, flag: str, beside: str) -> str:
        """The only candidate, the one with spot_ros2's name, or the one nearest to `beside`; else an error."""
        if len(candidates) > 1 and (usual := [t for t in candidates if re.search(r"(^|/)depth/hand/(image|points)$", t)]):
            candidates = usual
        if len(candidates) > 1 and beside:
            nearness = {t: _nearness(t, beside) for t in candidates}
            candidates = [t for t in candidates if nearness[t] == max(nearness.values())]
        if len(candidates) > 1:
            todo = f"pass {flag} with one of: {', '.join(candidates)}"
            raise TopicError(f"has {len(candidates)} topics that may be the {what}", where=self.where, todo=todo)
        return candidates[0]

    def _optional(self, given: str, flag: str, candidates: list[str], beside: str) -> str:
        if given == NOT_WANTED:
            return ""
        if given:
            return self._given(given, "", flag)
        what = flag.removeprefix("--").removesuffix("-topic")
        return self._one(candidates, what, flag, beside) if candidates else ""

    def _given(self, name: str, kind: str, flag: str) -> str:
        """A topic that the user named; it must exist and have its type."""
        if not name:
            return ""
        found = name if name in self.types else "/" + name.lstrip("/")
        packed = [f"{found}/{transport}" for transport in TRANSPORTS if self.types.get(f"{found}/{transport}") == COMPRESSED]
        if found not in self.types and packed:
            return packed[0]
        if found not in self.types:
            raise NoTopicError(f"has no topic '{name}' ({flag})", where=self.where, todo=self._all())
        if kind and self.types[found] not in {kind, COMPRESSED if kind == IMAGE else kind}:
            raise NoTopicError(f"topic '{found}' ({flag}) is a {self.types[found]}, not a {kind}", where=self.where)
        return found

    def _info_beside(self, topic: str, flag: str) -> str:
        if found := self._sibling(topic):
            return found
        infos = self._of_type(INFO)
        lacking = f"{base_topic(topic).rpartition('/')[0]}/camera_info"
        todo = f"record {lacking} too (does the driver publish it?)"
        if infos:
            todo += f", or pass {flag} with the topic of this camera's calibration, one of: {', '.join(infos)}"
        raise TopicError(f"has no CameraInfo beside '{topic}'", where=self.where, todo=todo)

    def _sibling(self, topic: str) -> str:
        """`camera_info` in the namespace of a topic, or under the topic itself."""
        topic = base_topic(topic)
        names = (f"{topic.rpartition('/')[0]}/camera_info", f"{topic}/camera_info") if topic else ()
        return next((n for n in names if self.types.get(n) == INFO), "")

    def _of_type(self, kind: str) -> list[str]:
        return sorted(t for t, k in self.types.items() if k == kind)

    def _all(self) -> str:
        return f"its topics: {', '.join(sorted(self.types)) or 'none'}"


def _words(topic: str) -> frozenset[str]:
    depth = {"depth"} if topic.endswith(f"/{DEPTH_TRANSPORT}") else set()
    return frozenset(re.split(r"[^a-z]+", base_topic(topic).lower())) | depth


def _nearness(topic: str, other: str) -> int:
    """Number of path parts that two topics share, at any position (`/depth/hand/image`, `/hand/temperature`)."""
    return len(set(topic.split("/")) & set(other.split("/")) - {""})
