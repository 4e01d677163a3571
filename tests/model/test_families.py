"""Families and vectors, compared with the file written out by hand."""

import re

import numpy as np
import pytest

import lagsim
from lagsim.outputs.shapes import string_lengths
from tests.model import test_faults as faults
from tests.model._files import model, problems
from tests.support import refused, simulate


def columns(text, **options):
    """Return the columns of a run, by name."""
    result = simulate(lagsim.load(text), **options)
    assert result.complete
    return {name: result[name] for name in result.columns}


CHAIN = """
parameters: {n: 4, l: 1/n, m(1..n): [1, 1, 2, 1], g: 9.81, c: 0.1}
coordinates: {q(1..n): {unit: rad}}
definitions:
  x(0): 0
  y(0): 0
  x(i = 1..n): x(i-1) + l*sin(q(i))
  y(i = 1..n): {value: y(i-1) - l*cos(q(i)), unit: m}
  height: sum(i = 1..n, m(i)*y(i))
energy:
  kinetic: sum(i = 1..n, m(i)*(x_dot(i)^2 + y_dot(i)^2))/2
  potential: g*height
forces: {q(i = 1..n): -c*q_dot(i)*i, x(n): 0.3*t}
initial: {q(1..n): pi/2, q(3): 0.1, q_dot(1..n): [0, 0, 1, 0]}
simulation: {duration: 0.5, output_step: 0.01, until: x(2) <= -0.4}
scene: {points: {p(i = 0..n): [x(i), y(i)]}, links: [[p(0..n)]]}
output: {plots: [{x: x(n), y: "y(1..n)"}]}
"""


def chain_by_hand(n=4, masses=(1, 1, 2, 1)):
    """Write the file without families: every name ends in its number."""
    k = range(1, n + 1)
    lines = [f"parameters: {{n: {n}, l: 1/n, g: 9.81, c: 0.1"]
    lines[0] += "".join(f", m{i}: {m}" for i, m in zip(k, masses, strict=True)) + "}"
    lines += ["coordinates:", *(f"  q{i}: {{unit: rad}}" for i in k)]
    lines += ["definitions:", "  x0: 0", "  y0: 0"]
    lines += [f"  x{i}: x{i - 1} + l*sin(q{i})" for i in k]
    lines += [f"  y{i}: y{i - 1} - l*cos(q{i})" for i in k]
    lines += [f"  height: {' + '.join(f'm{i}*y{i}' for i in k)}"]
    squares = " + ".join(f"m{i}*(x{i}_dot^2 + y{i}_dot^2)" for i in k)
    lines += [f"energy: {{kinetic: ({squares})/2, potential: g*height}}", "forces:"]
    lines += [f"  q{i}: -c*q{i}_dot*{i}" for i in k] + [f"  x{n}: 0.3*t"]
    starts = (f"q{i}: {0.1 if i == 3 else 'pi/2'}" for i in k)
    lines += [f"initial: {{{', '.join(starts)}, q3_dot: 1}}"]
    lines += ["simulation: {duration: 0.5, output_step: 0.01, until: x2 <= -0.4}"]
    return "\n".join(lines) + "\n"


@pytest.mark.slow
def test_a_family_is_the_chain_written_by_hand():
    family, hand = columns(CHAIN), columns(chain_by_hand())
    plain = {
        re.sub(r"^(\w+?)(_d*dot)?\.(\d+)$", r"\1\3\2", k): v for k, v in family.items()
    }
    assert plain.keys() == hand.keys()
    for name, values in hand.items():
        np.testing.assert_array_equal(plain[name], values, err_msg=name)


BODIES = 4
PLANETS = f"""
parameters: {{n: {BODIES}, m(1..n): [1, 0.1, 0.2, 0.05], k: 0.02, b: [0.01, 0, -0.02]}}
coordinates: {{r(1..n): {{components: xyz, unit: m}}}}
definitions:
  centre: sum(i = 1..n, m(i)*r(i))/sum(i = 1..n, m(i))
  L: sum(i = 1..n, m(i)*cross(r(i), r_dot(i)))
  d(i = 1..n, j = i+1..n): norm(r(j) - r(i))
energy:
  kinetic: sum(i = 1..n, m(i)*dot(r_dot(i), r_dot(i)))/2
  potential: -sum(i = 1..n, sum(j = i+1..n, m(i)*m(j)/d(i, j)))
forces: {{"r(i = 1..n)": -k*r_dot(i) + m(i)*b}}
constraints: {{level: unit(r(2) - r(1)).z = 0.1}}
initial:
  r(1..n): [[0, 0, 0], {{guess: [1, 0, 0.1]}}, [0, 2, 0], [-2, -2, 0.5]]
  r_dot(i = 1..n): {{guess: vec(0, m(i), 0)}}
simulation: {{duration: 0.5, output_step: 0.05}}
"""


