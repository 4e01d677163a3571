"""Each fault of a file is reported once, in its place.

A row of the table: the code, names and numbers of the message or of its hint with `; `
between these, and the text. The wording is free but for mistakes of YAML, whose
messages differ by their advice. The token that the caret must stand under is marked
⟪so⟫, and ¶ is a line break. Words in capitals abbreviate common beginnings of texts.
"""

import re
import sys

import pytest

from lagsim.model.reader.fields import MAX_FAULTS, Faults
from tests.model._files import problems

BEGINNINGS = {
    "CONTACT": "constraints: {c: {relation: x >= 0, restitution: 0,",
    "LAW": "constraints: {c: {relation:",
    "RELATION": "constraints: {c:",
    "KINETIC": "energy: {kinetic: x_dot^2,",
    "CURVE": "forces: {x: f(t)}¶tables: {f: {points: [[0, 0], [1, 1]],",
    "TABLE": "forces: {x: f(t)}¶tables: {f:",
    "INITIAL": "initial: {x: 0, y: 0,",
    "POINT": "scene: {points: {o: [0, 0]},",
    "SHAPE": "scene: {points: {o: [0, 0]}, shapes: {",
}
TABLE = r"""
# the file
unknown-key | `forces` | ⟪force⟫: {x: 1}
not-a-mapping | `1` | parameters: ⟪1⟫
format-version | 1; 2 | lagsim: ⟪2⟫
bad-model-name | `a/b` | name: ⟪a/b⟫
bad-model-name |  | name: ⟪a\b⟫
bad-model-name | `..` | name: ⟪..⟫
bad-model-name |  | name: ⟪''⟫
bad-model-name |  | name: ⟪"a\nb"⟫
not-a-text | `name` | name: ⟪[a]⟫
not-a-text | U+0000 | description: "a⟪\0⟫"
yaml-syntax | : | description: a⟪:⟫ b
# parameters
unknown-key | `value` | parameters: {k: {⟪valeu⟫: 1}}
missing-key | `value` | parameters: {⟪k⟫: {unit: m}}
not-an-expression |  | parameters:¶  k:⟪⟫¶
not-an-expression |  | parameters: {k: ⟪[1]⟫}
later-parameter |  | parameters: {a: 1 + ⟪a⟫}
not-constant | `x` | parameters: {a: 2*⟪x⟫}
not-constant | `t` | parameters: {a: 2*⟪t⟫}
unknown-name | `mass` | parameters: {mass: 1, b: 2*⟪maas⟫}
unknown-name | `friction` | forces: {x: ⟪slip_speed⟫}
not-a-text |  | parameters: {k: {value: 1, unit: ⟪"m\n/s"⟫}}
# tables
unknown-interpolation | `spline` | CURVE interpolation: ⟪spline⟫}}
unknown-interpolation | `error`; `hold` | CURVE outside: ⟪clamp⟫}}
unknown-key | `f` | CURVE ⟪colour⟫: red}}
not-a-list | points | TABLE {points: ⟪1⟫}}
table-points | `0` | TABLE {points: [⟪0⟫]}}
table-points | 2; 0 | TABLE {points: [⟪0⟫, 1, 2, 3]}}
table-points | 2; 1 | TABLE {points: [[0, 1], ⟪[2]⟫]}}
table-points | 3 | TABLE {points: [[0, 1, 2], ⟪[2, 3]⟫]}}
table-points | 1 | tables: {⟪f⟫: {points: [[0, 1]]}}¶forces: {x: f(t)}
table-points | 2; 1 | TABLE {points: [[2, 1], [⟪1⟫, 0], [1, 2]]}}
table-points | 0 | TABLE {points: [[0, 0], [2, ⟪1⟫]], outside: repeat}}
table-points | 0, 1 | TABLE {points: [[0, 1, 2], [⟪0⟫, 1, 3]]}}
table-points | 1, 1 | TABLE {points: [[⟪0⟫, 0, 2], [0, 1, 3], [1, 0, 0]]}}
table-points |  | TABLE {points: [[⟪0⟫, 0, 2], [0, 1, 3]]}}
unknown-interpolation |  | TABLE {points: [[0, 0, 2], [0, 1, 3]],
    ⟪interpolation⟫: monotone}}
expression-not-finite | 1e999 | TABLE {points: [[0, 0], [⟪1e999⟫, 1]]}}
unknown-name | `nan` | TABLE {points: [[0, 0], [1, ⟪nan⟫]]}}
not-constant | `k` | parameters: {k: 1}¶TABLE {points: [[0, 0], [1, ⟪k⟫]]}}
missing-key | `points` | tables: {⟪f⟫: {outside: hold}}¶forces: {x: f(t)}
both-given | `points`; `file` | CURVE ⟪file⟫: a.csv}}
both-given |  | CURVE ⟪x⟫: a}}
missing-key | `y` | TABLE {⟪file⟫: models/road.csv, x: distance}}
unused-table | f(...) | tables: {⟪f⟫: {points: [[0, 0], [1, 1]]}}
reserved-name |  | tables: {⟪sin⟫: {points: [[0, 0], [1, 1]]}}
name-clash |  | parameters: {f: 1}¶
    tables: {⟪f⟫: {points: [[0, 0], [1, 1]]}}
expression-arity | `f`; 1; 2 |
    tables: {f: {points: [[0, 0], [1, 1]]}}¶forces: {x: 1 + ⟪f⟫(t, x)}
unknown-name | f(...) | tables: {f: {points: [[0, 0], [1, 1]]}}¶forces: {x: ⟪f⟫}
expression-unknown-function | curve(t) |
    tables: {curve: {points: [[0, 0], [1, 1]]}}¶
    forces: {x: curve(t), y: ⟪curv⟫(t)}
# sections
missing-key | `at` | output: {sections: {⟪c⟫: {direction: up}}}
both-given | `at`; `every` | output: {sections: {⟪c⟫: {at: x = 0, every: 1}}}
both-given | every; direction | output: {sections: {c: {every: 1, ⟪direction⟫: up}}}
not-an-equality |  | output: {sections: {c: {⟪at⟫: x >= 0}}}
no-coordinate | `every` | output: {sections: {c: {at: ⟪t = 1⟫}}}
unknown-name | `both` | output: {sections: {c: {at: x, direction: ⟪left⟫}}}
unknown-name | `z` | output: {sections: {c: {at: x, plot: [x, ⟪z⟫]}}}
wrong-count | 1 | output: {sections: {c: {at: x, ⟪plot⟫: [x]}}}
not-constant | `x` | output: {sections: {c: {every: ⟪x⟫}}}
bad-name | `a-b` | output: {sections: {⟪a-b⟫: {at: x}}}
unknown-key | `every` | output: {sections: {c: {⟪evry⟫: 1}}}
# names
bad-name |  | parameters: {⟪"a\n"⟫: 1}
bad-name | `2k` | parameters: {⟪2k⟫: 1}
bad-name | `k_1` | parameters: {⟪k-1⟫: 1}
bad-name |  | parameters: {⟪_k⟫: 1}
bad-name | `x2` | parameters: {⟪x²⟫: 1}
reserved-name | `t` | parameters: {⟪t⟫: 1}
reserved-name | `kinetic` | definitions: {⟪kinetic⟫: 1}
reserved-name | `work` | constraints: {⟪work⟫: x = y}
reserved-name |  | parameters: {⟪and⟫: 1}
reserved-name | `_dot` | parameters: {⟪z_dot⟫: 1}
reserved-name | `_ddot` | definitions: {⟪z_ddot⟫: x}
name-clash |  | coordinates: {x: , y: }¶parameters: {⟪x⟫: 1}
column-clash | `c` | parameters: {⟪lambda_c⟫: 1}¶
    RELATION x = 1}¶initial: {x: 1, y: 0}
column-clash | `c` | definitions: {⟪residual_c⟫: x}¶
    RELATION x = y}
column-clash | `x` | definitions: {⟪impulse⟫: [x, y]}¶
    constraints: {x: x = y}
column-clash | `x` | definitions: {⟪friction⟫: [x, y]}¶
    constraints: {x: x = y}
column-clash | `x` | definitions: {⟪reaction⟫: [x, y]}
column-clash | `x` | definitions: {⟪sd⟫: [x, y]}
column-clash | `c.1` |
    definitions: {⟪lambda_c(1..2)⟫: x}¶
    constraints: {c: {relation: [x_dot = 0, y_dot = 0], limit: 5}}
# coordinates
missing-key |  | ⟪coordinates⟫: {}
# definitions
cycle | a -> b -> a | definitions: {c: a, a: x + ⟪b⟫, b: sin(a), d: c_dot}
cycle | a -> b -> a | definitions: {a: x + ⟪b_dot⟫, b: a}
cycle |  | states: {⟪a⟫: {rate: k}}¶definitions: {k: a_dot}¶
    initial: {x: 0, y: 0, a: 0}
missing-key | `a_dot` | states: {⟪a⟫: {}}¶initial: {x: 0, y: 0, a: 0}
missing-initial | `a: {steady: 0}` | states: {a: {rate: x}}¶⟪initial⟫: {x: 0, y: 0}
name-clash |  | states: {x: {rate: 1}}¶coordinates: {⟪x⟫: , y: }
unknown-name | `theta_dot` | coordinates: {theta: , y: }¶
    definitions: {a: ⟪thta_dot⟫}¶energy: {kinetic: theta_dot^2, potential: 0}¶
    initial: {theta: 0, y: 0}
unknown-name | `k` | parameters: {k: 1}¶definitions: {a: ⟪k_dot⟫}
unknown-name | `x_ddot` | definitions: {a: ⟪x_dot_dot⟫}
no-rate |  | definitions: {v: 2*x_ddot, a: ⟪v_dot⟫}
unknown-name | `lambda_path` | constraints: {path: x = y}¶
    definitions: {a: ⟪lambda_pth⟫}
unknown-name |  | definitions: {a: ⟪work⟫}
unknown-name | `lagrangian` | energy: {lagrangian: x_dot^2 + y_dot^2}¶
    definitions: {a: ⟪kinetic⟫}
unknown-name | sin(...) | definitions: {a: ⟪sin⟫}
# expressions (their own tests are elsewhere; here: the place in the file)
expression-syntax | 2*x | definitions: {a: 2 ⟪x⟫}
expression-parenthesis |  | LAW ⟪(⟫x - y}}
unknown-name | `zz` | definitions:¶  a: >-¶    x +¶    2*⟪zz⟫
unknown-name | `zz` | definitions: {a:   1 +   ⟪zz⟫}
unknown-name | `zz` | definitions: {a: '⟪zz⟫'}
unknown-name | `zz` | definitions: {a: "1 + ⟪zz⟫"}
unknown-name | `zz` | definitions: {a: "\t1\x20+\u0020 ⟪zz⟫"}
unknown-name | `zz` | definitions:¶  a: 1 +¶     ⟪zz⟫
unknown-name | `zz` | definitions:¶  a: 1 +¶¶     2 + ⟪zz⟫
unknown-name | `zz` | definitions:¶  a: '1 +¶  ⟪zz⟫'
unknown-name | `zz` | definitions:¶  a: "1 + \¶   ⟪zz⟫"
unknown-name | `zz` | definitions:¶  a: |¶   1 +¶   ⟪zz⟫
unknown-name | `zz` | definitions:¶  a: >2 # comment¶     1 +¶¶    2 + ⟪zz⟫
unknown-name | `zz` | definitions:¶  a:¶    1 + ⟪zz⟫
unknown-name | `zz` | parameters: {é: 1}¶definitions: {a: é + ⟪zz⟫}
unknown-name | `nil` | parameters: {k: ⟪nil⟫}
expression-syntax |  | definitions: {a: 'x⟪''⟫ + 1'}
expression-syntax |  | parameters: {k: '⟪'⟫}
not-an-expression |  | parameters: {k: ⟪~⟫}
# energy
missing-key | kinetic; lagrangian | ⟪energy⟫: {}
missing-key | `potential: 0` | ⟪energy⟫: {kinetic: x_dot^2}
missing-key | `kinetic` | ⟪energy⟫: {potential: x^2}
both-given | `kinetic`; `lagrangian` | KINETIC ⟪lagrangian⟫: x_dot^2}
output-only |  | energy: {kinetic: ⟪x_ddot⟫^2, potential: 0}
output-only |  | definitions: {r: x*y}¶KINETIC potential: ⟪r_ddot⟫}
output-only |  | RELATION x = y}¶KINETIC potential: ⟪lambda_c⟫}
output-only |  | KINETIC potential: 0, dissipation: ⟪Qc_x⟫}
output-only | `a` | definitions: {b: a, a: x_ddot}¶
    KINETIC potential: ⟪a⟫}
# forces
output-only | `a` | definitions: {a: x_ddot}¶forces: {⟪a⟫: 1}
# constraints
missing-key | `relation` | constraints: {⟪c⟫: {description: a}}
no-coordinate |  | RELATION ⟪x - x = 0⟫}
expression-syntax | = | RELATION x = y ⟪=⟫ 0}
missing-key | `restitution` | constraints: {⟪floor⟫: x >= -1}
out-of-range | 1.5; 1 | LAW x >= 0, restitution: ⟪1.5⟫}}
out-of-range | -0.5 | LAW x >= 0, restitution: ⟪-0.5⟫}}
velocity-not-allowed |  | LAW x + ⟪x_dot⟫ >= 0, restitution: 0}}
velocity-not-allowed | `v` | definitions: {v:
    2*x_dot}¶LAW x + ⟪v⟫ <= 0, restitution: 0}}
missing-key | `slip` | CONTACT ⟪friction⟫: 1}}
missing-key | `friction` | CONTACT ⟪slip⟫: y_dot}}
out-of-range |  | CONTACT friction: ⟪-1⟫, slip: y_dot}}
not-affine |  | CONTACT friction: 1, slip: ⟪y_dot^2⟫}}
not-affine |  | CONTACT friction: 1, slip: ⟪2*y⟫}}
wrong-count | 3 | CONTACT friction: 1, slip: ⟪[x_dot, y_dot, y_dot]⟫}}
out-of-range | 0.2; 0.3 | CONTACT slip: y_dot, friction:
    {static: ⟪0.2⟫, dynamic: 0.3}}}
out-of-range | dynamic | CONTACT slip: y_dot, friction: {static: 1,
    dynamic: ⟪-0.3⟫}}}
missing-key | `dynamic` | CONTACT slip: y_dot, ⟪friction⟫: {static: 1}}}
not-homogeneous |  | RELATION ⟪x_dot >= 1⟫}
not-homogeneous |  | LAW ⟪x_dot^2 >= y_dot^2⟫}}
out-of-range | `c`; -2 |
    parameters: {F: -2}¶LAW x_dot, limit: ⟪F⟫}}
output-only | `c` | LAW x_dot, limit: ⟪x_ddot⟫}}
expression-syntax |  | LAW x = y, when:
    ⟪t⟫}}
not-of-time | `x`; `y_dot` | LAW x = y,
    when: ⟪x < 1 or y_dot < 1⟫}}
# initial
not-a-start-value |  | INITIAL ⟪x_ddot⟫: 1}
output-only |  | definitions: {a: x_ddot}¶INITIAL ⟪a⟫: 1}
no-rate |  | definitions: {a: x_dot}¶INITIAL ⟪a_dot⟫: 1}
later-initial | `x` | initial: {x: 2*⟪x⟫, y: 0}
not-a-start-value | `y_dot` | initial: {x: 0, y: 2*⟪y_dot⟫}
not-a-start-value |  | initial: {x: 0, y: ⟪t⟫}
not-an-expression | guess | initial: {x: 0, y: ⟪{}⟫}
# simulation
both-given | `duration`; `end` | simulation: {duration: 1, ⟪end⟫: 1}
out-of-range |  | simulation: {duration: ⟪0⟫}
out-of-range | 2; 1 | simulation: {start: 2, end: ⟪1⟫}
out-of-range | 1e+20 | simulation: {start: 1e20, duration: ⟪1⟫}
out-of-range | output_step; 0 | simulation: {duration: 1, output_step: ⟪0⟫}
out-of-range |  | simulation: {duration: 1, output_step: ⟪1.01⟫}
too-many-rows | 100000001 | simulation: {duration: 1e8, output_step: ⟪1⟫}
too-many-rows |  | simulation: {duration: 1e300, output_step: ⟪1e-300⟫}
out-of-range | rtol; -1 | simulation: {rtol: ⟪-1⟫}
out-of-range |  | simulation: {rtol: 0, atol: ⟪0⟫}
out-of-range | `atol` | simulation: {rtol: ⟪0⟫}
empty | `method` | simulation:¶  method:⟪⟫
no-coordinate | `end`; `duration` | simulation: {until: ⟪t >= 3⟫}
# scene
wrong-count | 1 | scene: {points: {p: ⟪[x]⟫}}
wrong-count | 4 | scene: {points: {p: ⟪[x, y, x, y]⟫}}
bad-name |  | scene: {points: {⟪p-1⟫: [x, y]}}
not-a-text |  | scene: {points: {o: [0, 0]}, links: [[o, ⟪[o]⟫]]}
wrong-count | 1 | scene: {points: {o: [0, 0]}, links: [⟪[o]⟫]}
unknown-name | `o` | scene: {points: {o: [0, 0]}, links: [[o, o, ⟪oo⟫]]}
both-given |  | POINT links: [{points: [o, o], as: rod, ⟪length⟫: 1}]}
out-of-range | -1 | POINT links: [{points: [o, o], length: ⟪-1⟫}]}
not-finite | inf | POINT links: [{points: [o, o], length: ⟪exp(1e9)⟫}]}
not-constant | `x` | POINT links: [{points: [o, o], length: 2*⟪x⟫}]}
unknown-name | `spring` | POINT links: [{points: [o, o], as: ⟪sprung⟫}]}
missing-key | `points` | POINT links: [⟪{as: rod}⟫]}
unknown-key | `points` | POINT links: [{⟪point⟫: [o, o]}]}
# shapes
missing-key | `disk`; `ring`; `box` | SHAPE ⟪a⟫: {}}}
unknown-key | `disk` | SHAPE a: {⟪dsik⟫: 1}}}
both-given | `disk`; `box` | SHAPE a: {box: [1, 2], ⟪disk⟫: 1}}}
bad-name |  | SHAPE ⟪a-b⟫: {disk: 1}}}
unknown-name | `o` | SHAPE a: {disk: 1, at: ⟪oo⟫}}}
unknown-name | `z` | SHAPE a: {disk: 1, at: [x, ⟪z⟫]}}}
shape-of-space | `a` | SHAPE ⟪a⟫: {sphere: 1}}}
shape-of-space | `a` | SHAPE ⟪a⟫: {box: [1, 2, 3]}}}
shape-of-space | `a` | SHAPE ⟪a⟫: {disk: 1, at: [1, 2, 3]}}}
shape-of-space | `a` | SHAPE ⟪a⟫: {ground: 1}}}
out-of-range | disk `a`; -1 | SHAPE a: {disk: ⟪-1⟫}}}
out-of-range | box `a`; -2 | SHAPE a: {box: [1, ⟪-2⟫]}}}
not-finite | disk `a`; inf | SHAPE a: {disk: ⟪exp(1e9)⟫}}}
wrong-count | 1 | SHAPE a: {box: ⟪[1]⟫}}}
not-a-list | [1, 2] | scene:¶  shapes:¶    a:¶      box:⟪⟫
wrong-count | 1000; 2 | SHAPE a: {polygon: ⟪[[0, 0], [1, 0]]⟫}}}
wrong-count | polygon | SHAPE a: {polygon: [[0, 0], [1, 0], ⟪[1]⟫]}}}
not-constant | `x` | SHAPE a: {disk: ⟪x⟫}}}
not-an-expression |  | SHAPE a: {disk: ⟪[1]⟫}}}
missing-key | s: [0, 2*pi] | SHAPE a: {curve: ⟪[t, t]⟫}}}
unknown-name | `u` | SHAPE a: {curve: [⟪u⟫, s], s: [0, 1]}}}
unknown-name | `s` | SHAPE a: {disk: 1, at: [⟪s⟫, 0]}}}
unknown-key | `scale`; `arrow` | SHAPE a: {disk: 1, ⟪scale⟫: 1}}}
output-only |  | SHAPE a: {disk: 1, frame: ⟪x_ddot⟫}}}
not-a-mapping | `1` | SHAPE a: ⟪1⟫}}
wrong-count |  | SHAPE a: {disk: 1, frame: ⟪[[1, 0], [0, 1, 0]]⟫}}}
shape-of-space | `a` | SHAPE ⟪a⟫: {disk: 1, frame: [[1,0,0],[0,1,0],[0,0,1]]}}}
# output
not-a-list | [] | output:¶  columns:⟪⟫
not-a-definition |  | output: {columns: [⟪x_dot⟫]}
not-a-definition | k_given: k | parameters: {k: 1}¶output: {columns: [⟪k⟫]}
not-a-definition | Qc_ | output: {reactions: [⟪x⟫]}
unknown-name | output: {reactions: [a]} | definitions: {a: x, b: ⟪reaction.a⟫}
output-only |  | definitions: {a: x}¶forces: {x: ⟪reaction.a⟫}¶
    output: {reactions: [a]}
missing-key | `y` | output: {plots: [⟪{x: t}⟫]}
unknown-axis |  | output: {plots: [{x: t, y: x, log: [y, ⟪{a: 1}⟫]}]}
unknown-axis |  | output: {plots: [{x: t, y: x, log: [y, ⟪y2⟫]}]}
wrong-count | 6; 0 | output: {plots: [{x: t, y: ⟪[]⟫}]}
wrong-count | 7 | output: {plots: [{x: t, y: ⟪[x, x, x, x, x, x, x]⟫}]}
unknown-name | `z` | output: {plots: [{x: t, y: [x, ⟪z⟫]}]}
not-an-expression |  | output: {plots: [{x: ⟪[t, x]⟫, y: x}]}
# YAML that models do not use, and what a person writes by mistake
yaml-syntax | quoted | x-x: -y⟪:⟫ 3
yaml-syntax | comma | x-a: {b: c⟪:⟫ d}
unknown-name | `zz` | definitions: {a: atan2(y, ⟪zz⟫), b: 1}
unknown-name | `zz` | output: {plots: [{x: t, y: [if(x > 0,¶    1, ⟪zz⟫), y]}]}
expression-parenthesis | never closed | definitions: {a: ⟪max⟫(x, y}
missing-space | `theta: 1` | x-i:¶  ⟪theta:1⟫¶  u: 2
missing-space | `theta: 1` | x-i:¶  u: 2¶  ⟪theta:1⟫
missing-space | `theta: 1` | x-i: {u: 2, ⟪theta:1⟫}
yaml-syntax | "*x + 1" | x-a: ⟪*⟫x + 1
yaml-syntax | "%x" | x-a: ⟪%⟫x
yaml-syntax | "@x" | x-a: ⟪@⟫x
yaml-syntax | quote | x-a: ⟪`⟫x`
yaml-syntax | ">= 3" | x-a: ⟪>⟫= 3
yaml-syntax | write abs(x) + abs(y) | x-a: ⟪|⟫x| + |y|
yaml-syntax | "- y" | x-a: ⟪-⟫ y
yaml-syntax | quote | x-a: ⟪,⟫x
yaml-tab | spaces | x-a:¶  x-b: 1¶⟪	⟫x-c: 2
yaml-syntax | line 2 | x-a: ⟪{⟫b: 1¶x-c: 2
yaml-syntax | `]` | x-a: ⟪[⟫1, 2
yaml-syntax | never closed | x-a: ⟪'⟫x¶x-b: 1
yaml-syntax | whole | x-a: 'x' ⟪+⟫ y
yaml-syntax | single quotes | x-a: "⟪\⟫q"
yaml-syntax | best quoted | x-a: {b: "c" ⟪d⟫}
yaml-syntax | `}` closes nothing | x-a: {x}⟪}⟫
yaml-syntax | which has a value already | x-a: 1¶  ⟪x⟫-b: 2
yaml-syntax | column |   x-a: 1¶⟪x⟫-b: 2
yaml-syntax | <<<<<<< HEAD | x-a: 1¶⟪<<<<<<< HEAD⟫
yaml-syntax | expected `key: value` | x-a: 1¶⟪b⟫
"""


