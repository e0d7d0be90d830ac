# SPDX-License-Identifier: Apache-2.0
"""`python -m tests.fuzz.run --target image --runs 10000000`: coverage-guided fuzzing; what is found and how far it came is kept.

Executions add up over calls in `out/fuzz/NAME/executions`, and the corpus grows there; `--runs` is what they should add up to.
A finding ends the run with the file to put into tests/fuzz/found/NAME once it is mended.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.fuzz.targets import TARGETS

REPOSITORY = Path(__file__).resolve().parents[2]
MEMORY_MB = 1024
HANG_S = 10
PATIENCE_S = 60.0 * HANG_S
"""Of the clock, after which a timeout is believed that does not end when it is tried again."""
SLICE = 500_000
"""Executions of one process. Atheris itself keeps some 800 bytes of each (the same calls without it keep none), which is not to count."""
PULSE = re.compile(r"^#(\d+)\s|^Done (\d+) runs|^stat::number_of_executed_units: +(\d+)")


def main() -> int:
    """Fuzz one target, or all of them one after the other."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz.run", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--target", choices=[*TARGETS, "all"], default="all")
    parser.add_argument("--runs", type=int, help="executions that the target should add up to (default: the target's bar)")
    parser.add_argument("--seconds", type=float, default=0.0, help="stop a target after so long (default: never)")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out" / "fuzz")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--input", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    names = list(TARGETS) if args.target == "all" else [args.target]
    if args.input:
        return again(names[0], args.input)
    if args.child:
        return fuzz(names[0], args.out / names[0], args.runs)
    try:
        import atheris  # noqa: F401
    except ImportError:
        sys.stderr.write("fuzz: atheris is not installed; pip install 'toftwin[fuzz]'\n")
        return 2
    return max([watch(name, args.out / name, args.runs or TARGETS[name].runs, args.seconds) for name in names])


def watch(name: str, out: Path, runs: int, seconds: float) -> int:
    """Run the fuzzer in processes of their own, one after the other, and count executions, however they end."""
    out.mkdir(parents=True, exist_ok=True)
    tally = out / "executions"
    before = int(tally.read_text()) if tally.exists() else 0
    start, done, findings = time.monotonic(), 0, list[str]()
    while before + done < runs and not findings and not (seconds and time.monotonic() - start > seconds):
        left = seconds - (time.monotonic() - start) if seconds else 0.0
        more = _slice(name, out, min(SLICE, runs - before - done), left)
        done += more
        tally.write_text(str(before + done))
        new = (p for p in out.glob("*-*") if p.stat().st_mtime > time.time() - (time.monotonic() - start) - 1)
        findings = sorted(p.name for p in new if p.name.partition("-")[0] in ("crash", "oom") or _hangs(name, p))
        if not more:
            break
    told = ", ".join(findings) or "nothing found"
    say(f"{name}: {done} executions in {time.monotonic() - start:.0f} s, {before + done} of {runs} in all; {told}")
    return int(bool(findings))


def _hangs(name: str, path: Path) -> bool:
    """Whether a timeout is one in processor time: where others have the core, a call of milliseconds may take ten seconds of the clock."""
    if not path.name.startswith("timeout-"):
        return False
    before = os.times()
    command = [sys.executable, "-m", "tests.fuzz.run", "--target", name, "--input", str(path)]
    try:
        subprocess.run(command, cwd=REPOSITORY, check=False, timeout=PATIENCE_S, stderr=subprocess.DEVNULL)
    except subprocess.TimeoutExpired:
        return True
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system > HANG_S


def again(name: str, path: Path) -> int:
    """Call a target with one input."""
    with tempfile.TemporaryDirectory() as folder:
        TARGETS[name].open(Path(folder))(path.read_bytes())
    return 0


def _slice(name: str, out: Path, runs: int, seconds: float) -> int:
    """One child; executions that it did. Ended after `seconds`, if any."""
    command = [sys.executable, "-m", "tests.fuzz.run", "--child", "--target", name, "--runs", str(runs), "--out", str(out.parent)]
    start, done = time.monotonic(), 0
    with (
        subprocess.Popen(command, cwd=REPOSITORY, stderr=subprocess.PIPE, text=True, errors="replace") as child,
        (out / "log").open("w") as log,
    ):
        assert child.stderr is not None
        try:
            for line in child.stderr:
                log.write(line)
                if found := PULSE.match(line):
                    done = max(done, int(found[found.lastindex or 1]))
                if seconds and time.monotonic() - start > seconds:
                    child.terminate()
        except KeyboardInterrupt:
            child.terminate()
            raise SystemExit(130) from None
    return done


def say(line: str) -> None:
    """A line on stdout, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def fuzz(name: str, out: Path, runs: int) -> int:
    """The child: instrument, then run until done or until something is found."""
    import atheris

    target = TARGETS[name]
    corpus = out / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f"fuzz-{name}-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))  # noqa: S108 (a file system in memory)
    with atheris.instrument_imports(include=list(target.watched)):
        run = target.open(scratch)
        for i, seed in enumerate(target.seeds(scratch)):
            (corpus / f"seed{i}").write_bytes(seed)
    flags = [
        f"-runs={runs}",
        f"-rss_limit_mb={MEMORY_MB}",
        f"-timeout={HANG_S}",
        f"-artifact_prefix={out}/",
        f"-max_len={target.longest}",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], *flags, str(corpus)], run)
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())