def planets_by_hand():
    """Write the file by components."""
    n, k = BODIES, range(1, BODIES + 1)
    m = [1, 0.1, 0.2, 0.05]
    pairs = [(i, j) for i in k for j in k if i < j]
    lines = ["parameters: {k: 0.02, bx: 0.01, by: 0, bz: -0.02"]
    lines[0] += "".join(f", m{i}: {m[i - 1]}" for i in k) + "}"
    lines += ["coordinates:", *(f"  {c}{i}: {{unit: m}}" for i in k for c in "xyz")]
    lines += ["definitions:"]
    for i, j in pairs:
        squares = " + ".join(f"({c}{j} - {c}{i})^2" for c in "xyz")
        lines += [f"  d{i}{j}: sqrt({squares})"]
    kinetic = " + ".join(f"m{i}*(x{i}_dot^2 + y{i}_dot^2 + z{i}_dot^2)" for i in k)
    potential = " - ".join(f"m{i}*m{j}/d{i}{j}" for i, j in pairs)
    lines += [f"energy: {{kinetic: ({kinetic})/2, potential: -{potential}}}", "forces:"]
    lines += [f"  {c}{i}: -k*{c}{i}_dot + m{i}*b{c}" for i in k for c in "xyz"]
    lines += ["constraints: {level: (z2 - z1)/d12 = 0.1}", "initial:"]
    starts = [(0, 0, 0), (1, 0, 0.1), (0, 2, 0), (-2, -2, 0.5)]
    for i in k:
        texts = [f"{{guess: {x}}}" if i == 2 else x for x in starts[i - 1]]
        lines += [f"  {c}{i}: {x}" for c, x in zip("xyz", texts, strict=True)]
        lines += [
            f"  {c}{i}_dot: {{guess: {m[i - 1] if c == 'y' else 0}}}" for c in "xyz"
        ]
    lines += ["simulation: {duration: 0.5, output_step: 0.05}"]
    assert n == len(m)
    return "\n".join(lines) + "\n"


@pytest.mark.slow
def test_vectors_are_their_components():
    family, hand = columns(PLANETS), columns(planets_by_hand())
    for i in range(1, BODIES + 1):
        for c in "xyz":
            for order in ("", "_dot", "_ddot"):
                np.testing.assert_allclose(
                    family[f"r{order}.{i}.{c}"], hand[f"{c}{i}{order}"], atol=1e-11
                )
    np.testing.assert_allclose(family["lambda_level"], hand["lambda_level"], atol=1e-10)
    r = np.array([[family[f"r.{i}.{c}"] for c in "xyz"] for i in range(1, BODIES + 1)])
    v = np.array(
        [[family[f"r_dot.{i}.{c}"] for c in "xyz"] for i in range(1, BODIES + 1)]
    )
    m = np.array([1, 0.1, 0.2, 0.05])
    centre = np.einsum("i,ict->ct", m, r) / m.sum()
    momentum = np.einsum("i,ict->ct", m, np.cross(r, v, axis=1))
    for k, c in enumerate("xyz"):
        np.testing.assert_allclose(family[f"centre.{c}"], centre[k], atol=1e-14)
        np.testing.assert_allclose(family[f"L.{c}"], momentum[k], atol=1e-14)


@pytest.mark.slow
def test_another_number_of_members():
    """A structural parameter reads the file again; others are bound as ever."""
    text = CHAIN.replace("[1, 1, 2, 1]", "1").replace("q(3): 0.1, ", "")
    text = text.replace("[0, 0, 1, 0]", "0").replace("x(2)", "x(1)")
    text = text.replace("y(1..n)", "y(1)")
    loaded = lagsim.load(text)
    for n in (1, 2, 7):
        bound = loaded.bind(n=n)
        read = lagsim.load(text.replace("n: 4", f"n: {n}"))
        assert [c.name for c in bound.coordinates] == [
            f"q.{i}" for i in range(1, n + 1)
        ]
        assert [x.value for x in bound.initial] == [x.value for x in read.initial]
        one, other = simulate(bound), simulate(read)
        np.testing.assert_array_equal(one["q.1"], other["q.1"])
    back = loaded.bind(n=2).bind({"m.2": 3, "q.2": 1.0}).bind(n=4)
    values = {p.name: p.value for p in back.parameters}
    assert (values["m.2"], values["m.3"], len(back.coordinates)) == (3.0, 1.0, 4)
    assert loaded.bind({"m.2": 3}).graph is loaded.graph


