"""sympy, from the text of the file alone, against the formats."""

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.show.as_python import as_python
from lagsim.show.lagrange import derived
from lagsim.show.printers import as_json
from tests.mechanics.test_equations import agrees, rows_of, solves, state_of
from tests.show.cases import EACH, READ, document_of, equations_of, known, numbers
from tests.support import MODELS, run
from tests.sympy_oracle import reads

# Whose accelerations are no longer than a few lines.
SHORT = (
    "appell-hamel", "bead-hoop", "car-on-a-road", "cart-pole", "chaplygin-sleigh",
    "charged-particle",
    "coupled-oscillators", "dc-motor", "double-pendulum", "dry-friction",
    "elastic-pendulum",
    "elastic-pendulum-curve", "elastic-pendulum-forced", "forced-oscillator",
    "heavy-top", "henon-heiles", "kepler", "moving-pivot", "pendulum-cartesian",
    "quarter-car", "shear-building", "stick-slip", "vibration-absorber",
    "von-mises-truss",
    "ziegler-column",
)  # fmt: skip
# Their multipliers are not told: contacts come and go.
SHORT_WITH_CONTACTS = (
    "ball-on-a-vibrating-table", "bouncing-ball", "hopper", "pendulum-friction",
    "planar-brake",
    "rocking-block", "slack-string", "sliding-ladder", "trebuchet",
)  # fmt: skip


EACH_READ = [case for case in EACH if case.values[0] in READ]


@pytest.mark.slow
@pytest.mark.parametrize("name", EACH_READ)
def test_json_read_again_gives_the_same_numbers(name):
    d = document_of(name)
    n, m = len(d["coordinates"]), len(d["constraints"])
    for seed in range(2):
        state, expected = state_of(name, seed)
        values = known(d, state)
        M = np.reshape(numbers([x for row in d["M"] for x in row], values), (n, n))
        f = numbers(d["f"], values)
        A = np.reshape(
            numbers([x for c in d["constraints"] for x in c["A"]], values), (m, n)
        )
        b = numbers([c["b"] for c in d["constraints"]], values)
        agrees(M, expected.M)
        agrees(f, expected.f)
        for k in range(m):
            # Squares of distances, written out, cancel: b has their power 3/2 below.
            part = 1e-10 if name == "newtons-cradle" else 1e-12
            agrees([*A[k], b[k]], [*expected.A[k], expected.b[k]], part)
        agrees(
            numbers([c["function"] for c in d["constraints"]], values),
            expected.residuals,
        )
        random = np.random.default_rng(seed)
        q_ddot, lam = random.standard_normal(n), random.standard_normal(m)
        values |= dict(
            zip((f"{q}_ddot" for q in d["coordinates"]), q_ddot, strict=True)
        )
        multipliers = [f"lambda_{c['name']}" for c in d["constraints"]]
        values |= dict(zip(multipliers, lam, strict=True))
        sides = [line[side] for line in d["equations"] for side in ("left", "right")]
        left, right = np.reshape(numbers(sides, values), (n, 2)).T
        size = np.abs(expected.M) @ np.abs(q_ddot) + np.abs(expected.f)
        size += np.abs(expected.A.T) @ np.abs(lam)
        balance = expected.M @ q_ddot - expected.f - expected.A.T @ lam
        assert np.max(np.abs(left - right - balance) / np.max(size)) < 1e-12
        accelerations = [c["acceleration"] for c in d["constraints"]]
        agrees(numbers(accelerations, values), expected.A @ q_ddot - expected.b)


@pytest.mark.parametrize("name", EACH_READ)
def test_terms_add_up_to_the_equation(name):
    d = as_json(derived(equations_of(name), expand=True))
    values = known(d, state_of(name, seed=1)[0])
    random = np.random.default_rng(5)
    values |= {f"{q}_ddot": random.standard_normal() for q in d["coordinates"]}
    values |= {f"lambda_{c['name']}": 0.0 for c in d["constraints"]}
    for line in d["equations"]:
        keys = [k for k in line if k not in ("coordinate", "momentum", "left", "right")]
        terms = dict(zip(keys, numbers([line[k] for k in keys], values), strict=True))
        total = sum(terms[k] for k in terms if k in ("ddt_dT_dqdot", "dV_dq"))
        total += sum(terms[k] for k in terms if k == "ddt_dL_dqdot")
        total -= sum(terms[k] for k in terms if k in ("dT_dq", "dL_dq", "Q"))
        total -= terms.get("ddt_dV_dqdot", 0.0)
        left, right = numbers([line["left"], line["right"]], values)
        size = sum(map(abs, terms.values())) + abs(left) + abs(right)
        assert left - right == pytest.approx(total, rel=0, abs=1e-12 * (size or 1.0))


