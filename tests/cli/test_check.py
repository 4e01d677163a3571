"""`lagsim check`: the verdict, the contract's keys, the exit codes."""

import json
import subprocess
import sys

import pytest

from tests.small_scenes import CAPTION, CONTACT, CURVE, ON_THE_CURVE, PENDULUM
from tests.support import MODELS

NONHOLONOMIC = """\
coordinates: {x: , y: , phi: }
energy: {kinetic: (x_dot^2 + y_dot^2 + phi_dot^2)/2, potential: 0}
constraints: {edge: x_dot*sin(phi) = y_dot*cos(phi), driven: phi_dot = cos(t)}
initial: {x: 0, y: 0, phi: 0, x_dot: 1, phi_dot: 1}
simulation: {duration: 1}
"""


def test_an_admissible_start(lagsim, write):
    called = lagsim("check", write(ON_THE_CURVE), code=0, err="")
    first, second = called.out.splitlines()[:2]
    assert first == "admissible: model"
    assert second.strip() == (
        "2 coordinates, 1 constraint of rank 1, 1 degree of freedom"
    )
    assert not lagsim("check", write(PENDULUM), "--repair").code


def test_the_captions_start(lagsim, write):
    called = lagsim("check", write(CAPTION), code=1)
    first = called.out.splitlines()[0]
    assert first.startswith("inadmissible: model: ")
    assert "`path` has the residual 1" in first
    # The nearest state in the metric of M, as the errata of the notes give it.
    assert "theta: 0.770916997" in called.out
    assert "u: 0.405686983" in called.out
    assert "guess" in called.out


def test_the_document(lagsim, write):
    called = lagsim("check", write(CAPTION), "--json", code=1, err="")
    document = called.json
    assert document["admissible"] is False
    assert document["degrees_of_freedom"] == 1
    [path] = document["constraints"]
    expected = {
        "name": "path", "kind": "holonomic", "scleronomic": True, "pfaffian": None,
        "integrable": None, "residual": 1.0, "velocity_residual": 0.0,
        "satisfied": False, "redundant": False,
        # It always holds, and has no mode.
        "rate": None, "active": None, "holds": None, "mode": None,
    }  # fmt: skip
    assert {key: path[key] for key in expected} == expected
    assert document["repair"] == pytest.approx(
        {"theta": 0.770917, "u": 0.405687}, abs=1e-6
    )
    assert isinstance(document["warnings"], list)


@pytest.mark.parametrize(
    ("simulation", "code"),
    [
        ("start: 2", 0),
        ("start: 2, duration: 1", 0),
        ("start: 1", 1),
        ("start: 2, method: rk5", 2),
    ],
)
def test_what_the_file_says_of_a_run_without_an_end(lagsim, write, simulation, code):
    text = NONHOLONOMIC.replace("phi_dot: 1", "phi_dot: cos(2)")
    lagsim("check", write(text.replace("duration: 1", simulation)), code=code)


def test_what_is_inferred_of_velocity_relations(lagsim, write):
    document = lagsim("check", write(NONHOLONOMIC), "--json").json
    edge, driven = document["constraints"]
    assert document["admissible"] is True
    assert document["degrees_of_freedom"] == 1
    assert (edge["kind"], edge["pfaffian"], edge["scleronomic"]) == (
        "nonholonomic", True, True,
    )  # fmt: skip
    assert (driven["pfaffian"], driven["scleronomic"]) == (True, False)
    assert edge["velocity_residual"] is None


def test_a_start_value_that_is_missed_is_no_constraint(lagsim, write):
    model = write(ON_THE_CURVE.replace("initial: {", "initial: {x: 0.5, "))
    called = lagsim("check", model, code=1)
    assert "`x: 0.5`" in called.out.splitlines()[0]
    document = lagsim("check", model, "--json").json
    assert document["admissible"] is False
    assert [c["name"] for c in document["constraints"]] == ["path"]


def test_a_contact_is_classified(lagsim, write):
    called = lagsim("check", write(CONTACT), "--json", code=0)
    [floor] = called.json["constraints"]
    assert (floor["name"], floor["kind"]) == ("floor", "one-sided")
    assert floor["residual"] == 1.0
    assert floor["pfaffian"] is None
    below = lagsim("check", write(CONTACT.replace("y: 1", "y: -1")), code=1)
    assert "`floor`" in below.out.splitlines()[0]


