"""A plugin of pytest for the core alone: tests that need a wing or planners are skipped."""

import pytest


def find_missing(error):
    """Return the missing part of the product behind an error, or an empty text."""
    while error is not None:
        if isinstance(error, ModuleNotFoundError):
            name = str(error.name)
            return name if name.partition(".")[0] in ("cspace", "planners") else ""
        error = error.__cause__ or error.__context__
    return ""


def skip_if_missing(report, call, path):
    """Make a report that of a skipped test if a part of the product is missing."""
    missing = find_missing(call.excinfo.value) if call and call.excinfo else ""
    if missing:
        report.outcome = "skipped"
        report.longrepr = (str(path), 1, f"Skipped: needs {missing}")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    return skip_if_missing(report, call, item.path)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    report = yield
    return skip_if_missing(report, getattr(report, "call", None), collector.path)