@pytest.mark.slow
@pytest.mark.parametrize("name", EACH)
def test_accelerations_are_told_where_they_are_short(name):
    told = document_of(name)["accelerations"] is not None
    assert told == (name in (*SHORT, *SHORT_WITH_CONTACTS))


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in SHORT if reads(MODELS / f"{n}.yaml")])
def test_accelerations_in_closed_form_solve_the_equations(name):
    d = document_of(name)
    assert d["accelerations"]["steps"] == {}
    for seed in range(2):
        state, x = state_of(name, seed)
        values = known(d, state)
        lam = numbers(d["accelerations"]["lambda"], values)
        multipliers = [f"lambda_{c['name']}" for c in d["constraints"]]
        values |= dict(zip(multipliers, lam, strict=True))
        q_ddot = np.array(numbers(d["accelerations"]["q_ddot"], values))
        # Quotients of sums lose some digits more than sums do.
        solves(x, q_ddot, np.array(lam))


def module_of(name):
    scope = {}
    exec(compile(as_python(equations_of(name), "0"), name, "exec"), scope)
    return scope


@pytest.mark.parametrize("name", EACH_READ)
def test_the_python_module_gives_the_numbers_of_the_graph(name):
    e, module = equations_of(name), module_of(name)
    assert module["COORDINATES"] == e.q
    rows = rows_of(e)
    assert module["CONSTRAINTS"] == tuple(row.name for row in rows)
    assert module["PARAMETERS"] == {p.name: p.value for p in e.model.parameters}
    for seed in range(2):
        values, _ = state_of(name, seed)
        module["PARAMETERS"].update({p: values[p] for p in module["PARAMETERS"]})
        n, m, states = len(e.q), len(rows), [x.rate for x in e.states]
        state = [values[x] for x in e.state]
        parts = state[:n], state[n : 2 * n], state[2 * n :]
        at = values["t"], *(parts if states else parts[:2])
        for function, nodes, shape in (
            ("mass_matrix", [x for row in e.M for x in row], (n, n)),
            ("force", e.f, (n,)),
            ("constraint_matrix", [x for row in rows for x in row.A], (m, n)),
            ("constraint_rhs", [row.b for row in rows], (m,)),
            *([("state_rates", states, (len(states),))] if states else []),
        ):
            found = module[function](*at)
            assert found.shape == shape
            agrees(np.ravel(found), evaluate(e.graph, nodes, values))


QUICK = ("bead-hoop", "charged-particle", "heavy-top", "kepler")


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[] if n in QUICK else [pytest.mark.slow]) for n in READ],
)
def test_what_is_told_holds_along_a_run(name):
    d = document_of(name)
    r = run(name, duration=0.02, output_step=0.002)
    columns = r.system.columns.names
    found = []
    for row in r.rows:
        at = dict(zip(columns, map(float, row[: len(columns)]), strict=True))
        values = known(d, {**d["parameters"], **at})
        kept = numbers([k["expression"] for k in d["conserved"]], values)
        found.append(kept)
        if d["kinetic"] is not None:
            T, V = numbers([d["kinetic"], d["potential"]], values)
            # Each a sum of some ten terms, which may cancel.
            assert pytest.approx(at["kinetic"], rel=1e-12, abs=1e-12) == T
            assert pytest.approx(at["potential"], rel=1e-9, abs=1e-12) == V
    for kept in np.transpose(found):
        # The run's own tolerance is 1e-11 of the scale of each component.
        scale = max(np.max(np.abs(kept)), np.max(r["kinetic"]))
        assert np.ptp(kept) <= 1e-9 * scale