def starts(text):
    return {x.name: x.value for x in model(text).initial}


def test_values_by_members():
    found = model("""
parameters: {n: 3, a: 2, k(i = 1..n): a*i^2, m(1..n): [a, 5, a + 1], e(1..0): 1,
  next(i = 1..n): mod(i, n) + 1, w: [1, a], J: [1, 2, 3, 4, 5, 6]}
definitions:
  empty: sum(i = 1..0, k(i)) + 7
  ring: sum(i = 1..n, k(next(i))*i)
  top: max(i = 1..n, k(i))
  least: min(i = n-1..n, -m(i))
  pairs(i = 1..n, j = i+1..n): i*10 + j
  all: sum(i = 1..n, sum(j = i+1..n, pairs(i, j)))
  F(0): 0
  F(1): 1
  F(i = 2..10): F(i-1) + F(i-2)
  second: w(2) + J.xy
  turned: vec(-w.y, w.x)
  chosen: if(a > 1, turned, w)
  z: cross(w, 3*turned)/2
""")
    values = {d.name: found.graph.value(d.node) for d in found.definitions}
    parameters = {p.name: p.value for p in found.parameters}
    known = lagsim.language.evaluate.evaluate(
        found.graph, [d.node for d in found.definitions], parameters
    )
    values = dict(zip(values, known, strict=True))
    assert [parameters[f"k.{i}"] for i in (1, 2, 3)] == [2, 8, 18]
    assert [parameters[f"m.{i}"] for i in (1, 2, 3)] == [2, 5, 3]
    assert (values["empty"], values["ring"]) == (7, 8 * 1 + 18 * 2 + 2 * 3)
    assert (values["top"], values["least"]) == (18, -5)
    assert values["all"] == 12 + 13 + 23
    assert (values["F.10"], values["second"]) == (55, 2 + 4)
    assert (values["turned.x"], values["chosen.y"], values["z"]) == (-2, 1, 7.5)


def test_start_values_by_members():
    text = """
parameters: {n: 3, l: 2}
coordinates: {q(1..n): {}, r(1..2): {components: xy}, v: {components: xyz}}
energy: {kinetic: "sum(i = 1..n, q_dot(i)^2) + dot(v_dot, v_dot)", potential: 0}
initial:
  q(2): 5
  q(i = 1..n): {guess: i*l}
  q_dot(1..n): [1, 2, 3]
  r(1..2): [[0, 1], vec(l, q(2))]
  v: [1, l, 3]
  v_dot: cross(v, vec(0, 0, 1))
  v_dot.z: 9
"""
    with pytest.raises(AssertionError):
        assert not problems(text)  # `v_dot.z` is given by `v_dot` already
    found = starts(text.replace("  v_dot.z: 9\n", ""))
    assert [found[f"q.{i}"] for i in (1, 2, 3)] == [2, 5, 6]
    assert [found[f"q_dot.{i}"] for i in (1, 2, 3)] == [1, 2, 3]
    assert [found[f"r.{i}.{c}"] for i in (1, 2) for c in "xy"] == [0, 1, 2, 5]
    assert [found[f"v_dot.{c}"] for c in "xyz"] == [2, -1, 0]


