# SPDX-License-Identifier: Apache-2.0
"""Git's commit-msg hook: refuse a subject that is too long: `scripts/check_subject.py .git/COMMIT_EDITMSG`."""

from __future__ import annotations

import sys
from pathlib import Path

LONGEST = 72
"""Characters of a subject; git log and most forges cut longer ones."""
MADE_BY_GIT = ("Merge ", "Revert ", "fixup! ", "squash! ")
"""Beginnings of subjects that git writes itself."""


def fault(message: str) -> str:
    """What is wrong with a commit message, as one line; "" if nothing."""
    lines = [line for line in message.splitlines() if not line.startswith("#")]
    subject = lines[0].rstrip() if lines else ""
    if not subject:
        return "the commit message has no subject in its first line"
    if len(subject) > LONGEST and not subject.startswith(MADE_BY_GIT):
        return f"the subject has {len(subject)} characters, {LONGEST} at most: put the reason into the body: {subject!r}"
    if len(lines) > 1 and lines[1].strip():
        return "the second line of the commit message is not empty: a blank line separates subject and body"
    return ""


def main() -> int:
    """Check the file that git names; 1 refuses the commit."""
    if found := fault(Path(sys.argv[1]).read_text(encoding="utf-8")):
        print(found, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
