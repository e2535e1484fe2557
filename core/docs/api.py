#!/usr/bin/env python3
"""Lists the public interface of elunar-core from rustdoc's pages, and compares it with api.txt.

    cargo doc --no-deps --package elunar-core && core/docs/api.py target/doc          # compare; --write writes api.txt anew
"""

import html
import pathlib
import re
import sys

kept = pathlib.Path(__file__).with_name("api.txt")
root = pathlib.Path(sys.argv[1]) / "elunar_core"
# What a page declares: the item itself, and its own methods and constants. Implementations of traits come behind this mark.
foreign = 'id="trait-implementations"'
declared = re.compile(r'<pre class="rust item-decl"><code>(.*?)</code></pre>|<h4 class="code-header">(.*?)</h4>', re.S)


def text(fragment):
    """Returns a declaration on one line, without tags and folded parts."""
    plain = html.unescape(re.sub(r"<[^>]*>", "", fragment.replace("<br>", " ")))
    line = re.sub(r"\s+", " ", re.sub(r"Show \d+ (fields|variants)", "", plain)).strip()
    return line.replace("( ", "(").replace(", )", ")")


if not (root / "all.html").is_file():
    sys.exit(f"ERROR: {root}: expected rustdoc's pages, found none")
lines = []
for page in re.findall(r'<li><a href="([^"#]+\.html)"', (root / "all.html").read_text()):
    module = "::".join(page.split("/")[:-1])
    own = (root / page).read_text().split(foreign)[0]
    parts = [text(item or method) for item, method in declared.findall(own)]
    lines += [f"{module}: {parts[0]}"] + [f"{module}:     {part}" for part in parts[1:]]
listing = "\n".join(lines) + "\n"
if len(lines) < 300:
    sys.exit(f"ERROR: {root}: expected more than 300 declarations, found {len(lines)}")
if "--write" in sys.argv:
    kept.write_text(listing)
elif listing != kept.read_text():
    import difflib

    difference = difflib.unified_diff(kept.read_text().splitlines(), lines, str(kept), "rustdoc", lineterm="", n=0)
    sys.exit("\n".join(difference) + f"\nERROR: {kept}: expected the public interface, found another; if that is meant: api.py --write")