FAULTS = r"""
# members
expression-member | has the members `s(1)` to `s(3)` |
    definitions: {s(1..3): x, a: ⟪s⟫(4)}
expression-member | `s(0)`: `s` | definitions: {s(i = 1..3): ⟪s⟫(i-1) + x}
expression-member | `c` has 2 subscripts, found 1 |
    definitions: {c(1..2, 1..2): x, a: ⟪c⟫(1)}
expression-member | no members | definitions: {s(1..0): x, a: ⟪s⟫(1)}
expression-member | no `s.4` | definitions: {s(1..3): x}¶forces: {⟪s(4)⟫: 1}
expression-member | no `s.0` | definitions: {s(1..3): x}¶output: {columns: [⟪s(0..2)⟫]}
# names of columns, which end so: the member is read
expression-member | the name of a column | definitions: {s(1..3): x}¶forces: {⟪s.2⟫: 1}
expression-member | the name of a column |
    definitions: {s(1..3): x}¶output: {columns: [⟪s.2⟫]}
expression-member | the name of a column |
    definitions: {s(1..3): x}¶output: {reactions: [⟪s.2⟫]}
expression-member | the name of a column |
    definitions: {s(1..3): x}¶output: {sections: {c: {at: x = 0, plot: [⟪s.2⟫, x]}}}
expression-member | the name of a column |
    definitions: {s(1..3): x}¶initial: {x: 0, y: 0, s(2): 0, ⟪s.2⟫: 0}
expression-member | the name of a column |
    scene: {points: {p(1..3): [x, y]}, links: [[p(1), ⟪p.2⟫]]}
expression-member | the name of a column |
    scene: {points: {p(1..3): [x, y]}, shapes: {b: {disk: 1, at: ⟪p.2⟫}}}
unknown-name | no definition `s(1` |
    definitions: {s(1..3): x}¶output: {columns: [⟪s(1⟫]}
expression-subscript | whole number, found 1.5 | definitions: {s(1..3): x, a: ⟪s⟫(3/2)}
expression-subscript | `x` is none | definitions: {s(1..3): x, a: s(⟪x⟫)}
expression-subscript | a subscript is missing | definitions: {s(1..3): x, a: 2*⟪s⟫}
expression-subscript | is no family | definitions: {s(1..3): x, a: ⟪x⟫(1)}
expression-subscript | a subscript is missing |
    definitions: {s(1..3): x}¶forces: {⟪s⟫: 1}
expression-unknown-function | there are no delays |
    definitions: {s(1..3): x, a: ⟪x⟫(t - 1)}
expression-subscript | there are no delays | definitions: {s(1..3): x, a: s(⟪t⟫ - 1)}
expression-syntax | there are no delays | definitions: {s(1..3): x, a: s(1)⟪(⟫t - 1)}
expression-syntax | there are no random numbers |
    definitions: {s(1..3): x, a: rand(⟪)⟫}
expression-unknown-function | no random numbers | definitions: {s(1..3): ⟪rand⟫(1)}
expression-unknown-function | write x^2 for the square |
    definitions: {s(1..3): x, a: ⟪sqr⟫(x)}
expression-syntax | write 60*pi/180 | definitions: {s(1..3): x, a: 60 ⟪deg⟫}
wrong-count | write vec(0, 1) for the same vector at each |
    coordinates: {x: {}, y: {}, p(1..2): {components: xy}}¶
    initial: {x: 0, y: 0, p(1..2): {guess: ⟪[0, 1]⟫}}
wrong-count | write vec(0, 1, 2) for the same vector at each |
    coordinates: {x: {}, y: {}, p(1..2): {components: xyz}}¶
    initial: {x: 0, y: 0, p(1..2): ⟪[0, 1, 2]⟫}
expression-member | `x(0): 0` and `x(i = 1..n): p(i)` |
    coordinates: {x: {}, y: {}, p(1..2): {}}¶definitions: {a: ⟪p⟫(0)}¶
    initial: {x: 0, y: 0, p(1..2): 0}
name-clash | a definition of another name | coordinates: {x: {}, y: {}, p(1..2): {}}¶
    definitions: {⟪p(0)⟫: 0}¶initial: {x: 0, y: 0, p(1..2): 0}
expression-unknown-function | write sum |
    definitions: {s(1..3): x, a: ⟪summ⟫(s(1))}
duplicate-member | `s.3` | definitions: {s(1..3): x, ⟪s(3)⟫: y}
duplicate-member | `s.2` |
    definitions: {s(1..3): x}¶initial: {x: 0, y: 0, s(1..2): 0, ⟪s(2..3)⟫: 0}
wrong-count | 3 members, and the list 2 |
    parameters: {m(1..3): ⟪[1, 2]⟫}¶definitions: {a: m(3)*x}
wrong-count | 1 or 2 subscripts | definitions: {s(1..3): x, ⟪s(1, 1)⟫: y}
name-clash | already in `parameters` | parameters: {s: 1}¶definitions: {⟪s(1..3)⟫: x}
reserved-name | is a function | definitions: {⟪sin(1..3)⟫: x}
cycle | s.1 -> s.2 -> s.3 -> s.1 | definitions: {s(i = 1..3): ⟪s⟫(mod(i, 3) + 1)}
# ranges
expression-too-many | 1,000,000,000 members | definitions: {s(i = 1⟪..⟫10^9): x}
expression-too-many | 1,000,000 terms |
    definitions: {s(1..2): x, a: "⟪sum⟫(i = 1..10^7, x)", b: "sum(i = 1..2, x)"}
expression-range | needs a range | definitions: {s(1..2): x, a: ⟪sum⟫(s(1))}
expression-range | cannot follow a table: `k` |
    tables: {h: {points: [[0, 0], [2, 1]]}}¶parameters: {m: 2*h(2), k: m}¶
    definitions: {s(1..⟪k⟫): x}
expression-range | no meaning | definitions: {s(1..2): x, a: 1 ⟪..⟫ 2}
expression-range | empty range, 1..0 |
    definitions: {s(1..2): x, a: "⟪max⟫(i = 1..0, x)"}
expression-subscript | whole number, found 1.5 | definitions: {s(i = 1⟪..⟫3/2): x}
expression-subscript | `x` is none | definitions: {s(i = 1..⟪x⟫): x}
later-parameter | which is below it | parameters: {m(1..2): ⟪l⟫, l: 1}
unknown-name | `zz` | definitions: {s(i = 1..3): i*⟪zz⟫}
unknown-interpolation | cannot be `no` |
    tables: {f: {points: [[0,0],[1,1]], interpolation: ⟪no⟫}}¶definitions: {r: [f(x),1]}
unknown-key | did you mean `points` |
    definitions: {s(1..3): x}¶scene: {points: {o: [0, 0]}, links: [{⟪point⟫: [o, o]}]}
expression-syntax | a value is expected | definitions: {s(i = 1..3): (i*⟪)⟫}
expression-syntax | `s` takes its subscripts | definitions: {s(1..3): x, a: s(⟪)⟫}
expression-syntax | `vec` takes 2 or 3 arguments |
    definitions: {s(1..3): x, a: "vec(0, ⟪)⟫"}
expression-syntax | `sum` takes a range and | definitions: {a: "sum(i = 1..3, ⟪)⟫"}
# what refers to its own family, too, and what nothing uses
expression-subscript | `x` is none | definitions: {s(0): x, s(1..2): s(0) + s(⟪x⟫)}
expression-unknown-function | no function or family `ssin` |
    definitions: {s(0): x, s(i = 1..3): s(i-1) + ⟪ssin⟫(x)}
expression-subscript | `x` is none | definitions: {s(0): x, s(i = 1..3): s(⟪x⟫)}
expression-component | a number has | definitions: {s(0): x, s(1..3): s(0) + x⟪.y⟫}
# vectors
expression-size | found 2 and 3 | definitions: {a: [x, y], b: [x, y, 1], c: a ⟪+⟫ b}
expression-size | found 2 and 1 | definitions: {a: [x, y], c: a ⟪-⟫ 1}
expression-size | dot(a, b) or cross | definitions: {a: [x, y], c: a⟪*⟫a}
expression-size | write dot(a, a) | definitions: {a: [x, y], c: a⟪^⟫2}
expression-size | write norm(a) | definitions: {a: [x, y], c: ⟪abs⟫(a)}
expression-size | found a vector of 2 |
    definitions: {a: [x, y]}¶energy: {kinetic: x_dot^2 + y_dot^2, potential: ⟪a⟫}
expression-size | one size, found 2 and 1 |
    definitions: {a: [x, y]}¶constraints: {c: a ⟪=⟫ 0}
expression-component | no component `.z` | definitions: {a: [x, y], c: a⟪.z⟫}
expression-component | a number has | definitions: {a: [x, y], c: x⟪.x⟫}
wrong-count | is a vector of 2 | definitions: {a: [x, y]}¶forces: {a: ⟪[1, 2, 3]⟫}
expression-member | components 1 to 2 | definitions: {a: [x, y], c: ⟪a⟫(3)}
not-an-expression | a list | definitions: {a: [x, y], c: ⟪[x]⟫}
not-an-expression | a list | constraints: {c: ⟪[x = 0, y = 0]⟫}
not-an-expression | a list | constraints: {c: ⟪[]⟫}
# what cannot be read is reported, and not what stands on it
unknown-key | `component` in the coordinate |
    coordinates: {x: {}, y: {}, r: {⟪component⟫: xy}}¶definitions: {a: r.x, b: [x, y]}
expression-component | found `xz` |
    coordinates: {x: {}, y: {}, r: {components: ⟪xz⟫}}¶definitions: {b: norm(r + r)}
expression-component | must be `xy` or `xyz` |
    coordinates: {x: {}, y: {}, r: {components: ⟪[x, y]⟫}}¶definitions: {a: r.x}
not-a-mapping | found a list |
    coordinates: {x: {}, y: {}, r: ⟪[1, 2]⟫}¶definitions: {a: r.x, b: [x, y]}
unknown-key | did you mean `definitions` | ⟪definition⟫: {s(1..3): x}¶forces: {s(2): 1}
unknown-name | unknown name `r` | definitions: {a: [x, y], b: ⟪r⟫.x}
unknown-name | unknown name `r` | definitions: {a: [x, y], b: "dot(a, ⟪r⟫)"}
expression-component | a number has | definitions: {a: [x, y], b: t⟪.x⟫}
unknown-name | `r` is neither a coordinate |
    definitions: {a: [x, y]}¶forces: {⟪r⟫: [1, 2]}
expression-subscript | whole number, found 1.5 |
    scene: {points: {p(i = 1⟪..⟫3/2): [x, y]}, links: [[p(1), p(2)]]}
# ... nor what refers to its own family beside it
bad-name | `2*(1..2)` |
    coordinates: {x: {}, y: {}, ⟪2*(1..2)⟫: {}}¶
    definitions: {s(0): x, s(i = 1..2): s(i-1) + r(i)}
bad-name | `w 1..2)` |
    frames: {⟪w 1..2)⟫: {angle: x}}¶
    definitions: {s(0): [x, y], s(i = 1..2): "s(i-1) + rotate(w(i), vec(1, 0))"}
not-an-expression | a list |
    definitions: {s(0): ⟪[x]⟫, s(i = 1..2): "s(i-1) + vec(x, y)"}
"""
FAULTS = {row[2].replace("\n", "¶"): row for row in faults.table(FAULTS)}


