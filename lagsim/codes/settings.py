"""E4xx: how a model is to be run."""

from __future__ import annotations

from lagsim.codes.row import Row

ROWS = (
    Row(
        "E401", "unknown-method",
        "A method is one of those that `lagsim methods` lists, or `auto`.",
        "`lagsim methods` lists them",
        commands=("lagsim run pendulum.yaml --method rk5",),
    ),
    Row(
        "E402", "method-refused",
        "A method can handle what the model has.",
        "`lagsim methods` says what each handles; `auto` chooses one that can",
        "forces: {theta: -theta_dot}\n",
        ("lagsim run pendulum.yaml --method kahan-li6 --step 0.01",),
    ),
    Row(
        "E403", "unknown-formulation",
        "A formulation is one of those that docs/model-file.md describes, or `auto`.",
        "leave it out: `auto` chooses one",
        "simulation: {duration: 1, formulation: exact}\n",
    ),
    Row(
        "E404", "formulation-refused",
        "A formulation suits the constraints of the model.",
        "`auto` chooses one that can be had",
        "simulation: {duration: 1, formulation: elimination}\n"
        "constraints: {wall: {relation: theta >= 0, restitution: 0.5}}\n",
        ("lagsim run pendulum.yaml",),
    ),
    Row(
        "E405", "adaptive-method",
        "Borders of stability are those of methods with a fixed step.",
        "--vary shows how the work of the others changes with a parameter",
        commands=("lagsim stability pendulum.yaml --methods dop853",),
    ),
    Row(
        "E406", "no-stability",
        "Stability is looked at where the same equations hold all along.",
        "`lagsim bench` compares methods on such a scene",
        "constraints: {wall: {relation: theta >= 0, restitution: 0.5}}\n",
        ("lagsim stability pendulum.yaml",),
    ),
    Row(
        "E407", "too-many-rows",
        "A table has at most 10^8 rows.",
        "choose a longer `output_step`",
        "simulation: {duration: 1, output_step: 1e-12}\n",
    ),
    Row(
        "E408", "too-long",
        "Equations have a size that can be worked with, and are derived in time.",
        "fewer terms that couple; `derive --format python` takes energies as they are",
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
    ),
    Row(
        "E409", "too-large",
        "The equations of a model of usual size take at most 3,000,000 operations, and "
        "a mass matrix has at most 1,000,000 entries that are not 0.",
        "fewer velocities in one product or square of the energies couple less",
        commands=(),
    ),
)  # fmt: skip
