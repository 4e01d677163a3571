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
    ),
    Row(
        "E602", "bad-table",
        "A table has a header, a column `t`, and a number in each cell.",
        "give tables as `lagsim run` writes them, or their folders",
        commands=("lagsim compare pendulum.yaml pendulum.yaml",),
    ),
    Row(
        "E603", "no-golden",
        "A model has a golden before it is compared with it.",
        "`lagsim golden --update` stores one",
        commands=("lagsim golden pendulum.yaml",),
    ),
    Row(
        "E604", "bad-golden",
        "A golden is a table and a record that belong together.",
        "`lagsim golden --update` stores it anew",
        commands=(
            "lagsim golden pendulum.yaml --update -q",
            "printf {} > golden/pendulum.json",
            "lagsim golden pendulum.yaml",
        ),
    ),
    Row(
        "E605", "incomplete",
        "A golden is stored of a run that is complete.",
        "mend what the run says, or shorten its duration",
        "coordinates: {r: {unit: m}}\ndefinitions: {}\n"
        "energy: {kinetic: r_dot^2/2, potential: -1/r}\n"
        "initial: {r: 1}\nsimulation: {duration: 2}\n",
        ("lagsim golden pendulum.yaml --update",),
    ),
    Row(
        "E606", "no-results",
        "A folder holds what `lagsim run` has written.",
        "`lagsim run MODEL -o FOLDER` makes such a folder",
        commands=("lagsim overlay nowhere",),
    ),
    Row(
        "E607", "no-column",
        "A column that is drawn is in each of the tables.",
        "name columns that all of them have: --columns x",
        commands=(_RUN.format("one"), "lagsim overlay one one --columns speed"),
    ),
    Row(
        "E608", "no-spectrum",
        "A spectrum needs rows at equal distances in time, with a number in each.",
        "a run with one `output_step` gives such rows",
        "simulation: {duration: 1, output_step: 0.5}\n",
        (_RUN.format("one"), "lagsim spectrum one theta"),
    ),
    Row(
        "E609", "not-json",
        "What is read is a document of `lagsim bench`, in JSON.",
        "give the file work_precision.json, or its folder",
        commands=("printf { > work_precision.json", "lagsim bench work_precision.json"),
    ),
    Row(
        "E610", "not-a-bench",
        "The document is that of `lagsim bench`.",
        "run `lagsim bench` again",
        commands=(
            "printf {} > work_precision.json",
            "lagsim bench work_precision.json",
        ),
    ),
    Row(
        "E611", "another-sweep",
        "`--resume` goes on with the same model, values and options.",
        "leave --resume out to begin anew, or choose another folder with -o",
        commands=(
            "mkdir found; echo [] > found/sweep.rows.jsonl",
            "lagsim sweep pendulum.yaml m=1,3 -o found -q --resume",
        ),
    ),
    Row(
        "E612", "nothing-to-draw",
        "What is drawn has a scene, or columns `x` and `y`.",
        "give the model a `scene`, or definitions `x` and `y`",
        "definitions: {}\n"
        "energy: {kinetic: m*l^2*theta_dot^2/2, potential: -m*g*l*cos(theta)}\n",
        (_RUN.format("one"), "lagsim overlay one one -o both.html"),
    ),
    Row(
        "E613", "another-run",
        "`--resume` goes on with the same model and options, on the same machine.",
        "leave --resume out to begin anew, or choose another folder with -o",
        commands=(
            "mkdir out; echo kept > out/.lagsim-restart",
            "lagsim run pendulum.yaml -o out --resume",
        ),
    ),
)  # fmt: skip