def table(text, words=BEGINNINGS):
    """Return the cells of a table; a line that is indented continues the last."""
    whole = re.sub(r"\n    ", " ", re.sub(r"¶\n    ", "¶", text))
    for word, meaning in words.items():
        whole = whole.replace(word, meaning)
    rows = (row for row in whole.split("\n") if row and not row.startswith("#"))
    return [[cell.replace("¶", "\n") for cell in row.split(" | ", 2)] for row in rows]


CASES = {row[2].replace("\n", "¶"): row for row in table(TABLE)}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_fault(case):
    code, names, marked = case
    before, token, after = re.split("[⟪⟫]", marked)
    line = before.count("\n") + 1
    column = len(before) - (before.rfind("\n") + 1) + 1
    text = before + token + after

    found = problems(text)

    assert [p.code for p in found] == [code], found
    (problem,) = found
    shown = f"{problem.text} | {problem.whole.hint}"
    assert all(name in shown for name in names.split("; ")), shown
    assert problem.place == (
        "model.yaml", line, column, max(1, len(token)), text.split("\n")[line - 1],
    )  # fmt: skip


@pytest.mark.parametrize("section", ["coordinates", "energy", "initial"])
def test_required_section(section):
    found = problems("name: a", omit=section)
    assert [p.code for p in found] == ["missing-key"]
    assert section in found[0].text
    assert (found[0].place.line, found[0].place.column) == (1, 1)


