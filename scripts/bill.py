# SPDX-License-Identifier: Apache-2.0
"""`python scripts/bill.py`: out/bill-of-materials.json (CycloneDX 1.6) of the locks, and THIRD_PARTY.md with licences and what wheels bundle.

Names, versions and hashes come from requirements/*.txt; licences and bundled libraries from what is installed here.
"""

from __future__ import annotations

import json
import re
import sys
import uuid
from dataclasses import dataclass, field
from importlib.metadata import Distribution, distributions
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BILL = ROOT / "out" / "bill-of-materials.json"
PAGE = ROOT / "THIRD_PARTY.md"
PINNED = re.compile(r"^([\w.-]+)==([^\s;]+)(?: ;[^\\\n]*?)?((?: \\\n +--hash=sha256:[0-9a-f]{64})+)", re.MULTILINE)
HASH = re.compile(r"sha256:([0-9a-f]{64})")
BUNDLED = re.compile(r"(?:^|/)[\w.-]+\.libs/(lib[\w+-]+?)(?:-[0-9a-f]{6,})?\.so")
"""Shared libraries that auditwheel put beside a package, without its hash."""
LONGEST_LICENCE = 60


@dataclass(frozen=True, slots=True)
class Package:
    """One pinned package; `locks`: where it is wanted."""

    name: str
    version: str
    hashes: tuple[str, ...]
    locks: tuple[str, ...] = ()
    licence: str = ""
    bundled: tuple[str, ...] = field(default=())

    @property
    def purl(self) -> str:
        """Package URL."""
        return f"pkg:pypi/{self.name}@{self.version}"


def normal(name: str) -> str:
    """A package's name as PEP 503 writes it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def locked(folder: Path = ROOT / "requirements") -> list[Package]:
    """All packages of all locks, each once, by name."""
    found: dict[str, tuple[str, tuple[str, ...], list[str]]] = {}
    for path in sorted(folder.glob("*.txt")):
        for name, version, hashes in PINNED.findall(path.read_text(encoding="utf-8")):
            known = found.setdefault(normal(name), (version, tuple(HASH.findall(hashes)), []))
            if known[0] != version:
                message = f"{path.name}: {name} {version} is {known[0]} in another lock; run scripts/lock.py"
                raise SystemExit(message)
            known[2].append(path.stem)
    return [Package(name, version, hashes, tuple(locks)) for name, (version, hashes, locks) in sorted(found.items())]


def described(package: Package, installed: dict[str, Distribution]) -> Package:
    """With licence and bundled libraries, where it is installed."""
    there = installed.get(package.name)
    if there is None:
        return package
    bundled = sorted({m[1] for file in there.files or () if (m := BUNDLED.search(str(file)))})
    return Package(package.name, package.version, package.hashes, package.locks, licence_of(there), tuple(bundled))


def licence_of(distribution: Distribution) -> str:
    """The licence in one line: an SPDX expression where the package has one, else what it says."""
    facts = distribution.metadata
    stated = [facts[key].strip() for key in ("License-Expression", "License") if key in facts]
    text = next(filter(None, stated), "").partition("\n")[0]
    if text and len(text) <= LONGEST_LICENCE and text.upper() != "UNKNOWN":
        return text
    if manifest := next((f for f in distribution.files or () if str(f).endswith("/package.xml")), None):
        licences = re.findall(r"<license[^>]*>([^<]+)</license>", Path(str(manifest.locate())).read_text(encoding="utf-8"))  # a ROS package
        return ", ".join(dict.fromkeys(licences))
    classes = [c.rpartition(" :: ")[2] for c in distribution.metadata.get_all("Classifier") or () if c.startswith("License :: ")]
    return ", ".join(c for c in classes if c != "OSI Approved") or text[:LONGEST_LICENCE]


def bill(packages: list[Package], version: str) -> dict[str, object]:
    """The CycloneDX document."""
    whole = json.dumps([(p.name, p.version, p.hashes) for p in packages])
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, whole)}",
        "version": 1,
        "metadata": {"component": {"type": "application", "name": "toftwin", "version": version, "bom-ref": f"pkg:pypi/toftwin@{version}"}},
        "components": [component(p) for p in packages],
    }


def component(p: Package) -> dict[str, object]:
    """One package of the document; the hashes of its files stand as references, since each file has its own."""
    made: dict[str, object] = {"type": "library", "name": p.name, "version": p.version, "purl": p.purl, "bom-ref": p.purl}
    made["scope"] = "required" if {"run", "ros"} & set(p.locks) else "optional"
    if p.licence:
        made["licenses"] = [{"license": {"name": p.licence}}]
    made["externalReferences"] = [
        {"type": "distribution", "url": f"https://pypi.org/project/{p.name}/{p.version}/", "hashes": [{"alg": "SHA-256", "content": h}]}
        for h in p.hashes
    ]
    if p.bundled:
        made["components"] = [{"type": "library", "name": name, "bom-ref": f"{p.purl}#{name}"} for name in p.bundled]
    return made


def page(packages: list[Package]) -> str:
    """THIRD_PARTY.md."""
    lines = [
        "# Third-party packages",
        "toftwin itself is under Apache-2.0 (LICENSE, NOTICE). It carries no code of these packages; set-up installs them from the package index, each file held to its hash (`requirements/*.txt`).",
        "`run` is what the commands need, `ros` is ROS 2 where none is sourced, `dev` what tests and benchmarks need, `open3d` the second ray caster. Bundled libraries lie within the package's wheel and have licences of their own, in its `*.dist-info`.",
        "Made by `scripts/bill.py` from the locks and from the metadata that the packages carry.",
        "",
        "| package | version | licence by its metadata | bundled libraries | wanted by |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {p.name} | {p.version} | {p.licence or 'not installed here'} | {', '.join(p.bundled)} | {', '.join(p.locks)} |"
        for p in packages
    ]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Write both."""
    installed = {normal(d.metadata["Name"]): d for d in distributions()}
    packages = [described(p, installed) for p in locked()]
    own = re.search(r'^version = "([^"]+)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE)
    assert own
    BILL.parent.mkdir(exist_ok=True)
    BILL.write_text(json.dumps(bill(packages, own[1]), indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(page(packages), encoding="utf-8")
    unknown = [p.name for p in packages if not p.licence]
    print(
        f"{BILL.relative_to(ROOT)}: {len(packages)} packages, {sum(len(p.hashes) for p in packages)} hashes; licence not known of {len(unknown)}: {', '.join(unknown)}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
