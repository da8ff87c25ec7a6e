"""Reads what is delivered under deploy/ with libraries that know the formats, and prints it as JSON.

    deployed.py yaml FILE...            the documents of all files
    deployed.py kubernetes FILE...      the same, each held strictly against the schema of Kubernetes' oldest and newest version
"""

import json
import sys

import yaml

VERSIONS = ("1.29", "1.37")


def documents(paths):
    for path in paths:
        with open(path, encoding="utf-8") as file:
            yield from ((path, it) for it in yaml.safe_load_all(file) if it is not None)


def main(what, *paths):
    found = list(documents(paths))
    if what == "kubernetes":
        import kubernetes_validate

        for path, document in found:
            for version in VERSIONS:
                try:
                    kubernetes_validate.validate(document, version, strict=True)
                except kubernetes_validate.ValidationError as error:
                    sys.exit(f"{path}: {document['kind']} in {version}: {error.message} at {list(error.path)}")
    print(json.dumps([document for _, document in found]))


if __name__ == "__main__":
    main(*sys.argv[1:])
