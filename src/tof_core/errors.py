# SPDX-License-Identifier: Apache-2.0
"""The tree of errors. Each message is one line: what is wrong, where, and what to do."""

from __future__ import annotations

import reprlib


class ToftwinError(Exception):
    """An error that the user can resolve. Exit code 1: the data do not support a result.

    Args:
        what: what is wrong.
        where: the file, topic, frame or key it concerns.
        todo: what to do about it.
    """

    exit_code = 1

    def __init__(self, what: str, *, where: object = "", todo: str = "") -> None:
        """Join the three parts into one line."""
        self.what, self.where, self.todo = what, str(where), todo
        parts = [f"{self.where}: {what}" if self.where else what, todo]
        super().__init__(" ".join("; ".join(p for p in parts if p).split()))


class UsageError(ToftwinError):
    """The call was wrong (flags, paths, names). Exit code 2."""

    exit_code = 2


class ConfigError(UsageError):
    """A configuration key or value is unknown or out of bounds."""


class BagError(ToftwinError):
    """A bag is missing, truncated, or lacks what is needed."""


class NoBagError(BagError, UsageError):
    """There is no bag where the call says there is one. Exit code 2."""

    exit_code = 2


class TopicError(BagError):
    """A topic is missing or ambiguous; the message lists the candidates and the flag."""


class NoTopicError(TopicError, UsageError):
    """A topic that the call names is missing or has another type. Exit code 2."""

    exit_code = 2


class DecodeError(ToftwinError):
    """A message's bytes contradict its header."""


class CameraError(ToftwinError):
    """A CameraInfo is uncalibrated, unknown, or disagrees with its image."""


class TransformError(ToftwinError):
    """A transform is missing, has a gap, or is no rigid motion."""


class SceneError(ToftwinError):
    """A scene file or mesh cannot be used."""


class RefusedError(ToftwinError):
    """The data do not support an answer; the reason is the message."""


class DatasetError(ToftwinError):
    """A dataset is damaged, of another schema, or cannot be written."""


class ModelError(ToftwinError):
    """A network file is damaged, foreign, or made for another camera."""


def brief(value: object) -> str:
    """A foreign value as one short line, however large it is."""
    try:
        return reprlib.repr(value)
    except ValueError:  # Python writes no integer of more than 4300 digits
        return f"a {type(value).__name__} of thousands of digits"
