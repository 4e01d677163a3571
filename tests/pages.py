"""README.md and docs/ as data: blocks that are set apart, headings, links, commands."""

from __future__ import annotations

import re
import shlex
from typing import NamedTuple

from tests.support import ROOT

PAGES = ("README.md", *(f"docs/{p.name}" for p in sorted((ROOT / "docs").glob("*.md"))))
_FENCED = re.compile(r"^( *)```(\w*)[^\n]*\n(.*?)^ *```$", re.DOTALL | re.MULTILINE)
_INDENTED = re.compile(r"(?:^\n)(?:^    .*\n|^\n)+", re.MULTILINE)


class Block(NamedTuple):
    """A fenced block of a page; `kind` is the word at its fence."""

    page: str
    kind: str
    text: str

    @property
    def name(self):
        """The page and the first line of the block, which name its test."""
        return f"{self.page}: {self.text.partition(chr(10))[0]}"


def text_of(page):
    """Read a page by its path from the root."""
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page):
    """Return the fenced blocks of a page, in order."""
    found = []
    for margin, kind, inside in _FENCED.findall(text_of(page)):
        lines = [line.removeprefix(margin) for line in inside.splitlines()]
        found.append(Block(page, kind, "\n".join(lines) + "\n"))
    return found


def indented(page):
    """Return the blocks set apart by four blanks alone, which have no kind."""
    rest = _FENCED.sub("", text_of(page))
    return [piece for piece in _INDENTED.findall(rest) if piece.strip()]


def prose(page):
    """Return a page without its blocks."""
    return _FENCED.sub("", text_of(page))


def commands(block):
    """Return the commands of a block, each with the output shown."""
    if block.kind == "sh":
        for line in block.text.replace("\\\n", "").splitlines():
            if line.strip() and not line.startswith("#"):
                yield line, ""
    elif block.kind == "console":
        for piece in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
            first, _, shown = piece.partition("\n")
            yield first, shown


def words_of(command, folder):
    """Split a command as a shell would, with its patterns and without its comment."""
    found = []
    for word in shlex.split(command, comments=True):
        files = sorted(folder.glob(word)) if "*" in word else []
        found += [str(f.relative_to(folder)) for f in files] or [word]
    return found


def anchors(page):
    """Return the anchors of a page's headings, as GitHub and the site have them."""
    found: set[str] = set()
    for title in re.findall(r"^#+ +(.*?) *#*$", prose(page), re.MULTILINE):
        words = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", title).replace("`", "")
        name = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
        found.add(name)
    return found


def links(page):
    """Return the targets of a page's links and pictures."""
    plain = re.sub(r"`[^`\n]*`", "", prose(page))
    marked = re.findall(r"\]\(<?([^)\s>]+)>?(?: [^)]*)?\)", plain)
    return marked + re.findall(r'(?:src|href)="([^"]+)"', plain)