class TestManyAtOnce:
    def test_in_the_order_of_the_file(self):
        text = """\
lagsim: 3
parameters: {a: 2*b, b: 1e999}
definitions:
  r: -y: 3
  s: r + qq
  T: lambda_c
energy: {kinetic: x_dot^2, potential: T}
forces: {z: 1}
constraints: {c: x >= 0}
simulation: {duration: -1, rtol: -1}
"""
        found = problems(text)
        assert [(p.place.line, p.place.column, p.code) for p in found] == [
            (1, 9, "format-version"), (2, 19, "later-parameter"),
            (2, 25, "expression-not-finite"), (4, 8, "yaml-syntax"),
            (5, 10, "unknown-name"), (7, 39, "output-only"), (8, 10, "unknown-name"),
            (9, 15, "missing-key"), (10, 24, "out-of-range"), (10, 34, "out-of-range"),
        ]  # fmt: skip

    def test_two_names_of_one_expression(self):
        found = problems("definitions: {a: zz1 + zz2 + zz1}")
        assert [(p.place.column, p.code) for p in found] == [
            (18, "unknown-name"),
            (24, "unknown-name"),
        ]

    @pytest.mark.parametrize(
        ("name", "text"),
        [("zz", "unknown name `zz`"), ("q(1)", "there is no function `q`")],
    )
    def test_what_is_unknown_is_reported_once(self, name, text):
        """Where it is used first, in the order of the file."""
        used = f"forces: {{x: {name}}}\ndefinitions: {{a: 2*{name}, b: {name}}}\n"
        (found,) = problems(used)
        assert (found.text, found.place.line) == (f"{text}, and 2 more places", 1)
        (found,) = problems(used.splitlines()[0])
        assert found.text == text

    @pytest.mark.slow
    def test_they_are_bounded(self, monkeypatch):
        assert MAX_FAULTS == 1000
        monkeypatch.setattr(sys.modules[Faults.__module__], "MAX_FAULTS", 50)
        text = "definitions:\n" + "".join(f"  a{i}: zz{i}\n" for i in range(70))
        found = problems(text)
        assert len(found) == 51
        assert found[-1].text == "20 more faults are not shown"


