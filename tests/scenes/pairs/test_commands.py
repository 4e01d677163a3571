"""Each method, and each option of outputs, with each physical feature."""

import numpy as np
import pytest

import lagsim
from lagsim.methods import method, names
from lagsim.plan.formulation import formulations
from tests.scenes.pairs.commands import COMMANDS, FORMULATIONS, FREEDOM, METHODS
from tests.scenes.pairs.physical import BY_NAME
from tests.scenes.pairs.scene import (
    PAIRS,
    Refusal,
    holds_sections,
    motion,
    part_of,
    scene,
)

STEP = 0.001
# By the order of the method: what its error is at STEP, for motions of size 1.
BOUNDS = {1: 1e-2, 2: 1e-5}
FREE = [name for name, f in BY_NAME.items() if not f.formulation]


def _cases():
    for m in METHODS:
        for name in BY_NAME:
            marks = [] if part_of(f"{m} {name}", 6) else [pytest.mark.slow]
            yield pytest.param(m, name, id=f"{m} {name}", marks=marks)


def asked(*fragments, extra="", coupled=False, **options):
    text = scene(*fragments, extra=extra, coupled=coupled)
    result = lagsim.simulate(lagsim.load(text), error_bar="never", **options)
    assert result.complete, result.reason
    return result


def test_every_method_is_in_the_table():
    assert set(METHODS) == set(names())


@pytest.mark.parametrize(("m", "name"), list(_cases()))
def test_methods(m, name):
    fragment, module = BY_NAME[name], method(m)
    steps = not module.ADAPTIVE
    options = {"method": m, **({"step": STEP} if steps else {})}
    if name in METHODS[m]:
        with Refusal("method-refused", METHODS[m][name]).expected(f"`{m}`"):
            asked(fragment, **options)
        return
    result = asked(fragment, **options)
    bound = BOUNDS.get(module.ORDER, 1e-9)
    assert result.t[-1] == pytest.approx(fragment.end, abs=max(bound, 1e-9))
    for q, x in motion(fragment, t=result.t).items():
        assert result[q] == pytest.approx(x, abs=bound), q
    holds_sections(result, fragment, bound=bound)


def _posed():
    for formulation in FORMULATIONS:
        for name in FREE:
            case = f"{formulation} {name}"
            marks = [] if part_of(case, 10) else [pytest.mark.slow]
            yield pytest.param(formulation, name, id=case, marks=marks)


def test_every_formulation_is_in_the_table():
    assert {"auto", *FORMULATIONS} == set(formulations())


@pytest.mark.parametrize(("formulation", "name"), list(_posed()))
def test_formulations(formulation, name):
    pair = BY_NAME[name], BY_NAME["smooth"]
    reason = FORMULATIONS[formulation].get(name)
    if reason is not None:
        with Refusal("formulation-refused", reason).expected(f"`{formulation}`"):
            asked(*pair, formulation=formulation)
        return
    result = asked(*pair, formulation=formulation)
    for q, x in motion(*pair, t=result.t).items():
        assert result[q] == pytest.approx(x, abs=1e-9), q
    holds_sections(result, *pair, bound=1e-9)


@pytest.mark.parametrize("name", FREE)
def test_check_counts_the_degrees_of_freedom(name):
    found = lagsim.check(lagsim.load(scene(BY_NAME[name])))
    assert found.admissible
    assert found.degrees_of_freedom == FREEDOM.get(name, 1)


@pytest.mark.slow
@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_check_counts_those_of_both(first, second):
    if first == second == "until" or "elimination" in (first, second):
        pytest.skip("no pair, or a formulation that `check` does not choose")
    found = lagsim.check(lagsim.load(scene(BY_NAME[first], BY_NAME[second])))
    assert found.admissible
    assert found.degrees_of_freedom == FREEDOM.get(first, 1) + FREEDOM.get(second, 1)


@pytest.mark.parametrize("name", BY_NAME)
def test_the_action_is_the_integral_of_the_rows(name):
    # Trapezia: an impact has two rows at one time, so jumps cost nothing.
    more = {} if BY_NAME[name].formulation else {"method": "dop853"}
    result = asked(
        BY_NAME[name], extra="output: {action: true}", output_step=0.002, **more
    )
    L = result["kinetic"] - result["potential"]
    S = np.concatenate(([0.0], np.cumsum((L[1:] + L[:-1]) / 2 * np.diff(result.t))))
    assert result["action.S"] == pytest.approx(S, abs=2e-4)


@pytest.mark.parametrize("name", BY_NAME)
def test_gauss_is_what_the_constraint_forces_do_to_unit_masses(name):
    extra = "output: {gauss: true}"
    if name in COMMANDS["gauss"]:
        with Refusal("singular-mass", COMMANDS["gauss"][name]).expected():
            asked(BY_NAME[name], extra=extra)
        return
    result = asked(BY_NAME[name], extra=extra)
    forces = [c for c in result.columns if c.startswith("Qc_")]
    least = sum(result[c] ** 2 for c in forces) / 2 + 0.0 * result.t
    assert result["gauss.G"] == pytest.approx(least, rel=1e-9, abs=1e-18)


@pytest.mark.parametrize("name", BY_NAME)
def test_what_moves_by_its_own_forces_needs_no_reaction(name):
    # x1 moves as a coordinate of its own would: nothing has to hold it.
    result = asked(
        BY_NAME[name],
        BY_NAME["smooth"],
        coupled=True,
        extra="output: {reactions: [x1, x2]}",
    )
    for x in ("reaction.x1", "reaction.x2"):
        assert result[x] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_NAME)
def test_a_sweep_has_the_ends_of_single_runs(name):
    model = lagsim.load(scene(BY_NAME[name], BY_NAME["smooth"]))
    starts = [1.0, 0.5]
    swept = lagsim.sweep(model, {"x2": starts}, error_bar="never", jobs=1)
    assert list(swept["outcome"]) == 2 * ["until" if name == "until" else "done"]
    end = BY_NAME[name].end
    assert swept["x2.end"] == pytest.approx(np.cos(2 * end) * np.array(starts))
    for k, x2 in enumerate(starts):
        alone = lagsim.simulate(model.bind(x2=x2), error_bar="never")
        assert swept["x1.end"][k] == alone["x1"][-1]
        assert swept["x2.end"][k] == alone["x2"][-1]


@pytest.mark.slow
@pytest.mark.parametrize("law", ["sliding", "holonomic", "Pfaffian", "contact"])
def test_gauss_while_the_motion_follows_a_switch_is_that_of_its_partner(law):
    # What the switch holds is a force of the model, and no constraint's.
    extra, pair = "output: {gauss: true}", (BY_NAME["sliding"], BY_NAME[law])
    result = asked(*pair, coupled=True, extra=extra)
    alone = asked(pair[1], extra=extra)
    k = np.searchsorted(result.t, 1.9), np.searchsorted(alone.t, 1.9)
    assert result["gauss.G"][k[0]] == pytest.approx(alone["gauss.G"][k[1]], abs=1e-9)
