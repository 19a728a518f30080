"""Runs one program and measures it: wall time and peak memory of that process alone."""

import json
import os
import subprocess
import sys
import tempfile
import time


class ChildFailed(RuntimeError):
    """The program ended with an error."""


def run(command, on_line=None):
    """Runs `command`; `on_line(line, seconds_since_start)` sees each line of its standard output.

    Returns (wall seconds, peak resident bytes). Standard error goes to a temporary file and is shown on failure.
    """
    errors = tempfile.TemporaryFile()
    start = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, bufsize=1)
    for line in process.stdout:
        if on_line:
            on_line(line.rstrip("\n"), time.monotonic() - start)
    # wait4 gives this child's own peak, where RUSAGE_CHILDREN would give the largest of all children so far.
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.monotonic() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        errors.seek(0)
        tail = errors.read().decode(errors="replace")[-2000:]
        raise ChildFailed(f"{' '.join(command)} ended with {process.returncode}:\n{tail}")
    # Linux counts kibibytes.
    return wall, usage.ru_maxrss * 1024


def python(script, *arguments, on_line=None):
    """As `run`, for a script beside this one, in this interpreter."""
    here = os.path.dirname(os.path.abspath(__file__))
    return run([sys.executable, os.path.join(here, script), *map(str, arguments)], on_line)


def python_json(script, *arguments):
    """What a script prints as JSON on its last line.

    The driver itself must stay small: a child's peak starts at the size of the process that forked it, so NumPy and
    pycolmap are never loaded here.
    """
    lines = []
    python(script, *arguments, on_line=lambda line, _: lines.append(line))
    return json.loads(lines[-1])