LAWS = """\
coordinates: {x: , y: , a: }
energy: {kinetic: (x_dot^2 + y_dot^2 + a_dot^2)/2, potential: 9.8*y}
forces: {a: 1}
constraints:
  floor: {relation: y >= 0, restitution: 0.5, friction: 0.2, slip: x_dot}
  wheel: x_dot >= a_dot
  brake: {relation: a_dot = 0, limit: 2}
  hold: {relation: x = a, when: t > 1}
initial: {x: 0, y: 0, a: 0, x_dot: 1, y_dot: -3}
simulation: {duration: 1}
"""


def test_what_holds_at_times_is_told(lagsim, write):
    model = write(LAWS)
    called = lagsim("check", model, "--json")
    assert called.code == 0, called.err
    found = {
        c["name"]: tuple(c[k] for k in ("kind", "rate", "active", "holds", "mode"))
        for c in called.json["constraints"]
    }
    assert found == {
        "floor": ("one-sided", -3.0, True, False, "impact"),
        "wheel": ("one-sided", 1.0, False, False, "free"),
        "brake": ("nonholonomic", 0.0, True, True, "sticks"),
        "hold": ("holonomic", 1.0, False, False, "out of force"),
    }
    assert called.json["degrees_of_freedom"] == 2
    assert {c["velocity_residual"] for c in called.json["constraints"][:3]} == {None}
    told = lagsim("check", model).out
    assert "floor  one-sided, scleronomic; gap 0, its rate -3; touches; impact" in told
    assert "4 constraints of rank 1, 2 degrees of freedom" in told


@pytest.mark.slow
def test_parameters_can_be_set(lagsim, write):
    model = write(CAPTION.replace("u: l}", "u: g/9.8}"))
    assert lagsim("check", model).code == 1
    assert lagsim("check", model, "--set", "g=0").code == 0


@pytest.mark.slow
def test_several_models_give_the_worst_exit_code(lagsim, write):
    good, bad = write(ON_THE_CURVE, "good.yaml"), write(CAPTION, "bad.yaml")
    called = lagsim("check", good, bad, good, code=1)
    assert [line for line in called.out.splitlines() if "dmissible: " in line] == [
        "admissible: good",
        next(x for x in called.out.splitlines() if x.startswith("inadmissible: bad")),
        "admissible: good",
    ]
    assert lagsim("check", good, "missing.yaml").code == 2
    documents = lagsim("check", good, "missing.yaml", "--json").json
    assert documents[0]["admissible"] is True
    assert documents[1]["errors"][0]["code"] == "unreadable"


ROUGH = CURVE.replace("theta: 1, u: START", "theta: 0.7, u: 0.5100003")


def test_repair_of_a_rough_start_gives_the_exact_state(lagsim, write):
    called = lagsim("check", write(ROUGH), "--repair", code=0)
    assert "as if the start had been typed with 6 digits" in called.out
    lines = [line.strip() for line in called.out.splitlines()]
    first = lines.index("the exact state, for `initial:`") + 1
    exact = ", ".join(lines[first : first + 2])
    assert exact.startswith("theta: 0.69999")
    pasted = write(CURVE.replace("theta: 1, u: START", exact))
    again = lagsim("check", pasted, "--repair", code=0)
    assert "nothing to repair" in again.out
    assert "typed" not in again.out
    assert "the exact state" not in lagsim("check", write(ROUGH)).out


MEMBERS = """\
coordinates: {q(1..2): , r: {components: xy}}
energy: {kinetic: "sum(i = 1..2, q_dot(i)^2) + dot(r_dot, r_dot)", potential: 0}
constraints: {a(i = 1..2): 2*q(i) = i, b: norm(r) = 5}
initial:
  q(1..2): 3
"""


def test_a_repair_of_members_and_components_can_be_pasted(lagsim, write):
    model = write(MEMBERS + "  r: [4, 4]\n")
    lines = lagsim("check", model, "--repair", code=1).out.splitlines()
    first = lines.index("  the nearest admissible state, for `initial:`") + 1
    assert lines[first : first + 2] == ["    q(1): 0.5", "    q(2): 1.0"]
    pasted = write(MEMBERS + "\n".join(line[2:] for line in lines[first : first + 4]))
    assert "nothing to repair" in lagsim("check", pasted, "--repair", code=0).out
    assert "q(1): {guess: ...}, q(2): {guess: ...}, r.x: {" in lines[first + 4]


CONTRADICTORY = """\
coordinates: {x: , y: }
energy: {kinetic: x_dot^2 + y_dot^2, potential: 0}
constraints: {a: x^2 + y^2 = 1, b: x^2 + y^2 = 2}
initial: {x: -1, y: 0}
"""


