"""What mkdocs does besides: the README is the first page, and models are carried.

Pages link to files of the repository, as readers have them. In the site a link leads to
what the site has, pages and model files; of the others the words are left.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parent.parent
FIRST = "index.md"
# Words, which may hold a picture, and a target that is not a place on the same page.
LINK = re.compile(r"\[((?:[^\[\]]|!\[[^\]]*\]\([^)]*\))*)\]\((?![a-z]+:|#)([^)\s]+)\)")


def on_files(files, config):
    """Add the README as the first page, and the models as they are."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    files.append(File.generated(config, FIRST, content=readme))
    for path in (ROOT / "models").glob("**/*.yaml"):
        name = path.relative_to(ROOT).as_posix()
        files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown, page, config, files):  # noqa: ARG001
    """Lead links to where the site has what they are for."""
    folder = "." if page.file.src_uri == FIRST else "docs"

    def led(found):
        words, target = found.groups()
        path, mark, place = target.partition("#")
        path = posixpath.normpath(f"{folder}/{path}")
        path = FIRST if path == "README.md" else path.removeprefix("docs/")
        if files.get_file_from_path(path) is None:
            return words
        return f"[{words}]({path}{mark}{place})"

    return LINK.sub(led, markdown)
