"""Command that compiles functions ahead of their use, by running small jobs."""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path

import typer

from cspace._cli.options import AS_JSON
from cspace._cli.report import Stopwatch, show


def compile_ahead(as_json: bool = AS_JSON) -> None:
    """Compile the functions for maps, plans and arms.

    Otherwise, each function is compiled at its first call. Run it while you make the image of a
    container, as the user of the container.
    """
    from cspace._cli.demo import write_inputs
    from cspace._cli.jobs import JOBS
    from cspace.inside import describe_code

    describe_code()  # raises an error before the work
    logger = logging.getLogger("cspace.compiling")
    level = logger.level
    logger.setLevel(logging.ERROR)  # users of this command expect a long wait
    clock = Stopwatch()
    try:
        with tempfile.TemporaryDirectory() as inputs:
            write_inputs(Path(inputs))
            for number, (name, job) in enumerate(JOBS.items()):
                with clock.step(name) as progress:
                    if progress is not None:
                        progress(number, len(JOBS))
                    elif not as_json:  # the log of a container's image
                        typer.echo(f"cspace: compiling: {name}", err=True)
                    str(job(Path(inputs)))  # printing a plan computes its proven distances
    finally:
        logger.setLevel(level)
    show({**describe_code(), "seconds": clock.seconds}, as_json)
