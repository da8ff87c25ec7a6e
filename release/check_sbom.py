"""Checks a list made by release/sbom: by the schema of CycloneDX in somebody else's library, and that each part says what
it is."""

import json
import pathlib
import sys

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator


def main():
    text = pathlib.Path(sys.argv[1]).read_text()
    wrong = JsonStrictValidator(SchemaVersion.V1_5).validate_str(text)
    if wrong:
        # The rest is the schema itself.
        sys.exit(f"{sys.argv[1]}: {str(wrong).splitlines()[0]}")
    bom = json.loads(text)
    components = bom["components"]
    for key in ("version", "licenses", "purl"):
        missing = [it["name"] for it in components if not it.get(key)]
        if missing:
            sys.exit(f"{sys.argv[1]}: no {key}: {missing}")
    known = {it["bom-ref"] for it in components} | {bom["metadata"]["component"]["bom-ref"]}
    named = {ref for it in bom["dependencies"] for ref in [it["ref"], *it.get("dependsOn", [])]}
    if named - known:
        sys.exit(f"{sys.argv[1]}: nobody knows {sorted(named - known)}")
    print(f"{sys.argv[1]}: {len(components)} components, valid")


if __name__ == "__main__":
    main()
