"""What mkdocs does besides: the README is the first page, and models are carried.

The gallery links to pages on which its models are played with; they are written here.

Pages link to files of the repository, as readers have them. In the site a link leads to
what the site has, pages and model files; of the others the words are left.
"""

from __future__ import annotations

import functools
import posixpath
import re
import sys
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parent.parent
FIRST, GALLERY = "index.md", "gallery.md"
# The page of a model, and the text that a link to it or the page itself replaces: a
# command in the gallery, a picture in the page on `explore`.
PLAYED = "play/{}.html"
RUN = re.compile(r"`lagsim run models/([\w-]+)\.yaml`")
PICTURE = "![The page of an elastic pendulum](explore.png)"
FRAME = (
    f'<iframe src="{PLAYED.format("elastic-pendulum")}" title="An elastic pendulum" '
    'style="width: 100%; height: 900px; border: 0" loading="lazy"></iframe>'
)
# Words, which may hold a picture, and a target that is not a place on the same page.
LINK = re.compile(r"\[((?:[^\[\]]|!\[[^\]]*\]\([^)]*\))*)\]\((?![a-z]+:|#)([^)\s]+)\)")


def on_files(files, config):
    """Add the README as the first page, and the models as they are."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    files.append(File.generated(config, FIRST, content=readme))
    for path in (ROOT / "models").glob("**/*.yaml"):
        name = path.relative_to(ROOT).as_posix()
        files.append(File.generated(config, name, abs_src_path=str(path)))
    for name, content in _played().items():
        files.append(File.generated(config, PLAYED.format(name), content=content))
    return files


@functools.cache
def _played():
    """Return the pages on which models are played with, once for `mkdocs serve`."""
    sys.path.insert(0, str(ROOT))
    from benchmarks.played import pages

    return pages()


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

    def played(found):
        page = PLAYED.format(found[1])
        if files.get_file_from_path(page) is None:
            return found[0]
        return f"[Play with it]({page}), or `lagsim run models/{found[1]}.yaml`"

    markdown = LINK.sub(led, markdown)
    if page.file.src_uri == GALLERY:
        return RUN.sub(played, markdown)
    return markdown.replace(PICTURE, FRAME)
