"""`lagsim methods`."""

from pathlib import Path

import pytest

from lagsim.methods import names
from lagsim.model.model import RETIRED_FORMULATIONS
from tests.small_scenes import oscillator

KEYS = {"name", "order", "adaptive", "handles"}


def test_the_list_has_each_method_with_its_order(lagsim):
    called = lagsim("methods", code=0)
    assert called.err == ""
    rows = {line.split()[0]: line.split() for line in called.out.splitlines()}
    assert rows["dop853"][1:3] == ["8", "adaptive"]
    assert rows["rk4"][1:3] == ["4", "fixed"]
    assert list(rows)[1:] == list(names())
    # One line each on a terminal of usual width, in columns.
    assert max(map(len, called.out.splitlines())) <= 88
    first, *rest = called.out.splitlines()
    begins = first.index("handles")
    assert all(line[begins - 1] == " " != line[begins] for line in rest)


def test_the_list_as_json(lagsim):
    called = lagsim("methods", "--json", code=0)
    orders = {m["name"]: m["order"] for m in called.json}
    assert list(orders) == list(names())
    assert orders.items() >= {"dop853": 8, "rk4": 4, "euler": 1}.items()
    assert all(m.keys() >= KEYS for m in called.json)


@pytest.mark.parametrize("name", names())
def test_the_page_on_one_names_its_source(lagsim, name):
    called = lagsim("methods", name, code=0)
    assert "Source" in called.out
    assert "order " in called.out
    assert max(map(len, called.out.splitlines())) <= 88
    assert [m["name"] for m in lagsim("methods", name, "--json").json] == [name]


def test_a_run_by_a_retired_method_takes_another_one(lagsim, write):
    write(oscillator("duration: 1"))
    options = ("--method", "exponential", "--no-plots", "--json")
    record = lagsim("run", "model.yaml", *options, code=0).json
    assert [x["code"] for x in record["warnings"]] == ["retired"]
    assert record["method"] in names()
    assert "is retired" in lagsim("methods", "exponential", code=2).err


@pytest.mark.slow
@pytest.mark.parametrize("name", RETIRED_FORMULATIONS)
def test_a_run_in_a_retired_formulation_takes_another_one(lagsim, name):
    Path("model.yaml").write_text(
        "coordinates: {x: {}, y: {}}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: x^2/2}\n"
        "initial: {x: 1, y: 0}\n"
        f"simulation: {{duration: 1, formulation: {name}}}\n"
    )
    for options in ((), ("--formulation", name)):
        record = lagsim("run", "model.yaml", "--no-plots", "--json", *options).json
        assert [x["code"] for x in record["warnings"]] == ["retired"]
        assert record["formulation"] == "none"


@pytest.mark.slow
def test_commands_on_several_methods_leave_a_retired_one_out(lagsim, write):
    write(oscillator("duration: 1"))
    options = ("--methods", "exponential,rk4", "--steps", "0.01:0.02", "--json")
    found = lagsim("stability", "model.yaml", *options, code=0)
    assert found.reports("W207", "`exponential`")
    assert list(found.json["borders"]) == ["rk4"]
