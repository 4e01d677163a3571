"""What tests of several folders share, and which of them are run.

Set in the environment:

LAGSIM_TEST_PATIENCE : 1; every timeout of a test is so many times longer.
LAGSIM_TEST_COMMIT : nothing; with one the cases that are quick change with it.
LAGSIM_TEST_SLICE : nothing; `slow=4,nightly=100` keeps one in four of the slow tests
    and one in a hundred of the nightly ones, others with each commit.
LAGSIM_TEST_SKIPS : nothing; the run fails if more tests than this are skipped.
"""

from __future__ import annotations

import os
import signal

import pytest

from tests.choosing import COMMIT, chosen, slices
from tests.patience import PATIENCE


@pytest.fixture
def heeded_signals():
    """Heed SIGINT and SIGTERM as in a foreground job, whoever started pytest.

    Under `trap '' INT`, or with `&` in a script, both pytest and what it starts would
    ignore them.
    """
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


# Tests of many like cases (each shipped model, say) that take seconds in all: every
# fifth case is quick, the others wait for the slow suite.
MANY_LIKE_CASES = {
    "test_a_dead_zone_crossed_by_a_motion_that_diverges",
    "test_a_method_behaves_or_refuses",
    "test_a_run_in_plain_python_is_the_native_run",
    "test_accelerations_and_multipliers_at_reference_times",
    "test_accelerations_make_it_least_among_admissible_ones",
    "test_against_the_multipliers_of_explicit_constraints",
    "test_all_columns_agree",
    "test_ascii_is_ascii_and_lines_break",
    "test_constant_parts_give_the_same_motion",
    "test_constraint_forces_are_those_of_the_reduced_system",
    "test_coordinates_are_drawn_where_they_are",
    "test_deep_and_huge_input",
    "test_documents_by_value",
    "test_each_failing_scene_raises_its_alarm",
    "test_energy_minus_work_is_constant_in_every_model",
    "test_equations_of_unusual_expressions",
    "test_every_fixed_step_method_keeps_its_order_through_a_switch",
    "test_four_bars_pass_their_dead_points",
    "test_graph_gives_the_numbers_of_an_independent_derivation",
    "test_graph_with_fifty_digits",
    "test_json_read_again_gives_the_same_numbers",
    "test_kinked_potentials_from_all_sides",
    "test_latex_is_read_by_a_strict_reader",
    "test_motion_is_that_of_the_matrix",
    "test_native_motion_satisfies_the_equations",
    "test_no_change_is_missed_and_none_invented",
    "test_no_healthy_model_raises_any",
    "test_no_law_hangs_at_its_switch_wherever_that_is",
    "test_no_shipped_model_is_stiff",
    "test_order_of_rows_within_a_step",
    "test_order_of_whole_runs_with_a_fixed_step",
    "test_pieces_give_the_same_bits",
    "test_random_scenes_agree",
    "test_reference",
    "test_repair_is_the_nearest_state_in_the_metric_of_inertia",
    "test_rows_are_those_of_the_text_read_again",
    "test_shipped_models",
    "test_size_neither_hangs_nor_exhausts",
    "test_straight_and_dense_agree",
    "test_tapes_give_the_bits_of_compiled_code",
    "test_terms_add_up_to_the_equation",
    "test_the_default_tolerances_are_tight_enough",
    "test_the_wall_is_met_from_far",
    "test_units_do_not_matter",
    "test_verdicts_depend_on_neither_scale_nor_units",
    "test_whole_documents",
}
QUICK_ONE_IN = 5


# What tests start shows where it is when `finished` ends it.
os.environ.setdefault("PYTHONFAULTHANDLER", "1")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    for item in items:
        many = getattr(item, "originalname", "") in MANY_LIKE_CASES
        if many and not chosen(item.nodeid, COMMIT, QUICK_ONE_IN):
            item.add_marker(pytest.mark.slow)
        _have_patience(item, float(config.getini("timeout")))
    kept = [item for item in items if _in_the_slice(item)]
    gone = [item for item in items if not _in_the_slice(item)]
    if gone:
        config.hook.pytest_deselected(items=gone)
        items[:] = kept


def _in_the_slice(item):
    """Tell whether a slow or nightly test has its turn: the rarer mark decides."""
    one_in = slices(os.environ.get("LAGSIM_TEST_SLICE", ""))
    for mark in ("nightly", "slow"):
        if item.get_closest_marker(mark):
            return chosen(item.nodeid, f"slice {COMMIT}", one_in.get(mark, 1))
    return True


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
