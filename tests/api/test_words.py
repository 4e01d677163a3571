"""Arguments: forms that denote a model, and faults in the words of Python."""

import copy
import inspect
import math
import pickle
import re

import numpy as np
import pytest

import lagsim
from tests.small_scenes import spring
from tests.support import refused

SPRING = spring("duration: 1")
NUMBERS = [
    "duration", "output_step", "rtol", "atol", "step", "gain", "spectral_radius",
]  # fmt: skip


def sweep(model, **options):
    return lagsim.sweep(model, {"k": [1]}, **options)


@pytest.fixture
def spring():
    return lagsim.load(SPRING)


@pytest.mark.parametrize("call", [lagsim.simulate, sweep])
@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((n, -1) for n in NUMBERS), *((n, "2*") for n in NUMBERS),
        ("method", "rk5"), ("formulation", "x"), ("rtol", 2),
    ],
)  # fmt: skip
def test_a_fault_names_the_argument(spring, call, name, value):
    if call is sweep and name == "formulation":
        pytest.skip("known when the runs begin")
    with pytest.raises(lagsim.InputError) as raised:
        call(spring, **{name: value})
    text = str(raised.value)
    assert text.startswith(f"{name}=")
    assert "--" not in text
    [problem] = raised.value.problems
    first, source, caret, *_ = text.split("\n")
    assert first.startswith(f"{problem.file}:1:{problem.column}: ")
    # The caret stands below what is given.
    shown = source[2 + len(name) + 1 :]
    assert float(shown) == value if isinstance(value, int) else shown == value
    assert len(name) + 3 <= caret.index("^") <= len(source)


@pytest.mark.parametrize(("values", "text"), [
    ({"k": "2*"}, "k=2*:1:5"), ({"x": "k k"}, "x=k k:1:5"), ({"kk": 1}, "kk=1.0:1:1"),
    ({"x_dott": 1}, "x_dott=1.0:1:1"),
])  # fmt: skip
def test_a_fault_of_a_value_names_it(spring, values, text):
    for call in (
        lambda: spring.bind(**values),
        lambda: lagsim.load(SPRING, **values),
        lambda: spring.bind(values if "k" in str(values) else None, None, **values),
    ):
        with pytest.raises(lagsim.InputError) as raised:
            call()
        assert str(raised.value).startswith(text)
        assert "--" not in str(raised.value)


@pytest.mark.parametrize("value", [[1], None, object(), True, np.True_])
def test_what_is_neither_number_nor_text_is_refused(spring, value):
    with pytest.raises(TypeError, match=r"^k="):
        spring.bind(k=value)
    if value is not None:
        with pytest.raises(TypeError, match=r"^step="):
            lagsim.simulate(spring, step=value)
    with pytest.raises(TypeError, match=r"^k=|^k: "):
        lagsim.sweep(spring, {"k": [value]})


def test_words_and_lists_are_checked(spring):
    with pytest.raises(ValueError, match=r"error_bar='no': one of 'auto', 'always'"):
        lagsim.simulate(spring, error_bar="no")
    with pytest.raises(ValueError, match="error_bar"):
        sweep(spring, error_bar="no")
    for jobs in (0, -1, "x", 1.5, True):
        with pytest.raises(ValueError, match=rf"jobs={jobs!r}: 1 or more"):
            sweep(spring, jobs=jobs)
    for values in ("k=1", None, [("k", [1])], {3: [1]}):
        with pytest.raises(TypeError, match=r"^values.* expected"):
            lagsim.sweep(spring, values)
    with pytest.raises(TypeError, match=r"method=3"):
        lagsim.simulate(spring, method=3)
    for values in ("1,2", 3, None):
        with pytest.raises(TypeError, match=r"^k: .* a list of values"):
            lagsim.sweep(spring, {"k": values})
    with pytest.raises(TypeError, match="ouput_step"):
        sweep(spring, ouput_step=1)
    for call in (spring.bind, lambda k: lagsim.sweep(spring, {"k": [k]})):
        with pytest.raises(ValueError, match=r"^k: the largest number is about"):
            call(k=10**400)
    with pytest.raises(ValueError, match=r"table='xls': one of 'csv'"):
        lagsim.simulate(spring, error_bar="never").write("nowhere", table="xls")


@pytest.mark.parametrize(
    "wrong",
    ["a", "1.5", None, 1j, {"x": 1}, [[1], [1, 2]], ["a"], True, [None], 10**400],
)
def test_times_and_states_name_themselves(spring, wrong):
    result = lagsim.simulate(spring, error_bar="never")
    for copied in (pickle.dumps, copy.deepcopy):
        with pytest.raises(
            TypeError, match=r"cannot be pickled or copied: `result\.wr"
        ):
            copied(result)
    for name, call in [
        ("t", result.at), ("t", lambda x: spring.rhs(x, [1], [0])),
        ("q", lambda x: spring.rhs(0, x, [0])),
        ("q_dot", lambda x: spring.rhs(0, [1], x)),
    ]:  # fmt: skip
        with pytest.raises(TypeError, match=rf"^{name}=.*a number is expected"):
            call(wrong)


