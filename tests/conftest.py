"""What tests of several folders share, and which of them are run.

Set in the environment:

LAGSIM_TEST_PATIENCE : 1; every timeout of a test is so many times longer.
LAGSIM_TEST_COMMIT : nothing; with one the cases that are quick change with it.
LAGSIM_TEST_SLICE : nothing; `slow=4,nightly=100` keeps one in four of the slow tests
    and one in a hundred of the nightly ones, others with each commit.
LAGSIM_TEST_CASES : nothing; with `all` all cases of quick tests are quick, and a night
    has all of a test that is marked `nightly(one_in=3)`.
LAGSIM_TEST_SKIPS : nothing; the run fails if more tests than this are skipped.
"""

import collections
import gc
import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from lagsim.run.interrupt import heard
from tests.choosing import COMMIT, chosen, share, slices, tonight
from tests.patience import PATIENCE

# No test is held to a time of the clock.
settings.register_profile("lagsim", deadline=None)
settings.load_profile("lagsim")


@pytest.fixture
def heeded_signals():
    """Heed SIGINT and SIGTERM as in a foreground job, whoever started pytest.

    Under `trap '' INT`, or with `&` in a script, both pytest and what it starts would
    ignore them. Signals that an earlier test raised are forgotten.
    """
    heard.clear()
    before = {
        kind: signal.signal(kind, heeded)
        for kind, heeded in (
            (signal.SIGINT, signal.default_int_handler),
            (signal.SIGTERM, signal.SIG_DFL),
        )
    }
    yield
    for kind, handler in before.items():
        signal.signal(kind, handler)


# Of a test with this many cases or more every tenth is quick, others with each commit;
# the rest waits for the slow suite.
MANY_CASES = 4
QUICK_ONE_IN = 10
# Not where a case takes a millisecond, and not the goldens and files that are derived:
# all of these are quick. A shipped model takes longer.
ALL_CASES = (
    *(f"tests/{room}/" for room in ("codes", "golden", "language", "model", "native")),
    "tests/test_derived.py",
)
EVERY = os.environ.get("LAGSIM_TEST_CASES", "") == "all"
# What is not run without being asked for; `QUICK` is in pyproject.toml.
LATER = ("slow", "nightly")
QUICK = "not slow and not nightly"


# What tests start shows where it is when `finished` ends it.
os.environ.setdefault("PYTHONFAULTHANDLER", "1")
# Byte code is kept in any case, and outside of the tree where none is wanted in it: to
# compile tests and lagsim takes nine seconds of each process that runs tests.
if sys.dont_write_bytecode:
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(Path(__file__).parents[1] / ".pytest_cache/bytecode")
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Search for garbage seldom, and never among what is collected."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000, 20, 20)
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_generate_tests(metafunc):
    """Mark the cases that wait for the slow suite; a quick run does without them.

    The first of each test stays, so that what it asks for is looked up in any run.
    """
    result = yield
    cases, test = metafunc._calls, metafunc.definition
    whole = test.nodeid.startswith(ALL_CASES) and "::test_shipped_" not in test.nodeid
    marked = {mark.name for mark in test.iter_markers()}
    if len(cases) >= MANY_CASES and not (EVERY or whole):
        for case in cases:
            # A nightly case stays out of the slow suite.
            if {*LATER} & (marked | {m.name for m in case.marks}):
                continue
            if not chosen(f"{test.nodeid}[{case.id}]", COMMIT, QUICK_ONE_IN):
                case.marks.append(pytest.mark.slow.mark)
    config = metafunc.config
    if config.option.markexpr == QUICK and not any("::" in x for x in config.args):
        quick = [
            x for x in cases if not {*LATER} & (marked | {m.name for m in x.marks})
        ]
        cases[:] = quick or cases[:1]
    return result


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    if missing := sorted(name for item in items for name in _missing(item)):
        raise pytest.UsageError("no such fixture: " + ", ".join(missing))
    for item in items:
        _have_patience(item, float(config.getini("timeout")))
    others = set() if EVERY else _for_other_nights(items)
    kept, gone = [], []
    for item in items:
        has_turn = _in_the_slice(item) and item.nodeid not in others
        (kept if has_turn else gone).append(item)
    if gone:
        config.hook.pytest_deselected(items=gone)
        items[:] = kept


def _missing(item):
    """Give what a test asks for and nobody gives: of slow and nightly tests, too."""
    given = {"request", *item._fixtureinfo.name2fixturedefs}
    return [f"{name} of {item.nodeid}" for name in {*item.fixturenames} - given]


def _in_the_slice(item):
    """Tell whether a slow or nightly test has its turn: the rarer mark decides."""
    one_in = slices(os.environ.get("LAGSIM_TEST_SLICE", ""))
    for mark in reversed(LATER):
        if item.get_closest_marker(mark):
            return chosen(item.nodeid, f"slice {COMMIT}", one_in.get(mark, 1))
    return True


def _for_other_nights(items):
    """Give cases of nightly tests that wait for other commits: `nightly(one_in=3)`."""
    families = collections.defaultdict(list)
    if "nightly" not in slices(os.environ.get("LAGSIM_TEST_SLICE", "")):
        for item in items:
            mark = item.get_closest_marker("nightly")
            if mark and "one_in" in mark.kwargs:
                family = item.nodeid.partition("[")[0], mark.kwargs["one_in"]
                families[family].append(item.nodeid)
    return {
        name
        for (_, one_in), names in families.items()
        for name in set(names).difference(share(names, tonight(), one_in))
    }


def _have_patience(item, usual):
    """Let a test take longer where all do; its stacks are printed when it is over."""
    marker = item.get_closest_marker("timeout")
    if PATIENCE != 1.0:
        seconds = marker.args[0] if marker else usual
        item.add_marker(pytest.mark.timeout(PATIENCE * seconds), append=False)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    """Fail a run whose tests are skipped although nothing says that they may be."""
    most = os.environ.get("LAGSIM_TEST_SKIPS")
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if not most or reporter is None or hasattr(session.config, "workerinput"):
        return
    skipped = reporter.stats.get("skipped", [])
    if len(skipped) > int(most) and exitstatus == pytest.ExitCode.OK:
        reporter.write_line(f"{len(skipped)} tests are skipped, {most} may be:")
        for report in skipped:
            reporter.write_line(f"  {report.nodeid}: {report.longrepr[-1]}")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
