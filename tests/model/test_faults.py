"""Each fault of a file is reported once, in its place.

A row of the table: the code, a part of the message or of its hint, and the text. The
token that the caret must stand under is marked ⟪so⟫, and ¶ is a line break. Words in
capitals abbreviate common beginnings of texts.
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
unknown-key | did you mean `forces` | ⟪force⟫: {x: 1}
not-a-mapping | found `1` | parameters: ⟪1⟫
format-version | must be 1, found `2` | lagsim: ⟪2⟫
bad-model-name | `a/b` | name: ⟪a/b⟫
bad-model-name | path separators | name: ⟪a\b⟫
bad-model-name | `..` | name: ⟪..⟫
bad-model-name | cannot be a name | name: ⟪''⟫
bad-model-name | a line break | name: ⟪"a\nb"⟫
not-a-text | `name` must be a text | name: ⟪[a]⟫
not-a-text | U+0000 | description: "a⟪\0⟫"
yaml-syntax | a second `:` | description: a⟪:⟫ b
# parameters
unknown-key | did you mean `value` | parameters: {k: {⟪valeu⟫: 1}}
missing-key | no `value` | parameters: {⟪k⟫: {unit: m}}
not-an-expression | found nothing | parameters:¶  k:⟪⟫¶
not-an-expression | a list | parameters: {k: ⟪[1]⟫}
later-parameter | uses itself | parameters: {a: 1 + ⟪a⟫}
not-constant | `x` is a coordinate | parameters: {a: 2*⟪x⟫}
not-constant | `t` is the time | parameters: {a: 2*⟪t⟫}
unknown-name | did you mean `mass` | parameters: {mass: 1, b: 2*⟪maas⟫}
unknown-name | the `friction` of a contact | forces: {x: ⟪slip_speed⟫}
not-a-text | a line break | parameters: {k: {value: 1, unit: ⟪"m\n/s"⟫}}
# tables
unknown-interpolation | `spline` | CURVE interpolation: ⟪spline⟫}}
unknown-interpolation | known are `error`, `hold` | CURVE outside: ⟪clamp⟫}}
unknown-key | in the table `f` | CURVE ⟪colour⟫: red}}
not-a-list | `points` must be a list | TABLE {points: ⟪1⟫}}
table-points | found `0` | TABLE {points: [⟪0⟫]}}
table-points | a list of 2, found `0` | TABLE {points: [⟪0⟫, 1, 2, 3]}}
table-points | a list of 2, found a list of 1 | TABLE {points: [[0, 1], ⟪[2]⟫]}}
table-points | a list of 3, found | TABLE {points: [[0, 1, 2], ⟪[2, 3]⟫]}}
table-points | has 1 point | tables: {⟪f⟫: {points: [[0, 1]]}}¶forces: {x: f(t)}
table-points | after 2 here, and at 1 more | TABLE {points: [[2, 1], [⟪1⟫, 0], [1, 2]]}}
table-points | the first, 0 | TABLE {points: [[0, 0], [2, ⟪1⟫]], outside: repeat}}
table-points | the point at 0, 1 is given | TABLE {points: [[0, 1, 2], [⟪0⟫, 1, 3]]}}
table-points | no point at 1, 1 | TABLE {points: [[⟪0⟫, 0, 2], [0, 1, 3], [1, 0, 0]]}}
table-points | one row of a grid | TABLE {points: [[⟪0⟫, 0, 2], [0, 1, 3]]}}
unknown-interpolation | of one argument | TABLE {points: [[0, 0, 2], [0, 1, 3]],
    ⟪interpolation⟫: monotone}}
expression-not-finite | 1e999 | TABLE {points: [[0, 0], [⟪1e999⟫, 1]]}}
unknown-name | `nan` | TABLE {points: [[0, 0], [1, ⟪nan⟫]]}}
not-constant | `k` is a | parameters: {k: 1}¶TABLE {points: [[0, 0], [1, ⟪k⟫]]}}
missing-key | neither `points` nor | tables: {⟪f⟫: {outside: hold}}¶forces: {x: f(t)}
both-given | both `points` and `file` | CURVE ⟪file⟫: a.csv}}
both-given | there is none | CURVE ⟪x⟫: a}}
missing-key | has no `y` | TABLE {⟪file⟫: models/road.csv, x: distance}}
unused-table | call it as `f(...)` | tables: {⟪f⟫: {points: [[0, 0], [1, 1]]}}
reserved-name | a function already | tables: {⟪sin⟫: {points: [[0, 0], [1, 1]]}}
name-clash | a parameter already | parameters: {f: 1}¶
    tables: {⟪f⟫: {points: [[0, 0], [1, 1]]}}
expression-arity | `f` takes 1 argument, found 2 |
    tables: {f: {points: [[0, 0], [1, 1]]}}¶forces: {x: 1 + ⟪f⟫(t, x)}
unknown-name | write f(...) | tables: {f: {points: [[0, 0], [1, 1]]}}¶forces: {x: ⟪f⟫}
expression-unknown-function | write curve(t) |
    tables: {curve: {points: [[0, 0], [1, 1]]}}¶
    forces: {x: curve(t), y: ⟪curv⟫(t)}
# sections
missing-key | neither `at` nor | output: {sections: {⟪c⟫: {direction: up}}}
both-given | both `at` and `every` | output: {sections: {⟪c⟫: {at: x = 0, every: 1}}}
both-given | `every` and `dir | output: {sections: {c: {every: 1, ⟪direction⟫: up}}}
not-an-equality | must be an equality | output: {sections: {c: {⟪at⟫: x >= 0}}}
no-coordinate | depends on no | output: {sections: {c: {at: ⟪t = 1⟫}}}
unknown-name | known are `both` | output: {sections: {c: {at: x, direction: ⟪left⟫}}}
unknown-name | no column `z` | output: {sections: {c: {at: x, plot: [x, ⟪z⟫]}}}
wrong-count | found 1 | output: {sections: {c: {at: x, ⟪plot⟫: [x]}}}
not-constant | `x` is a coordinate | output: {sections: {c: {every: ⟪x⟫}}}
bad-name | `a-b` | output: {sections: {⟪a-b⟫: {at: x}}}
unknown-key | did you mean `every` | output: {sections: {c: {⟪evry⟫: 1}}}
# names
bad-name | a line break | parameters: {⟪"a\n"⟫: 1}
bad-name | `2k` | parameters: {⟪2k⟫: 1}
bad-name | `k_1` | parameters: {⟪k-1⟫: 1}
bad-name | a letter | parameters: {⟪_k⟫: 1}
bad-name | write `x2` | parameters: {⟪x²⟫: 1}
reserved-name | `t` is reserved | parameters: {⟪t⟫: 1}
reserved-name | `kinetic` | definitions: {⟪kinetic⟫: 1}
reserved-name | `work` | constraints: {⟪work⟫: x = y}
reserved-name | operator | parameters: {⟪and⟫: 1}
reserved-name | `_dot` | parameters: {⟪z_dot⟫: 1}
reserved-name | `_ddot` | definitions: {⟪z_ddot⟫: x}
name-clash | a coordinate already | coordinates: {x: , y: }¶parameters: {⟪x⟫: 1}
column-clash | the multiplier of the constraint `c` | parameters: {⟪lambda_c⟫: 1}¶
    RELATION x = 1}¶initial: {x: 1, y: 0}
column-clash | the residual of the constraint `c` | definitions: {⟪residual_c⟫: x}¶
    RELATION x = y}
column-clash | the impulse of the constraint `x` | definitions: {⟪impulse⟫: [x, y]}¶
    constraints: {x: x = y}
column-clash | the friction of the constraint `x` | definitions: {⟪friction⟫: [x, y]}¶
    constraints: {x: x = y}
column-clash | the reaction of `x` | definitions: {⟪reaction⟫: [x, y]}
column-clash | the standard deviation of `x` | definitions: {⟪sd⟫: [x, y]}
column-clash | the multiplier of the constraint `c.1` |
    definitions: {⟪lambda_c(1..2)⟫: x}¶
    constraints: {c: {relation: [x_dot = 0, y_dot = 0], limit: 5}}
# coordinates
missing-key | no coordinates | ⟪coordinates⟫: {}
# definitions
cycle | a -> b -> a | definitions: {c: a, a: x + ⟪b⟫, b: sin(a), d: c_dot}
cycle | a -> b -> a | definitions: {a: x + ⟪b_dot⟫, b: a}
cycle | depends on itself | states: {⟪a⟫: {rate: k}}¶definitions: {k: a_dot}¶
    initial: {x: 0, y: 0, a: 0}
missing-key | the expression for `a_dot` | states: {⟪a⟫: {}}¶initial: {x: 0, y: 0, a: 0}
missing-initial | `a: {steady: 0}` | states: {a: {rate: x}}¶⟪initial⟫: {x: 0, y: 0}
name-clash | a state already | states: {x: {rate: 1}}¶coordinates: {⟪x⟫: , y: }
unknown-name | did you mean `theta_dot` | coordinates: {theta: , y: }¶
    definitions: {a: ⟪thta_dot⟫}¶energy: {kinetic: theta_dot^2, potential: 0}¶
    initial: {theta: 0, y: 0}
unknown-name | `k` is a parameter | parameters: {k: 1}¶definitions: {a: ⟪k_dot⟫}
unknown-name | `x_ddot` | definitions: {a: ⟪x_dot_dot⟫}
no-rate | accelerations | definitions: {v: 2*x_ddot, a: ⟪v_dot⟫}
unknown-name | did you mean `lambda_path` | constraints: {path: x = y}¶
    definitions: {a: ⟪lambda_pth⟫}
unknown-name | a column of results | definitions: {a: ⟪work⟫}
unknown-name | the file gives `lagrangian` | energy: {lagrangian: x_dot^2 + y_dot^2}¶
    definitions: {a: ⟪kinetic⟫}
unknown-name | sin(...) | definitions: {a: ⟪sin⟫}
# expressions (their own tests are elsewhere; here: the place in the file)
expression-syntax | write 2*x | definitions: {a: 2 ⟪x⟫}
expression-parenthesis | never closed | LAW ⟪(⟫x - y}}
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
expression-syntax | unexpected character | definitions: {a: 'x⟪''⟫ + 1'}
expression-syntax | expected | parameters: {k: '⟪'⟫}
not-an-expression | found nothing | parameters: {k: ⟪~⟫}
# energy
missing-key | neither | ⟪energy⟫: {}
missing-key | `potential: 0` | ⟪energy⟫: {kinetic: x_dot^2}
missing-key | no `kinetic` | ⟪energy⟫: {potential: x^2}
both-given | `kinetic` and `lagrangian` | KINETIC ⟪lagrangian⟫: x_dot^2}
output-only | an acceleration | energy: {kinetic: ⟪x_ddot⟫^2, potential: 0}
output-only | the second rate | definitions: {r: x*y}¶KINETIC potential: ⟪r_ddot⟫}
output-only | a constraint multiplier | RELATION x = y}¶KINETIC potential: ⟪lambda_c⟫}
output-only | a constraint force | KINETIC potential: 0, dissipation: ⟪Qc_x⟫}
output-only | the definition `a` uses accelerations | definitions: {b: a, a: x_ddot}¶
    KINETIC potential: ⟪a⟫}
# forces
output-only | `a` | definitions: {a: x_ddot}¶forces: {⟪a⟫: 1}
# constraints
missing-key | no `relation` | constraints: {⟪c⟫: {description: a}}
no-coordinate | no coordinate | RELATION ⟪x - x = 0⟫}
expression-syntax | one `=` | RELATION x = y ⟪=⟫ 0}
missing-key | one-sided and has no `restitution` | constraints: {⟪floor⟫: x >= -1}
out-of-range | 1.5; it must not exceed 1 | LAW x >= 0, restitution: ⟪1.5⟫}}
out-of-range | -0.5; it must not be negative | LAW x >= 0, restitution: ⟪-0.5⟫}}
velocity-not-allowed | one-sided | LAW x + ⟪x_dot⟫ >= 0, restitution: 0}}
velocity-not-allowed | the definition `v` depends on velocities | definitions: {v:
    2*x_dot}¶LAW x + ⟪v⟫ <= 0, restitution: 0}}
missing-key | no `slip` | CONTACT ⟪friction⟫: 1}}
missing-key | no `friction` | CONTACT ⟪slip⟫: y_dot}}
out-of-range | negative | CONTACT friction: ⟪-1⟫, slip: y_dot}}
not-affine | not affine | CONTACT friction: 1, slip: ⟪y_dot^2⟫}}
not-affine | no velocity | CONTACT friction: 1, slip: ⟪2*y⟫}}
wrong-count | found 3 | CONTACT friction: 1, slip: ⟪[x_dot, y_dot, y_dot]⟫}}
out-of-range | 0.2, less than the dynamic one, 0.3 | CONTACT slip: y_dot, friction:
    {static: ⟪0.2⟫, dynamic: 0.3}}}
out-of-range | the dynamic friction | CONTACT slip: y_dot, friction: {static: 1,
    dynamic: ⟪-0.3⟫}}}
missing-key | no `dynamic` | CONTACT slip: y_dot, ⟪friction⟫: {static: 1}}}
not-homogeneous | not homogeneous in the velocities | RELATION ⟪x_dot >= 1⟫}
not-homogeneous | a freewheel is | LAW ⟪x_dot^2 >= y_dot^2⟫}}
out-of-range | the limit of the constraint `c` is -2; it must not be negative |
    parameters: {F: -2}¶LAW x_dot, limit: ⟪F⟫}}
output-only | the limit of the constraint `c` | LAW x_dot, limit: ⟪x_ddot⟫}}
expression-syntax | a comparison is expected here, found a number | LAW x = y, when:
    ⟪t⟫}}
not-of-time | depends on `x`, `y_dot`; it must not depend on the motion | LAW x = y,
    when: ⟪x < 1 or y_dot < 1⟫}}
# initial
not-a-start-value | an acceleration | INITIAL ⟪x_ddot⟫: 1}
output-only | accelerations | definitions: {a: x_ddot}¶INITIAL ⟪a⟫: 1}
no-rate | velocities | definitions: {a: x_dot}¶INITIAL ⟪a_dot⟫: 1}
later-initial | the start value of `x` | initial: {x: 2*⟪x⟫, y: 0}
not-a-start-value | `y_dot` is a velocity | initial: {x: 0, y: 2*⟪y_dot⟫}
not-a-start-value | the time | initial: {x: 0, y: ⟪t⟫}
not-an-expression | guess | initial: {x: 0, y: ⟪{}⟫}
# simulation
both-given | both `duration` and `end` | simulation: {duration: 1, ⟪end⟫: 1}
out-of-range | must be positive | simulation: {duration: ⟪0⟫}
out-of-range | from 2 to 1 | simulation: {start: 2, end: ⟪1⟫}
out-of-range | from 1e+20 to 1e+20 | simulation: {start: 1e20, duration: ⟪1⟫}
out-of-range | `output_step` is 0 | simulation: {duration: 1, output_step: ⟪0⟫}
out-of-range | longer than the run | simulation: {duration: 1, output_step: ⟪1.01⟫}
too-many-rows | makes 100000001 rows | simulation: {duration: 1e8, output_step: ⟪1⟫}
too-many-rows | infinitely many | simulation: {duration: 1e300, output_step: ⟪1e-300⟫}
out-of-range | `rtol` is -1 | simulation: {rtol: ⟪-1⟫}
out-of-range | both 0 | simulation: {rtol: 0, atol: ⟪0⟫}
out-of-range | without an `atol` | simulation: {rtol: ⟪0⟫}
empty | `method` | simulation:¶  method:⟪⟫
no-coordinate | `end` or `duration` | simulation: {until: ⟪t >= 3⟫}
# scene
wrong-count | found 1 | scene: {points: {p: ⟪[x]⟫}}
wrong-count | found 4 | scene: {points: {p: ⟪[x, y, x, y]⟫}}
bad-name | a point | scene: {points: {⟪p-1⟫: [x, y]}}
not-a-text | a list | scene: {points: {o: [0, 0]}, links: [[o, ⟪[o]⟫]]}
wrong-count | or more, found 1 | scene: {points: {o: [0, 0]}, links: [⟪[o]⟫]}
unknown-name | did you mean `o` | scene: {points: {o: [0, 0]}, links: [[o, o, ⟪oo⟫]]}
both-given | this link is a rod | POINT links: [{points: [o, o], as: rod, ⟪length⟫: 1}]}
out-of-range | of a string is -1 | POINT links: [{points: [o, o], length: ⟪-1⟫}]}
not-finite | of a string is inf | POINT links: [{points: [o, o], length: ⟪exp(1e9)⟫}]}
not-constant | `x` is a coordinate | POINT links: [{points: [o, o], length: 2*⟪x⟫}]}
unknown-name | did you mean `spring` | POINT links: [{points: [o, o], as: ⟪sprung⟫}]}
missing-key | a link has no `points` | POINT links: [⟪{as: rod}⟫]}
unknown-key | did you mean `points` | POINT links: [{⟪point⟫: [o, o]}]}
# shapes
missing-key | `disk`, `ring`, `box` | SHAPE ⟪a⟫: {}}}
unknown-key | did you mean `disk` | SHAPE a: {⟪dsik⟫: 1}}}
both-given | as `disk`, `box` | SHAPE a: {box: [1, 2], ⟪disk⟫: 1}}}
bad-name | the name of a shape | SHAPE ⟪a-b⟫: {disk: 1}}}
unknown-name | did you mean `o` | SHAPE a: {disk: 1, at: ⟪oo⟫}}}
unknown-name | `z` | SHAPE a: {disk: 1, at: [x, ⟪z⟫]}}}
shape-of-space | the sphere `a` | SHAPE ⟪a⟫: {sphere: 1}}}
shape-of-space | the box `a` | SHAPE ⟪a⟫: {box: [1, 2, 3]}}}
shape-of-space | the disk `a` | SHAPE ⟪a⟫: {disk: 1, at: [1, 2, 3]}}}
shape-of-space | the ground `a` | SHAPE ⟪a⟫: {ground: 1}}}
out-of-range | the disk `a` is -1 | SHAPE a: {disk: ⟪-1⟫}}}
out-of-range | the box `a` is -2 | SHAPE a: {box: [1, ⟪-2⟫]}}}
not-finite | the disk `a` is inf | SHAPE a: {disk: ⟪exp(1e9)⟫}}}
wrong-count | 2 or 3 numbers, found 1 | SHAPE a: {box: ⟪[1]⟫}}}
not-a-list | such as [1, 2] | scene:¶  shapes:¶    a:¶      box:⟪⟫
wrong-count | 3 to 1000 corners, found 2 | SHAPE a: {polygon: ⟪[[0, 0], [1, 0]]⟫}}}
wrong-count | a corner of the polygon | SHAPE a: {polygon: [[0, 0], [1, 0], ⟪[1]⟫]}}}
not-constant | `x` is a coordinate | SHAPE a: {disk: ⟪x⟫}}}
not-an-expression | a list | SHAPE a: {disk: ⟪[1]⟫}}}
missing-key | such as s: [0, 2*pi] | SHAPE a: {curve: ⟪[t, t]⟫}}}
unknown-name | `u` | SHAPE a: {curve: [⟪u⟫, s], s: [0, 1]}}}
unknown-name | `s` | SHAPE a: {disk: 1, at: [⟪s⟫, 0]}}}
unknown-key | `scale` belongs to `arrow` | SHAPE a: {disk: 1, ⟪scale⟫: 1}}}
output-only | the motion gives | SHAPE a: {disk: 1, frame: ⟪x_ddot⟫}}}
not-a-mapping | found `1` | SHAPE a: ⟪1⟫}}
wrong-count | rows of as many | SHAPE a: {disk: 1, frame: ⟪[[1, 0], [0, 1, 0]]⟫}}}
shape-of-space | the disk `a` | SHAPE ⟪a⟫: {disk: 1, frame: [[1,0,0],[0,1,0],[0,0,1]]}}}
# output
not-a-list | [] means no columns | output:¶  columns:⟪⟫
not-a-definition | leave it out | output: {columns: [⟪x_dot⟫]}
not-a-definition | define it: k_given: k | parameters: {k: 1}¶output: {columns: [⟪k⟫]}
not-a-definition | Qc_ | output: {reactions: [⟪x⟫]}
unknown-name | output: {reactions: [a]} | definitions: {a: x, b: ⟪reaction.a⟫}
output-only | which the motion gives | definitions: {a: x}¶forces: {x: ⟪reaction.a⟫}¶
    output: {reactions: [a]}
missing-key | no `y` | output: {plots: [⟪{x: t}⟫]}
unknown-axis | found a mapping | output: {plots: [{x: t, y: x, log: [y, ⟪{a: 1}⟫]}]}
unknown-axis | the plot has none | output: {plots: [{x: t, y: x, log: [y, ⟪y2⟫]}]}
wrong-count | 1 to 6 curves, found 0 | output: {plots: [{x: t, y: ⟪[]⟫}]}
wrong-count | found 7 | output: {plots: [{x: t, y: ⟪[x, x, x, x, x, x, x]⟫}]}
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
    code, part, marked = case
    before, token, after = re.split("[⟪⟫]", marked)
    line = before.count("\n") + 1
    column = len(before) - (before.rfind("\n") + 1) + 1
    text = before + token + after

    found = problems(text)

    assert [p.code for p in found] == [code], found
    (problem,) = found
    assert part in f"{problem.text} | {problem.whole.hint}"
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
