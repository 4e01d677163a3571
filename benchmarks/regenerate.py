"""Write every file that is derived from others: python -m benchmarks.regenerate

    python -m benchmarks.regenerate [--check] [--all] [NAME ...]

Files that are up to date are not touched. With `--check` stale files are listed and the
exit code is 1. Pictures carry a digest of the models and the code that they show, and
messages of examples that run for long are kept while their examples stay; `--all` draws
and runs these anew as well, which takes some minutes. NAME is a name in `DERIVED`.

Not here: results of measurements (`run.py`, `choices.py`, `rivals.py`), and goldens,
which `lagsim golden MODEL --dir tests/golden --update` stores once a person has judged
the motion.
"""

from __future__ import annotations

import argparse
import ast
import functools
import hashlib
import re
import struct
import sys
import zlib
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from benchmarks import errors as errors_page
from benchmarks import pages, readme
from lagsim.cli.schema import document
from lagsim.codes import RETIRED, cautions, errors, every
from tests.scenes.pairs import page as pairs
from tests.show import stored

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    # The content of a file; None where the file is to be removed.
    Content = Callable[[], bytes | None]

ROOT, DOCS = pages.ROOT, pages.DOCS
SOURCE = b"tEXtSource\0"
COMMAND = "python -m benchmarks.regenerate"


class Derived(NamedTuple):
    """Files that are derived from others.

    `stale` returns the path and the new content of each file that is not up to date;
    with `anew`, of files whose sources are unchanged as well, where it is costly to
    compare their contents.
    """

    name: str
    files: str
    sources: str
    stale: Callable[[bool], Iterator[tuple[Path, Content]]]


def _text(path: Path, make: Callable[[], str]):
    """Return `stale` for a text that is cheap to write."""

    def stale(_anew):
        text = make()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            yield path, text.encode

    return stale


def _documents(_anew):
    for name, text in stored.documents():
        yield from _text(stored.DOCUMENTS / name, lambda text=text: text)(_anew)
    yield from _others(stored.DOCUMENTS, stored.names())


def _others(folder, names):
    """Yield the files of a folder other than `names`, which are to be removed."""
    for path in sorted(folder.iterdir()):
        if path.name not in names:
            yield path, lambda: None


def _errors(anew):
    page = errors_page.PAGE.read_text(encoding="utf-8")
    yield from _text(errors_page.PAGE, lambda: errors_page.page(page, anew=anew))(anew)


def _thumbnails(anew):
    drawn = {path.stem: [path] for path in pages.shipped()}
    for name, (path,) in list(drawn.items()):
        tables = re.findall(r"[\w-]+\.csv", path.read_text(encoding="utf-8"))
        drawn[name] = [_text_of(path), *(_text_of(pages.MODELS / x) for x in tables)]
    yield from _pictures("thumbnails", pages.PICTURES, drawn, anew)


def _failing(anew):
    # The code of a picture is read, not imported: it needs matplotlib and scipy.
    text = (ROOT / "benchmarks/failing.py").read_text(encoding="utf-8")
    code = {
        node.name: ast.get_source_segment(text, node)
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef)
    }
    models = {p.stem: p for p in (pages.MODELS / "failing").glob("*.yaml")}
    drawn = {}
    for name in re.findall(r"\w+", text.partition("PICTURES = (")[2].partition(")")[0]):
        used = sorted({*re.findall(r'"([\w-]+)"', code[name])} & {*models})
        drawn[name] = [code[name], *(_text_of(models[x]) for x in used)]
    yield from _pictures("failing", DOCS / "failing", drawn, anew)


def _text_of(path):
    """Return the text of a file without lines of comments."""
    return re.sub(r"(?m)^\s*#.*\n", "", path.read_text(encoding="utf-8"))


def _pictures(module, folder, drawn, anew):
    """Yield the pictures that are out of date: the path, and a function that draws it.

    A picture contains the digest of the texts that it depends on.

    module : the module of `benchmarks` whose function `drawn` returns a picture
    drawn : the texts that a picture depends on, by the name of the picture
    anew : whether all pictures are drawn
    """
    for name, texts in drawn.items():
        path = folder / f"{name}.png"
        digest = hashlib.sha256("\0".join(texts).encode()).hexdigest()[:16]
        there = path.read_bytes() if path.exists() else b""
        if anew or SOURCE + digest.encode() not in there:
            yield path, functools.partial(_draw, module, name, digest)
    yield from _others(folder, {f"{name}.png" for name in drawn})


def _draw(module, name, digest):
    picture = import_module(f"benchmarks.{module}").drawn(name)
    # A text in front of the picture's data, as PNG has it.
    content = SOURCE + digest.encode()
    chunk = struct.pack(">I", len(content) - 4) + content
    chunk += struct.pack(">I", zlib.crc32(content))
    at = picture.index(b"IDAT") - 4
    return picture[:at] + chunk + picture[at:]


CODES = ROOT / "tests/data/codes.txt"