@pytest.mark.parametrize("case", FAULTS.values(), ids=FAULTS.keys())
def test_faults_name_the_place_in_the_file(case):
    faults.test_fault(case)


@pytest.mark.parametrize(
    ("n", "code"),
    [
        ("1.5", "expression-subscript"), ("10^6", "expression-too-many"),
        ("zz", "unknown-name"), ("q(1)", "expression-range"),
    ],
)  # fmt: skip
def test_a_fault_of_many_ranges_is_reported_once(n, code):
    assert [p.code for p in problems(CHAIN.replace("n: 4", f"n: {n}"))] == [code]


def test_an_event_that_sets_members_of_a_broken_family_is_no_other_fault():
    text = "modes: {w(1..1.5): 0}\nevents: {tick: {every: 1, set: {w(1): 1}}}"
    assert [p.code for p in problems(text)] == ["expression-subscript"]
    text = "modes: {w(1..0): 0}\nevents: {tick: {every: 1, set: {w(i = 1..0): 1}}}"
    assert [p.code for p in problems(text)] == ["missing-key"]


def test_links_may_stand_above_their_points():
    text = "scene: {links: [[p(1..3)]], points: {p(i = 1..3): [x, i]}}"
    assert model(text).scene.links == (("p.1", "p.2"), ("p.2", "p.3"))


