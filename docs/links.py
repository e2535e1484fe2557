#!/usr/bin/env python3
"""Checks the links between documents: files and headings exist, every page is in the summary, and code names no page that is not there.

    docs/links.py
"""

import re
import sys

from pages import ROOT, SUMMARY, links, pages, tracked

# Pages that programs write.
MADE = {"comparison.md", "faults.md", "inject.md", "profile.md", "tables.md"}
NAMED = re.compile(r"[\w./-]*\w\.md\b")
SOURCES = {".rs", ".py", ".sh", ".toml", ".c", ".h", ".cpp", ".hpp", ".fpp", ".yml"}


def headings(page):
    """Returns the anchors of a page's headings, as file viewers and mdBook make them."""
    found = set()
    text = re.sub(r"^( *)(```|~~~).*?^\1\2[^\n]*$", "", page.read_text(), flags=re.M | re.S)
    for heading in re.findall(r"^#{1,6} +(.*?) *$", text, re.M):
        plain = re.sub(r"!?\[(.*?)\]\(.*?\)", r"\1", heading)
        anchor = re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", plain.lower()))
        one, count = anchor, 0
        while one in found:
            count += 1
            one = f"{anchor}-{count}"
        found.add(one)
    return found


def faults_of_page(page, known):
    text = page.read_text()
    for link in links(text):
        name, _, anchor = link["target"].partition("#")
        target = (page.parent / name).resolve() if name else page
        where = f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, link.start()) + 1}: {link['target']}"
        if target not in known:
            yield f"{where}: expected a file or folder of the repository, found none"
        elif anchor and target.suffix == ".md" and anchor not in headings(target):
            yield f"{where}: expected a heading, found none"


def faults_of_source(source, known):
    """A page is named from the folder of the source, or from one above it."""
    for number, line in enumerate(source.read_text().splitlines(), 1):
        for name in NAMED.findall(line):
            if name.split("/")[-1] in MADE or any((above / name.lstrip("/")).resolve() in known for above in source.parents):
                continue
            yield f"{source.relative_to(ROOT)}:{number}: {name}: expected a page, found none"


def main():
    files = tracked()
    known = set(files) | {folder for file in files for folder in file.parents}
    documents = [file for file in files if file.suffix == ".md"]
    faults = [fault for page in documents for fault in faults_of_page(page, known)]
    for source in files:
        if source.suffix in SOURCES and source.parent != SUMMARY.parent:
            faults += faults_of_source(source, known)
    listed = pages()
    faults += [f"{page.relative_to(ROOT)}: expected once in {SUMMARY.relative_to(ROOT)}, found {listed.count(page)} times"
               for page in documents if page != SUMMARY and listed.count(page) != 1]
    for fault in faults:
        print(f"ERROR: {fault}", file=sys.stderr)
    count = sum(len(links(page.read_text())) for page in documents)
    print(f"{len(documents)} pages, {count} links, {len(faults)} faults")
    sys.exit(bool(faults))


main()
