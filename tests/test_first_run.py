"""Independence of tests from other packages' warnings and from chance."""

import importlib.util
import sys
import warnings

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


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


def draw_examples():
    """Run a test with hypothesis; return its examples."""
    drawn = []

    @settings(max_examples=300)
    @given(st.integers(), st.floats())
    def collect(integer, number):
        drawn.append((integer, number))

    collect()
    return drawn


def test_examples_do_not_depend_on_earlier_imports(tmp_path, monkeypatch):
    before = draw_examples()
    file = tmp_path / "constants.py"
    file.write_text("\n".join(f"C{i} = {1_000_003 + i}, {i}.12345" for i in range(50)))
    spec = importlib.util.spec_from_file_location("constants", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(sys.modules, "constants", module)
    assert repr(draw_examples()) == repr(before)
