"""E4xx: methods and settings of a run."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E401", "unknown-method",
        "A method is one of those that `lagsim methods` lists, or `auto`.",
        "`lagsim methods` lists them",
        commands=("lagsim run pendulum.yaml --method rk5",),
        found="The method does not exist.",
    ),
    Row(
        "E402", "method-refused",
        "The method suits the model.",
        "`lagsim methods` lists what each handles; `auto` chooses one that suits",
        "forces: {theta: -theta_dot}\n",
        ("lagsim run pendulum.yaml --method kahan-li6 --step 0.01",),
        found="The method cannot integrate this model.",
    ),
    Row(
        "E403", "unknown-formulation",
        "A formulation is one of those that docs/model-file.md describes, or `auto`.",
        "leave it out: `auto` chooses one",
        "simulation: {duration: 1, formulation: exact}\n",
        found="The formulation does not exist.",
    ),
    Row(
        "E404", "formulation-refused",
        "The formulation suits the constraints of the model.",
        "`auto` chooses one that suits",
        "simulation: {duration: 1, formulation: elimination}\n"
        "constraints: {wall: {relation: theta >= 0, restitution: 0.5}}\n",
        ("lagsim run pendulum.yaml",),
        found="The formulation cannot be used with this model's constraints.",
    ),
    Row(
        "E405", "adaptive-method",
        "A stability limit is that of a method with a fixed step.",
        "use --vary to see how the work of this method changes with a parameter",
        commands=("lagsim stability pendulum.yaml --methods dop853",),
        found="A stability limit is asked for, and the method chooses its steps "
        "itself.",
    ),
    Row(
        "E406", "no-stability",
        "One set of equations holds for the whole run: no contacts, no friction, and "
        "no constraints that come and go.",
        "`lagsim bench` compares methods on such a model",
        "constraints: {wall: {relation: theta >= 0, restitution: 0.5}}\n",
        ("lagsim stability pendulum.yaml",),
        found="A stability map is asked for, and the model's equations change "
        "during the run.",
    ),
    Row(
        "E407", "too-many-rows",
        "A table has at most 10^8 rows.",
        "choose a longer `output_step`",
        "simulation: {duration: 1, output_step: 1e-12}\n",
        found="The table would have too many rows.",
    ),
    Row(
        "E408", "too-long",
        "The equations are derived within the limits of length and time.",
        "couple fewer terms; `derive --format python` uses the energies as written",
        """\
definitions:
  a: sin(theta) + cos(theta)
  b: sin(a)*a + cos(a)*a + a
  c: sin(b)*b + cos(b)*b + b
  d: sin(c)*c + cos(c)*c + c
  e: sin(d)*d + cos(d)*d + d
  f: sin(e)*e + cos(e)*e + e
  y: sin(f)*f + cos(f)*f + f
""",
        ("lagsim derive pendulum.yaml",),
        found="The equations are too long to be derived.",
    ),
    Row(
        "E409", "too-large",
        "The equations of a model of usual size take at most 3,000,000 operations, and "
        "a mass matrix has at most 1,000,000 entries that are not 0.",
        "put fewer velocities into one product or square of the energies",
        commands=(),
        found="The equations of the model are too large.",
    ),
)  # fmt: skip