@pytest.mark.slow
def test_the_first_line_names_the_rows_that_contradict(lagsim, write):
    called = lagsim("check", write(CONTRADICTORY), code=1)
    assert called.out.splitlines()[0] == (
        "inadmissible: model: `b` contradicts `a` on the level of position, by 1 [E301]"
    )
    assert "no admissible state was found: `b` contradicts `a`" in called.out
    document = lagsim("check", write(CONTRADICTORY), "--json").json
    [found] = document["contradictions"]
    assert found["name"] == "b"
    assert found["combination"] == pytest.approx({"a": 1.0})
    assert found["levels"] == pytest.approx({"position": 1.0})


@pytest.mark.slow
def test_inadmissible_guesses_get_a_repair_of_all_values(lagsim, write):
    model = write(
        "coordinates: {x: , y: }\n"
        "energy: {kinetic: x_dot^2 + y_dot^2, potential: 0}\n"
        "constraints: {a: x^2 + y^2 = 1}\n"
        "initial: {x: 2, y: {guess: 0.5}}\n"
    )
    called = lagsim("check", model, code=1)
    assert "changing the guesses is not enough: `a` cannot be satisfied" in called.out
    assert "the nearest admissible state" in called.out


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(MODELS.glob("*.yaml")), ids=lambda p: p.stem)
def test_the_keys_of_shipped_models(lagsim, path):
    called = lagsim("check", path, "--json", code=0)
    found = called.json
    kinds = {
        "admissible": bool, "degrees_of_freedom": int, "constraints": list, "rank": int,
        "generic_rank": int, "conditioning": float, "generic_conditioning": float,
        "multipliers_not_unique": list, "mass_matrix": str, "start_values": list,
        "dependences": list, "contradictions": list, "changes": dict, "unsolved": str,
        "warnings": list,
    }  # fmt: skip
    assert {key: type(found[key]) for key in kinds} == kinds
    assert found["admissible"] is True
    assert found["repair"] is None
    assert found["changes"] == {}
    for c in found["constraints"]:
        assert c["satisfied"] is True
        assert isinstance(c["scleronomic"], bool)
        assert isinstance(c["redundant"], bool)
        nonholonomic = c["kind"] == "nonholonomic"
        if c["kind"] == "one-sided":
            assert c["residual"] >= -c["bound"]
            assert c["velocity_residual"] is None
            assert isinstance(c["rate"], float)
            assert c["mode"] in ("open", "closed", "impact", "sticks", "slides")
            assert c["active"] is not (c["mode"] == "open" and c["residual"] > 0)
        elif c["mode"] == "in force":  # now, and not always
            assert abs(c["residual"]) <= c["bound"]
            assert c["active"] is True
        elif c["mode"] is not None:  # it has a limit
            assert nonholonomic
            assert c["mode"] in ("sticks", "slides")
            assert c["active"] is True
        else:
            assert abs(c["residual"]) <= c["bound"]
            assert (c["velocity_residual"] is None) is nonholonomic
            assert (c["rate"], c["active"], c["mode"]) == (None, None, None)
        assert (c["pfaffian"] is None) is not nonholonomic
        decided = nonholonomic and c["pfaffian"] and c["mode"] is None
        assert isinstance(c["integrable"], bool) is decided


@pytest.mark.slow
def test_no_heavy_library_is_imported():
    code = (
        "import sys, json; sys.argv = ['lagsim', 'check', '--json', *sys.argv[1:]]\n"
        "from lagsim.cli import main\n"
        "code = main()\n"
        "heavy = [m for m in ('sympy', 'scipy', 'matplotlib') if m in sys.modules]\n"
        "print(json.dumps([code, heavy]), file=sys.stderr)"
    )
    # Curves of tables are scipy's.
    texts = {str(p): p.read_text(encoding="utf-8") for p in MODELS.glob("*.yaml")}
    models = sorted(path for path, text in texts.items() if "cubic" not in text)
    assert len(models) > 30
    done = subprocess.run(
        [sys.executable, "-c", code, *models], capture_output=True, text=True
    )
    assert json.loads(done.stderr) == [0, []]
    assert [m["admissible"] for m in json.loads(done.stdout)] == [True] * len(models)


@pytest.mark.slow
def test_quiet_says_only_what_is_wrong(lagsim, write):
    good, bad = write(ON_THE_CURVE, "good.yaml"), write(CAPTION, "bad.yaml")
    lagsim("check", "-q", good, code=0, out="", err="")
    called = lagsim("check", "-q", good, bad, code=1, err="")
    assert called.out == lagsim("check", bad).out
    assert lagsim("check", "-q", good, "--json").json["admissible"]
