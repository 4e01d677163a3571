"""E6xx: what is made of results: comparisons, goldens, pictures of several runs."""

from __future__ import annotations

from lagsim.codes.row import Row

_RUN = "lagsim run pendulum.yaml -o {} --no-plots -q"

ROWS = (
    Row(
        "E601", "differs",
        "Two results are the same within their bounds.",
        "look at the column and the time that are named first: `--plot FILE` draws "
        "them; `lagsim golden --update` stores what is right now",
        commands=(
            _RUN.format("one"),
            _RUN.format("other --set m=2 --set l=1.01"),
            "lagsim compare one other",
        ),
        found="Two results differ by more than the bound.",
    ),
    Row(
        "E602", "bad-table",
        "A table has a header, a column `t`, and a number in each cell.",
        "give tables as `lagsim run` writes them, or their folders",
        commands=("lagsim compare pendulum.yaml pendulum.yaml",),
        found="A file is not a table of results.",
    ),
    Row(
        "E603", "no-golden",
        "A golden is stored before a model is compared with it.",
        "`lagsim golden --update` stores one",
        commands=("lagsim golden pendulum.yaml",),
        found="There is no golden of this model.",
    ),
    Row(
        "E604", "bad-golden",
        "A golden is a table and a record that belong together.",
        "`lagsim golden --update` stores it again",
        commands=(
            "lagsim golden pendulum.yaml --update -q",
            "printf {} > golden/pendulum.json",
            "lagsim golden pendulum.yaml",
        ),
        found="The files of a golden are damaged, or do not belong together.",
    ),
    Row(
        "E605", "incomplete",
        "A golden is stored from a complete run.",
        "correct what the message names, or shorten the duration",
        "coordinates: {r: {unit: m}}\ndefinitions: {}\n"
        "energy: {kinetic: r_dot^2/2, potential: -1/r}\n"
        "initial: {r: 1}\nsimulation: {duration: 2}\n",
        ("lagsim golden pendulum.yaml --update",),
        found="The run of a golden could not finish.",
    ),
    Row(
        "E606", "no-results",
        "A folder holds what `lagsim run` has written.",
        "`lagsim run MODEL -o FOLDER` makes such a folder",
        commands=("lagsim overlay nowhere",),
        found="A folder holds no results.",
    ),
    Row(
        "E607", "no-column",
        "A column that is drawn is in each of the tables.",
        "name columns that all of them have: --columns x",
        commands=(_RUN.format("one"), "lagsim overlay one one --columns speed"),
        found="A column to be drawn is missing in a table.",
    ),
    Row(
        "E608", "no-spectrum",
        "A spectrum needs rows at equal distances in time, with a number in each.",
        "a run with one `output_step` gives such rows",
        "simulation: {duration: 1, output_step: 0.5}\n",
        (_RUN.format("one"), "lagsim spectrum one theta"),
        found="A spectrum cannot be computed from this column.",
    ),
    Row(
        "E609", "not-json",
        "What is read is a document of `lagsim bench`, in JSON.",
        "give the file work_precision.json, or its folder",
        commands=("printf { > work_precision.json", "lagsim bench work_precision.json"),
        found="A file is not JSON.",
    ),
    Row(
        "E610", "not-a-bench",
        "The document is that of `lagsim bench`.",
        "run `lagsim bench` again",
        commands=(
            "printf {} > work_precision.json",
            "lagsim bench work_precision.json",
        ),
        found="A JSON document is not one of `lagsim bench`.",
    ),
    Row(
        "E611", "another-sweep",
        "`--resume` goes on with the same model, values and options.",
        "leave --resume out to start again, or choose another folder with -o",
        commands=(
            "mkdir found; echo [] > found/sweep.rows.jsonl",
            "lagsim sweep pendulum.yaml m=1,3 -o found -q --resume",
        ),
        found="The folder holds another sweep.",
    ),
    Row(
        "E612", "nothing-to-draw",
        "What is drawn has a section `scene`, or columns `x` and `y`.",
        "give the model a `scene`, or definitions `x` and `y`",
        "definitions: {}\n"
        "energy: {kinetic: m*l^2*theta_dot^2/2, potential: -m*g*l*cos(theta)}\n",
        (_RUN.format("one"), "lagsim overlay one one -o both.html"),
        found="The results have nothing to animate.",
    ),
    Row(
        "E613", "another-run",
        "`--resume` goes on with the same model and options, on the same machine.",
        "leave --resume out to start again, or choose another folder with -o",
        commands=(
            "mkdir out; echo kept > out/.lagsim-restart",
            "lagsim run pendulum.yaml -o out --resume",
        ),
        found="The folder holds another run.",
    ),
)  # fmt: skip
