"""What a binary of the program is built from, as cargo and the compiler of this machine say."""

import json
import pathlib
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
NAME = "vfd-gateway"


def said(*command):
    """What a command prints; its own complaint where it fails."""
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def host():
    """The target that this machine builds for."""
    lines = said("rustc", "--version", "--verbose").splitlines()
    return next(line.removeprefix("host: ") for line in lines if line.startswith("host: "))


def packages(target):
    """The program, and the packages of others whose code is in a binary for `target`, by name and version.

    What only builds it is left out. The crates of this repository are the program.
    """
    metadata = json.loads(
        said("cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", target)
    )
    known = {(it["name"], it["version"]): it for it in metadata["packages"]}
    edges = ("--edges", "normal,no-proc-macro", "--prefix", "none", "--format", "{p}")
    tree = said("cargo", "tree", "--locked", "--target", target, *edges)
    used = {tuple(line.split(" ")[:2]) for line in tree.splitlines() if line}
    found = (known[name, version.removeprefix("v")] for name, version in sorted(used))
    return [it for it in found if it["source"] or it["name"] == NAME]


def own(target):
    """The program itself."""
    return next(it for it in packages(target) if it["name"] == NAME)


def parts():
    """What is in the program and no package."""
    return json.loads((ROOT / "release/parts.json").read_text())


def standard_library():
    """The standard library of the compiler, which is in every binary, and the file with its copyrights."""
    version = said("rustc", "--version").split(" ")[1]
    sysroot = pathlib.Path(said("rustc", "--print", "sysroot").strip())
    component = {
        "type": "library",
        "bom-ref": "Rust standard library",
        "name": "Rust standard library",
        "version": version,
        "description": "The standard library of the compiler",
        "scope": "required",
        "licenses": [{"expression": "MIT OR Apache-2.0"}],
        "purl": f"pkg:generic/rust-std@{version}",
        "externalReferences": [{"type": "website", "url": "https://github.com/rust-lang/rust"}],
    }
    return component, sysroot / "share/doc/rust/COPYRIGHT-library.html"
