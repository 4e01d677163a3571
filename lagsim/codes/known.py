"""Codes of errors and warnings: an unknown one cannot be imported.

Derived from the rows of this package: see docs/adding.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

ADAPTIVE_METHOD: Final = "adaptive-method"
ALIAS: Final = "alias"
ANCHOR: Final = "anchor"
ANOTHER_RUN: Final = "another-run"
ANOTHER_SWEEP: Final = "another-sweep"
BAD_DATA: Final = "bad-data"
BAD_GOLDEN: Final = "bad-golden"
BAD_MODEL_NAME: Final = "bad-model-name"
BAD_NAME: Final = "bad-name"
BAD_POINTS: Final = "bad-points"
BAD_TABLE: Final = "bad-table"
BOTH_GIVEN: Final = "both-given"
BUG: Final = "bug"
CHANGE_UNSEEN: Final = "change-unseen"
CHANGES_NOTHING: Final = "changes-nothing"
COLUMN_CLASH: Final = "column-clash"
COLUMN_NOT_FINITE: Final = "column-not-finite"
COMPLEX_KEY: Final = "complex-key"
CONSTRAINT_JUMPS: Final = "constraint-jumps"
CONSTRAINT_NOT_HELD: Final = "constraint-not-held"
COORDINATE_SINGULARITY: Final = "coordinate-singularity"
CYCLE: Final = "cycle"
DEGREES: Final = "degrees"
DIFFERS: Final = "differs"
DOUBLE_ROOT: Final = "double-root"
DUPLICATE_COLUMN: Final = "duplicate-column"
DUPLICATE_KEY: Final = "duplicate-key"
DUPLICATE_MEMBER: Final = "duplicate-member"
DUPLICATE_REACTION: Final = "duplicate-reaction"
EMPTY: Final = "empty"
EMPTY_FILE: Final = "empty-file"
END_IN_DOUBT: Final = "end-in-doubt"
ENERGY_DRIFTS: Final = "energy-drifts"
ENERGY_GAINED: Final = "energy-gained"
ENERGY_LOST: Final = "energy-lost"
ERROR_UNKNOWN: Final = "error-unknown"
EVENTS_CHATTER: Final = "events-chatter"
EVENTS_UNLISTED: Final = "events-unlisted"
EXISTS: Final = "exists"
EXPRESSION_ARITY: Final = "expression-arity"
EXPRESSION_COMPONENT: Final = "expression-component"
EXPRESSION_FRAME: Final = "expression-frame"
EXPRESSION_MEMBER: Final = "expression-member"
EXPRESSION_NAME: Final = "expression-name"
EXPRESSION_NOT_FINITE: Final = "expression-not-finite"
EXPRESSION_NUMBER: Final = "expression-number"
EXPRESSION_PARENTHESIS: Final = "expression-parenthesis"
EXPRESSION_RANGE: Final = "expression-range"
EXPRESSION_SIZE: Final = "expression-size"
EXPRESSION_SUBSCRIPT: Final = "expression-subscript"
EXPRESSION_SYNTAX: Final = "expression-syntax"
EXPRESSION_TOO_LONG: Final = "expression-too-long"
EXPRESSION_TOO_MANY: Final = "expression-too-many"
EXPRESSION_UNKNOWN_FUNCTION: Final = "expression-unknown-function"
FAILED: Final = "failed"
FAST_MODE_DAMPED: Final = "fast-mode-damped"
FEW_ROWS: Final = "few-rows"
FORMAT_VERSION: Final = "format-version"
FORMULATION_REFUSED: Final = "formulation-refused"
FROZEN_TIME: Final = "frozen-time"
GAIN_UNUSED: Final = "gain-unused"
HORIZON: Final = "horizon"
IMPACT_ENERGY: Final = "impact-energy"
IMPACT_ORDER: Final = "impact-order"
INADMISSIBLE: Final = "inadmissible"
INCOMPLETE: Final = "incomplete"
LATER_INITIAL: Final = "later-initial"
LATER_PARAMETER: Final = "later-parameter"
LAW_OUT_OF_RANGE: Final = "law-out-of-range"
MERGE_KEY: Final = "merge-key"
METHOD_REFUSED: Final = "method-refused"
MISPLACED_KEY: Final = "misplaced-key"
MISSING_INITIAL: Final = "missing-initial"
MISSING_KEY: Final = "missing-key"
MISSING_PACKAGE: Final = "missing-package"
MISSING_SPACE: Final = "missing-space"
MORE_FAULTS: Final = "more-faults"
MULTIPLE_ROOT: Final = "multiple-root"
MULTIPLIERS_NOT_UNIQUE: Final = "multipliers-not-unique"
NAME_CLASH: Final = "name-clash"
NEARLY_DEPENDENT: Final = "nearly-dependent"
NEGATIVE_INERTIA: Final = "negative-inertia"
NEWTON_FAILED: Final = "newton-failed"
NO_ANSWER: Final = "no-answer"
NO_COLUMN: Final = "no-column"
NO_COORDINATE: Final = "no-coordinate"
NO_EFFECT: Final = "no-effect"
NO_GOLDEN: Final = "no-golden"
NO_INERTIA: Final = "no-inertia"
NO_MOTION: Final = "no-motion"
NO_RATE: Final = "no-rate"
NO_REACTION: Final = "no-reaction"
NO_REFERENCE: Final = "no-reference"
NO_RESPONSE: Final = "no-response"
NO_REST: Final = "no-rest"
NO_RESULTS: Final = "no-results"
NO_ROOM: Final = "no-room"
NO_SPECTRUM: Final = "no-spectrum"
NO_STABILITY: Final = "no-stability"
NOT_A_BENCH: Final = "not-a-bench"
NOT_A_CONTACT: Final = "not-a-contact"
NOT_A_DEFINITION: Final = "not-a-definition"
NOT_A_DIRECTION: Final = "not-a-direction"
NOT_A_GUESS: Final = "not-a-guess"
NOT_A_LIST: Final = "not-a-list"
NOT_A_MAPPING: Final = "not-a-mapping"
NOT_A_MODE: Final = "not-a-mode"
NOT_A_START_VALUE: Final = "not-a-start-value"
NOT_A_TEXT: Final = "not-a-text"
NOT_A_TRUTH: Final = "not-a-truth"
NOT_A_VELOCITY: Final = "not-a-velocity"
NOT_AFFINE: Final = "not-affine"
NOT_AN_EQUALITY: Final = "not-an-equality"
NOT_AN_EXPRESSION: Final = "not-an-expression"
NOT_CONSTANT: Final = "not-constant"
NOT_DIFFERENTIABLE: Final = "not-differentiable"
NOT_DRAWN: Final = "not-drawn"
NOT_FINITE: Final = "not-finite"
NOT_HOMOGENEOUS: Final = "not-homogeneous"
NOT_IDENTIFIABLE: Final = "not-identifiable"
NOT_IN_A_FILE: Final = "not-in-a-file"
NOT_JSON: Final = "not-json"
NOT_LINEAR: Final = "not-linear"
NOT_LOCKED: Final = "not-locked"
NOT_OF_TIME: Final = "not-of-time"
NOT_ONE_SIDED: Final = "not-one-sided"
NOT_UTF8: Final = "not-utf8"
NOTHING_TO_DRAW: Final = "nothing-to-draw"
ONE_NAME: Final = "one-name"
OPTION_UNUSED: Final = "option-unused"
OTHER_ROOTS: Final = "other-roots"
OUT_OF_RANGE: Final = "out-of-range"
OUT_OF_SCALE: Final = "out-of-scale"
OUTPUT_FILE: Final = "output-file"
OUTPUT_FOLDER: Final = "output-folder"
OUTPUT_ONLY: Final = "output-only"
PAINLEVE: Final = "painleve"
PARADOX: Final = "paradox"
PROJECTION_FAILED: Final = "projection-failed"
RANK: Final = "rank"
REACTION_ZERO: Final = "reaction-zero"
REDUNDANT: Final = "redundant"
RESERVED_NAME: Final = "reserved-name"
RESIDUAL_PATTERN: Final = "residual-pattern"
RESULT_REPLACED: Final = "result-replaced"
RETIRED: Final = "retired"
ROUGH_START: Final = "rough-start"
SEVERAL_DOCUMENTS: Final = "several-documents"
SHAPE_OF_SPACE: Final = "shape-of-space"
SHARED_CONTACT: Final = "shared-contact"
SHARED_FRICTION: Final = "shared-friction"
SINGULAR_MASS: Final = "singular-mass"
START_CHANGED: Final = "start-changed"
STARVED: Final = "starved"
STATE_JUMPS: Final = "state-jumps"
STATE_MISPLACED: Final = "state-misplaced"
STEP_AT_STABILITY_BOUND: Final = "step-at-stability-bound"
STEP_TOO_SMALL: Final = "step-too-small"
STEP_UNUSED: Final = "step-unused"
SWITCH_AT_REST: Final = "switch-at-rest"
SWITCHES_ACCUMULATE: Final = "switches-accumulate"
TABLE_ENDS: Final = "table-ends"
TABLE_FILE: Final = "table-file"
TABLE_POINTS: Final = "table-points"
TAG: Final = "tag"
TOLERANCE_UNUSED: Final = "tolerance-unused"
TOO_DEEP: Final = "too-deep"
TOO_LARGE: Final = "too-large"
TOO_LONG: Final = "too-long"
TOO_MANY_ROWS: Final = "too-many-rows"
TOO_MANY_STEPS: Final = "too-many-steps"
TOO_MANY_VALUES: Final = "too-many-values"
UNDETERMINED_GUESS: Final = "undetermined-guess"
UNDETERMINED_SLIDERS: Final = "undetermined-sliders"
UNIT_MISMATCH: Final = "unit-mismatch"
UNKNOWN_AXIS: Final = "unknown-axis"
UNKNOWN_BEGIN: Final = "unknown-begin"
UNKNOWN_CODE: Final = "unknown-code"
UNKNOWN_CPU: Final = "unknown-cpu"
UNKNOWN_FORMULATION: Final = "unknown-formulation"
UNKNOWN_INTERPOLATION: Final = "unknown-interpolation"
UNKNOWN_KEY: Final = "unknown-key"
UNKNOWN_METHOD: Final = "unknown-method"
UNKNOWN_NAME: Final = "unknown-name"
UNKNOWN_PARAMETER: Final = "unknown-parameter"
UNKNOWN_RESTITUTION_LAW: Final = "unknown-restitution-law"
UNKNOWN_TEMPLATE: Final = "unknown-template"
UNREADABLE: Final = "unreadable"
UNRESOLVED_SWITCH: Final = "unresolved-switch"
UNSETTLED_IMPULSES: Final = "unsettled-impulses"
UNUSED_PARAMETER: Final = "unused-parameter"
UNUSED_TABLE: Final = "unused-table"
UNWRITABLE: Final = "unwritable"
USAGE: Final = "usage"
VALUES_NOT_FINITE: Final = "values-not-finite"
VANISHING_GRADIENT: Final = "vanishing-gradient"
VELOCITY_NOT_ALLOWED: Final = "velocity-not-allowed"
WRONG_COUNT: Final = "wrong-count"
YAML_CHARACTER: Final = "yaml-character"
YAML_SYNTAX: Final = "yaml-syntax"
YAML_TAB: Final = "yaml-tab"

if TYPE_CHECKING:
    from typing import Literal, TypeAlias

    ErrorCode: TypeAlias = Literal[
        "adaptive-method",
        "alias",
        "anchor",
        "another-run",
        "another-sweep",
        "bad-data",
        "bad-golden",
        "bad-model-name",
        "bad-name",
        "bad-points",
        "bad-table",
        "both-given",
        "bug",
        "changes-nothing",
        "column-clash",
        "complex-key",
        "constraint-jumps",
        "cycle",
        "differs",
        "duplicate-column",
        "duplicate-key",
        "duplicate-member",
        "duplicate-reaction",
        "empty",
        "empty-file",
        "events-chatter",
        "exists",
        "expression-arity",
        "expression-component",
        "expression-frame",
        "expression-member",
        "expression-name",
        "expression-not-finite",
        "expression-number",
        "expression-parenthesis",
        "expression-range",
        "expression-size",
        "expression-subscript",
        "expression-syntax",
        "expression-too-long",
        "expression-too-many",
        "expression-unknown-function",
        "failed",
        "format-version",
        "formulation-refused",
        "inadmissible",
        "incomplete",
        "later-initial",
        "later-parameter",
        "law-out-of-range",
        "merge-key",
        "method-refused",
        "misplaced-key",
        "missing-initial",
        "missing-key",
        "missing-package",
        "missing-space",
        "more-faults",
        "multiple-root",
        "name-clash",
        "negative-inertia",
        "newton-failed",
        "no-answer",
        "no-column",
        "no-coordinate",
        "no-golden",
        "no-inertia",
        "no-motion",
        "no-rate",
        "no-reaction",
        "no-reference",
        "no-rest",
        "no-results",
        "no-room",
        "no-spectrum",
        "no-stability",
        "not-a-bench",
        "not-a-contact",
        "not-a-definition",
        "not-a-direction",
        "not-a-guess",
        "not-a-list",
        "not-a-mapping",
        "not-a-mode",
        "not-a-start-value",
        "not-a-text",
        "not-a-truth",
        "not-a-velocity",
        "not-affine",
        "not-an-equality",
        "not-an-expression",
        "not-constant",
        "not-finite",
        "not-homogeneous",
        "not-in-a-file",
        "not-json",
        "not-of-time",
        "not-one-sided",
        "not-utf8",
        "nothing-to-draw",
        "one-name",
        "out-of-range",
        "out-of-scale",
        "output-file",
        "output-folder",
        "output-only",
        "paradox",
        "projection-failed",
        "reserved-name",
        "several-documents",
        "shape-of-space",
        "singular-mass",
        "starved",
        "state-jumps",
        "state-misplaced",
        "step-too-small",
        "switch-at-rest",
        "switches-accumulate",
        "table-ends",
        "table-file",
        "table-points",
        "tag",
        "too-deep",
        "too-large",
        "too-long",
        "too-many-rows",
        "too-many-steps",
        "too-many-values",
        "undetermined-sliders",
        "unknown-axis",
        "unknown-begin",
        "unknown-code",
        "unknown-cpu",
        "unknown-formulation",
        "unknown-interpolation",
        "unknown-key",
        "unknown-method",
        "unknown-name",
        "unknown-parameter",
        "unknown-restitution-law",
        "unknown-template",
        "unreadable",
        "unused-table",
        "unwritable",
        "usage",
        "values-not-finite",
        "velocity-not-allowed",
        "wrong-count",
        "yaml-character",
        "yaml-syntax",
        "yaml-tab",
    ]
    WarningCode: TypeAlias = Literal[
        "change-unseen",
        "column-not-finite",
        "constraint-not-held",
        "coordinate-singularity",
        "degrees",
        "double-root",
        "end-in-doubt",
        "energy-drifts",
        "energy-gained",
        "energy-lost",
        "error-unknown",
        "events-unlisted",
        "fast-mode-damped",
        "few-rows",
        "frozen-time",
        "gain-unused",
        "horizon",
        "impact-energy",
        "impact-order",
        "multiple-root",
        "multipliers-not-unique",
        "nearly-dependent",
        "no-effect",
        "no-response",
        "not-differentiable",
        "not-drawn",
        "not-identifiable",
        "not-linear",
        "not-locked",
        "nothing-to-draw",
        "option-unused",
        "other-roots",
        "painleve",
        "rank",
        "reaction-zero",
        "redundant",
        "residual-pattern",
        "result-replaced",
        "retired",
        "rough-start",
        "shared-contact",
        "shared-friction",
        "start-changed",
        "step-at-stability-bound",
        "step-unused",
        "tolerance-unused",
        "undetermined-guess",
        "unit-mismatch",
        "unresolved-switch",
        "unsettled-impulses",
        "unused-parameter",
        "vanishing-gradient",
    ]
