"""E1xx: files, YAML, and the sections of a model."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E101", "unreadable",
        "A model is a regular file that may be read.",
        "look at the path, and at who may read it",
        commands=("lagsim check nowhere.yaml",),
    ),
    Row(
        "E102", "not-utf8",
        "Text is UTF-8.",
        "save the file as UTF-8",
        commands=(r"printf 'name: p\351ndulo\n' > old.yaml", "lagsim check old.yaml"),
    ),
    Row(
        "E103", "empty-file",
        "A model file has sections.",
        "`lagsim new NAME` writes one to begin from",
        commands=("printf '# later\\n' > empty.yaml", "lagsim check empty.yaml"),
    ),
    Row(
        "E104", "several-documents",
        "A file holds one model.",
        "put what follows `---` into a file of its own",
        "simulation: {duration: 1}\n---\nname: another\n",
    ),
    Row(
        "E105", "yaml-syntax",
        "Brackets and quotes are closed, and the entries of a section begin in one "
        "column.",
        "an editor that knows YAML shows where it goes wrong; `lagsim schema` gives it "
        "the keys",
        "initial: {theta: 1\n",
    ),
    Row(
        "E106", "yaml-tab",
        "Lines are indented with spaces.",
        "replace tabs by spaces",
        "definitions:\n\tx: l*sin(theta)\n  y: -l*cos(theta)\n",
    ),
    Row(
        "E107", "yaml-character",
        "A file holds letters that can be seen.",
        "delete the letter and type it anew",
        "simulation: {duration: 1\x07}\n",
    ),
    Row(
        "E108", "missing-space",
        "A space follows the colon after a key.",
        "write `key: value`",
        "initial: {theta:1}\n",
    ),
    Row(
        "E109", "split-by-comma",
        "Within `{}` and `[]` a comma ends a value.",
        "quote the value",
        "definitions: {x: atan2(theta, 1), y: 0}\n",
    ),
    Row(
        "E110", "too-deep",
        "Brackets and sections nest a few levels deep.",
        "no section of a model needs this",
        f"initial: {{theta: {'[' * 110}{']' * 110}}}\n",
    ),
    Row(
        "E111", "anchor",
        "Each value is written where it stands, without anchors.",
        "define a parameter, and use its name",
        "parameters: {m: &one 1, g: 9.81, l: 1}\n",
    ),
    Row(
        "E112", "alias",
        "Each value is written where it stands; a value that begins with `*` is an "
        "alias of YAML.",
        "quote the value if it is an expression",
        "parameters: {m: 1, g: 9.81, l: *m}\n",
    ),
    Row(
        "E113", "tag",
        "Values have no tags: what is expected in a place follows from the place.",
        "leave the tag out, or quote the value",
        "parameters: {m: !!float 1, g: 9.81, l: 1}\n",
    ),
    Row(
        "E114", "merge-key",
        "Sections are not merged with `<<`.",
        "write the entries out",
        "initial: {<<: {theta: 1}}\n",
    ),
    Row(
        "E115", "complex-key",
        "A key is a plain text.",
        "write `name: value`",
        "initial: {[theta]: 1}\n",
    ),
    Row(
        "E116", "duplicate-key",
        "A key stands once in its section.",
        "delete one of the two",
        "initial: {theta: 1, theta: 2}\n",
    ),
    Row(
        "E117", "unknown-key",
        "A section has the keys that are known.",
        "`lagsim schema` lists all keys, and lets an editor complete them",
        "simulation: {duratoin: 1}\n",
    ),
    Row(
        "E118", "misplaced-key",
        "Each key stands in its section.",
        "move it there",
        "energy: {kinetic: m*theta_dot^2/2, potential: 0, output: {}}\n",
    ),
    Row(
        "E119", "missing-key",
        "A model has coordinates, an energy and a start, a run has a duration, and "
        "some keys need others.",
        "add the key; `lagsim new NAME` writes a model with all that is needed",
        "energy: {potential: m*g*y}\n",
    ),
    Row(
        "E120", "both-given",
        "Of two ways to say the same, one is taken.",
        "give one of them",
        "simulation: {duration: 1, end: 2}\n",
    ),
    Row(
        "E121", "not-a-mapping",
        "A section is a mapping, `key: value`.",
        "write each entry as `key: value`, indented below the section or within `{}`",
        "initial: [1, 0]\n",
    ),
    Row(
        "E122", "not-a-list",
        "Several values are a list.",
        "a list is written [a, b]",
        "output: {columns: x}\n",
    ),
    Row(
        "E123", "not-a-text",
        "A name, a title or a description is a text.",
        "write one text, in quotes where it has special letters",
        "name: [pendulum]\n",
    ),
    Row(
        "E124", "not-a-truth",
        "The value is `true` or `false`.",
        "write `true` or `false`, without quotes",
        "output: {gauss: maybe}\n",
    ),
    Row(
        "E125", "wrong-count",
        "A list has as many entries as its key asks for.",
        "count what the message asks for",
        "scene: {points: {bob: [x]}}\n",
    ),
    Row(
        "E126", "empty",
        "A key that is written has a value.",
        "give a value, or leave the key out",
        "simulation: {duration: 1, method: }\n",
    ),
    Row(
        "E127", "format-version",
        "The format of model files is version 1.",
        "leave `lagsim` out, or install the version of lagsim that the file asks for",
        "lagsim: 7\n",
    ),
    Row(
        "E128", "bad-model-name",
        "A model's name can be the name of a folder.",
        "leave out separators and letters that nobody sees",
        "name: one/two\n",
    ),
    Row(
        "E129", "out-of-range",
        "A number lies in the range that has a meaning.",
        "choose a number within the range that the message names",
        "simulation: {duration: -1}\n",
    ),
    Row(
        "E130", "unknown-axis",
        "`log` names axes that a plot has: x, y, y2.",
        "name one of x, y, y2",
        "output: {plots: [{x: x, y: y, log: z}]}\n",
    ),
    Row(
        "E131", "duplicate-column",
        "A column is asked for once.",
        "delete one of the two",
        "output: {columns: [x, x]}\n",
    ),
    Row(
        "E132", "duplicate-reaction",
        "A reaction is asked for once.",
        "delete one of the two",
        "output: {reactions: [x, x]}\n",
    ),
    Row(
        "E133", "more-faults",
        "The first thousand faults of a file are shown.",
        "mend those above, and look again",
        commands=(
            "{ cat pendulum.yaml; seq -f 'key%g: 1' 1200; } > long.yaml",
            "lagsim check long.yaml 2>&1 | tail -n 4",
        ),
    ),
    Row(
        "E134", "too-many-values",
        "A file has at most as many values and collections as fit a scene that can be "
        "run.",
        "tables of numbers belong into a program that calls lagsim: docs/python.md",
        commands=(
            "{ echo x-many:; yes '  - 1' | head -n 1000001; } > many.yaml",
            "lagsim check many.yaml",
        ),
    ),
)  # fmt: skip
