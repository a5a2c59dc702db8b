#!/usr/bin/env python3
"""Prints the licences of the crates that the released programs link.

Usage: script/third-party-licenses.py PACKAGE... >THIRD-PARTY-LICENSES.txt

The crates are the closure of normal and build dependencies that `cargo metadata` resolves for Linux on x86-64, and of
lodestream-web, the page for browsers, for WebAssembly; the texts are the licence files in their sources. Equal texts are
printed once. The output depends on Cargo.lock only.
"""

import json
import os
import re
import subprocess
import sys
import textwrap
from collections import defaultdict

TARGET = "x86_64-unknown-linux-gnu"
# The package that runs elsewhere.
PAGE, PAGE_TARGET = "lodestream-web", "wasm32-unknown-unknown"
LICENSE_FILE = re.compile(r"^(li[cs]en[cs]e|copying|copyright|notice|unlicen[cs]e|ofl|ufl)([-_.].*)?$", re.IGNORECASE)
# Sources in these languages are never a licence, whatever their name.
SOURCE_FILE = re.compile(r"\.(rs|c|h|cc|cpp|py|toml|json|html|js)$", re.IGNORECASE)
# The first comment of a C file.
LEADING_COMMENT = re.compile(r"\A\s*/\*(.*?)\*/", re.DOTALL)
RULE = "=" * 100


def fail(message):
    sys.exit(f"error: {message}")


def metadata(target):
    command = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", target]
    result = subprocess.run(command, stdout=subprocess.PIPE, check=False)
    if result.returncode != 0:
        fail("cargo metadata failed; see its message above")
    return json.loads(result.stdout)


def all_dependencies(roots):
    """Third-party packages that the roots link, sorted by name and version."""
    programs = [root for root in roots if root != PAGE]
    found = dependencies(metadata(TARGET), programs) if programs else []
    if PAGE in roots:
        found += dependencies(metadata(PAGE_TARGET), [PAGE])
    distinct = {package["id"]: package for package in found}.values()
    return sorted(distinct, key=lambda package: (package["name"], package["version"]))


def dependencies(data, roots):
    """Third-party packages that the roots link on the data's platform."""
    packages = {package["id"]: package for package in data["packages"]}
    nodes = {node["id"]: node for node in data["resolve"]["nodes"]}
    names = {packages[member]["name"]: member for member in data["workspace_members"]}
    for root in roots:
        if root not in names:
            fail(f"the workspace has no package {root}")
    pending, reached = [names[root] for root in roots], set()
    while pending:
        package = pending.pop()
        if package not in reached:
            reached.add(package)
            for dependency in nodes[package]["deps"]:
                if any(kind["kind"] != "dev" for kind in dependency["dep_kinds"]):
                    pending.append(dependency["pkg"])
    return [packages[package] for package in reached if packages[package]["source"]]


def read(path):
    with open(path, encoding="utf-8", errors="replace") as file:
        return file.read()


def tidy(text):
    """The text without form feeds, trailing spaces, and empty lines at both ends."""
    return "\n".join(line.rstrip() for line in text.replace("\f", "").splitlines()).strip("\n")


def license_texts(package):
    """Texts of a package's licence files, also of the C libraries and fonts that it contains.

    Without such a file, the comments with a copyright notice at the head of its C files.
    """
    folder = os.path.dirname(package["manifest_path"])
    paths, headers = set(), []
    for parent, folders, files in os.walk(folder):
        folders.sort()
        has_fonts = any(name.endswith(".ttf") for name in files)
        for name in sorted(files):
            path = os.path.join(parent, name)
            named = LICENSE_FILE.match(name) or os.path.basename(parent).lower() == "licenses"
            if (named and not SOURCE_FILE.search(name)) or (has_fonts and name.endswith(".txt")):
                paths.add(path)
            elif name.endswith((".h", ".hpp")):
                headers.append(path)
    if package["license_file"]:
        paths.add(os.path.join(folder, package["license_file"]))
    texts = [tidy(read(path)) for path in sorted(paths)]
    if not paths:
        comments = [LEADING_COMMENT.match(read(path)) for path in headers]
        texts = [tidy(comment[1]) for comment in comments if comment and "copyright" in comment[1].lower()]
    return [text for text in texts if text]


def main():
    roots = sys.argv[1:]
    if roots in (["--help"], ["-h"]):
        print(__doc__.strip())
        return
    if not roots:
        fail("no package is named; usage: script/third-party-licenses.py PACKAGE...")
    os.chdir(os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
    packages = all_dependencies(roots)
    # By the text without its line breaks: the first layout of a text is printed.
    users, layouts, without_text = defaultdict(list), {}, []
    for package in packages:
        label = f"{package['name']} {package['version']}"
        if not (package["license"] or package["license_file"]):
            fail(f"{label} states no licence")
        texts = license_texts(package)
        for text in texts:
            words = " ".join(text.split())
            layouts.setdefault(words, text)
            if label not in users[words]:
                users[words].append(label)
        if not texts:
            without_text.append((label, package))

    lines = [
        "Third-party software in Lodestream",
        "",
        "The programs and the page for browsers contain the Rust standard library (MIT OR Apache-2.0,",
        "https://www.rust-lang.org) and these crates. Where a crate offers several licences, each applies at your choice.",
        "The texts follow.",
        "",
    ]
    for package in packages:
        license_name = package["license"] or "see its licence text"
        lines.append(f"{package['name']} {package['version']}: {license_name}")
        if package["repository"]:
            lines.append(f"    {package['repository']}")
    if without_text:
        lines += ["", "These crates contain no licence text; the licences that they name are printed for other crates:", ""]
        for label, package in without_text:
            authors = ", ".join(package["authors"]) or "its authors"
            lines.append(f"{label}: {package['license']}, copyright {authors}")
    for words, labels in sorted(users.items(), key=lambda entry: (entry[1], entry[0])):
        lines += ["", RULE, *textwrap.wrap(", ".join(labels), 100), RULE, "", layouts[words]]
    sys.stdout.reconfigure(encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
