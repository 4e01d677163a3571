"""The alarms of a run, as `lagsim run` raises them."""

from __future__ import annotations

from lagsim.run.observers.ledger import Ledger
from lagsim.studies.alarms import Witness, alarms


def cautions(found, bar="not estimated"):
    """Give the cautions of a finished run."""
    names = found.system.columns.names
    ledger, witness = Ledger(names), Witness(names, len(found.equations.q))
    ledger.add(found.rows)
    witness.add(found.rows)
    return alarms(found.session, found.trajectory, ledger, witness, bar)


def codes(found, bar="not estimated"):
    """Give their codes, sorted, without repetition."""
    return sorted({caution.code for caution in cautions(found, bar)})
