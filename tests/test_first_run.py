"""Independence of tests from other packages' warnings."""

import warnings

import pytest


@pytest.mark.parametrize(
    ("category", "module"),
    [
        (UserWarning, "collada.scene"),
        (DeprecationWarning, "collada.scene"),
        (RuntimeWarning, "scipy.optimize"),
        (DeprecationWarning, "cspace.grid"),  # numpy warns so about calls in our code
        (FutureWarning, "planners.plan"),
    ],
)
def test_warnings_of_other_packages_fail_no_test(category, module):
    with warnings.catch_warnings(record=True) as caught:
        warnings.warn_explicit("a test of warnings", category, "file.py", 1, module=module)
    assert len(caught) == 1


@pytest.mark.parametrize("module", ["cspace.grid", "planners.plan", "tests.test_robot"])
@pytest.mark.parametrize("category", [UserWarning, RuntimeWarning])
def test_warnings_in_our_code_fail_a_test(category, module):
    with pytest.raises(category):
        warnings.warn_explicit("a test of warnings", category, "file.py", 1, module=module)