SCENE = """
parameters: {l: 2, k(1..2): [3, 4]}
scene: {points: {p(i = 1..2): [x, i], a: [x, 0], b: [0, 0], c: [1, 0]}, links: LINKS}
"""


@pytest.mark.parametrize(
    ("links", "pairs", "looks", "lengths"),
    [
        ("[[a, b, c]]", "ab bc", ["", ""], [None, None]),
        ("[[a, b, c, a], [a, b]]", "ab bc ca ab", [""] * 4, [None] * 4),
        ("[{points: [a, b, c], as: rod}]", "ab bc", ["rod"] * 2, [None] * 2),
        ("[{points: [a, b, c], length: l}]", "ab bc", ["string"] * 2, [2.0] * 2),
        ("[{points: [a, b], as: string, length: l/4}]", "ab", ["string"], [0.5]),
        ("[{points: [a, b], length: k(2)}]", "ab", ["string"], [4.0]),
        ("[[a, p(1..2)]]", "a1 12", ["", ""], [None, None]),
        ("[{points: [p(1..2), c], length: k(1)}]", "12 2c", ["string"] * 2, [3.0] * 2),
    ],
)
def test_links_join_each_point_to_the_next(links, pairs, looks, lengths):
    found = model(SCENE.replace("LINKS", links))
    scene, names = found.scene, {"1": "p.1", "2": "p.2"}
    assert ["".join(pair).replace("p.", "") for pair in scene.links] == pairs.split()
    assert all(names.get(end, end) for pair in scene.links for end in pair)
    assert list(scene.looks) == looks
    assert string_lengths(found) == lengths
    if lengths[0] == 2.0:
        assert string_lengths(found.bind(l=5)) == [5.0, 5.0]
        with refused("out-of-range", "-1"):
            found.bind(l=-1)


@pytest.mark.slow
def test_a_fault_of_many_members_is_reported_once_and_quickly():
    text = "definitions: {s(i = 1..5000): i*zz, a: s(5001)}"
    assert [p.code for p in problems(text)] == ["unknown-name", "expression-member"]