def codes():
    """Return the list of all numbers and codes ever used; new rows are appended.

    Raises
    ------
    ValueError
        Where a number or a code of a published message has changed, or has neither a
        row nor an entry in `RETIRED`.
    """
    lines = CODES.read_text(encoding="utf-8").splitlines()
    published = dict(line.split() for line in lines)
    now = {row.number: row.code for row in (*every(), *RETIRED)}
    if not published.items() <= now.items():
        raise ValueError(f"changed: {sorted(published.items() - now.items())}")
    new = sorted(now.keys() - published.keys())
    return "\n".join([*lines, *(f"{number} {now[number]}" for number in new)]) + "\n"


def known():
    """Return the module with the codes of errors and warnings, and their types."""
    rows = sorted({*errors(), *cautions()})
    parts = [KNOWN, *(f'{constant(code)}: Final = "{code}"\n' for code in rows)]
    parts.append("\nif TYPE_CHECKING:\n    from typing import Literal, TypeAlias\n\n")
    for name, codes_of in {"ErrorCode": errors(), "WarningCode": cautions()}.items():
        listed = "".join(f'        "{code}",\n' for code in sorted(codes_of))
        parts.append(f"    {name}: TypeAlias = Literal[\n{listed}    ]\n")
    return "".join(parts)


def constant(code):
    """Return the name in `lagsim.codes.known` of a code: BAD_NAME for `bad-name`."""
    return code.upper().replace("-", "_")


KNOWN = '''\
"""Codes of errors and warnings: an unknown one cannot be imported.

Derived from the rows of this package: see docs/adding.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

'''

DERIVED = (
    Derived(
        "schema", "`lagsim/lagsim.schema.json`",
        "names of methods, formulations and functions; options of methods",
        _text(ROOT / "lagsim/lagsim.schema.json", lambda: document() + "\n"),
    ),
    Derived(
        "codes", "`tests/data/codes.txt`", "`lagsim/codes`", _text(CODES, codes),
    ),
    Derived(
        "known", "`lagsim/codes/known.py`", "`lagsim/codes`",
        _text(ROOT / "lagsim/codes/known.py", known),
    ),
    Derived(
        "errors", "`docs/errors.md`, the list of messages",
        "`lagsim/codes`, whose examples are run", _errors,
    ),
    Derived(
        "alarms", "`docs/failing.md`, the table of alarms",
        "`lagsim/codes/warnings.py`",
        _text(DOCS / "failing.md", pages.failing_page),
    ),
    Derived(
        "methods", "`docs/methods.md`", "docstrings and options of `methods/`",
        _text(DOCS / "methods.md", pages.methods_page),
    ),
    Derived(
        "keys", "`docs/model-file.md`, the table of keys", "the schema",
        _text(DOCS / "model-file.md", pages.model_page),
    ),
    Derived(
        "gallery", "`docs/gallery.md`", "headers of `models/`",
        _text(DOCS / "gallery.md", pages.gallery_page),
    ),
    Derived(
        "thumbnails", "`docs/gallery/*.png`", "`models/`, which are run", _thumbnails,
    ),
    Derived(
        "failing", "`docs/failing/*.png`",
        "`benchmarks/failing.py`, and `models/failing`, which are run", _failing,
    ),
    Derived(
        "pairs", "`docs/pairs.md`", "tables in `tests/scenes/pairs`",
        _text(pairs.PAGE, pairs.page),
    ),
    Derived(
        "documents", "`tests/show/documents`",
        "the printers of `derive`, and `tests/show/stored.py`", _documents,
    ),
    Derived(
        "list", "`docs/adding.md`, the table of derived files",
        "`DERIVED` in `benchmarks/regenerate.py`",
        _text(DOCS / "adding.md", lambda: pages.with_table("adding", LIST, table())),
    ),
    Derived(
        "readme", "the numbers in `README.md`", "`benchmarks/results*.md`",
        _text(readme.README, lambda: readme.page(readme.README.read_text("utf-8"))),
    ),
)  # fmt: skip


LIST = "<!-- From here on derived from benchmarks/regenerate.py. -->\n"


def table():
    """Return the table of derived files, for docs/adding.md."""
    rows = [f"| `{one.name}` | {one.files} | {one.sources} |\n" for one in DERIVED]
    return "".join(["| name | files | derived from |\n|---|---|---|\n", *rows])


def main(arguments):
    """Write stale files, or list them; return the exit code."""
    parser = argparse.ArgumentParser(prog=COMMAND)
    parser.add_argument("--check", action="store_true", help="list stale files only")
    parser.add_argument("--all", action="store_true", help="draw and run all anew")
    parser.add_argument("names", nargs="*", metavar="NAME")
    asked = parser.parse_args(arguments)
    known = {one.name: one for one in DERIVED}
    for name in asked.names:
        if name not in known:
            parser.error(f"{name} is none of {', '.join(known)}")
    found = False
    for one in map(known.get, asked.names or known):
        for path, content in one.stale(asked.all):
            found = True
            print(path.relative_to(ROOT))
            if asked.check:
                continue
            made = content()
            if made is None:
                path.unlink()
            else:
                path.write_bytes(made)
    return int(found and asked.check)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
