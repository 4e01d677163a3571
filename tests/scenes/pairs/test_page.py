"""The page on pairs of features is in the navigation of the site."""

from tests.support import ROOT


def test_the_site_lists_it():
    assert "pairs.md" in (ROOT / "mkdocs.yml").read_text("utf-8")
