"""Independence of tests from other packages' warnings."""

import warnings

import pytest


def test_warnings_fail_a_test_in_our_code_alone():
    with warnings.catch_warnings(record=True):
        warnings.warn_explicit("of others", UserWarning, "file.py", 1, module="collada.scene")
    for module in ("cspace._grid", "planners.plan", "tests.test_robot"):
        with pytest.raises(RuntimeWarning):
            warnings.warn_explicit("of ours", RuntimeWarning, "file.py", 1, module=module)
