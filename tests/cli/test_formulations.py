"""Formulations on the command line: choices, refusals, entries of run.json."""

import json
from pathlib import Path

import pytest

from tests.cli._results import manifest
from tests.small_scenes import ON_THE_CURVE


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "formulation"),
    [
        ("auto", "elimination"), ("full", "projection"), ("projection", "projection"),
        ("elimination", "elimination"), ("baumgarte", "baumgarte"), ("drift", "drift"),
    ],
)  # fmt: skip
def test_run_json_has_the_formulation_and_its_reason(lagsim, write, name, formulation):
    options = ["--formulation", name, "--no-plots", "-o", "out"]
    lagsim("run", write(ON_THE_CURVE), *options, code=0)
    document = manifest("out")
    assert document["formulation"] == formulation
    reasons = {c["choice"]: c["reason"] for c in document["plan"]}
    assert reasons[f"formulation: {formulation}"]
    head = Path("out/trajectory.csv").read_text().split("\n", 1)[0]
    assert head == (
        "t,theta,u,theta_dot,u_dot,theta_ddot,u_ddot,x,y,kinetic,potential,energy,"
        "lambda_path,Qc_theta,Qc_u,residual_path"
    )


@pytest.mark.slow
def test_a_gain_is_told(lagsim, write):
    used = ["--formulation", "baumgarte", "--gain", "3", "--no-plots"]
    called = lagsim("run", write(ON_THE_CURVE), *used, code=0, err="")
    assert "gain 3 per unit of time" in called.out


def test_check_says_what_a_run_would_do(lagsim, write):
    called = lagsim("check", write(ON_THE_CURVE), "--json")
    plan = {c["choice"]: c["reason"] for c in json.loads(called.out)["plan"]}
    assert "u from path" in plan["formulation: elimination"]
    assert "formulation: elimination (u from path" in lagsim(
        "check", write(ON_THE_CURVE)
    ).out  # fmt: skip