# What depends on a fault is passed over: the code, and the text with that fault alone.
ALONE = r"""
expression-syntax | definitions: {a: 2*, b: a, c: b_dot}¶forces: {a: 1, c: b}¶
    constraints: {k: a = x}¶output: {columns: [a, b, c]}
cycle | definitions: {a: b, b: a, c: a_dot}¶forces: {a: c}
unknown-name | definitions: {a: zz, c: a_dot}¶initial: {x: 0, y: 0, a: 1}
expression-not-finite | parameters: {k: 1e999, m: k, n: m}¶initial: {x: n, y: x}¶
    simulation: {duration: n}
bad-name | parameters: {k-1: 1}¶forces: {x: 1}
bad-name | parameters: {x²: 1, b: 2*x²}¶forces: {x: x²}
reserved-name | parameters: {z_dot: 1}¶forces: {x: z_dot}
not-a-mapping | coordinates: [x, y]
yaml-syntax | coordinates: {a: b: c}
not-a-mapping | parameters: [k]¶forces: {x: k}
missing-space | parameters: {k:1}¶forces: {x: k}
unknown-key | paramters: {k: 1}¶forces: {x: k}
duplicate-key | parameters: {k: 1}¶parameters: {m: 1}¶forces: {x: k*m}
yaml-syntax | energy: {kinetic: x_dot: 2, potential: 0}¶definitions: {a: kinetic}
unknown-name | energy: {kinetic: zz, potential: 0}¶definitions: {a: kinetic}
missing-key | energy: {kinetic: x_dot^2}¶definitions: {a: potential}
bad-name | constraints: {c-1: x = 0, d: x = y}
expression-syntax | initial: {x: 2*, y: x}
yaml-syntax | initial: {x: a: 1, y: x}
yaml-syntax | simulation: {duration: a: b}
unknown-name | scene: {points: {p: [x, zz]}, links: [[p, p]]}
yaml-syntax | scene:¶  points: a: b¶  links: [[p, p]]
name-clash | parameters: {x: 1}¶coordinates: {x: , y: }¶definitions: {x: 1}
expression-syntax | constraints: {c: {relation: 'if(x, 1, 2) >= 0', restitution: 1}}
unknown-name | constraints: {c: x_dot >= zz_dot}
unknown-name | constraints: {c: {relation: x_dot = zz, limit: 1}}
unknown-name | constraints: {c: {relation: x_dot, limit: zz, when: t < 1}}
"""


@pytest.mark.parametrize(("code", "text"), table(ALONE), ids=str)
def test_nothing_follows_from_a_fault(code, text):
    found = problems(text)
    assert [p.code for p in found] == [code], found