@pytest.mark.parametrize(
    ("given", "code", "name"),
    [
        ({"m.4": "1"}, "unknown-parameter", "`m.4`"),
        ({"m": "1"}, "unknown-parameter", "`m.1`"),
        ({"m(2)": "1"}, "unknown-parameter", "`m.2`"),
        ({"v(1)": "1"}, "unknown-parameter", "`v.1.x`"),
        ({"v(1).y": "1"}, "unknown-parameter", "`v.1.y`"),
        ({"n": "1.5"}, "expression-subscript", "1.5"),
        ({"n": "10^6"}, "expression-too-many", "100,000"),
    ],
)
def test_values_that_replace_others(given, code, name):
    with refused(code, name):
        model(
            "parameters: {n: 3, m(1..n): 1, v(1..2): [[1, 2], [3, 4]]}\n"
            "definitions: {a: m(1)*x}",
            overrides=given,
        )


@pytest.mark.slow
def test_a_sweep_over_the_number_of_members():
    """Runs of other members share a table: columns that a run has not are nan."""
    text = CHAIN.replace("[1, 1, 2, 1]", "1").replace("q(3): 0.1, ", "")
    text = text.replace("[0, 0, 1, 0]", "0").replace(", until: x(2) <= -0.4", "")
    text = text.replace("y(1..n)", "y(1)")
    sweep = lagsim.sweep(lagsim.load(text), {"n": [1, 3], "g": [1, 2]}, jobs=1)
    for k, values in enumerate(({"n": 1, "g": 1}, {"n": 1, "g": 2}, {"n": 3, "g": 1})):
        run = lagsim.simulate(lagsim.load(text, **values), error_bar="never")
        for name in ("q.1", "q.3"):
            end = run[name][-1] if name in run.columns else np.nan
            np.testing.assert_array_equal(sweep[f"{name}.end"][k], end)
    sweep = lagsim.sweep(lagsim.load(text), {"n": [3, 4], "m.4": [1]}, jobs=1)
    assert list(sweep["complete"]) == [False, True]
    assert sweep["reason"][0] == "there is no parameter or start value `m.4`"


@pytest.mark.slow
def test_a_sweep_of_contacts_of_members_beside_a_state():
    text = """
parameters: {n: 2, v: 1}
coordinates: {y(1..n): {}}
states: {s: {rate: -s}}
energy: {kinetic: "sum(i = 1..n, y_dot(i)^2)/2", potential: 0}
constraints: {floor(i = 1..n): {relation: y(i) >= 0, restitution: 0.5}}
initial: {y(1..n): 1, y_dot(1..n): -v, s: 1}
simulation: {duration: 2}
"""
    sweep = lagsim.sweep(lagsim.load(text), {"v": [1, 2]}, jobs=1)
    assert list(sweep["y.2.end"]) == pytest.approx([0.5, 1.5], abs=1e-12)


RING = """
parameters: {n: 4, m: 2, k: 3, r: 1}
modes: {held(i = 1..n): "if(i > 2, 1, 0)", count: 0}
coordinates: {p(1..n): {components: xy, unit: m}}
states: {s(i = 1..2): {rate: p(i).x - s(i)}}
definitions: {d(i = 1..n): p(mod(i, n) + 1) - p(i)}
energy:
  kinetic: sum(i = 1..n, m*dot(p_dot(i), p_dot(i)))/2
  potential: sum(i = 1..n, k*(norm(d(i)) - r)^2)/2 + sum(i = 1..n, m*p(i).y)
constraints:
  fix(i = 3..n): {relation: p_dot(i) = vec(0, 0), when: held(i) > 0}
  ground(i = 1..2):
    {relation: p(i).y >= -1, restitution: 0.5, friction: 0.2, slip: p_dot(i).x}
events:
  loose(i = 3..n): {at: p(1).y <= 0.05*i - 0.3, set: {held(i): 0, count: count + i}}
initial: {p(1..n): [[0, 0], [1, 0], [1, 1], [0, 1]], s(1..2): 0}
simulation: {duration: 2, output_step: 0.05}
scene:
  points: {c(i = 1..n): p(i), o: [0, 0]}
  links: [[c(1..n), c(1)], {points: [o, c(1)], as: spring}]
  shapes: {ball(i = 1..n): {disk: 0.1, at: c(i)}, v: {arrow: p_dot(1), at: p(1)}}
output:
  columns: [d(1..2)]
  plots: [{x: t, y: p(1)}, {x: t, y: [p(1..2), s]}]
  sections: {cut: {at: p(1).x = 0, plot: [p_dot(2).x, s(1)]}}
"""


