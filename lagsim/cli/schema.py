"""`lagsim schema`: the JSON Schema of the model file, for editors."""

from __future__ import annotations

import json

from lagsim.cli._streams import say


def command() -> int:
    """Print the JSON Schema of model files, for editors."""
    from lagsim.methods import names
    from lagsim.model.schema import schema
    from lagsim.plan.formulation import formulations

    choices = {"method": ["auto", *names()], "formulation": formulations()}
    say(json.dumps(schema(choices), indent=2))
    return 0
