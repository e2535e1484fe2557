#!/usr/bin/env python3
"""Writes the software bills of materials of libelunar.a and of the program `elunar`, as CycloneDX 1.5: the same bytes every time.

    sbom.py OUT            OUT/libelunar.cdx.json, OUT/elunar.cdx.json; compares the archive's packages with packages.csv
    sbom.py OUT --write    the same, and writes packages.csv

From Cargo.lock and cargo alone, offline once the crates are there. What is built on the way and not part of the result (build scripts, procedural
macros and what they need) has the scope `excluded`. The compiler's own library is a component, too: it is linked into both. A validator is
cyclonedx-python-lib (pip install 'cyclonedx-python-lib[json-validation]'); without it that check is skipped.
"""

import csv
import io
import json
import os
import pathlib
import subprocess
import sys
import tomllib

try:
    import jsonschema  # noqa: F401 - the validator needs it
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator
except ImportError:
    JsonStrictValidator = None

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
LIST = HERE / "packages.csv"
FLIGHT = {"manifest": HERE / "Cargo.toml", "package": "elunar-staticlib", "target": "all", "type": "library", "rust": "core"}
GROUND = {"manifest": ROOT / "Cargo.toml", "package": "elunar", "target": "x86_64-unknown-linux-gnu", "type": "application", "rust": "std"}


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout


def tree(what, edges):
    """Returns (name, version) of every package that cargo's tree has along these edges."""
    lines = run("cargo", "tree", "--locked", "--manifest-path", what["manifest"], "--package", what["package"], "--target", what["target"],
                "--edges", edges, "--prefix", "none", "--format", "{p}").splitlines()
    words = [line.split() for line in lines if line.strip()]
    return {(word[0], word[1].removeprefix("v")) for word in words}


def purl(package):
    return f"pkg:cargo/{package['name']}@{package['version']}"


def component(package, hashes, kind, scope):
    key = package["name"], package["version"]
    made = {"type": kind, "bom-ref": purl(package), "name": package["name"], "version": package["version"], "scope": scope}
    if key in hashes:
        made["hashes"] = [{"alg": "SHA-256", "content": hashes[key]}]
    if package["license"]:
        # Some packages separate their licences by a slash, as Cargo once asked for.
        made["licenses"] = [{"expression": package["license"].replace(" / ", "/").replace("/", " OR ")}]
    elif package["license_file"]:
        made["licenses"] = [{"license": {"name": package["license_file"]}}]
    made["purl"] = purl(package)
    if package["repository"]:
        made["externalReferences"] = [{"type": "vcs", "url": package["repository"]}]
    return made


def compiler(name):
    """The library that the compiler brings and links."""
    said = dict(line.split(": ", 1) for line in run("rustc", "-vV").splitlines() if ": " in line)
    return {"type": "library", "bom-ref": f"rust-{name}", "name": f"rust-{name}", "version": said["release"], "scope": "required",
            "description": f"{name} and what it needs (compiler_builtins), as the compiler brings it", "licenses": [{"expression": "MIT OR Apache-2.0"}],
            "externalReferences": [{"type": "vcs", "url": f"https://github.com/rust-lang/rust/tree/{said['commit-hash']}"}]}


def bill(what):
    linked, built = tree(what, "normal,no-proc-macro"), tree(what, "normal,build")
    data = json.loads(run("cargo", "metadata", "--locked", "--format-version", "1", "--manifest-path", what["manifest"]))
    packages = {package["id"]: package for package in data["packages"] if (package["name"], package["version"]) in built}
    lock = tomllib.loads(what["manifest"].with_name("Cargo.lock").read_text())["package"]
    hashes = {(one["name"], one["version"]): one["checksum"] for one in lock if "checksum" in one}
    top = next(package for package in packages.values() if package["name"] == what["package"])
    rust = compiler(what["rust"])
    components, needs = [rust], [{"ref": rust["bom-ref"]}]
    for package in sorted(packages.values(), key=purl):
        scope = "required" if (package["name"], package["version"]) in linked else "excluded"
        if package is not top:
            components.append(component(package, hashes, "library", scope))
        node = next(node for node in data["resolve"]["nodes"] if node["id"] == package["id"])
        of = {packages[one["pkg"]]["name"]: purl(packages[one["pkg"]]) for one in node["deps"]
              if one["pkg"] in packages and any(kind["kind"] != "dev" for kind in one["dep_kinds"])}
        needs.append({"ref": purl(package), "dependsOn": sorted({*of.values(), rust["bom-ref"]})})
    return {"$schema": "http://cyclonedx.org/schema/bom-1.5.schema.json", "bomFormat": "CycloneDX", "specVersion": "1.5", "version": 1,
            "metadata": {"component": component(top, hashes, what["type"], "required"),
                         "properties": [{"name": "cdx:reproducible", "value": "true"}]},
            "components": components, "dependencies": needs}


def listing(made):
    """The packages of the archive, as packages.csv has them: those of registries with their checksum."""
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(["package", "version", "licence", "sha256 of the source"])
    for one in [made["metadata"]["component"], *made["components"]]:
        if one["scope"] == "required":
            rows.writerow([one["name"], one["version"], one["licenses"][0]["expression"], one.get("hashes", [{"content": ""}])[0]["content"]])
    return out.getvalue()


def valid(name, text):
    """Returns whether the schema finds nothing wrong, and says what it finds."""
    if JsonStrictValidator is None:
        print(f"SKIPPED: sbom: {name}: no validator (pip install 'cyclonedx-python-lib[json-validation]')")
        return not os.environ.get("ELUNAR_REQUIRE_ORACLES")
    fault = JsonStrictValidator(SchemaVersion.V1_5).validate_str(text)
    print(f"sbom: {name}: valid CycloneDX 1.5" if fault is None else f"ERROR: {name}: {str(fault).splitlines()[0]}")
    return fault is None


def main():
    out = pathlib.Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    good = True
    for name, what in [("libelunar", FLIGHT), ("elunar", GROUND)]:
        made = bill(what)
        text = json.dumps(made, indent=1) + "\n"
        (out / f"{name}.cdx.json").write_text(text)
        parts = [one["scope"] for one in made["components"]]
        print(f"sbom: {out}/{name}.cdx.json: {parts.count('required')} components linked, {parts.count('excluded')} for the build alone")
        good &= valid(name, text)
        if what is FLIGHT and "--write" in sys.argv[2:]:
            LIST.write_text(listing(made))
        if what is FLIGHT and (not LIST.is_file() or listing(made) != LIST.read_text()):
            print(f"ERROR: {LIST.relative_to(ROOT)}: expected the packages of the archive, found others; --write after a review", file=sys.stderr)
            print(listing(made), file=sys.stderr)
            good = False
    sys.exit(not good)


main()