@pytest.mark.parametrize(
    "call", [sweep, lambda x: lagsim.simulate(x, error_bar="never")]
)
def test_a_table_is_asked_for_its_columns(spring, call):
    found = call(spring)
    assert tuple(found) == found.columns
    assert found.columns[-1] in found
    assert "y" not in found


CALLS = {
    "simulate": lambda x: lagsim.simulate(x, error_bar="never").table.tolist(),
    "check": lambda x: lagsim.check(x).record["constraints"],
    "derive": lambda x: lagsim.derive(x).json["accelerations"],
    "sweep": lambda x: lagsim.sweep(x, {"k": [1, 2]}, ends=True)["x.end"].tolist(),
    "load": lambda x: lagsim.load(x).parameters,
}


@pytest.mark.parametrize("name", sorted(CALLS))
def test_a_path_or_a_text_stands_for_a_model(spring, tmp_path, name):
    call, path = CALLS[name], tmp_path / "spring.yaml"
    path.write_text(SPRING)
    assert call(path) == call(str(path)) == call(SPRING) == call(spring)
    for wrong in (3, None, ["a"]):
        with pytest.raises(TypeError, match=r"a path, or the text of a file"):
            call(wrong)
    with refused("unreadable", "other.yaml"):
        call(tmp_path / "other.yaml")


@pytest.mark.parametrize("name", ["simulate", "sweep", "check", "derive", "load"])
def test_help_explains_each_argument(name):
    function = getattr(lagsim, name)
    said = inspect.getdoc(function)
    parameters = said.partition("Parameters\n----------\n")[2].partition("Raises")[0]
    heads = re.findall(r"(?m)^(\S.*?)(?: : .*)?$", parameters)  # without the types
    named = ", ".join(heads).replace("*", "")
    if name == "sweep":
        named = named.replace(
            "...", ", ".join(inspect.signature(lagsim.simulate).parameters)
        )
    assert set(inspect.signature(function).parameters) <= set(named.split(", "))


# Parameters whose meaning depends on the function.
VARIED = {"**values", "*columns", "error_bar", "starts", "values", "vary"}
# Of a fit these stand together.
OF_RUNS = {"duration", "method", "formulation", "atol"}


def parameters_of(function):
    """Return the descriptions of parameters in a docstring, by name."""
    text = inspect.cleandoc(function.__doc__ or "")
    found = re.search(r"Parameters\n-+\n(.*?)(\n\n\w+\n-+\n|\Z)", text, re.DOTALL)
    parts = re.split(r"\n(?=\S)", found[1]) if found else []
    heads = (part.partition("\n") for part in parts)
    return {
        name: " ".join(about.split())
        for head, _, about in heads
        for name in head.partition(" : ")[0].split(", ")
    }


def test_a_parameter_is_described_alike_everywhere():
    shown = [getattr(lagsim, name) for name in lagsim.__all__]
    functions = [x for x in shown if inspect.isfunction(x)]
    methods = [vars(x).values() for x in shown if inspect.isclass(x)]
    functions += [f for some in methods for f in some if inspect.isfunction(f)]
    texts = {}
    for function in functions:
        own = OF_RUNS if function is lagsim.fit else set()
        for name, text in parameters_of(function).items():
            if name not in VARIED | own:
                texts.setdefault(name, set()).add(text)
    assert {"model", "folder", "jobs"} <= texts.keys()
    assert {name: found for name, found in texts.items() if len(found) > 1} == {}


DRIVEN = """
name: spring
parameters: {k: 4}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
forces: {x: 0}
initial: {x: 0}
"""


@pytest.mark.parametrize("ends", [(5, 5), (math.nan, 2), ("a", "b"), (1, 2, 3), 7])
def test_a_range_is_two_different_numbers(ends):
    with pytest.raises(ValueError, match=r"^k=.*: two different numbers are expected"):
        lagsim.equilibrium(DRIVEN, vary={"k": ends})
    with pytest.raises(ValueError, match=r"^frequencies=.*: two frequencies above 0"):
        lagsim.modes(DRIVEN, response=["x:x"], frequencies=ends)


@pytest.mark.slow
def test_a_range_may_have_its_larger_end_first():
    found = lagsim.equilibrium(DRIVEN, vary={"k": (5, 1)})
    values = [point["value"] for branch in found.branches for point in branch]
    assert (min(values), max(values)) == (1.0, 5.0)
    response = lagsim.modes(DRIVEN, response=["x:x"], frequencies=(10, 0.1)).response
    assert response["frequency"][[0, -1]].tolist() == pytest.approx([0.1, 10.0])


@pytest.mark.parametrize("text", ["x", "x:", ":x", "x:x:x"])
def test_a_response_is_of_an_output_to_an_input(text):
    with pytest.raises(ValueError, match="'INPUT:OUTPUT' is expected"):
        lagsim.modes(DRIVEN, response=[text])
