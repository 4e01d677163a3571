"""E1xx: files, YAML, and the sections of a model."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E101", "unreadable",
        "A model is a regular file that may be read.",
        "look at the path, and at who may read it",
        commands=("lagsim check nowhere.yaml",),
        found="The model file cannot be read.",
    ),
    Row(
        "E102", "not-utf8",
        "Text is UTF-8.",
        "save the file as UTF-8",
        commands=(r"printf 'name: p\351ndulo\n' > old.yaml", "lagsim check old.yaml"),
        found="The file is not UTF-8.",
    ),
    Row(
        "E103", "empty-file",
        "A model file has sections.",
        "`lagsim new NAME` writes one to begin from",
        commands=("printf '# later\\n' > empty.yaml", "lagsim check empty.yaml"),
        found="The file has no sections.",
    ),
    Row(
        "E104", "several-documents",
        "A file holds one model.",
        "put what follows `---` into a file of its own",
        "simulation: {duration: 1}\n---\nname: another\n",
        found="The file holds more than one YAML document.",
    ),
    Row(
        "E105", "yaml-syntax",
        "Brackets and quotes are closed, and the entries of a section begin in one "
        "column.",
        "an editor that knows YAML shows where it goes wrong; `lagsim schema` gives it "
        "the keys",
        "initial: {theta: 1\n",
        found="The file is not valid YAML.",
    ),
    Row(
        "E106", "yaml-tab",
        "Lines are indented with spaces.",
        "replace tabs by spaces",
        "definitions:\n\tx: l*sin(theta)\n  y: -l*cos(theta)\n",
        found="A line is indented with a tab.",
    ),
    Row(
        "E107", "yaml-character",
        "Every character of a file can be seen.",
        "delete the character and type it again",
        "simulation: {duration: 1\x07}\n",
        found="The file has a character that cannot be seen, or that YAML does not "
        "allow.",
    ),
    Row(
        "E108", "missing-space",
        "A space follows the colon after a key.",
        "write `key: value`",
        "initial: {theta:1}\n",
        found="The space after a colon is missing.",
    ),
    Row(
        "E109", "split-by-comma",
        "Within `{}` and `[]` a comma ends a value.",
        "quote the value",
        "definitions: {x: atan2(theta, 1), y: 0}\n",
        found="A comma has ended a value too early.",
    ),
    Row(
        "E110", "too-deep",
        "Brackets and sections nest a few levels deep.",
        "no section of a model needs this",
        f"initial: {{theta: {'[' * 110}{']' * 110}}}\n",
        found="Brackets or sections are nested too deep.",
    ),
    Row(
        "E111", "anchor",
        "Each value is written where it is used, without anchors.",
        "define a parameter, and use its name",
        "parameters: {m: &one 1, g: 9.81, l: 1}\n",
        found="The file has an anchor of YAML, such as `&one`.",
    ),
    Row(
        "E112", "alias",
        "Each value is written where it is used; a value that begins with `*` is an "
        "alias of YAML.",
        "quote the value if it is an expression",
        "parameters: {m: 1, g: 9.81, l: *m}\n",
        found="The file has an alias of YAML, such as `*one`.",
    ),
    Row(
        "E113", "tag",
        "Values have no tags: their keys determine their kind.",
        "leave the tag out, or quote the value",
        "parameters: {m: !!float 1, g: 9.81, l: 1}\n",
        found="A value has a tag of YAML, such as `!!float`.",
    ),
    Row(
        "E114", "merge-key",
        "Sections are not merged with `<<`.",
        "write the entries out",
        "initial: {<<: {theta: 1}}\n",
        found="The file has a merge key of YAML, `<<`.",
    ),
    Row(
        "E115", "complex-key",
        "A key is plain text.",
        "write `name: value`",
        "initial: {[theta]: 1}\n",
        found="A key is not a plain text.",
    ),
    Row(
        "E116", "duplicate-key",
        "A key is given once in its section.",
        "delete one of the two",
        "initial: {theta: 1, theta: 2}\n",
        found="A key appears twice in one section.",
    ),
    Row(
        "E117", "unknown-key",
        "Every key of a section is one of its known keys.",
        "`lagsim schema` lists all keys, and lets an editor complete them",
        "simulation: {duratoin: 1}\n",
        found="A section has an unknown key.",
    ),
    Row(
        "E118", "misplaced-key",
        "Each key is in its section.",
        "move it there",
        "energy: {kinetic: m*theta_dot^2/2, potential: 0, output: {}}\n",
        found="A key is in the wrong section.",
    ),
    Row(
        "E119", "missing-key",
        "A model has coordinates, an energy and a start, a run has a duration, and "
        "some keys need others.",
        "add the key; `lagsim new NAME` writes a model with all that is needed",
        "energy: {potential: m*g*y}\n",
        found="A key is missing that the model, the run or another key needs.",
    ),
    Row(
        "E120", "both-given",
        "Of keys that exclude each other, one is given.",
        "give one of them",
        "simulation: {duration: 1, end: 2}\n",
        found="Two keys are given that exclude each other.",
    ),
    Row(
        "E121", "not-a-mapping",
        "A section is a mapping, `key: value`.",
        "write each entry as `key: value`, indented below the section or within `{}`",
        "initial: [1, 0]\n",
        found="A section is not a mapping.",
    ),
    Row(
        "E122", "not-a-list",
        "Several values are a list.",
        "a list is written [a, b]",
        "output: {columns: x}\n",
        found="A value is not a list.",
    ),
    Row(
        "E123", "not-a-text",
        "A name, a title or a description is a text.",
        "write one text, in quotes where it has special letters",
        "name: [pendulum]\n",
        found="A value is not a text.",
    ),
    Row(
        "E124", "not-a-truth",
        "The value is `true` or `false`.",
        "write `true` or `false`, without quotes",
        "output: {gauss: maybe}\n",
        found="A value is neither `true` nor `false`.",
    ),
    Row(
        "E125", "wrong-count",
        "A list has as many entries as its key asks for.",
        "count what the message asks for",
        "scene: {points: {bob: [x]}}\n",
        found="A list has too many entries, or too few.",
    ),
    Row(
        "E126", "empty",
        "A key that is written has a value.",
        "give a value, or leave the key out",
        "simulation: {duration: 1, method: }\n",
        found="A key has no value.",
    ),
    Row(
        "E127", "format-version",
        "The format of model files is version 1.",
        "leave `lagsim` out, or install the version of lagsim that the file asks for",
        "lagsim: 7\n",
        found="The file asks for a version of the format that this lagsim does not "
        "read.",
    ),
    Row(
        "E128", "bad-model-name",
        "A model's name can be the name of a folder.",
        "leave out separators and invisible letters",
        "name: one/two\n",
        found="The name of the model cannot be used for a folder.",
    ),
    Row(
        "E129", "out-of-range",
        "A number is within its range.",
        "choose a number within the range that the message names",
        "simulation: {duration: -1}\n",
        found="A number is outside its range.",
    ),
    Row(
        "E130", "unknown-axis",
        "`log` names axes that a plot has: x, y, y2.",
        "name one of x, y, y2",
        "output: {plots: [{x: x, y: y, log: z}]}\n",
        found="`log` names an axis that the plot does not have.",
    ),
    Row(
        "E131", "duplicate-column",
        "A column is asked for once.",
        "delete one of the two",
        "output: {columns: [x, x]}\n",
        found="A column is listed twice.",
    ),
    Row(
        "E132", "duplicate-reaction",
        "A reaction is asked for once.",
        "delete one of the two",
        "output: {reactions: [x, x]}\n",
        found="A reaction is listed twice.",
    ),
    Row(
        "E133", "more-faults",
        "The first thousand faults of a file are shown.",
        "mend those above, and look again",
        commands=(
            "{ cat pendulum.yaml; seq -f 'key%g: 1' 1200; } > long.yaml",
            "lagsim check long.yaml 2>&1 | tail -n 4",
        ),
        found="The file has more faults than are shown.",
    ),
    Row(
        "E134", "too-many-values",
        "A file has at most as many values and collections as fit a model that can be "
        "run.",
        "tables of numbers belong into a program that calls lagsim: docs/python.md",
        commands=(
            "{ echo x-many:; yes '  - 1' | head -n 1000001; } > many.yaml",
            "lagsim check many.yaml",
        ),
        found="The file has too many values.",
    ),
)  # fmt: skip
