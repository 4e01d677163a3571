"""Runs as `lagsim run` judges them: their evidence, alarms, finding and error bar."""

from lagsim.model.reader import read
from lagsim.run.observers import Keep
from lagsim.run.observers.monitors import Checkpoints
from lagsim.run.session import Stopwatch, open_case
from lagsim.studies.attempts import Attempts, ErrorBars
from lagsim.studies.audit.alarms import alarms
from lagsim.studies.audit.evidence import Evidence
from lagsim.studies.audit.finding import audit
from lagsim.studies.repeats import Allowance


def evidence(found, bar="not estimated"):
    """Return the evidence of a finished run."""
    own = Evidence(found.session)
    own.add(found.rows)
    return own.end(found.trajectory, bar)


def cautions(found, bar="not estimated"):
    """Return the cautions of a finished run."""
    return alarms(evidence(found, bar))


def codes(found, bar="not estimated"):
    """Return the codes of the cautions, sorted, without repetition."""
    return sorted({caution.code for caution in cautions(found, bar)})


def doubt(found, bar="not estimated"):
    """Return the finding against a finished run, or None."""
    return audit(evidence(found, bar))


def made(model, values=None, **options):
    """Run a model, or a text; return its session, trajectory and checkpoints."""
    if isinstance(model, str):
        texts = ({k: str(x) for k, x in (d or {}).items()} for d in (values, options))
        model = read(model, "model.yaml", *texts)
    session = open_case(model).ready()
    checkpoints = Checkpoints(session.case.equations, session.case.settings)
    return session, session.run([checkpoints]), checkpoints


def repeated(session, trajectory, checkpoints, allowance=None, always=False):
    """Return the error bar of a run."""
    own = Evidence(session).end(trajectory, "none")
    own.checkpoints = checkpoints
    bars = ErrorBars.ALWAYS if always else ErrorBars.AUTO
    attempts = Attempts(Keep(), None, Stopwatch(), error_bars=bars)
    attempts.allowance = allowance or Allowance(session.system, trajectory)
    return attempts.repeated(own)


def barred(model, allowance=None, *, always=False, values=None, **options):
    """Run a model, or a text, and its repeat; return the checkpoints and the bar.

    `values` : of parameters; others are options of its simulation.
    """
    ran = made(model, values, **options)
    return ran[2], repeated(*ran, allowance, always=always)
