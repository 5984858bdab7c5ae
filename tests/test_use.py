"""In use: the soak of saves, threads, processes and growth, for a few seconds."""

import subprocess
import sys
from pathlib import Path

CODE = """
import sys
sys.path.insert(0, "benchmarks/soak")  # without all the rest of the soak
import use
from benchmarks.report import Report

if __name__ == "__main__":
    report = Report(True)
    use.check(report, 0, 2, 0.01)
    raise SystemExit(len(report.failures))
"""


def test_saves_processes_threads_and_long_use(tmp_path: Path) -> None:
    script = tmp_path / "soak.py"
    script.write_text(CODE)
    code = f"import runpy; runpy.run_path({str(script)!r}, run_name='__main__')"
    root = Path(__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
