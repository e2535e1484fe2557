#!/usr/bin/env python3
"""Builds the book of all documents with mdBook: its pages are those of SUMMARY.md, where they lie in the repository.

    docs/book.py target          writes target/book, from a copy of pages, pictures and linked files in target/book-source
"""

import pathlib
import shutil
import subprocess
import sys

from pages import ROOT, SUMMARY, links, pages


def page_of_book(page, text, listed, source):
    """Returns the text of a page, and copies the files that it links to. Links to folders and to the summary become plain text."""
    for link in reversed(links(text)):
        name = link["target"].partition("#")[0]
        target = (page.parent / name).resolve() if name else page
        if target.is_dir() or target == SUMMARY:
            text = text[: link.start()] + link["text"] + text[link.end() :]
        elif target not in listed:
            copy = source / target.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(target, copy)
    return text


def main():
    out = pathlib.Path(sys.argv[1]).resolve()
    book = out / "book-source"
    source = book / "src"
    shutil.rmtree(book, ignore_errors=True)
    listed = pages()
    for page in listed:
        copy = source / page.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_text(page_of_book(page, page.read_text(), listed, source))
    shutil.copyfile(SUMMARY.parent / "book.toml", book / "book.toml")
    # The summary lies in docs/, that of the book above all pages.
    (source / "SUMMARY.md").write_text(SUMMARY.read_text().replace("](../", "]("))
    subprocess.run(["mdbook", "build", book, "--dest-dir", out / "book"], check=True)
    print(f"{out / 'book' / 'index.html'}: {len(listed)} pages")


main()
