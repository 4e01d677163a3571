"""`lagsim schema`: the JSON Schema of the model file, for editors."""

from __future__ import annotations

import json

from lagsim.cli._shared import write_stdout
from lagsim.methods import names
from lagsim.model.reader import schema
from lagsim.plan.formulation import formulations


def command() -> int:
    """Print the JSON Schema of model files, for editors."""
    write_stdout(lambda: print(document()))
    return 0


def document() -> str:
    """Return the text of the JSON Schema, with the names of methods and functions."""
    choices = {"method": ["auto", *names()], "formulation": formulations()}
    return json.dumps(schema(choices), indent=2)
