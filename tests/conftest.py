"""Fixtures of several folders, and the choice of the tests that are run.

Set in the environment:

LAGSIM_TEST_PATIENCE : 1; factor of the timeouts of all tests.
LAGSIM_TEST_COMMIT : unset; a commit, which changes the cases that are quick.
LAGSIM_TEST_SLICE : unset; `slow=4,nightly=100` runs one in four of the slow tests
    and one in a hundred of the nightly ones, others with each commit; `quick=3` one in
    three of the quick tests.
LAGSIM_TEST_CASES : unset; with `all` all cases of quick tests are quick, and a night
    has all of a test that is marked `nightly(one_in=3)`.
LAGSIM_TEST_SKIPS : unset; the run fails if more tests than this are skipped.
"""

import collections
import contextlib
import gc
import importlib
import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from lagsim.native.link import gradual
from lagsim.program import system
from lagsim.run.interrupt import heard
from tests.choosing import COMMIT, chosen, share, slices, tonight, turn
from tests.patience import PATIENCE

# No test is held to a time of the clock.
settings.register_profile(
    "lagsim", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("lagsim")


def pytest_configure(config):
    """Let a quick run link kernels as quick code, as `lagsim run` does first.

    Most of its tests take milliseconds, and to optimise the kernels of a test takes up
    to five seconds. Other runs test optimised code.
    """
    if config.option.markexpr == QUICK and not EVERY:
        system.GradualParts = QuickParts


class QuickParts(gradual.GradualParts):
    """Parts that stay linked as quick code, also in runs of seconds."""

    def __init__(self, parts, **_):
        super().__init__(parts, quick=True)

    def used(self, _seconds):
        return False


@pytest.fixture
def heeded_signals():
    """Handle SIGINT and SIGTERM as in a foreground job, however pytest was started.

    Under `trap '' INT`, or with `&` in a script, both pytest and its processes would
    ignore these signals. Signals that an earlier test raised are discarded.
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


# Of a test with this many cases or more one in QUICK_ONE_IN is quick, and at least one,
# others with each commit; the rest waits for the slow suite. Of two or three cases one
# is quick where each is a run of a model, or several.
MANY_CASES = 4
QUICK_ONE_IN = 40
ROOMS_OF_RUNS = (
    *("admissibility", "api", "cli", "invariance", "mechanics", "methods", "outputs"),
    *("program", "run", "scenes", "show", "studies"),
)
RUNS = tuple(f"tests/{room}/" for room in ROOMS_OF_RUNS)
# Not where a case takes a millisecond, and not the goldens and files that are derived:
# all of these are quick, but for cases that take longer.
ALL_CASES = (
    *(f"tests/{room}/" for room in ("codes", "golden", "language", "model", "native")),
    *("tests/mechanics/contact/", "tests/methods/order/", "tests/test_derived.py"),
    "tests/run/observers/test_energy_monitor.py",
    *(f"tests/methods/test_{one}.py" for one in ("implicit", "symplectic", "tableau")),
)
LONG_CASES = (
    "tests/golden/test_responses.py::test_the_golden_of_a_shipped_model",
    "tests/language/test_elements.py::test_equations_are_those_of_the_terms",
    "tests/language/test_elements.py::test_roundoff_is_bounded",
    "tests/language/test_elements.py::test_sizes_of_terms",
    "tests/language/test_smooth.py::test_a_motion_through_the_singularity",
    "tests/language/test_tables.py::test_enclosures_hold",
    "tests/language/test_tails.py::test_a_body_at_rest_far_out",
    "tests/methods/order/test_convergence.py",
    "tests/native/test_elementary.py::test_within_two_units",
    "tests/native/test_lanes.py",
    "tests/native/test_polynomials.py",
    "tests/native/test_series_code.py::test_coefficients",
)
EVERY = os.environ.get("LAGSIM_TEST_CASES", "") == "all"
SLICES = slices(os.environ.get("LAGSIM_TEST_SLICE", ""))
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
def pytest_collection(session):
    """Run the garbage collector rarely, and never on the collected tests."""
    gc.disable()
    try:
        if not session.config.args or session.config.args == ["tests"]:
            _import_from_the_end(session.config)
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000, 20, 20)
        gc.enable()


def _import_from_the_end(config):
    """Import all test modules in reverse order, in every second process of a run.

    Where no byte code is stored yet, each process then compiles half of the modules,
    and finds the other half stored. A module that fails to import fails again when it
    is collected.
    """
    number = (
        getattr(config, "workerinput", {}).get("workerid", "gw0").removeprefix("gw")
    )
    if int(number) % 2 == 0:
        return
    root = Path(__file__).parents[1]
    files = sorted(root.joinpath("tests").rglob("test_*.py"), reverse=True)
    for file in files:
        name = ".".join(file.relative_to(root).with_suffix("").parts)
        with contextlib.suppress(Exception, pytest.skip.Exception):
            importlib.import_module(name)


@pytest.hookimpl(wrapper=True)
def pytest_generate_tests(metafunc):
    """Mark the cases that wait for the slow suite; a quick run omits these.

    The first case of each test stays, so that its fixtures are resolved in any run.
    """
    result = yield
    cases, test = metafunc._calls, metafunc.definition
    long = "::test_shipped_" in test.nodeid or test.nodeid.startswith(LONG_CASES)
    whole = test.nodeid.startswith(ALL_CASES) and not long
    marked = {mark.name for mark in test.iter_markers()}
    # A nightly case stays out of the slow suite.
    free = [x for x in cases if not {*LATER} & (marked | {m.name for m in x.marks})]
    if free and not (EVERY or whole):
        for case in waiting(test.nodeid, free, many=len(cases) >= MANY_CASES):
            case.marks.append(pytest.mark.slow.mark)
    config = metafunc.config
    if config.option.markexpr == QUICK and not any("::" in x for x in config.args):
        quick = [
            x for x in cases if not {*LATER} & (marked | {m.name for m in x.marks})
        ]
        cases[:] = quick or cases[:1]
    return result


def waiting(test, cases, *, many):
    """Return the cases of a test that wait for the slow suite at this commit."""
    if many:
        names = [f"{test}[{case.id}]" for case in cases]
        quick = {*share(names, COMMIT, QUICK_ONE_IN)}
        return [x for x, name in zip(cases, names, strict=True) if name not in quick]
    if not test.startswith(RUNS):
        return []
    quick = turn(test, COMMIT, cases)
    return [case for case in cases if case is not quick]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    if missing := sorted(name for item in items for name in _missing(item)):
        raise pytest.UsageError("no such fixture: " + ", ".join(missing))
    for item in items:
        _have_patience(item, float(config.getini("timeout")))
    others = set() if EVERY else _for_other_nights(items)
    kept, gone = [], []
    for item in items:
        marks = {mark.name for mark in item.iter_markers()}
        has_turn = _in_the_slice(item.nodeid, marks) and item.nodeid not in others
        (kept if has_turn else gone).append(item)
    if gone:
        config.hook.pytest_deselected(items=gone)
        items[:] = kept


def _missing(item):
    """Return the fixtures of a test that do not exist, also of nightly tests."""
    given = {"request", *item._fixtureinfo.name2fixturedefs}
    return [f"{name} of {item.nodeid}" for name in {*item.fixturenames} - given]


def _in_the_slice(test, marks):
    """Return whether a test is in the slice of its kind; the rarer mark decides."""
    kind = next((mark for mark in reversed(LATER) if mark in marks), "quick")
    return chosen(test, f"slice {COMMIT}", SLICES.get(kind, 1))


def _for_other_nights(items):
    """Return the cases of nightly tests that wait for other commits.

    These are the cases of tests marked `nightly(one_in=3)`.
    """
    families = collections.defaultdict(list)
    if "nightly" not in SLICES:
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
    """Extend the timeout of a test by the factor of all; then print its stacks."""
    marker = item.get_closest_marker("timeout")
    if PATIENCE != 1.0:
        seconds = marker.args[0] if marker else usual
        item.add_marker(pytest.mark.timeout(PATIENCE * seconds), append=False)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    """Fail a run in which tests are skipped that are not permitted to be."""
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
