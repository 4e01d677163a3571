"""`lagsim methods`."""

from __future__ import annotations

import pytest

KEYS = {"name", "order", "adaptive", "handles"}


def test_the_list_has_each_method_with_its_order(lagsim):
    called = lagsim("methods")
    assert called.code == 0
    assert called.err == ""
    rows = {line.split()[0]: line.split() for line in called.out.splitlines()}
    assert rows["dop853"][1:3] == ["8", "adaptive"]
    assert rows["rk4"][1:3] == ["4", "fixed"]


def test_the_list_as_json(lagsim):
    called = lagsim("methods", "--json")
    assert called.code == 0
    orders = {m["name"]: m["order"] for m in called.json}
    assert orders == {"dop853": 8, "rk4": 4}
    assert all(m.keys() >= KEYS for m in called.json)


@pytest.mark.parametrize("name", ["dop853", "rk4"])
def test_the_page_on_one_names_its_source(lagsim, name):
    called = lagsim("methods", name)
    assert called.code == 0
    assert "Hairer" in called.out
    assert max(map(len, called.out.splitlines())) <= 88
    assert [m["name"] for m in lagsim("methods", name, "--json").json] == [name]


@pytest.mark.parametrize("name", ["rk44", "auto", ""])
def test_an_unknown_method(lagsim, name):
    called = lagsim("methods", name)
    assert (called.code, called.out) == (2, "")
    assert f"no method `{name}`" in called.err
    assert "one of dop853, rk4" in called.err
    [error] = lagsim("methods", name, "--json").json["errors"]
    assert error["code"] == "unknown-method"
