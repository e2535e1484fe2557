"""The documents and what they link to, for links.py and book.py."""

import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
SUMMARY = ROOT / "docs/SUMMARY.md"

CODE = re.compile(r"^( *)(```|~~~).*?^\1\2[^\n]*$|(`+)(?:(?!\3)[^\n]|\n(?!\n))+?\3|^(?: {4,}|\t)[^\n]*$", re.M | re.S)
LINK = re.compile(r"(?P<picture>!?)\[(?P<text>(?:[^\[\]]|\[[^\[\]]*\])*)\]\((?P<target>[^()\s]+)\)")


def tracked():
    """Returns every file of the repository, also those that are not committed yet."""
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=ROOT, check=True, capture_output=True)
    return [path for name in listed.stdout.decode().split("\0") if name and (path := ROOT / name).is_file()]


def without_code(text):
    """Returns a page with blanks in the place of code, so that places stay the same."""
    return CODE.sub(lambda code: re.sub(r"[^\n]", " ", code.group()), text)


def links(text):
    """Returns the links of a page that are not addresses on the net, as matches."""
    return [link for link in LINK.finditer(without_code(text)) if not re.match(r"[a-z]+:", link["target"])]


def pages():
    """Returns the pages of the summary, in its order."""
    return [(SUMMARY.parent / link["target"]).resolve() for link in links(SUMMARY.read_text())]
