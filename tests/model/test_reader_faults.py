"""One fault for each sentence of the contract: told once, in its place.

The token that the caret must stand under is marked ⟪so⟫ in the text.
"""

import pytest

from tests.model._files import problems

# (section 1 of model-format.md, in its order) code, part of the message, text.
CASES = {
    # the file
    "unknown key": ("unknown-key", "`colour`", "⟪colour⟫: red"),
    "unknown key, suggested": ("unknown-key", "did you mean `forces`",
                               "⟪force⟫: {x: 1}"),
    "duplicate key": ("duplicate-key", "is given twice",
                      "name: a\n⟪name⟫: b"),
    "anchor": ("anchor", "`&a`", "parameters: {k: ⟪&a 1⟫}"),
    "alias": ("alias", "`*a`", "parameters: {k: ⟪*a⟫}"),
    "merge key": ("merge-key", "`<<`", "parameters: {⟪<<⟫: {k: 1}}"),
    "tag": ("tag", "`!x`", "parameters: {k: ⟪!x 1⟫}"),
    "not a mapping": ("not-a-mapping", "found `1`", "parameters: ⟪1⟫"),
    "a list for a mapping": ("not-a-mapping", "without the `-`",
                             "forces: ⟪[x, y]⟫"),
    "format version": ("format-version", "must be 1, found `2`", "lagsim: ⟪2⟫"),
    "name with separator": ("bad-model-name", "`a/b`", "name: ⟪a/b⟫"),
    "name with backslash": ("bad-model-name", "path separators", "name: ⟪a\\b⟫"),
    "name of the folder above": ("bad-model-name", "`..`", "name: ⟪..⟫"),
    "name empty": ("bad-model-name", "cannot be a name", "name: ⟪''⟫"),
    "name of two lines": ("bad-model-name", "a line break", 'name: ⟪"a\\nb"⟫'),
    "name is no text": ("not-a-text", "`name` must be a text", "name: ⟪[a]⟫"),
    "text with control character": ("not-a-text", "U+0000",
                                    'description: "a⟪\\0⟫"'),
    "unquoted colon": ("yaml-syntax", "a second `:`", "description: a⟪:⟫ b"),
    # parameters
    "parameter key": ("unknown-key", "did you mean `value`",
                      "parameters: {k: {⟪valeu⟫: 1}}"),
    "parameter without value": ("missing-key", "no `value`",
                                "parameters: {⟪k⟫: {unit: m}}"),
    "parameter empty": ("not-an-expression", "found nothing",
                        "parameters:\n  k:⟪⟫\n"),
    "parameter list": ("not-an-expression", "a list", "parameters: {k: ⟪[1]⟫}"),
    "later parameter": ("later-parameter", "`a` uses `b`, which is below it",
                        "parameters: {a: 2*⟪b⟫, b: 1}"),
    "own parameter": ("later-parameter", "uses itself",
                      "parameters: {a: 1 + ⟪a⟫}"),
    "parameter of a coordinate": ("not-constant", "`x` is a coordinate",
                                  "parameters: {a: 2*⟪x⟫}"),
    "parameter of time": ("not-constant", "`t` is the time",
                          "parameters: {a: 2*⟪t⟫}"),
    "parameter unknown name": ("unknown-name", "did you mean `mass`",
                               "parameters: {mass: 1, b: 2*⟪maas⟫}"),
    "literal not finite": ("expression-not-finite", "1e999",
                           "parameters: {a: 2*⟪1e999⟫}"),
    "parameter not finite": ("not-finite", "inf", "parameters: {a: ⟪1/0⟫}"),
    "parameter not a number": ("not-finite", "nan",
                               "parameters: {b: 2, a: ⟪sqrt(1 - b)⟫}"),
    "unit of two lines": ("not-a-text", "a line break",
                          'parameters: {k: {value: 1, unit: ⟪"m\\n/s"⟫}}'),
    # names
    "name with line break": ("bad-name", "a line break", 'parameters: {⟪"a\\n"⟫: 1}'),
    "name begins with digit": ("bad-name", "`2k`", "parameters: {⟪2k⟫: 1}"),
    "name with minus": ("bad-name", "`k_1`", "parameters: {⟪k-1⟫: 1}"),
    "name with underscore first": ("bad-name", "a letter", "parameters: {⟪_k⟫: 1}"),
    "name not NFKC": ("bad-name", "write `x2`", "parameters: {⟪x²⟫: 1}"),
    "name with dot": ("bad-name", "`a.b`", "parameters: {⟪a.b⟫: 1}"),
    "reserved t": ("reserved-name", "`t` is reserved", "parameters: {⟪t⟫: 1}"),
    "reserved pi": ("reserved-name", "`pi` is reserved", "definitions: {⟪pi⟫: 1}"),
    "reserved kinetic": ("reserved-name", "`kinetic`", "definitions: {⟪kinetic⟫: 1}"),
    "reserved potential": ("reserved-name", "`potential`",
                           "parameters: {⟪potential⟫: 1}"),
    "reserved lagrangian": ("reserved-name", "`lagrangian`",
                            "parameters: {⟪lagrangian⟫: 1}"),
    "reserved energy": ("reserved-name", "`energy`", "parameters: {⟪energy⟫: 1}"),
    "reserved work": ("reserved-name", "`work`", "constraints: {⟪work⟫: x = y}"),
    "operator as name": ("reserved-name", "operator", "parameters: {⟪and⟫: 1}"),
    "ends in _dot": ("reserved-name", "`_dot`", "parameters: {⟪z_dot⟫: 1}"),
    "ends in _ddot": ("reserved-name", "`_ddot`", "definitions: {⟪z_ddot⟫: x}"),
    "parameter and coordinate": ("name-clash", "a parameter already",
                                 "parameters: {x: 1}\ncoordinates: {⟪x⟫: , y: }"),
    "coordinate and parameter": ("name-clash", "a coordinate already",
                                 "coordinates: {x: , y: }\nparameters: {⟪x⟫: 1}"),
    "definition and parameter": ("name-clash", "in line 1",
                                 "parameters: {a: 1}\ndefinitions: {⟪a⟫: x}"),
    "column of a multiplier": ("column-clash", "the multiplier of the constraint `c`",
                               ("parameters: {⟪lambda_c⟫: 1}\n"
                               "constraints: {c: x = 1}\ninitial: {x: 1, y: 0}")),
    "column of a residual": ("column-clash", "the residual of the constraint `c`",
                             "definitions: {⟪residual_c⟫: x}\nconstraints: {c: x = y}"),
    "column of a constraint force": ("column-clash", "the constraint force on `x`",
                                     "definitions: {⟪Qc_x⟫: x}"),
    # coordinates
    "coordinate with a value": ("not-a-mapping", "{unit: rad}",
                                "coordinates: {x: ⟪rad⟫, y: {}}"),
    "coordinate key": ("unknown-key", "`initial`",
                       "coordinates: {x: {⟪initial⟫: 1}, y: }"),
    "no coordinates": ("missing-key", "no coordinates", "⟪coordinates⟫: {}"),
    # definitions
    "definition empty": ("not-an-expression", "nothing", "definitions:\n  a:⟪⟫\n"),
    "cycle": ("cycle", "a -> b -> a",
              "definitions: {c: a, a: x + ⟪b⟫, b: sin(a), d: c_dot}"),
    "cycle of one": ("cycle", "a -> a", "definitions: {a: x + ⟪a⟫}"),
    "cycle through a rate": ("cycle", "a -> b -> a",
                             "definitions: {a: x + ⟪b_dot⟫, b: a}"),
    "unknown name": ("unknown-name", "did you mean `length`",
                     "parameters: {length: 1}\ndefinitions: {a: ⟪lenght⟫*x}"),
    "unknown rate": ("unknown-name", "did you mean `theta_dot`",
                     ("coordinates: {theta: , y: }\ndefinitions: {a: ⟪thta_dot⟫}\n"
                     "energy: {kinetic: theta_dot^2, potential: 0}\n"
                     "initial: {theta: 0, y: 0}")),
    "rate of a parameter": ("unknown-name", "`k` is a parameter",
                            "parameters: {k: 1}\ndefinitions: {a: ⟪k_dot⟫}"),
    "dot of a dot": ("unknown-name", "`x_ddot`", "definitions: {a: ⟪x_dot_dot⟫}"),
    "rate of velocities": ("no-rate", "depends on velocities",
                           "definitions: {v: 2*x_dot, a: ⟪v_dot⟫}"),
    "second rate of velocities": ("no-rate", "depends on velocities",
                                  "definitions: {v: 2*x_dot, a: ⟪v_ddot⟫}"),
    "rate of accelerations": ("no-rate", "accelerations",
                              "definitions: {v: 2*x_ddot, a: ⟪v_dot⟫}"),
    "unknown constraint": ("unknown-name", "did you mean `lambda_path`",
                           ("constraints: {path: x = y}\n"
                           "definitions: {a: ⟪lambda_pth⟫}")),
    "work in a definition": ("unknown-name", "a column of results",
                             "definitions: {a: ⟪work⟫}"),
    "kinetic with a Lagrangian": ("unknown-name", "the file gives `lagrangian`",
                                  ("energy: {lagrangian: x_dot^2 + y_dot^2}\n"
                                  "definitions: {a: ⟪kinetic⟫}")),
    "function without arguments": ("unknown-name", "sin(...)",
                                   "definitions: {a: ⟪sin⟫}"),
    # expressions (their own tests are elsewhere; here: the place in the file)
    "implicit product": ("expression-syntax", "write `*`", "definitions: {a: 2 ⟪x⟫}"),
    "unknown function": ("expression-unknown-function", "did you mean `sin`",
                         "definitions: {a: 2*⟪sinn⟫(x)}"),
    "arguments": ("expression-arity", "2 arguments",
                  "definitions: {a: '⟪atan2⟫(x)'}"),
    "open parenthesis in braces": ("expression-parenthesis", "never closed",
                                   "constraints: {c: {relation: ⟪(⟫x - y}}"),
    "comma in braces": ("split-by-comma", '"atan2(y, x) = 0"',
                        "constraints: {c: {relation: ⟪atan2(y, x) = 0⟫}}"),
    "comparison outside if": ("expression-syntax", "only in `if`",
                              "definitions: {a: ⟪x⟫ > 0}"),
    "relation outside constraints": ("expression-syntax", "`=`",
                                     "forces: {x: y ⟪=⟫ 1}"),
    "folded": ("unknown-name", "`zz`",
               "definitions:\n  a: >-\n    x +\n    2*⟪zz⟫"),
    "quoted": ("unknown-name", "`zz`", "definitions:\n  a: 'x +\n    2*⟪zz⟫'"),
    # energy
    "no energies": ("missing-key", "neither", "⟪energy⟫: {}"),
    "no potential": ("missing-key", "`potential: 0`", "⟪energy⟫: {kinetic: x_dot^2}"),
    "no kinetic": ("missing-key", "no `kinetic`", "⟪energy⟫: {potential: x^2}"),
    "both energies": ("both-given", "`kinetic` and `lagrangian`",
                      "energy: {kinetic: x_dot^2, ⟪lagrangian⟫: x_dot^2}"),
    "energy key": ("unknown-key", "did you mean `kinetic`",
                   "energy: {⟪kinetik⟫: x_dot^2, potential: 0}"),
    "acceleration in energy": ("output-only", "an acceleration",
                               "energy: {kinetic: ⟪x_ddot⟫^2, potential: 0}"),
    "second rate in energy": ("output-only", "the second rate",
                              ("definitions: {r: x*y}\n"
                              "energy: {kinetic: x_dot^2, potential: ⟪r_ddot⟫}")),
    "multiplier in energy": ("output-only", "a constraint multiplier",
                             ("constraints: {c: x = y}\n"
                             "energy: {kinetic: x_dot^2, potential: ⟪lambda_c⟫}")),
    "constraint force in dissipation": (
        "output-only", "a constraint force",
        "energy: {kinetic: x_dot^2, potential: 0, dissipation: ⟪Qc_x⟫}"),
    "energy in energy": ("output-only", "an energy",
                         "energy: {kinetic: x_dot^2, potential: ⟪kinetic⟫}"),
    "output definition in energy": (
        "output-only", "the definition `a` uses accelerations",
        ("definitions: {b: a, a: x_ddot}\n"
        "energy: {kinetic: x_dot^2, potential: ⟪a⟫}")),
    "output definition of one in energy": (
        "output-only", "the definition `b` uses accelerations",
        ("definitions: {b: a, a: kinetic}\n"
        "energy: {kinetic: x_dot^2, potential: ⟪b⟫}")),
    # forces
    "force on nothing": ("unknown-name", "did you mean `reach`",
                         "definitions: {reach: x*y}\nforces: {⟪reech⟫: 1}"),
    "force on a parameter": ("not-a-direction", "a parameter",
                             "parameters: {k: 1}\nforces: {⟪k⟫: 1}"),
    "force on a velocity": ("not-a-direction", "a force on `x`",
                            "forces: {⟪x_dot⟫: 1}"),
    "force on what is not linear": ("not-affine", "not linear in the velocities",
                                    "definitions: {s: x_dot^2}\nforces: {⟪s⟫: 1}"),
    "force on a speed": ("not-affine", "not linear in the velocities",
                         "definitions: {s: 'hypot(x_dot, y_dot)'}\nforces: {⟪s⟫: 1}"),
    "force on output": ("output-only", "`a`",
                        "definitions: {a: x_ddot}\nforces: {⟪a⟫: 1}"),
    "acceleration in force": ("output-only", "the force on `x`",
                              "forces: {x: ⟪y_ddot⟫}"),
    # constraints
    "constraint without relation": ("missing-key", "no `relation`",
                                    "constraints: {⟪c⟫: {description: a}}"),
    "constraint key": ("unknown-key", "did you mean `restitution`",
                       "constraints: {c: {relation: x >= 0, ⟪restitutoin⟫: 1}}"),
    "no coordinate": ("no-coordinate", "no coordinate", "constraints: {c: ⟪t = 1⟫}"),
    "no coordinate left": ("no-coordinate", "no coordinate",
                           "constraints: {c: ⟪x - x = 0⟫}"),
    "acceleration in relation": ("output-only", "an acceleration",
                                 "constraints: {c: ⟪x_ddot⟫ = 1}"),
    "multiplier in relation": ("output-only", "a constraint multiplier",
                               "constraints: {c: x = ⟪lambda_c⟫}"),
    "chain of relations": ("expression-syntax", "one `=`",
                           "constraints: {c: x = y ⟪=⟫ 0}"),
    "strict relation": ("expression-syntax", "`>=`",
                        "constraints: {c: {relation: x ⟪>⟫ 0, restitution: 0}}"),
    "restitution of an equality": (
        "not-one-sided", "no `restitution`",
        "constraints: {c: {relation: x = y, ⟪restitution⟫: 0}}"),
    "friction of an equality": (
        "not-one-sided", "no `friction`",
        "constraints: {c: {relation: x = y, ⟪friction⟫: 0}}"),
    "slip of an equality": ("not-one-sided", "no `slip`",
                            "constraints: {c: {relation: x = y, ⟪slip⟫: x_dot}}"),
    "no restitution": ("missing-key", "one-sided and has no `restitution`",
                       "constraints: {⟪floor⟫: x >= -1}"),
    "no restitution in braces": ("missing-key", "no `restitution`",
                                 "constraints: {⟪floor⟫: {relation: x >= -1}}"),
    "restitution above 1": (
        "out-of-range", "1.5, outside of 0 to 1",
        "constraints: {c: {relation: x >= 0, restitution: ⟪1.5⟫}}"),
    "restitution below 0": (
        "out-of-range", "-0.5, outside of 0 to 1",
        "constraints: {c: {relation: x >= 0, restitution: ⟪-0.5⟫}}"),
    "restitution not constant": (
        "not-constant", "a velocity",
        "constraints: {c: {relation: x >= 0, restitution: ⟪x_dot⟫}}"),
    "velocity in one-sided": (
        "velocity-not-allowed", "one-sided",
        "constraints: {c: {relation: x + ⟪x_dot⟫ >= 0, restitution: 0}}"),
    "velocity in one-sided, by a definition": (
        "velocity-not-allowed", "the definition `v` depends on velocities",
        ("definitions: {v: 2*x_dot}\n"
        "constraints: {c: {relation: x + ⟪v⟫ <= 0, restitution: 0}}")),
    "friction without slip": (
        "missing-key", "no `slip`",
        "constraints: {c: {relation: x >= 0, restitution: 0, ⟪friction⟫: 1}}"),
    "slip without friction": (
        "missing-key", "no `friction`",
        "constraints: {c: {relation: x >= 0, restitution: 0, ⟪slip⟫: y_dot}}"),
    "friction below 0": (
        "out-of-range", "negative",
        ("constraints: {c: {relation: x >= 0, restitution: 0, friction: ⟪-1⟫, "
        "slip: y_dot}}")),
    "slip not affine": (
        "not-affine", "not affine",
        ("constraints: {c: {relation: x >= 0, restitution: 0, friction: 1, "
        "slip: ⟪y_dot^2⟫}}")),
    "slip of positions": (
        "not-affine", "no velocity",
        ("constraints: {c: {relation: x >= 0, restitution: 0, friction: 1, "
        "slip: ⟪2*y⟫}}")),
    "three slips": (
        "wrong-count", "found 3",
        ("constraints: {c: {relation: x >= 0, restitution: 0, friction: 1, "
        "slip: ⟪[x_dot, y_dot, y_dot]⟫}}")),
    "static below dynamic": (
        "out-of-range", "0.2, less than the dynamic one, 0.3",
        ("constraints: {c: {relation: x >= 0, restitution: 0, slip: y_dot, "
         "friction: {static: ⟪0.2⟫, dynamic: 0.3}}}")),
    "dynamic below 0": (
        "out-of-range", "the dynamic friction",
        ("constraints: {c: {relation: x >= 0, restitution: 0, slip: y_dot, "
         "friction: {static: 1, dynamic: ⟪-0.3⟫}}}")),
    "static without dynamic": (
        "missing-key", "no `dynamic`",
        ("constraints: {c: {relation: x >= 0, restitution: 0, slip: y_dot, "
         "⟪friction⟫: {static: 1}}}")),
    "friction key": (
        "unknown-key", "did you mean `static`",
        ("constraints: {c: {relation: x >= 0, restitution: 0, slip: y_dot, "
         "friction: {⟪statc⟫: 1, dynamic: 1}}}")),
    "friction not constant": (
        "not-constant", "the static friction of the constraint `c`",
        ("constraints: {c: {relation: x >= 0, restitution: 0, slip: y_dot, "
         "friction: {static: ⟪t⟫, dynamic: 1}}}")),
    "freewheel that is not homogeneous": (
        "not-homogeneous", "not homogeneous in the velocities",
        "constraints: {c: ⟪x_dot >= 1⟫}"),
    "freewheel of squares": (
        "not-homogeneous", "a freewheel is",
        "constraints: {c: {relation: ⟪x_dot^2 >= y_dot^2⟫}}"),
    "freewheel between positions and velocities": (
        "not-homogeneous", "`b_dot >= a_dot`", "constraints: {c: ⟪x + x_dot >= 0⟫}"),
    "freewheel that bounces": (
        "not-a-contact", "between velocities and has no `restitution`",
        "constraints: {c: {relation: x_dot >= y_dot, ⟪restitution⟫: 0}}"),
    "freewheel with friction": (
        "not-a-contact", "no `friction`",
        "constraints: {c: {relation: x_dot <= y_dot, ⟪friction⟫: 1}}"),
    "limit of positions": (
        "not-a-velocity", "write its rate",
        "constraints: {c: {relation: x = 0, ⟪limit⟫: 1}}"),
    "limit of a contact": (
        "not-an-equality", "one-sided and has no `limit`",
        "constraints: {c: {relation: x >= 0, restitution: 0, ⟪limit⟫: 1}}"),
    "limit of a freewheel": (
        "not-an-equality", "one-sided and has no `limit`",
        "constraints: {c: {relation: x_dot >= 0, ⟪limit⟫: 1}}"),
    "limit beside friction": (
        "not-one-sided", "no `friction`",
        "constraints: {c: {relation: x_dot = 0, limit: 1, ⟪friction⟫: 1}}"),
    "limit below 0": (
        "out-of-range", "the limit of the constraint `c` is -2, which is negative",
        "parameters: {F: -2}\nconstraints: {c: {relation: x_dot, limit: ⟪F⟫}}"),
    "limit of an acceleration": (
        "output-only", "the limit of the constraint `c`",
        "constraints: {c: {relation: x_dot, limit: ⟪x_ddot⟫}}"),
    "when of a number": (
        "expression-syntax", "a comparison is expected here, found a number",
        "constraints: {c: {relation: x = y, when: ⟪t⟫}}"),
    "when of an equation": (
        "expression-syntax", "`=`",
        "constraints: {c: {relation: x = y, when: t ⟪=⟫ 1}}"),
    "when of the motion": (
        "not-of-time", "depends on `x`, `y_dot`; it must not depend on the motion",
        "constraints: {c: {relation: x = y, when: ⟪x < 1 or y_dot < 1⟫}}"),
    "when of a definition of positions": (
        "not-of-time", "depends on `x`",
        ("definitions: {d: 2*x + t}\n"
         "constraints: {c: {relation: x = y, when: ⟪d < 1⟫}}")),
    # initial
    "coordinate without start": ("missing-initial", "the coordinate `y`",
                                 "⟪initial⟫: {x: 0}"),
    "start of nothing": ("unknown-name", "no coordinate",
                         "initial: {x: 0, y: 0, ⟪q⟫: 1}"),
    "start misspelt": ("unknown-name", "did you mean `theta`",
                       ("coordinates: {theta: }\n"
                       "energy: {kinetic: theta_dot^2, potential: 0}\n"
                       "initial: {⟪tehta⟫: 1}")),
    "start of a parameter": ("not-a-start-value", "belongs in `parameters`",
                             "parameters: {k: 1}\ninitial: {x: 0, y: 0, ⟪k⟫: 1}"),
    "start of an acceleration": ("not-a-start-value", "an acceleration",
                                 "initial: {x: 0, y: 0, ⟪x_ddot⟫: 1}"),
    "start of an output definition": (
        "output-only", "accelerations",
        "definitions: {a: x_ddot}\ninitial: {x: 0, y: 0, ⟪a⟫: 1}"),
    "start of a rate of velocities": (
        "no-rate", "velocities",
        "definitions: {a: x_dot}\ninitial: {x: 0, y: 0, ⟪a_dot⟫: 1}"),
    "start of a later one": ("later-initial", "the start value of `y`",
                             "initial: {x: 2*⟪y⟫, y: 0}"),
    "start of itself": ("later-initial", "the start value of `x`",
                        "initial: {x: 2*⟪x⟫, y: 0}"),
    "start of what has none": ("not-a-start-value", "`y_dot` is a velocity",
                               "initial: {x: 0, y: 2*⟪y_dot⟫}"),
    "start of time": ("not-a-start-value", "the time", "initial: {x: 0, y: ⟪t⟫}"),
    "start of energy": ("not-a-start-value", "an energy",
                        "initial: {x: 0, y: ⟪energy⟫}"),
    "start of unknown": ("unknown-name", "`zzz`", "initial: {x: 0, y: 1 + ⟪zzz⟫}"),
    "start not finite": ("not-finite", "inf", "initial: {x: 0, y: ⟪1/x⟫}"),
    "start empty": ("not-an-expression", "nothing", "initial:\n  x: 0\n  y:⟪⟫"),
    "guess of a definition": (
        "not-a-guess", "`r`",
        "definitions: {r: x*y}\ninitial: {x: 0, y: 0, ⟪r⟫: {guess: 1}}"),
    "guess misspelt": ("unknown-key", "did you mean `guess`",
                       "initial: {x: 0, y: {⟪gess⟫: 1}}"),
    "empty guess": ("not-an-expression", "guess", "initial: {x: 0, y: ⟪{}⟫}"),
    # simulation
    "simulation key": ("unknown-key", "did you mean `duration`",
                       "simulation: {⟪durration⟫: 1}"),
    "duration and end": ("both-given", "both `duration` and `end`",
                         "simulation: {duration: 1, ⟪end⟫: 1}"),
    "duration 0": ("out-of-range", "must be positive", "simulation: {duration: ⟪0⟫}"),
    "duration not finite": ("not-finite", "`duration` is inf",
                            "simulation: {duration: ⟪1/0⟫}"),
    "duration of time": ("not-constant", "the time", "simulation: {duration: ⟪t⟫}"),
    "duration of unknown": ("unknown-name", "`T`", "simulation: {duration: 2*⟪T⟫}"),
    "end before start": ("out-of-range", "from 2 to 1",
                         "simulation: {start: 2, end: ⟪1⟫}"),
    "no length": ("out-of-range", "from 1e+20 to 1e+20",
                  "simulation: {start: 1e20, duration: ⟪1⟫}"),
    "output_step 0": ("out-of-range", "`output_step` is 0",
                      "simulation: {duration: 1, output_step: ⟪0⟫}"),
    "output_step too long": ("out-of-range", "longer than the run",
                             "simulation: {duration: 1, output_step: ⟪1.01⟫}"),
    "too many rows": ("too-many-rows", "makes 1000000001 rows",
                      "simulation: {duration: 1, output_step: ⟪1e-9⟫}"),
    "one row too many": ("too-many-rows", "makes 100000001 rows",
                         "simulation: {duration: 1e8, output_step: ⟪1⟫}"),
    "infinitely many rows": ("too-many-rows", "infinitely many",
                             "simulation: {duration: 1e300, output_step: ⟪1e-300⟫}"),
    "step below 0": ("out-of-range", "`step` is -1", "simulation: {step: ⟪-1⟫}"),
    "rtol below 0": ("out-of-range", "`rtol` is -1", "simulation: {rtol: ⟪-1⟫}"),
    "atol below 0": ("out-of-range", "`atol` is -1", "simulation: {atol: ⟪-1⟫}"),
    "both tolerances 0": ("out-of-range", "both 0",
                          "simulation: {rtol: 0, atol: ⟪0⟫}"),
    "rtol 0 alone": ("out-of-range", "without an `atol`", "simulation: {rtol: ⟪0⟫}"),
    "method empty": ("empty", "`method`", "simulation:\n  method:⟪⟫"),
    "until acceleration": ("output-only", "`until`",
                           "simulation: {until: ⟪x_ddot⟫ <= 0}"),
    "until time": ("no-coordinate", "`end` or `duration`",
                   "simulation: {until: ⟪t >= 3⟫}"),
    "until strict": ("expression-syntax", "not strict",
                     "simulation: {until: x ⟪<⟫ 0}"),
    # scene
    "scene key": ("unknown-key", "did you mean `points`", "scene: {⟪point⟫: {}}"),
    "point of one": ("wrong-count", "found 1", "scene: {points: {p: ⟪[x]⟫}}"),
    "point of four": ("wrong-count", "found 4",
                      "scene: {points: {p: ⟪[x, y, x, y]⟫}}"),
    "point no list": ("not-a-list", "`x`", "scene: {points: {p: ⟪x⟫}}"),
    "point split by comma": ("split-by-comma", '"atan2(y, x)"',
                             "scene: {points: {p: [⟪atan2(y, x)⟫, 0]}}"),
    "point unknown name": ("unknown-name", "`z`", "scene: {points: {p: [x, ⟪z⟫]}}"),
    "point name": ("bad-name", "a point", "scene: {points: {⟪p-1⟫: [x, y]}}"),
    "link unknown": ("unknown-name", "did you mean `bob`",
                     "scene: {points: {bob: [x, y], o: [0, 0]}, links: [[o, ⟪bub⟫]]}"),
    "link of a list": ("not-a-text", "a list",
                       "scene: {points: {o: [0, 0]}, links: [[o, ⟪[o]⟫]]}"),
    "link no list": ("not-a-list", "`o`",
                     "scene: {points: {o: [0, 0]}, links: [⟪o⟫]}"),
    "link of three": ("wrong-count", "found 3",
                      "scene: {points: {o: [0, 0]}, links: [⟪[o, o, o]⟫]}"),
    "links no list": ("not-a-list", "must be a list",
                      "scene: {points: {o: [0, 0]}, links: ⟪{o: o}⟫}"),
    # output
    "output key": ("unknown-key", "did you mean `columns`", "output: {⟪column⟫: []}"),
    "columns no list": ("not-a-list", "`columns`", "output: {columns: ⟪x⟫}"),
    "columns empty": ("not-a-list", "[] means none", "output:\n  columns:⟪⟫"),
    "column unknown": ("unknown-name", "did you mean `reach`",
                       "definitions: {reach: x}\noutput: {columns: [⟪raech⟫]}"),
    "column of a coordinate": ("not-a-definition", "in any case",
                               "output: {columns: [⟪x⟫]}"),
    "column no name": ("not-a-text", "a list",
                       "definitions: {a: x}\noutput: {columns: [⟪[a]⟫]}"),
    "column twice": ("duplicate-column", "`a` is given twice",
                     "definitions: {a: x}\noutput: {columns: [a, ⟪a⟫]}"),
    "reactions no list": ("not-a-list", "`reactions`", "output: {reactions: ⟪x⟫}"),
    "reaction unknown": ("unknown-name", "did you mean `reach`",
                         "definitions: {reach: x}\noutput: {reactions: [⟪raech⟫]}"),
    "reaction of a coordinate": ("not-a-definition", "Qc_",
                                 "output: {reactions: [⟪x⟫]}"),
    "reaction of velocities": ("no-reaction", "depends on velocities",
                               "definitions: {a: x_dot}\noutput: {reactions: [⟪a⟫]}"),
    "reaction of output": ("no-reaction", "accelerations",
                           "definitions: {a: x_ddot}\noutput: {reactions: [⟪a⟫]}"),
    "reaction twice": ("duplicate-reaction", "is given twice",
                       "definitions: {a: x}\noutput: {reactions: [a, ⟪a⟫]}"),
    "reaction not asked for": ("unknown-name", "output: {reactions: [a]}",
                               "definitions: {a: x, b: ⟪reaction.a⟫}"),
    "reaction in a force": (
        "output-only", "which the motion gives",
        "definitions: {a: x}\nforces: {x: ⟪reaction.a⟫}\noutput: {reactions: [a]}"),
    "plot without y": ("missing-key", "no `y`", "output: {plots: [⟪{x: t}⟫]}"),
    "plot key": ("unknown-key", "did you mean `title`",
                 "output: {plots: [{x: t, y: x, ⟪titel⟫: a}]}"),
    "plot unknown": ("unknown-name", "`z`", "output: {plots: [{x: t, y: ⟪z⟫}]}"),
    "plot log": ("unknown-axis", "`x`, `y`, `y2`",
                 "output: {plots: [{x: t, y: x, log: ⟪z⟫}]}"),
    "plot log of a list": ("unknown-axis", "found a mapping",
                           "output: {plots: [{x: t, y: x, log: [y, ⟪{a: 1}⟫]}]}"),
    "plot log of no axis": ("unknown-axis", "the plot has none",
                            "output: {plots: [{x: t, y: x, log: [y, ⟪y2⟫]}]}"),
    "plot of nothing": ("wrong-count", "1 to 6 curves, found 0",
                        "output: {plots: [{x: t, y: ⟪[]⟫}]}"),
    "plot of too much": ("wrong-count", "found 7",
                         "output: {plots: [{x: t, y: ⟪[x, x, x, x, x, x, x]⟫}]}"),
    "plot of a list with faults": ("unknown-name", "`z`",
                                   "output: {plots: [{x: t, y: [x, ⟪z⟫]}]}"),
    "plot against a list": ("not-an-expression", "",
                            "output: {plots: [{x: ⟪[t, x]⟫, y: x}]}"),
    "plot no mapping": ("not-a-mapping", "`x`", "output: {plots: [⟪x⟫]}"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_fault(case):
    code, part, marked = case
    start = marked.index("⟪")
    length = marked.index("⟫") - start - 1
    before = marked[:start]
    line = before.count("\n") + 1
    column = start - (before.rfind("\n") + 1) + 1

    found = problems(marked.replace("⟪", "").replace("⟫", ""))

    assert [p.code for p in found] == [code], found
    (problem,) = found
    assert part in f"{problem.text} | {problem.hint}"
    place = problem.place
    assert (place.file, place.line, place.column) == ("model.yaml", line, column)
    assert place.length == max(1, length)
    lines = marked.replace("⟪", "").replace("⟫", "").split("\n")
    assert place.source == lines[line - 1]


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
            (1, 9, "format-version"),
            (2, 19, "later-parameter"),
            (2, 25, "expression-not-finite"),
            (4, 8, "yaml-syntax"),
            (5, 10, "unknown-name"),
            (7, 39, "output-only"),
            (8, 10, "unknown-name"),
            (9, 15, "missing-key"),
            (10, 24, "out-of-range"),
            (10, 34, "out-of-range"),
        ]

    def test_two_names_of_one_expression(self):
        found = problems("definitions: {a: zz1 + zz2 + zz1}")
        assert [(p.place.column, p.code) for p in found] == [
            (18, "unknown-name"),
            (24, "unknown-name"),
        ]

    def test_they_are_bounded(self):
        text = "definitions:\n" + "".join(f"  a{i}: zz\n" for i in range(1500))
        found = problems(text)
        assert len(found) == 1001
        assert found[-1].text == "500 more faults are not shown"


class TestNoCascades:
    """What rests on a fault is passed over: one fault is told once."""

    @pytest.mark.parametrize(
        ("text", "code"),
        [
            (("definitions: {a: 2*, b: a, c: b_dot}\nforces: {a: 1, c: b}\n"
             "constraints: {k: a = x}\noutput: {columns: [a, b, c]}"),
             "expression-syntax"),
            ("definitions: {a: b, b: a, c: a_dot}\nforces: {a: c}", "cycle"),
            ("definitions: {a: zz, c: a_dot}\ninitial: {x: 0, y: 0, a: 1}",
             "unknown-name"),
            (("parameters: {k: 1e999, m: k, n: m}\ninitial: {x: n, y: x}\n"
             "simulation: {duration: n}"), "expression-not-finite"),
            ("parameters: {k-1: 1}\nforces: {x: 1}", "bad-name"),
            ("parameters: {x²: 1, b: 2*x²}\nforces: {x: x²}", "bad-name"),
            ("parameters: {z_dot: 1}\nforces: {x: z_dot}", "reserved-name"),
            ("coordinates: [x, y]", "not-a-mapping"),
            ("coordinates: {a: b: c}", "yaml-syntax"),
            ("parameters: [k]\nforces: {x: k}", "not-a-mapping"),
            ("parameters: {k:1}\nforces: {x: k}", "missing-space"),
            ("paramters: {k: 1}\nforces: {x: k}", "unknown-key"),
            ("parameters: {k: 1}\nparameters: {m: 1}\nforces: {x: k*m}",
             "duplicate-key"),
            ("energy: {kinetic: x_dot: 2, potential: 0}\ndefinitions: {a: kinetic}",
             "yaml-syntax"),
            ("energy: {kinetic: zz, potential: 0}\ndefinitions: {a: kinetic}",
             "unknown-name"),
            ("energy: {kinetic: x_dot^2}\ndefinitions: {a: potential}", "missing-key"),
            ("constraints: {c-1: x = 0, d: x = y}", "bad-name"),
            ("initial: {x: 2*, y: x}", "expression-syntax"),
            ("initial: {x: a: 1, y: x}", "yaml-syntax"),
            ("simulation: {duration: a: b}", "yaml-syntax"),
            ("scene: {points: {p: [x, zz]}, links: [[p, p]]}", "unknown-name"),
            ("scene: {points: a: b, links: [[p, p]]}", "yaml-syntax"),
            ("constraints: {c: {relation: 'if(x, 1, 2) >= 0', restitution: 1}}",
             "expression-syntax"),
            ("constraints: {c: x_dot >= zz_dot}", "unknown-name"),
            ("constraints: {c: {relation: x_dot = zz, limit: 1}}", "unknown-name"),
            ("constraints: {c: {relation: x_dot, limit: zz, when: t < 1}}",
             "unknown-name"),
        ],
    )  # fmt: skip
    def test_one_fault(self, text, code):
        assert [p.code for p in problems(text)] == [code], problems(text)
