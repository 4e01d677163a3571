"""Write docs/methods.md and docs/gallery.md: python benchmarks/pages.py

What the pages say stands in the methods' own modules and in the headers of models/.
`thumbnails.py` makes the gallery's pictures.
"""

from __future__ import annotations

import re
from pathlib import Path

from lagsim.methods import method, names, page
from lagsim.model.reader import read_file

ROOT = Path(__file__).resolve().parent.parent
DOCS, MODELS = ROOT / "docs", ROOT / "models"
PICTURES = DOCS / "gallery"

METHODS = """\
# Methods

`auto` chooses a method, and a run reports the choice and the reason; `--method NAME`
overrules it. `lagsim methods NAME` prints the sections of this page. `lagsim bench`
measures the time of each method for its error ([Charts](charts.md)). [Failing
models](failing.md) shows where each of them fails.

"""

GALLERY = """\
# Gallery

The models in `models/`. Each runs as it is; its header has the source and the expected
values. Copy the most similar one to begin a model of your own. A picture shows the
paths of the points in the section `scene`, with links and shapes at the end, or
coordinates against time.

"""
GROUPS = (
    "Free motion",
    "Held by constraints",
    "Rolling and steering",
    "Contact and friction",
)


def methods_page() -> str:
    """Give the page on all methods."""
    rows = ["| name | order | step | handles |", "|---|---|---|---|"]
    parts = []
    for name in names():
        m = method(name)
        step = "adaptive" if m.ADAPTIVE else "fixed"
        rows.append(f"| [{name}](#{name}) | {m.ORDER} | {step} | {m.HANDLES} |")
        text = page(m.NAME)
        parts.append(f"## {name}\n\n{text}\n")
    return METHODS + "\n".join([*rows, "", *parts])


def shipped() -> list[Path]:
    """Give the files of the models, by name."""
    return sorted(MODELS.glob("*.yaml"))


def gallery_page() -> str:
    """Give the page on all models, by what they are about."""
    entries: dict[str, list[str]] = {group: [] for group in GROUPS}
    for path in shipped():
        entries[group_of(path)].append(_entry(path))
    head = "| | |\n|---|---|"
    parts = [
        f"## {group}\n\n{head}\n" + "\n".join(entries[group]) + "\n" for group in GROUPS
    ]
    return GALLERY + "\n".join(parts)


def group_of(path: Path) -> str:
    """Tell what a model is about, by its constraints and their laws."""
    model = read_file(str(path))
    text = path.read_text(encoding="utf-8")
    if not all(c.always for c in model.constraints) or "sign(" in text:
        return GROUPS[3]
    if not model.constraints:
        return GROUPS[0]
    said = re.search(r"^constraints:.*\n((?: .*\n)+)", text, re.MULTILINE)
    return GROUPS[2] if said and "_dot" in said[1] else GROUPS[1]


def _entry(path: Path) -> str:
    name = path.stem
    picture = f"[![{name}](gallery/{name}.png)](../models/{path.name})"
    told = first_lines(path.read_text(encoding="utf-8"))
    command = f"`lagsim run models/{path.name}`"
    return f"| {picture} | [**{name}**](../models/{path.name})<br>{told}<br>{command} |"


def first_lines(text: str) -> str:
    """Give what a header says first, up to its source or an empty line."""
    lines = []
    for line in text.splitlines():
        said = line.removeprefix("#").strip()
        if not line.startswith("#") or not said or re.match(r"[A-Z]\w+:", said):
            break
        lines.append(said)
    return re.sub(r"([\\*_<|])", r"\\\1", " ".join(lines))


if __name__ == "__main__":
    for name, text in (("methods", methods_page()), ("gallery", gallery_page())):
        (DOCS / f"{name}.md").write_text(text, encoding="utf-8")
