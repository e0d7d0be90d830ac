# SPDX-License-Identifier: Apache-2.0
"""The command `toftwin`: finds the commands, runs one, turns errors into one line and an exit code."""

from __future__ import annotations

import argparse
import sys
import traceback
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Protocol, cast

from tof_core.cores import one_thread
from tof_core.page import set_command, version
from tof_core.progress import set_quiet
from toftwin.faults import explain
from toftwin.paths import check_paths

if TYPE_CHECKING:
    from collections.abc import Sequence

ABOUT = "A time-of-flight camera and its digital twin: true depth, true pose, missing parts, and why simulation and camera differ."


class Command(Protocol):
    """The content of a module of `toftwin.commands`; nothing heavy is imported before `run`.

    HELP is the line in the list of commands, ABOUT the paragraph above the command's flags.
    """

    NAME: str
    HELP: str
    ABOUT: str
    EXAMPLE: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the flags."""

    def run(self, args: argparse.Namespace) -> int:
        """Execute the command; returns 0 if done, 1 if the data do not support a result."""


def command_names() -> list[str]:
    """Names of the commands, one module each."""
    folder = Path(__file__).parent / "commands"
    return sorted(path.stem for path in folder.glob("*.py") if not path.stem.startswith("_"))


def load_command(name: str) -> Command:
    """The module of a command."""
    return cast("Command", import_module(f"toftwin.commands.{name}"))


def build_parser(chosen: str = "") -> argparse.ArgumentParser:
    """The parser; only the chosen command declares its flags, so that help is fast."""
    parser = argparse.ArgumentParser(prog="toftwin", description=ABOUT, epilog="toftwin COMMAND --help shows an example.")
    parser.add_argument("--version", action="store_true", help="print the version and stop")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    for name in [chosen] if chosen else command_names():
        module = load_command(name)
        sub = commands.add_parser(
            module.NAME,
            help=module.HELP,
            description=fill(module.ABOUT, 79),
            epilog=f"example:\n  {module.EXAMPLE}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        sub.add_argument("--debug", action="store_true", help="show the traceback of an error")
        sub.add_argument("--quiet", action="store_true", help="show no progress")
        if chosen:
            module.add_arguments(sub)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    argv = list(sys.argv[1:] if argv is None else argv)
    names = command_names()
    chosen = argv[0] if argv and argv[0] in names else ""
    if argv and not chosen and not argv[0].startswith("-"):
        return _say(_no_such(argv[0], names), 2)
    try:
        parser = build_parser(chosen)
        args = parser.parse_args(argv)
        if args.version:
            print(f"toftwin {version()}")
            return 0
        if not chosen:
            parser.print_help()
            return 2
        set_quiet(args.quiet)
        check_paths(args)
        set_command(argv)
        if "numpy" not in sys.modules:
            one_thread()  # NumPy reads the variables at import; commands that use more threads set them
        return load_command(chosen).run(args)
    except SystemExit as stop:  # argparse has printed its message
        return stop.code if isinstance(stop.code, int) else 2
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001
        return report(error, debug="--debug" in argv)


def _no_such(word: str, names: list[str]) -> str:
    """Message on an unknown command, with the most similar one."""
    near = get_close_matches(word.lower(), names, n=1, cutoff=0.5)
    meant = f"did you mean '{near[0]}'?" if near else f"commands: {', '.join(names)}"
    return f"there is no command '{word}'; {meant}"


def report(error: BaseException, *, debug: bool = False) -> int:
    """Print an error as one line on stderr; an unexpected error also writes a traceback file. Returns the exit code."""
    if debug:
        traceback.print_exception(error)
    if isinstance(error, BrokenPipeError):
        sys.stderr.close()
        return 1
    return _say(*explain(error))


def _say(line: str, code: int) -> int:
    print(f"toftwin: {' '.join(line.split())}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
