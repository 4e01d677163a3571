"""The page of features in pairs is that of the table."""

from tests.scenes.pairs.page import PAGE, page
from tests.support import ROOT


def test_the_page_is_in_step_with_the_table():
    assert PAGE.read_text("utf-8") == page()


def test_the_site_lists_it():
    assert "pairs.md" in (ROOT / "mkdocs.yml").read_text("utf-8")
