"""Limits on the cost of a file in SECURITY.md are those of the code."""

import re

import pytest

from lagsim import limits
from lagsim.model.loading import MAX_DEPTH
from lagsim.model.reader.runs import MAX_ROWS
from tests.support import ROOT

# The row of the page's table, and the budgets in it in the order of the text.
PROMISED = {
    "a model file, also from a pipe": ["MODEL_BYTES", "NODES", "MAX_DEPTH"],
    "the file of a table in a model": ["MODEL_BYTES", "TABLE_NUMBERS"],
    "families": ["MEMBERS", "TERMS", "LARGEST_INDEX"],
    "one expression": ["EXPRESSION_LETTERS"],
    "the equations": ["GRAPH_NODES", "GRAPH_NODES_PER_BYTE", "INERTIAS", None],
    "checking and planning": ["WORK", "WORK_PER_BYTE", "USUAL_BYTES"],
    "a table that is read": ["TABLE_BYTES"],
    "a record, golden or journal that is read": ["DOCUMENT_BYTES"],
    "rows": ["MAX_ROWS"],
    "steps of a fixed size": ["STEPS"],
    "`derive`": [
        "DERIVING_SECONDS", "EXACT_DIGITS", "WRITTEN_OPERATIONS", "WRITTEN_DEPTH",
        "WRITTEN_TERMS",
        "DERIVED_OPERATIONS",
    ],
}  # fmt: skip
BUDGETS = vars(limits) | {"MAX_DEPTH": MAX_DEPTH, "MAX_ROWS": MAX_ROWS}
UNITS = {"KiB": 2**10, "MiB": 2**20, "GiB": 2**30}
NUMBER = re.compile(r"10\^(\d+)|(\d[\d,]*)(?: ([KMG]iB))?")


def numbers(text):
    """Return the numbers of a cell: 10^6, 3,000,000, 16 MiB."""
    return [
        10 ** int(power) if power else int(whole.replace(",", "")) * UNITS.get(unit, 1)
        for power, whole, unit in NUMBER.findall(text)
    ]


def table():
    text = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.+?) \| (.+?) \|$", text, re.MULTILINE)
    return {of: cell for of, cell in rows if of != "of"}


def test_the_page_promises_these():
    assert set(table()) == set(PROMISED)


@pytest.mark.parametrize("of", PROMISED)
def test_a_budget_is_that_of_the_page(of):
    said = numbers(table()[of])
    assert len(said) == len(PROMISED[of])
    for number, name in zip(said, PROMISED[of], strict=True):
        if name is not None:
            assert BUDGETS[name] == number


def test_every_budget_is_promised_or_within_one():
    names = {name for row in PROMISED.values() for name in row} - {
        None,
        "MAX_DEPTH",
        "MAX_ROWS",
    }
    assert {name for name in vars(limits) if name.isupper()} - names == {
        "TIDYING_PRODUCTS",
        "TYPE_CHECKING",
    }


def test_the_larger_of_two_budgets_counts():
    # 3,000,000 operations, or 30 for each byte: as many at 100,000 bytes.
    assert [limits.graph_nodes(n) for n in (0, 99_999, 100_001, 2_000_000)] == [
        3_000_000, 3_000_000, 3_000_030, 60_000_000,
    ]  # fmt: skip
