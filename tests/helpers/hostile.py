"""What holds for damaged files of each family: they are refused quickly, and nothing is started."""

import subprocess
import sys
from collections import Counter

import pytest

from tests.fuzz import files as fuzz


class DamagedFiles:
    """Tests over a fixture ``families``: an undamaged file by its name."""

    def test_every_family_opens_and_its_mutants_open_or_are_refused(self, families):
        outcomes = Counter()
        for name, path in families.items():
            assert fuzz.attempt(path) == "opened", name
            outcomes += fuzz.count_outcomes(7, families, name, 0, 12)
        assert set(outcomes) == {"opened", "refused"}

    def test_cut_files_are_refused_if_their_format_says_where_they_end(self, families):
        assert fuzz.open_cut_files(families, 8) == []

    @pytest.mark.thorough
    def test_opening_starts_no_process_and_writes_sends_and_imports_nothing(self, families):
        folder = next(iter(families.values())).parent
        code = [sys.executable, "-c", fuzz.AUDITED, str(folder)]
        done = subprocess.run(code, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == "[]"
