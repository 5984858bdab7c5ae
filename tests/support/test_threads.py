"""Loops in threads."""

import subprocess
import sys

CODE = """
import threading
from cspace._support.threads import map_in_threads

def work():
    threading.main_thread().join()
    print(map_in_threads(abs, [-1, -2], 2))

threading.Thread(target=work).start()
"""


def test_a_thread_that_outlives_the_program_goes_on():
    """Python joins it, but starts no more threads."""
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("[1, 2]\n", "")
