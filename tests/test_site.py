"""Relations between pages: links, anchors, commands in the text, generated pages."""

import re
import shlex
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location

import pytest
import typer
import yaml

from benchmarks import played
from lagsim.cli import COMMANDS
from lagsim.methods import names
from lagsim.run.trajectory import Outcome
from lagsim.version import __version__
from tests.pages import PAGES, anchors, blocks, links, prose, text_of
from tests.support import MODELS, ROOT

MOST_OF_GALLERY = 3_000_000


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    for link in links(page):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, place = link.partition("#")
        target = ((ROOT / page).parent / path).resolve() if path else ROOT / page
        assert target.exists(), f"{page}: {link}"
        if place and target.suffix == ".md":
            name = target.relative_to(ROOT).as_posix()
            assert place in anchors(name), f"{page}: {link}"


def test_the_site_has_all_pages():
    config = yaml.safe_load(text_of("mkdocs.yml"))

    def leaves(node):
        if isinstance(node, str):
            return [node]
        below = node.values() if isinstance(node, dict) else node
        return [leaf for x in below for leaf in leaves(x)]

    listed = leaves(config["nav"])
    docs = [p.removeprefix("docs/") for p in PAGES if p.startswith("docs/")]
    assert sorted(listed) == sorted(["index.md", *docs])
    # Nothing is fetched when a page is read.
    assert config["theme"]["font"] is False


def test_commands_in_the_text_are_commands():
    """Commands in `back quotes`, too, have names and options of the program."""
    app = typer.Typer()
    for name in COMMANDS:
        app.command(name)(import_module(f"lagsim.cli.{name}").command)
    group = typer.main.get_command(app)
    found = 0
    for page in PAGES:
        inline = re.findall(r"`(lagsim [^`]+)`", prose(page))
        told = [b.text for b in blocks(page) if b.kind in ("sh", "console", "text")]
        shown = re.findall(r"^\$? ?(lagsim [^#\n]*)", "\n".join(told), re.MULTILINE)
        for text in inline + shown:
            words = shlex.split(re.sub(r"[\[\]|>]|\.\.\.", " ", text).replace("\\", ""))
            if words[1].startswith("--") or words[1] == "COMMAND":
                continue
            assert words[1] in group.commands, f"{page}: {text}"
            known = {o for p in group.commands[words[1]].params for o in p.opts}
            options = [w.partition("=")[0] for w in words[2:] if w.startswith("--")]
            assert set(options) <= known | {"--help"}, f"{page}: {text}"
            found += 1
    assert found > 20
    listed = re.findall(r"^\| `lagsim (\w+)", text_of("docs/commands.md"), re.MULTILINE)
    assert sorted(listed) == sorted(COMMANDS)


def test_the_gallery_has_each_model_once():
    page = text_of("docs/gallery.md")
    shipped = sorted(p.stem for p in MODELS.glob("*.yaml"))
    assert sorted(re.findall(r"`lagsim run models/([\w-]+)\.yaml`", page)) == shipped
    pictures = list((ROOT / "docs/gallery").iterdir())
    assert sorted(p.stem for p in pictures) == shipped
    assert sum(p.stat().st_size for p in pictures) < MOST_OF_GALLERY
    # By eye, from what the files say: which ones are held, rolled, struck.
    parts = dict(
        re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE)
    )
    for group, some in {
        "Free motion": ["kepler"],
        "Held by constraints": ["andrews"],
        "Rolling and steering": ["rolling-disk", "bicycle"],
        "Contact and friction": ["newtons-cradle", "quadruped"],
    }.items():
        assert all(f"models/{name}.yaml`" in parts[group] for name in some)


def test_the_methods_are_counted():
    counted = ("twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen")
    assert f"{counted[len(names()) - 12]} integration methods" in text_of("README.md")


@pytest.mark.parametrize("outcome", [o for o in Outcome if o.advice], ids=str)
def test_the_page_on_errors_has_each_ending(outcome):
    assert outcome.advice in text_of("docs/errors.md")


def test_the_citation_names_this_version():
    cited = yaml.safe_load(text_of("CITATION.cff"))
    # What the format demands, and the facts that stand elsewhere too.
    assert cited["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= cited.keys()
    assert str(cited["version"]) == __version__
    [author] = cited["authors"]
    assert f"Copyright (c) 2026 {author['name']}" in text_of("LICENSE")
    assert text_of("LICENSE").startswith(f"{cited['license']} License")


def test_the_page_on_the_layout_has_every_room():
    rooms = text_of("docs/architecture.md").partition("## The rooms")[2]
    rooms = rooms.partition("\n## ")[0]
    there = {p.parent.name for p in (ROOT / "lagsim").glob("*/__init__.py")}
    told = set(
        re.findall(
            r"`(\w+)/`", "\n".join(re.findall(r"^\| .*? \|", rooms, re.MULTILINE))
        )
    )
    assert told == there


def test_the_page_on_adding_names_what_exists():
    page = text_of("docs/adding.md")
    rooms = [ROOT / x for x in (".", "lagsim", "lagsim/methods", "tests")]
    for path in re.findall(r"`([\w./-]+/[\w.-]+)`", page):
        assert any((room / path).exists() for room in rooms), path
    found = re.findall(
        r"`(\w+)`(?: (?:and|or) `(\w+)`)? (?:of|in)\s+`([\w/]+\.py)`", page
    )
    assert len(found) > 25
    for *parts, path in found:
        file = next(room / path for room in rooms if (room / path).exists())
        text = file.read_text(encoding="utf-8")
        for name in filter(None, parts):
            assert re.search(rf"\b{name}\b", text), f"{name} of {path}"


@pytest.fixture(scope="module")
def hooks():
    pytest.importorskip("mkdocs", reason="needs mkdocs")
    spec = spec_from_file_location("hooks", ROOT / "docs/hooks.py")
    made = module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def test_the_site_finds_where_models_are_played(hooks):
    shipped = sorted(p.stem for p in MODELS.glob("*.yaml"))
    assert sorted(hooks.RUN.findall(text_of("docs/gallery.md"))) == shipped
    assert text_of("docs/explore.md").count(hooks.PICTURE) == 1


def test_a_trial_of_the_site_plays_some_models(monkeypatch):
    models = sorted(MODELS.glob("*.yaml"))
    assert played.tried(models) == models
    monkeypatch.setenv("LAGSIM_TEST_SLICE", "slow=2,played=12")
    some = [path.stem for path in played.tried(models)]
    assert played.SHOWN in some
    assert len(models) / 12 <= len(some) <= len(models) / 12 + 2


@pytest.mark.slow
def test_models_that_a_page_can_hold_are_played():
    assert played.page(MODELS / "bouncing-ball.yaml") == b""
    page = played.page(MODELS / "elastic-pendulum.yaml")
    assert page.startswith(b"<!DOCTYPE html>")