@pytest.mark.slow
def test_sections_that_refer_to_members():
    loaded = lagsim.load(RING)
    assert loaded.scene.links[:4] == (
        ("c.1", "c.2"), ("c.2", "c.3"), ("c.3", "c.4"), ("c.4", "c.1"),
    )  # fmt: skip
    assert [shape.name for shape in loaded.scene.shapes][:2] == ["ball.1", "ball.2"]
    curves = [[c.text for c in plot.y] for plot in loaded.output.plots]
    assert curves[0] == ["p(1).x", "p(1).y"]
    assert curves[1] == ["p(1).x", "p(1).y", "p(2).x", "p(2).y", "s(1)", "s(2)"]
    assert loaded.output.sections[0].plot == ("p_dot.2.x", "s.1")
    found = columns(RING)
    assert [c for c in found if c.startswith("d.")] == [
        "d.1.x",
        "d.1.y",
        "d.2.x",
        "d.2.y",
    ]
    assert found["held.4"][0] == 1
    assert found["held.4"][-1] == found["held.3"][-1] == 0
    assert found["count"][-1] == 7
    drift = found["energy"] - found["work"]
    np.testing.assert_allclose(drift, drift[0], atol=1e-9)
    assert min(found["p.1.y"].min(), found["p.2.y"].min()) >= -1 - 1e-9


BRAKES = """
coordinates: {p(1..3): {components: xy}}
energy: {kinetic: "sum(i = 1..3, dot(p_dot(i), p_dot(i)))/2", potential: 0}
initial: {p(1..3): vec(0, 0), p_dot(1..3): vec(1.2, 0.9)}
constraints: {CONSTRAINTS}
simulation: {duration: 2, output_step: 0.1}
"""


LISTS = [f"[p_dot({i}).x = 0, p_dot({i}).y = 0]" for i in (1, 2, 3)]


@pytest.mark.parametrize(
    ("constraints", "ends"),
    [
        ("pad(i = 1..3): {relation: p_dot(i) = vec(0, 0), limit: i}", "xy"),
        (f"pad(i = 1..3): {{relation: [{', '.join(LISTS)}], limit: i}}", "12"),
        (
            ", ".join(
                f"pad{i}: {{relation: {both}, limit: {i}}}"
                for i, both in enumerate(LISTS, 1)
            ),
            "12",
        ),
    ],
)
def test_two_relations_share_a_limit_beside_families(constraints, ends):
    result = simulate(lagsim.load(BRAKES.replace("CONSTRAINTS", constraints)))
    t = result.t
    for i in (1, 2, 3):
        s = np.minimum(t, 1.5 / i)  # a speed of 1.5 that a force of i ends
        way = 1.5 * s - i * s**2 / 2
        assert result[f"p.{i}.x"] == pytest.approx(0.8 * way, abs=1e-10)
        assert result[f"p.{i}.y"] == pytest.approx(0.6 * way, abs=1e-10)
        name = "pad" + str(i) if "pad1" in constraints else f"pad.{i}"
        force = result[f"lambda_{name}.{ends[0]}"], result[f"lambda_{name}.{ends[1]}"]
        assert np.hypot(*force)[t < 1.5 / i - 1e-6] == pytest.approx(i)
    assert {event["kind"] for event in result.record["events"]} == {"stick"}


def test_three_relations_share_no_limit():
    text = """
coordinates: {p: {components: xyz}}
energy: {kinetic: "dot(p_dot, p_dot)/2", potential: 0}
initial: {p: [0, 0, 0]}
constraints: {pad: {relation: "p_dot = vec(0, 0, 0)", limit: 1}}
simulation: {duration: 1}
"""
    (found,) = problems(text)
    assert found.code == "wrong-count"
    assert "`pad`" in found.text
    assert "3" in found.text


FRAMED = """
parameters: {J: [1, 1, 2]}
coordinates: {a: {}, b: {}}
frames: {arm: {axis: [0, 0, 1], angle: a}}
definitions: {w: omega(arm), tip: "rotate(arm, vec(1, 0, 0))", up: "tip + vec(0, 0, b)"}
bodies: {hand: {mass: 1, at: up, frame: arm, inertia: J}}
energy: {kinetic: "bodies + spin(J, w)", potential: up.z}
initial: {a: 0, b: 0}
scene: {points: {tip: tip, up: up}}
simulation: {duration: 1}
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("axis: [0, 0, 1]", "axis: [0, 1]"),
        ("axis: [0, 0, 1], angle: a", "axis: [0, 0, 1]"),
        ('tip: "rotate(arm, vec(1, 0, 0))"', "tip: {unit: m}"),
        ('tip: "rotate(arm, vec(1, 0, 0))"', 'tip: "rotate(arm, vec(1, 0, 0)"'),
        ("J: [1, 1, 2]", "J: 1 2"),
        ("J: [1, 1, 2]", "J: {unit: kg*m^2}"),
    ],
)
def test_what_depends_on_a_fault_is_passed_over(old, new):
    assert not problems(FRAMED)
    (found,) = problems(FRAMED.replace(old, new))
    assert found.hint
